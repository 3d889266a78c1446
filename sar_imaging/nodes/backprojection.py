"""Node backprojection: range profiles to an image of every aperture."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping

from sar_imaging.imaging.aperture import ApertureImage, ApertureImager
from sar_imaging.imaging.backprojection import compile_kernels
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.sequence import describe_counters

from . import image_products
from .health import Health, Part
from .image_grid import GRID_PARAMETERS, describe_grid, make_grid
from .image_products import ImageProducts
from .managed import ManagedNode, run
from .parameters import ANY_TIME, Parameter
from .stage import Stage
from .step import Step

PARAMETERS = (
    *GRID_PARAMETERS,
    Parameter('aperture_timeout_s', 5.0, 'An aperture is closed when no input came for this long, '
              'by the wall clock.', 's', 0.01, 3600.0, changes=ANY_TIME),
    Parameter('min_pulse_fraction', 0.5, 'Share of its pulses that an aperture must have to be '
              'imaged.', '', 0.0, 1.0, changes=ANY_TIME),
    Parameter('target_db', -80.0, 'Largest error against exact correlation to plan for.', 'dB',
              -100.0, -20.0),
    *image_products.PARAMETERS,
)


class BackprojectionStep(Step):
    """Range profiles to images; see `ApertureImager`."""

    NAME = 'backprojection'
    PARAMETERS = PARAMETERS
    COUNTERS = ('images_published', 'pulses_imaged', 'pulses_missing_in_last_aperture',
                'pulses_skipped', 'last_image_seconds', 'image_latency_seconds',
                'predicted_error_db')
    FAULTS = ('pulses_missing', 'pulses_late', 'pulses_duplicate', 'apertures_dropped',
              'restarts')
    IDLE_PARAMETER = 'aperture_timeout_s'
    FORMS_IMAGES = True

    def __init__(self, parameters: Mapping[str, object], health: Health | Part):
        super().__init__(parameters, health)
        self._grid = make_grid(parameters)
        self._imager = ApertureImager(
            self._grid, pulses_per_aperture=parameters['pulses_per_aperture'],
            min_pulse_fraction=parameters['min_pulse_fraction'],
            target_db=parameters['target_db'])
        self._seconds = 0.0  # of work since the last image
        self._dropped = False  # by the latest flush
        compile_kernels()  # the first image must not wait for it

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publishers of the images; see `Step`."""
        self._products = ImageProducts(node, self.parameters)

    def activate(self, node: ManagedNode) -> None:
        """Tell where the images will be; see `Step`."""
        self._products.announce(self._grid, node.get_clock().now().to_msg())

    def summary(self) -> str:
        """Settings for the log line at the start."""
        return (f' -> {self._products.topic}, {describe_grid(self._grid)} in frame '
                f'{self.parameters["frame_id"]}, '
                f'{self.parameters["pulses_per_aperture"]} pulses per aperture')

    def process(self, block: PulseBlock) -> list[ApertureImage]:
        """Add profiles to their aperture; returns the images that became complete."""
        return self._follow(self._imager.add, block)

    def flush(self) -> list[ApertureImage]:
        """Close the aperture: the input pauses, or somebody asks."""
        dropped = self._imager.statistics.apertures_dropped
        images = self._follow(self._imager.flush)
        self._dropped = self._imager.statistics.apertures_dropped > dropped
        return images

    def nothing_formed(self) -> str:
        """Why the latest `flush` gave nothing."""
        if self._dropped:
            return ('the aperture has fewer pulses than '
                    f'min_pulse_fraction={self.parameters["min_pulse_fraction"]:g} of it '
                    'and was dropped')
        return 'no aperture is being filled'

    def skip(self, aperture: int | None) -> list[ApertureImage]:
        """Leave out an aperture; see `Step`."""
        if aperture is not None and self._imager.filling == aperture:
            self.health.count('pulses_skipped', self.discard())
        return []

    def discard(self) -> int:
        """Forget the aperture being filled; returns the number of its pulses."""
        dropped = self._imager.reset()
        self.report(self._imager.take_events())
        self._seconds = 0.0
        return dropped

    def update_counters(self) -> None:
        """Take the imager's statistics over."""
        s = self._imager.statistics
        for key in ('imaged', 'late', 'duplicate'):
            self.health.set(f'pulses_{key}', getattr(s, key))
        self.health.set('apertures_dropped', s.apertures_dropped)
        self.health.set('restarts', s.restarts)

    def _follow(self, work, *arguments) -> list[ApertureImage]:
        self._imager.min_pulse_fraction = self.parameters['min_pulse_fraction']
        started = time.perf_counter()
        try:
            return work(*arguments)
        finally:
            self._seconds += time.perf_counter() - started
            self.report(self._imager.take_events())

    def publish(self, product: ApertureImage) -> None:
        """Publish an image on all its topics."""
        self._products.publish(product.image, product.grid, product.stamp_ns)
        seconds, self._seconds = self._seconds, 0.0
        self.health.count('images_published')
        self.health.count('pulses_missing', product.n_missing)
        self.health.set('pulses_missing_in_last_aperture', product.n_missing)
        self.health.set('last_image_seconds', seconds)
        self.health.set('image_latency_seconds', time.monotonic() - self.received_s)
        self.health.set('predicted_error_db', product.predicted_error_db)
        self.health.info(f'{self.describe(product)}; {seconds:.3g} s of work, predicted error '
                         f'{product.predicted_error_db:.0f} dB')

    def describe(self, product: ApertureImage) -> str:
        """An image in words."""
        missing = describe_counters(product.missing.tolist()) if product.n_missing else 'none'
        return (f'image of aperture {product.aperture}: {product.n_pulses} pulses, '
                f'missing {missing}')


class BackprojectionNode(Stage):
    """Publishes images from what comes on `range_profiles`."""

    NAME = 'backprojection'
    INPUT = 'range_profiles'
    STEPS = (BackprojectionStep,)


def main() -> int:
    """Run the node."""
    return run(BackprojectionNode)


if __name__ == '__main__':
    sys.exit(main())
