"""Upper bounds of the memory of each node, from the lengths of its queues and the image."""

from __future__ import annotations

import dataclasses

from ..memory import IMAGE_BYTES
from .settings import Imaging

# Interpreter, libraries and compiled kernels (measured; see docs/configuration.md).
BASE_BYTES = {'pulse_buffer': 170e6, 'range_compression': 340e6, 'backprojection': 340e6,
              'afbp_fusion': 340e6}
PRODUCT_BYTES = 13  # of a pixel in the messages: complex, amplitude and quicklook
PRODUCTS_KEPT = 6  # by the middleware (depth 5), and the one being serialised
POLAR_IMAGES = 2.5  # polar image and its interpolation, relative to the image
CALIBRATED_IMAGES = 1.5  # the image scaled, and its scale of 4 bytes a pixel
VOLUME_IMAGES = 3  # the volume, its magnitudes and what is sorted of them
SPECTRUM_IMAGES = 2.6  # fused spectrum and transforms, relative to the image (docs/benchmarks.md)


@dataclasses.dataclass(frozen=True)
class NodeMemory:
    """Bound of one node.

    Parameters
    ----------
    node : str
        Name of the executable.
    n_bytes : int
        When all its queues are full.
    formula : str
        Where the number comes from.
    """

    node: str
    n_bytes: int
    formula: str


def node_memory(imaging: Imaging, n_pixels: int, *, block_bytes: int, profile_block_bytes: int,
                pulse_bytes: int, aperture_bytes: int) -> tuple[NodeMemory, ...]:
    """Bounds of the nodes that the mode needs.

    Parameters
    ----------
    imaging : Imaging
        Settings of the nodes.
    n_pixels : int
        Pixels of the image or volume.
    block_bytes, profile_block_bytes : int
        Blocks of samples and of range profiles.
    pulse_bytes : int
        Samples of one pulse, all channels.
    aperture_bytes : int
        Range profiles of an aperture.

    Returns
    -------
    tuple of NodeMemory
    """
    q = imaging.queue_depth

    def waiting(n_bytes):
        """Most blocks in front of the worker."""
        return min(imaging.worker_queue_size,
                   max(1, int(1e6 * imaging.worker_queue_megabytes / n_bytes)))

    products = n_pixels * PRODUCT_BYTES * PRODUCTS_KEPT
    image = n_pixels * IMAGE_BYTES
    calibrated = 0 if imaging.radiometry_quantity == 'none' else CALIBRATED_IMAGES
    w, w_profiles = waiting(block_bytes), waiting(profile_block_bytes)
    sizes = {
        'pulse_buffer': ((q + w + q) * block_bytes
                         + imaging.reorder_window_pulses * pulse_bytes,
                         f'({q} + {w} + {q}) blocks + reorder window'),
        'range_compression': ((q + w) * block_bytes + q * profile_block_bytes,
                              f'({q} + {w}) blocks + {q} blocks of profiles'),
    }
    if imaging.mode == 'volume':
        images = VOLUME_IMAGES + calibrated
        sizes['backprojection'] = (
            (q + w_profiles) * profile_block_bytes + images * image,
            f'({q} + {w_profiles}) blocks of profiles + {images:g} x 8 B/cell')
    elif imaging.mode == 'image':
        kept = aperture_bytes if imaging.keeps_pulses else 0
        images = 1 + POLAR_IMAGES + (2 if imaging.autofocus else 0) + calibrated
        images += SPECTRUM_IMAGES if imaging.method != 'exact' else 0
        sizes['backprojection'] = (
            (q + w_profiles) * profile_block_bytes + kept + images * image + products,
            f'({q} + {w_profiles}) blocks of profiles'
            + (' + profiles of 1 aperture' if kept else '')
            + f' + {images:g} x 8 B/pixel + {PRODUCTS_KEPT} x {PRODUCT_BYTES} B/pixel')
    else:
        n = 2 if imaging.subaperture_sliding else 1
        sizes['backprojection'] = (
            (q + w_profiles) * profile_block_bytes + n * aperture_bytes + POLAR_IMAGES * image,
            f'({q} + {w_profiles}) blocks of profiles + profiles of {n} aperture(s) + '
            f'{POLAR_IMAGES:g} x 8 B/pixel')
        images = 1 + SPECTRUM_IMAGES + POLAR_IMAGES + calibrated
        sizes['afbp_fusion'] = (
            images * image + products,
            f'{images:g} x 8 B/pixel + {PRODUCTS_KEPT} x {PRODUCT_BYTES} B/pixel')
    return tuple(NodeMemory(node, round(BASE_BYTES[node] + n_bytes),
                            f'{BASE_BYTES[node] / 1e6:.0f} MB + {formula}')
                 for node, (n_bytes, formula) in sizes.items())
