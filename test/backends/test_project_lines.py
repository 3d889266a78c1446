# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines of an image against sums written out, with given polynomials and with profiles."""

import dataclasses

import numpy as np
from hypothesis import assume, given, settings, strategies as st

from sar_imaging.backends.cpu.lines import (
    PolarLines,
    _project_lines,
    line_middles,
    project_lines as add_lines,
)
from sar_imaging.backends.cpu.profiles import Profiles
from sar_imaging.backends.reference.project_lines import project_lines
from sar_imaging.geometry.half_paths import sample_paths
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.profiles import RangeGate, plan_resampling
from sar_imaging.signal import SPEED_OF_LIGHT, RadarParameters

DEGREE = 4


@dataclasses.dataclass
class GivenPolynomials:
    """Stands where `Profiles` does: (R, U, 2 (DEGREE + 1), n) float32 coefficients."""

    resampling: object
    coefficients: np.ndarray
    range_m: float
    cycles_per_step: float
    cycles: float
    n_together: int

    def chunks(self, n_echoes):
        return [slice(i, min(i + self.n_together, n_echoes))
                for i in range(0, n_echoes, self.n_together)]

    def planes(self, echoes):
        return self.coefficients[echoes]

    def range_at(self, cell):
        return self.range_m

    def cycles_at(self, cell):
        return self.cycles


@dataclasses.dataclass
class Spacing:
    segment: int
    n_phases: int
    step_m: float


def expected(profiles, start_m, pitch_m, ramp, centres_m):
    """Sum of ``P(t) exp(j 2 pi c)`` on one line through all phase centres, in float64.

    A segment keeps the interval of its middle; its pixels read on from cell to cell.
    """
    resampling, half = profiles.resampling, profiles.resampling.segment // 2
    u, step = resampling.n_phases, resampling.step_m
    i = np.arange(len(ramp))
    middle = i // resampling.segment * resampling.segment + half
    total = np.zeros(len(ramp), complex)
    for coefficients, centre_m in zip(profiles.coefficients, centres_m, strict=True):
        n = np.floor((start_m + pitch_m * middle - centre_m - profiles.range_m) / step)
        cell = np.floor((n + 0.5) / u)
        v = (start_m + pitch_m * i - centre_m - profiles.range_m) / step
        index = (resampling.segment + cell + i - middle).astype(int)
        inside = (index >= 0) & (index < coefficients.shape[-1])
        some = coefficients[(n - cell * u).astype(int), :, np.where(inside, index, 0)]
        t = v - n - u * (i - middle)
        powers = t[:, None] ** np.arange(DEGREE + 1)
        value = ((some[:, :DEGREE + 1] + 1j * some[:, DEGREE + 1:]) * powers).sum(axis=-1)
        cycles = profiles.cycles_per_step * (v - u * i) + profiles.cycles
        total += np.where(inside, value, 0.0) * np.exp(2j * np.pi * np.fmod(cycles, 1.0))
    return total * ramp


@settings(max_examples=30)
@given(seed=st.integers(0, 2 ** 32), n_echoes=st.integers(1, 5), n_lines=st.integers(1, 70),
       n_pixels=st.integers(1, 150), segment=st.sampled_from([8, 16, 32, 128]),
       n_phases=st.integers(1, 3), n_together=st.integers(1, 5),
       layout=st.sampled_from(['planes', 'rows', 'columns', 'reversed']))
def test_sums_of_given_polynomials(seed, n_echoes, n_lines, n_pixels, segment, n_phases,
                                   n_together, layout):
    """Lines that run away from the phase centres: paths are straight, nothing is expanded."""
    rng = np.random.default_rng(seed)
    n_cells = 2 * segment + int(rng.integers(1, 200))
    coefficients = rng.standard_normal((n_echoes, n_phases, 2 * DEGREE + 2, n_cells)) * np.tile(
        0.5 ** np.arange(DEGREE + 1), 2)[:, None]
    coefficients = coefficients.astype(np.float32)
    coefficients[..., :segment] = coefficients[..., -segment:] = 0.0
    step_m = rng.uniform(0.05, 0.2)
    profiles = GivenPolynomials(Spacing(segment, n_phases, step_m), coefficients,
                                rng.uniform(90.0, 110.0), 10 ** rng.uniform(-1.0, 3.3),
                                rng.uniform(-1, 1), n_together)
    # at most a step of drift over half a segment; some lines begin before or end after the cells
    pitch_m = step_m * (n_phases + rng.uniform(-1, 1) * 2 / segment)
    start_m = profiles.range_m + rng.uniform(-2, 2) * segment * pitch_m
    angle = rng.uniform(0, 2 * np.pi, n_lines)
    away = np.stack([np.cos(angle), np.sin(angle) * 0.8, np.sin(angle) * 0.6], axis=-1)
    # phase centres on the way back of one line, or all in the middle of several
    along = rng.uniform(-3.0, 3.0, (2, n_echoes)) * (n_lines == 1)
    tx, rx = along[..., None] * away[0]
    ramp = np.exp(2j * np.pi * rng.random(n_pixels)).astype(np.complex64)

    def locate(pixel, line):
        position = (start_m + pitch_m * pixel)[..., None] * away[line]
        zero = np.zeros_like(position)
        return position, zero + pitch_m * away[line], zero, zero, zero

    image = rng.standard_normal((n_lines, n_pixels)) + 1j * rng.standard_normal(
        (n_lines, n_pixels))
    image = image.astype(np.complex64)
    memory, numbers = {
        'planes': (np.concatenate([image.real.ravel(), image.imag.ravel()]),
                   [0, n_pixels, 1, image.size]),
        'rows': (image.view(np.float32).ravel().copy(), [0, 2 * n_pixels, 2, 1]),
        'columns': (image.T.copy().view(np.float32).ravel(),
                    [0, 2, 2 * n_lines, 1]),
        'reversed': (image[:, ::-1].copy().view(np.float32).ravel(),
                     [2 * n_pixels - 2, 2 * n_pixels, -2, 1])}[layout]
    lines = line_middles(locate, n_lines, n_pixels, segment)
    layers = [(lines, np.array([n_lines, *numbers]))]
    add_lines(profiles, np.arange(n_echoes), tx, rx, layers, ramp, memory)
    added = {'planes': lambda: (memory[:image.size] + 1j * memory[image.size:]
                                ).reshape(image.shape),
             'rows': lambda: memory.view(np.complex64).reshape(image.shape),
             'columns': lambda: memory.view(np.complex64).reshape(image.shape[::-1]).T,
             'reversed': lambda: memory.view(np.complex64).reshape(image.shape)[:, ::-1]}[layout]()
    wanted = image + expected(profiles, start_m, pitch_m, ramp, along.mean(axis=0))
    # Sine polynomials err by 4e-6; phases lie within some dozen cycles of the segment's middle,
    # whatever positions have, which float32 holds to 1e-6 of a cycle. 5e-6 measured.
    assert np.linalg.norm(added - wanted) <= 3e-5 * (np.linalg.norm(wanted)
                                                     + np.sqrt(wanted.size))


@settings(max_examples=30)
@given(seed=st.integers(0, 2 ** 32), n_echoes=st.integers(8, 70), n_alpha=st.integers(1, 40),
       n_range=st.integers(32, 120), padding=st.integers(0, 17), apart=st.booleans(),
       target_db=st.sampled_from([-50.0, -70.0, -90.0]), oversampling=st.sampled_from([1.3, 2.0]))
def test_polar_images_are_as_exact_as_predicted(seed, n_echoes, n_alpha, n_range, padding, apart,
                                                target_db, oversampling):
    """Noise in the band of profiles that reach far beyond the image, at any height and range."""
    rng = np.random.default_rng(seed)
    range_m, bandwidth_hz = 10 ** rng.uniform(2.3, 4.0), rng.uniform(1.0, 5.0) * 1e8
    resolution_m = SPEED_OF_LIGHT / 2 / bandwidth_hz
    n_samples = int(n_range * oversampling) + 200
    spacing_m = 0.6 * resolution_m
    start_m = range_m - resolution_m / oversampling * 100
    radar = RadarParameters(bandwidth_hz * rng.uniform(2.0, 60.0), bandwidth_hz,
                            bandwidth_hz * oversampling, 2 * start_m / SPEED_OF_LIGHT)
    height_m = rng.uniform(0.0, 0.5) * range_m
    tx = np.zeros((n_echoes, 3))
    tx[:, 0] = rng.uniform(-0.5, 0.5) + 0.001 * range_m * np.linspace(-1, 1, n_echoes)
    tx[:, 1] = rng.uniform(-2, 2, n_echoes) * resolution_m  # anywhere between samples
    tx[:, 2] = height_m
    rx = tx + (1e-4 * range_m * rng.standard_normal(3) if apart else 0.0)
    polar = PolarGrid((0.0, 0.0, height_m), (1.0, 0.0), 1, 0.0, range_m, spacing_m, n_range,
                      rng.uniform(-0.3, 0.2),
                      min(0.1 * radar.wavelength_m / (0.002 * range_m + 1.0), 0.01), n_alpha)
    lines = polar.lines(*(v.ravel() for v in np.meshgrid(
        np.linspace(*polar.range_m[[0, -1]], 5), np.linspace(*polar.alpha[[0, -1]], 5))))
    paths = sample_paths(tx, rx, lines)
    window = RangeGate.whole(radar, n_samples)
    resampling = plan_resampling(paths, spacing_m, n_range, radar, n_samples, target_db)
    assume(resampling is not None)
    # quiet at its ends: profiles that are cut off ring within the image where cells are coarser
    # than samples
    spectrum = rng.standard_normal((n_echoes, n_samples, 2)).view(complex)[..., 0]
    spectrum[:, np.abs(np.fft.fftfreq(n_samples)) > 0.5 / oversampling] = 0.0
    samples = (np.fft.ifft(spectrum) * np.hanning(n_samples) ** 2).astype(np.complex64)
    parts = np.zeros((2, n_alpha, n_range + padding), np.float32)
    limits = paths.length.min() - spacing_m, paths.length.max() + spacing_m
    PolarLines(polar, Profiles(window, resampling, limits)).add(samples, tx, rx, parts)
    image = (parts[0] + 1j * parts[1])[:, :n_range]
    wanted = project_lines(window, samples, resampling.n_padded, tx, rx, polar)
    error_db = 20 * np.log10(np.linalg.norm(image - wanted) / np.linalg.norm(wanted))
    # Predictions are means over places between samples, of which few echoes and lines have few:
    # at most 3.7 dB above in 1,900 images of 100 pixels and more, 7.1 dB in 1,900 of 32 to 40.
    assert error_db <= resampling.predicted_error_db + (5.0 if wanted.size >= 100 else 9.0)
    assert not parts[..., n_range:].any() or padding == 0


def test_read_only_positions_need_no_kernel_of_their_own(make_case):
    """Those of a message: the first pulses of a node would wait for the compiler."""
    case = make_case(1000.0, n=24, pulses=8)
    block = case.block
    imager = plan_image(case.grid, block.radar, block.n_samples, method='exact', backend='cpu')
    imager(block)
    known = _project_lines.signatures
    for centres in (block.tx_m, block.rx_m):
        centres.flags.writeable = False
    imager(block)
    assert known and _project_lines.signatures == known
