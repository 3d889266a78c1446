"""Zero-padded profiles read at pixels, Rosenberg & Gray, equations 13 to 19."""

from __future__ import annotations

import numpy as np

from ...planning.baselines.zero_padding import ZeroPaddingPlan
from ...signal.pulses import PulseBlock
from .project_points import half_paths


def image_zero_padded(plan: ZeroPaddingPlan, block: PulseBlock) -> np.ndarray:
    """Backproject zero-padded profiles.

    ``f(x) = sum_r s_r(tau_r(x)) exp(+j w_c tau_r(x))``, s_r read as the plan says.

    Parameters
    ----------
    plan : ZeroPaddingPlan
        What is computed.
    block : PulseBlock
        Its range profiles, with phase centres.

    Returns
    -------
    complex64 array
        Of the shape of the plan's grid.

    Examples
    --------
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.backends.reference import image_zero_padded
    >>> from sar_imaging.planning.baselines.zero_padding import plan_zero_padding
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(4))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 9, 9, 0.5)
    >>> plan = plan_zero_padding(grid, block.radar, block.n_samples, block.tx_m, block.rx_m)
    >>> image = image_zero_padded(plan, block)
    >>> print(f'{abs(image[4, 4]):.1f} of 4 pulses and 5 channels')
    20.0 of 4 pulses and 5 channels
    """
    radar, points = plan.radar, plan.grid.points()
    n, n_dense = plan.n_samples, plan.ratio * plan.n_samples
    image = np.zeros(points.shape[:-1], np.complex128)
    profiles = block.samples.reshape(-1, n).astype(np.complex128)
    number = np.fft.fftfreq(n, 1 / n).astype(int)
    for profile, a, b, tx, rx in zip(profiles, *plan.paths(block.tx_m, block.rx_m), strict=True):
        spectrum = np.zeros(n_dense, np.complex128)
        spectrum[number] = np.fft.fft(profile, norm='forward')                         # (14)
        dense = np.fft.ifft(spectrum, norm='forward')
        delay, exact = (2 * half_paths(*ends, points) / radar.propagation_speed_m_per_s
                        for ends in ((a, b), (tx, rx)))
        place = (delay - radar.first_sample_delay_s) * plan.rate_hz
        if plan.interpolator == 'nearest':
            cell = np.floor(place + 0.5).astype(int)                                   # (16)
            value = dense[cell % n_dense]
            turned = radar.first_sample_delay_s + cell / plan.rate_hz + (exact - delay)  # (15, 19)
        else:
            cell = np.floor(place).astype(int)
            weights = plan.weights((place - cell).ravel()).reshape(*place.shape, -1)
            taps = np.arange(weights.shape[-1]) + 1 - weights.shape[-1] // 2
            value = (weights * dense[(cell[..., None] + taps) % n_dense]).sum(axis=-1)
            turned = exact
        inside = (cell >= 0) & (cell < n_dense)
        cycles = np.fmod(radar.carrier_hz * turned, 1.0)
        image += inside * value * np.exp(2j * np.pi * cycles)                          # (17)
    return image.astype(np.complex64)
