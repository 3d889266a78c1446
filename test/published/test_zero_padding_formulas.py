"""Backprojection of zero-padded profiles against its formula in plain NumPy."""

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.reference.project_points import half_paths
from sar_imaging.geometry.point_grids import PointGrid
from sar_imaging.published.zero_padding import (
    DELAYS,
    INTERPOLATORS,
    ZeroPaddingPlan,
    image_zero_padded,
    plan_zero_padding,
)
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

SEEDS = st.integers(0, 2 ** 32 - 1)


def formula(plan: ZeroPaddingPlan, block: PulseBlock) -> np.ndarray:
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


def pulses(rng, n_samples):
    """Profiles of noise around 100 m, sampled at 1.5 times their band."""
    radar = RadarParameters(10e9, 200e6, 300e6, 2 * 100.0 / 3e8)
    shape = rng.integers(1, 5), rng.integers(1, 4)
    samples = rng.standard_normal((*shape, n_samples, 2)).astype(np.float32).view(np.complex64)
    tx = rng.uniform(-3.0, 3.0, (*shape, 3))
    number = np.arange(shape[0])
    return PulseBlock(radar, True, number, number, samples[..., 0], tx,
                      tx + rng.normal(0, 0.1, tx.shape))


def places(rng, block, n):
    """Positions in, before and behind the profiles."""
    depth = block.n_samples * block.radar.sample_spacing_m
    way = rng.standard_normal((n, 3))
    r = block.radar.range_start_m + rng.uniform(-0.3, 1.3, n) * depth
    return r[:, None] * way / np.linalg.norm(way, axis=1)[:, None]


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, n=st.integers(1, 40), n_samples=st.integers(8, 60),
       interpolator=st.sampled_from(INTERPOLATORS), delay=st.sampled_from(DELAYS),
       ratio=st.integers(1, 9))
def test_images_are_their_formula(seed, n, n_samples, interpolator, delay, ratio):
    rng = np.random.default_rng(seed)
    block = pulses(rng, n_samples)
    points = np.concatenate([places(rng, block, n), block.tx_m[0, :1] + [[101.0, 0.0, 0.0]]])
    plan = plan_zero_padding(PointGrid(points), block.radar, n_samples, block.tx_m, block.rx_m,
                             interpolator=interpolator, ratio=ratio, delay=delay)
    found, wanted = image_zero_padded(plan, block), formula(plan, block)
    # single-precision transforms, and weights from a table
    scale = np.sqrt(np.sum(np.abs(block.samples) ** 2))
    assert np.abs(found - wanted).max() <= 1e-5 * scale
