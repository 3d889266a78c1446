# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Backprojection of zero-padded profiles against its formula in plain NumPy."""

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.geometry.grids import PointGrid
from sar_imaging.published.zero_padding import (
    DELAYS,
    INTERPOLATORS,
    image_zero_padded,
    plan_zero_padding,
)
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

SEEDS = st.integers(0, 2 ** 32 - 1)


def neighbour_weights(interpolator, place, plan):
    """(..., T) weights of the samples 1 - T/2 to T/2 at places (...) from 0 to 1, written out."""
    taps = {'linear': 2, 'cubic': 4, 'sinc': 8}[interpolator]
    nodes = np.arange(taps) + 1 - taps // 2
    if interpolator == 'sinc':  # Kaiser's window, to half way between band and repetition
        away = place[..., None] - nodes
        free = 0.5 - plan.radar.bandwidth_hz / plan.radar.sample_rate_hz / plan.ratio / 2
        beta = np.pi * np.sqrt(max((taps * free) ** 2 - 1, 0.0))
        root = np.sqrt(np.maximum(1 - (2 * away / taps) ** 2, 0.0))
        return np.sinc(away) * np.i0(beta * root) / np.i0(beta)
    return np.stack([np.prod([(place - m) / (n - m) for m in nodes if m != n], axis=0)
                     for n in nodes], axis=-1)  # Lagrange


def formula(plan, block):
    """``f(x) = sum_r s_r(tau_r(x)) exp(+j w_c tau_r(x))``, s_r read as the plan says."""
    radar, points = plan.radar, plan.grid.points()
    n, n_dense = plan.n_samples, plan.ratio * plan.n_samples
    rate_hz = plan.ratio * radar.sample_rate_hz
    image = np.zeros(points.shape[:-1], np.complex128)
    number = np.fft.fftfreq(n, 1 / n).astype(int)
    for index in np.ndindex(block.samples.shape[:2]):
        ends = read_ends = block.tx_m[index], block.rx_m[index]
        if plan.delay == 'midpoint':
            ends = read_ends = (0.5 * (ends[0] + ends[1]),) * 2
        if plan.delay == 'steering':  # the mean of all antennas of the pulse
            read_ends = (0.5 * (block.tx_m[index[0]] + block.rx_m[index[0]]).mean(axis=0),) * 2
        spectrum = np.zeros(n_dense, np.complex128)
        spectrum[number] = np.fft.fft(block.samples[index].astype(complex), norm='forward')  # (14)
        dense = np.fft.ifft(spectrum, norm='forward')
        delay, exact = (sum(np.linalg.norm(points - e, axis=-1) for e in both)
                        / radar.propagation_speed_m_per_s for both in (read_ends, ends))
        place = (delay - radar.first_sample_delay_s) * rate_hz
        if plan.interpolator == 'nearest':
            cell = np.floor(place + 0.5).astype(int)                                   # (16)
            value = dense[cell % n_dense]
            phase_s = radar.first_sample_delay_s + cell / rate_hz + (exact - delay)    # (15, 19)
        else:
            cell = np.floor(place).astype(int)
            weights = neighbour_weights(plan.interpolator, place - cell, plan)
            taps = np.arange(weights.shape[-1]) + 1 - weights.shape[-1] // 2
            value = (weights * dense[(cell[..., None] + taps) % n_dense]).sum(axis=-1)
            phase_s = exact
        inside = (cell >= 0) & (cell < n_dense)
        cycles = np.fmod(radar.carrier_hz * phase_s, 1.0)
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
