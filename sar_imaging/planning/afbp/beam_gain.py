"""By what echoes are multiplied before they are summed to beams that few taps interpolate.

Seen from beam to beam an echo is an exponential, whose frequency is the derivative of its path by
the number of the beam times the wavenumber; what the interpolation takes from that frequency the
echo gets beforehand. Frequencies, and with them gains, differ a little over a group of beams and
over a run of bins, which share one: the errors of that are known from the geometry.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from ..interpolators import Interpolator, design_interpolator

BEAM_TAPS, DEGREE = 6, 5  # neighbours between beams, and degree of the polynomials
STEP_BINS = 16  # over which phases of the beams of a group are taken to grow alike
_POINTS = 2048  # of the table: reading it linearly adds 1e-5
_NODES = 8  # between two beams
_BEYOND = 1.15  # times the band: what lies there should not meet a kink
_RUN_SHARE = 0.02  # of the carrier frequency, over which gains are taken to grow alike
_LEAST_RUNS = 16  # of bins; not by the number of threads, so that results do not depend on it


@dataclasses.dataclass(frozen=True, eq=False)
class BeamGain:
    """Gain of echoes by their frequency from beam to beam.

    Attributes
    ----------
    interpolator : Interpolator
        Between beams.
    step : float
        Of the table, cycles per beam.
    log_gain : (N,) float64
        Natural logarithm of the gain by the magnitude of the frequency, from 0.
    power : (N,) float64
        What interpolation leaves of frequencies over one cycle per beam.
    """

    interpolator: Interpolator
    step: float
    log_gain: np.ndarray
    power: np.ndarray

    def at(self, frequency, table) -> np.ndarray:
        """Values for some frequencies from a table that goes with that of the gain."""
        return np.interp(np.abs(frequency), self.frequencies, table)

    @functools.cached_property
    def frequencies(self) -> np.ndarray:
        """(N,) float64 frequencies of the tables, cycles per beam."""
        return self.step * np.arange(_POINTS)

    @functools.cached_property
    def derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivative of the logarithm by frequency."""
        first = np.gradient(self.log_gain, self.step)
        return first, np.gradient(first, self.step)


@functools.lru_cache(maxsize=512)
def _repeated(between: BeamGain, group: int) -> np.ndarray:
    """Table of how much errors grow that rise over groups of so many beams and start again.

    They come in at other frequencies, from which interpolation takes less.
    """
    if group == 1:
        return np.zeros(_POINTS)
    harmonic = np.arange(1, group)
    share = 1 / np.sin(np.pi * harmonic / group) ** 2
    place = (between.frequencies[:, None] + harmonic / group) * _POINTS
    power = between.power[place.round().astype(int) % _POINTS]
    return np.exp(between.log_gain) * np.sqrt(power @ share / share.sum())


def shared_errors(between: BeamGain, radians, chirp, uneven: float, relative, groups):
    """Rms errors of what neighbouring beams, bins and echoes share.

    From beam to beam an echo is ``exp(j phi(m))`` of frequency ``f = phi' / (2 pi)``, and is to be
    multiplied by the gain g(f). Relative to the echo, and with ``l = log g``:

    - f changes from beam to beam: ``g(d/dm)`` of a chirp is more than g times it by
      ``(g'' / g) phi'' / (8 pi^2)``, and ``g'' / g = l'' + l'^2``;
    - over a run of bins, r wide relative to the carrier, l is a straight line through two Gaussian
      points: the parabola ``l'' (f r)^2 / 2`` leaves ``1 / sqrt(180)`` of itself (rms);
    - m beams from the middle of a group of G, the gain is off by ``l' phi'' m / (2 pi)`` and the
      phase, which is held over a vector of bins v wide, by ``phi' v m / sqrt(12)``; m is
      ``sqrt((G^2 - 1) / 12)`` (rms). Half the phase's bend, ``phi'' m^2 / 2``, leaves
      ``sqrt((G^2 - 1) (G^2 - 4) / 180)`` beside a pair's common part;
    - echoes that share phasors are off by `uneven` times m.

    Errors of a group start again with the next one: interpolation lets a part of them through.

    Parameters
    ----------
    between, groups : BeamGain, sequence of G int
        Of the beams, and numbers of beams to a group.
    radians, chirp : (V, R, D) float64
        Of R echoes of V sub-apertures in D directions: phase from beam to beam, and how it grows.
    uneven : float
        Phase from beam to beam by which echoes that share phasors are not opposite, rad.
    relative : (float, float)
        Width of a run of bins, whose gains grow alike, and of a vector of bins, over which phases
        of the beams of a group do, relative to the carrier.

    Returns
    -------
    always : (2,) float64
        With any group: of frequencies that change from beam to beam, of gains over a run.
    grouped : (G, 2) float64
        Of gains and phases that grow over a group, and of phases that bend over it.
    paired : (G,) float64
        Of echoes that share phasors with opposite ones.
    """
    frequency = radians / (2 * math.pi)
    first, second = (between.at(frequency, v) for v in between.derivatives)
    # The kernel takes frequencies as held; gains run straight through two Gaussian points.
    always = rms_of_echoes(np.stack([(second + first ** 2) * chirp / (8 * math.pi ** 2),
                                   second * (frequency * relative[0]) ** 2 / 2 / math.sqrt(180)]))
    rising = np.hypot(first * chirp / (2 * math.pi), radians * relative[1] / math.sqrt(12))
    grown = np.stack([between.at(frequency, _repeated(between, group)) for group in groups])
    squared = np.square(groups)
    beside = np.sqrt((squared - 1) / 12)  # rms distance from the middle of a group
    squares = np.sqrt((squared - 1) * np.maximum(squared - 4, 0) / 180)
    return (always, np.stack([rms_of_echoes(rising * grown) * beside,
                              rms_of_echoes(chirp / 2 * grown) * squares], axis=1),
            rms_of_echoes(grown) * uneven * beside)


def rms_of_echoes(errors) -> np.ndarray:
    """Rms over echoes of the largest of errors (..., V, R, D) anywhere; of V the worst."""
    return np.sqrt((np.abs(errors).max(axis=-1) ** 2).mean(axis=-1)).max(axis=-1)


@functools.lru_cache(maxsize=64)
def beam_gain(oversampling: float, deapodised: bool) -> BeamGain:
    """Gain and interpolator for beams that lie so much closer than needed.

    Frequencies that change from beam to beam do best with gains of 1, which not being `deapodised`
    means.
    """
    interpolator = design_interpolator(oversampling, taps=BEAM_TAPS, degree=DEGREE,
                                       deapodised=deapodised)
    step = min(0.5, _BEYOND * 0.5 / interpolator.oversampling) / (_POINTS - 1)
    log_gain = np.zeros(_POINTS)
    if deapodised:
        log_gain = np.log(interpolator.gain(step * np.arange(_POINTS)))
    return BeamGain(interpolator, step, log_gain, _power(interpolator))


def _power(interpolator: Interpolator) -> np.ndarray:
    x, weight = np.polynomial.legendre.leggauss(_NODES)
    by_position = (0.5 + 0.5 * x)[:, None] ** np.arange(DEGREE + 1) @ interpolator.weights
    return 0.5 * weight @ np.abs(np.fft.fft(by_position, _POINTS)) ** 2


def bins_per_run(n_bins: int, relative_bandwidth: float) -> int:
    """Of all bins of a spectrum, those over which gains grow alike, in whole vectors.

    `relative_bandwidth` is that of all bins over the carrier frequency.
    """
    n_runs = max(_LEAST_RUNS, math.ceil(relative_bandwidth / _RUN_SHARE))
    return max(-(-n_bins // n_runs // STEP_BINS), 1) * STEP_BINS

