# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Beams of random echoes against sums written out."""

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cpu.beams import SpectrumBins, form_beams
from sar_imaging.backends.cpu.memory import WorkSpace
from sar_imaging.backends.reference.form_beams import form_beams as beams_of
from sar_imaging.planning.afbp.beams import STEP_BINS, beam_gain, bins_per_run, shared_errors


def formed(spectra, path_m, cycles, between, *, zero, n_cells, weights, group, paired, rng,
           longest=None):
    """Compiled and expected beams by bin of the spectrum of cells; which bins echoes have."""
    n_bins = spectra.shape[1]
    common = np.exp(2j * np.pi * rng.random(n_bins)) * rng.uniform(0.5, 1.5, n_bins)
    if longest is None:
        longest = bins_per_run(n_bins, n_bins * cycles[1] / cycles[0])
    beams = np.full((len(path_m), n_cells + 7), np.nan, np.complex64)
    form_beams(spectra, path_m, SpectrumBins.of(common, cycles, zero, n_cells, longest), between,
               weights, group, paired, beams, WorkSpace())
    number = (np.arange(n_bins) - zero + n_bins // 2) % n_bins - n_bins // 2
    wanted = beams_of(spectra.astype(complex) * common * (
        1.0 if weights is None else weights[:, None]), path_m, cycles[0] + number * cycles[1],
        between)
    kept = (number >= -(n_cells // 2)) & (number < (n_cells + 1) // 2)
    whole = np.zeros((len(path_m), n_cells), complex)
    whole[:, number[kept] % n_cells] = wanted[:, kept]
    assert np.isnan(beams[:, n_cells:]).all()
    return beams[:, :n_cells], whole


def noise(rng, *shape):
    return rng.standard_normal((*shape, 2)).astype(np.float32).view(np.complex64)[..., 0]


@settings(max_examples=30)
@given(seed=st.integers(0, 2 ** 32), n_echoes=st.integers(1, 23), n_beams=st.integers(2, 40),
       n_bins=st.integers(1, 300), n_cells=st.integers(1, 320), weighted=st.booleans(),
       history=st.booleans())
def test_beams_that_share_nothing(seed, n_echoes, n_beams, n_bins, n_cells, weighted, history):
    """Each beam a group of its own, and no gain: only phases are left to err."""
    rng = np.random.default_rng(seed)
    cycles = np.array([60.0, rng.uniform(1e-3, 0.05)])
    path_m = rng.uniform(-0.3, 0.3, (n_beams, n_echoes))
    weights = rng.uniform(0, 2, n_echoes).astype(np.float32) if weighted else None
    beams, wanted = formed(noise(rng, n_echoes, n_bins), path_m, cycles, beam_gain(3.0, False),
                           zero=n_bins // 2 if history else 0, n_cells=n_cells, weights=weights,
                           group=1, paired=False, rng=rng)
    # Phasors turn on from vector to vector of bins in float32: -93 dB measured at most.
    assert np.linalg.norm(beams - wanted) <= 10 ** -4.3 * np.linalg.norm(wanted) + 1e-9


@settings(max_examples=30)
@given(seed=st.integers(0, 2 ** 32), n_echoes=st.integers(2, 40), n_beams=st.integers(8, 40),
       n_bins=st.integers(64, 300), group=st.sampled_from([1, 2, 4, 6, 10, 18]),
       paired=st.booleans(), oversampling=st.sampled_from([1.2, 1.5, 2.0]))
def test_beams_that_share_phases_err_as_predicted(seed, n_echoes, n_beams, n_bins, group, paired,
                                                  oversampling):
    """Echoes of a track seen by direction, with gains; paths bend; echoes are not quite paired."""
    rng = np.random.default_rng(seed)
    between = beam_gain(oversampling, True)
    cycles = np.array([60.0, rng.uniform(1e-3, 1e-2)])
    highest = cycles[0] + n_bins / 2 * cycles[1]
    # growth of a path from beam to beam: within the band of the interpolator
    slope = np.linspace(-1, 1, n_echoes) * 0.5 / oversampling / highest
    slope += 1e-3 * rng.standard_normal(n_echoes) * slope[-1]
    bend = 3e-3 * slope * rng.uniform(-1, 1)
    beam = np.arange(n_beams) - n_beams / 2
    path_m = np.multiply.outer(beam, slope) + np.multiply.outer(beam ** 2, bend / n_beams)
    slopes = slope + np.multiply.outer(beam, 2 * bend / n_beams)
    beams, wanted = formed(noise(rng, n_echoes, n_bins), path_m, cycles, between, zero=0,
                           n_cells=n_bins, weights=None, group=group, paired=paired, rng=rng)
    opposite = np.sort(slopes, axis=1)
    uneven = np.abs(opposite + opposite[:, ::-1]).max() / 2
    longest = bins_per_run(n_bins, n_bins * cycles[1] / cycles[0])
    k = 2 * np.pi * cycles[0]
    always, grouped, shared = shared_errors(
        [between], k * slopes.T[None, None], k * np.broadcast_to(
            2 * bend[:, None] / n_beams, slopes.T.shape)[None, None], [k * uneven],
        [n * cycles[1] / cycles[0] for n in (longest, STEP_BINS)], [group])
    errors = np.concatenate([always[0], grouped[0, 0], shared[0] * paired])
    error = np.linalg.norm(beams - wanted) / np.linalg.norm(wanted)
    # Predicted as seen after interpolation, which takes up to a third of a frequency; gains of
    # the formula are central differences of the path. Float32 phasors add -80 dB.
    assert error <= 3.0 * np.linalg.norm(errors) + 2e-4
