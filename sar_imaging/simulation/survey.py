# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Surveys: many recordings of neighbouring patches of ground, each from a frame of its own.

A platform flies along y of the survey's frame and looks along +x at squares, one for each
aperture, and at nothing beside them. Neighbouring squares overlap. The frame of each recording
stands in the middle of what it sees, so that no two recordings have the same datum. The ground
is the same for all: reflectors at known places, and clutter, drawn cell by cell from the seed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from scipy import fft

from ..geometry.earth import Datum
from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters
from .echoes import quantise
from .noise import complex_gaussian
from .scenarios import Scenario, receive_array
from .scene import Clutter, Scatterer
from .trajectory import Trajectory

CARRIER_HZ = 10e9
GRAZING_RAD = math.pi / 4
PIXELS_PER_RESOLUTION = 2
BASELINE_M = (0.3, 0.0, 1.4)  # from one pass to the next, of sides of 200 m; less of shorter ones
_RANGE_SIDES = 5.0  # slant range, sides of the square
_SPEED_M_PER_S = 25.0
_NOISE_STD = 0.2  # of a sample before the filter of the receiver; the echo of a reflector is 1
_CLUTTER_AMPLITUDE = 0.05
_MARGIN_SAMPLES = 12  # of the profiles on both sides of the square
_BETWEEN_RECORDINGS_NS = 60 * 10**9
_BETWEEN_PASSES_NS = 24 * 3600 * 10**9


@dataclasses.dataclass(frozen=True)
class Survey:
    """A simulated survey of many recordings: lines of flight, ground and radar.

    Parameters
    ----------
    n_recordings : int
        Recordings, all passes together.
    apertures : int
        Number of apertures of each recording.
    lines : int
        Parallel lines of flight that a pass consists of.
    passes : int
        Times that the same ground is flown over, each a little higher.
    n_channels : int
        Number of channels of the radar.
    pixels : int
        Sides of an aperture's square, pixels.
    spacing_m : float
        Pixels, metres; the resolution is two of them.
    overlap : float
        Overlap of neighbouring squares, as a share of their sides, at least 0 and below 1.
    reflectors, clutter : int
        For each cell of the ground.
    datum : Datum
        Frame of the survey, in the middle of the first square.
    surface : str
        ``'plane'``: the ground is the plane z = 0 of the survey's frame; ``'ellipsoid'``: it is
        as high as the frame's origin everywhere.
    seed : int
        Seed of the ground and of the noise.

    Raises
    ------
    ValueError
        A number is out of range, or the recordings do not make whole passes and lines.

    Examples
    --------
    >>> from sar_imaging.simulation.survey import Survey
    >>> survey = Survey(n_recordings=4, lines=2, pixels=64)
    >>> [recording.name for recording in survey.recordings()]
    ['flight-0000', 'flight-0001', 'flight-0002', 'flight-0003']
    >>> print(f'squares of {survey.size_m:.0f} m, {survey.pulses_per_aperture} pulses for each')
    squares of 16 m, 32 pulses for each
    """

    n_recordings: int = 100
    apertures: int = 1
    lines: int = 1
    passes: int = 1
    n_channels: int = 1
    pixels: int = 160
    spacing_m: float = 0.25
    overlap: float = 0.2
    reflectors: int = 4
    clutter: int = 200
    datum: Datum = Datum(47.3, 8.5, 430.0)
    surface: str = 'plane'
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ('n_recordings', 'apertures', 'lines', 'passes', 'n_channels'):
            if getattr(self, name) < 1:
                raise ValueError(f'{name}={getattr(self, name)}; expected at least 1')
        if self.n_recordings % (self.lines * self.passes):
            raise ValueError(f'n_recordings={self.n_recordings} is no multiple of {self.passes} '
                             f'passes of {self.lines} lines')
        if self.pixels < 16:
            raise ValueError(f'pixels={self.pixels}; expected at least 16')
        if not (0 < self.spacing_m < 100):
            raise ValueError(f'spacing_m={self.spacing_m}; expected metres, more than 0')
        if not 0 <= self.overlap < 1:
            raise ValueError(f'overlap={self.overlap}; expected at least 0 and less than 1')
        if min(self.reflectors, self.clutter, self.seed) < 0:
            raise ValueError('reflectors, clutter and seed are not negative')
        if self.surface not in ('plane', 'ellipsoid'):
            raise ValueError(f'surface={self.surface!r}; expected plane or ellipsoid')
        if self.apertures > 1 and self.aperture_m > self.advance_m:
            raise ValueError(f'apertures of {self.aperture_m:.3g} m do not follow each other '
                             f'every {self.advance_m:.3g} m: choose a smaller overlap or a '
                             'larger spacing')

    @property
    def size_m(self) -> float:
        """Sides of an aperture's square, metres."""
        return self.pixels * self.spacing_m

    @property
    def advance_m(self) -> float:
        """From square to square, and sides of the cells of the ground, metres."""
        return self.size_m * (1 - self.overlap)

    @property
    def range_m(self) -> float:
        """Slant range of the middle of a square, metres."""
        return _RANGE_SIDES * self.size_m

    @property
    def aperture_m(self) -> float:
        """Length of an aperture, metres: its resolution is that of the pixels."""
        wavelength = SPEED_OF_LIGHT / CARRIER_HZ
        return wavelength * self.range_m / (2 * PIXELS_PER_RESOLUTION * self.spacing_m)

    @property
    def pulses_per_aperture(self) -> int:
        """Pulses whose scatterers repeat along the track after the side of a square."""
        step = SPEED_OF_LIGHT / CARRIER_HZ * self.range_m / (2 * self.size_m)
        return math.ceil(self.aperture_m / step)

    @property
    def radar(self) -> RadarParameters:
        """Of the range profiles; they begin where the nearest corner of a square lies."""
        bandwidth = SPEED_OF_LIGHT / (2 * PIXELS_PER_RESOLUTION * self.spacing_m
                                      * math.cos(GRAZING_RAD))
        rate = 4 / 3 * bandwidth
        near = self._extent_m[0] - _MARGIN_SAMPLES * SPEED_OF_LIGHT / (2 * rate)
        return RadarParameters(CARRIER_HZ, bandwidth, rate, 2 * near / SPEED_OF_LIGHT)

    @property
    def n_samples(self) -> int:
        """Of a range profile."""
        near, far = self._extent_m
        return math.ceil((far - near) / self.radar.sample_spacing_m) + 2 * _MARGIN_SAMPLES

    @property
    def n_bytes(self) -> int:
        """Of the samples of all recordings, bytes."""
        return (8 * self.n_recordings * self.apertures * self.pulses_per_aperture
                * self.n_channels * self.n_samples)

    @property
    def _extent_m(self) -> tuple[float, float]:
        """Smallest and largest range of a square from its aperture, and a little more, metres."""
        half, x = self.size_m / 2, self.range_m * math.cos(GRAZING_RAD)
        height = self.range_m * math.sin(GRAZING_RAD)
        rise = (self.passes - 1) * float(np.linalg.norm(self._baseline_m))
        slack = 0.01 * self.size_m + rise  # the Earth is round
        return (math.hypot(x - half, height) - slack,
                math.hypot(x + half, half + self.aperture_m / 2, height) + slack)

    @property
    def _baseline_m(self) -> np.ndarray:
        return np.array(BASELINE_M) * min(1.0, self.range_m / 1000.0)

    def recordings(self) -> Iterator[SurveyRecording]:
        """Its recordings, in the order of their times."""
        per_line = self.n_recordings // (self.lines * self.passes)
        for number in range(self.n_recordings):
            flown, place = divmod(number, self.lines * per_line)
            line, along = divmod(place, per_line)
            yield SurveyRecording(self, number, flown, line, along)

    def ground(self, points_m: np.ndarray) -> np.ndarray:
        """(N, 3) points of the ground at (N, 2) x and y of the survey's frame, metres."""
        points = np.column_stack([points_m, np.zeros(len(points_m))])
        if self.surface == 'plane':
            return points
        for _ in range(3):  # the normal through a place is hardly turned
            points[:, 2] -= self.datum.to_geographic(points)[2] - self.datum.height_m
        return points

    def cell(self, row: int, column: int) -> tuple[np.ndarray, np.ndarray]:
        """Reflectors (R, 3) and clutter (S, 3) of a cell of the ground, survey's frame, metres."""
        random = _uniform(self.seed, 2**40 + _number(row, column),
                          self.reflectors + self.clutter)
        corner = np.array([column, row]) * self.advance_m - self.size_m / 2
        points = self.ground(corner + random * self.advance_m)
        return points[:self.reflectors], points[self.reflectors:]

    def clutter_amplitudes(self, row: int, column: int) -> np.ndarray:
        """(S,) complex128 amplitudes of the clutter of a cell."""
        return _CLUTTER_AMPLITUDE * complex_gaussian(
            self.seed, 2**41 + _number(row, column), self.clutter)

    def reflectors_m(self) -> np.ndarray:
        """(N, 3) reflectors within at least one square, survey's frame, metres."""
        along = self.n_recordings // (self.lines * self.passes) * self.apertures
        cells = [self.cell(row, column)[0] for row in range(-1, along + 1)
                 for column in range(-1, self.lines + 1)]
        points = np.concatenate(cells)
        low = -self.size_m / 2
        high = np.array([self.lines - 1, along - 1]) * self.advance_m + self.size_m / 2
        return points[((points[:, :2] >= low) & (points[:, :2] < high)).all(axis=1)]


@dataclasses.dataclass(frozen=True)
class SurveyRecording:
    """One recording of a survey.

    Parameters
    ----------
    survey : Survey
        That it belongs to.
    number : int
        In the order of time.
    flown, line, along : int
        Pass, line of flight, and place along the line.
    """

    survey: Survey
    number: int
    flown: int
    line: int
    along: int

    @property
    def name(self) -> str:
        """Such as ``'flight-0012'``."""
        return f'flight-{self.number:04d}'

    @property
    def datum(self) -> Datum:
        """Of its frame, on the ground in the middle of its squares."""
        middles = self._middles_m()
        middle = self.survey.ground(middles.mean(axis=0, keepdims=True))
        latitude, longitude, height = self.survey.datum.to_geographic(middle)
        return Datum(float(latitude[0]), float(longitude[0]), float(height[0]))

    @property
    def grid(self) -> MapGrid:
        """The area of all its squares, in its frame."""
        survey = self.survey
        extra = (survey.apertures - 1) * survey.advance_m
        n_y = round((survey.size_m + extra) / survey.spacing_m)
        return MapGrid((0.0, 0.0, 0.0), survey.pixels, n_y, survey.spacing_m)

    def scenarios(self) -> list[Scenario]:
        """One for each aperture, in the recording's frame."""
        return [self._scenario(middle, number)
                for number, middle in enumerate(self._middles_m())]

    def reflectors(self) -> list[Scatterer]:
        """Those in its squares, in the recording's frame."""
        found = {s.name: s for middle in self._middles_m() for s in self._scene(middle)[0]}
        return list(found.values())

    def blocks(self, pulses_per_block: int) -> Iterator[PulseBlock]:
        """Its pulses, one aperture after the other."""
        survey, count = self.survey, self.survey.pulses_per_aperture
        start_ns = (self.number * _BETWEEN_RECORDINGS_NS + self.flown * _BETWEEN_PASSES_NS)
        for number, scenario in enumerate(self.scenarios()):
            late = start_ns + round(number * survey.advance_m / _SPEED_M_PER_S * 1e9)
            for block in scenario.blocks(pulses_per_block):
                yield dataclasses.replace(
                    block, stamp_ns=block.stamp_ns + late, counter=block.counter + number * count,
                    samples=quantise(block.samples + _noise(block, scenario.seed),
                                     scenario.resolution_bits, scenario.full_scale))

    def _middles_m(self) -> np.ndarray:
        """(A, 2) middles of its squares in the survey's frame, metres."""
        survey = self.survey
        rows = self.along * survey.apertures + np.arange(survey.apertures)
        return np.column_stack([np.full(len(rows), self.line), rows]) * survey.advance_m

    def _scene(self, middle: np.ndarray) -> tuple[list[Scatterer], Clutter]:
        """What lies in a square, in the recording's frame."""
        survey, half = self.survey, self.survey.size_m / 2
        reflectors, points, amplitudes = [], [], []
        # a square reaches into the cells of its neighbours
        row, column = (round(v / survey.advance_m) for v in middle[::-1])
        reach = math.ceil(half / survey.advance_m)
        for r in range(row - reach, row + reach + 1):
            for c in range(column - reach, column + reach + 1):
                bright, dim = survey.cell(r, c)
                reflectors += [(f'{r}_{c}_{i}', place) for i, place in enumerate(bright)]
                points.append(dim)
                amplitudes.append(survey.clutter_amplitudes(r, c))

        def inside(places: np.ndarray) -> np.ndarray:
            return (np.abs(places[:, :2] - middle) < half).all(axis=1)

        seen = [Scatterer(name, tuple(self._own(place[None])[0])) for name, place in reflectors
                if inside(place[None])[0]]
        places = np.concatenate(points)
        own = inside(places)
        return seen, Clutter(self._own(places[own]), np.concatenate(amplitudes)[own])

    def _own(self, points_m: np.ndarray) -> np.ndarray:
        """Points of the survey's frame in that of the recording."""
        return self.datum.from_ecef(self.survey.datum.to_ecef(points_m))

    def _scenario(self, middle: np.ndarray, number: int) -> Scenario:
        survey, radar = self.survey, self.survey.radar
        scatterers, clutter = self._scene(middle)
        place = self._own(survey.ground(middle[None]))[0]
        away = survey.range_m * np.array([-math.cos(GRAZING_RAD), 0.0, math.sin(GRAZING_RAD)])
        track = Trajectory(tuple(place + away + self.flown * survey._baseline_m),
                           (0.0, _SPEED_M_PER_S, 0.0))
        count = survey.pulses_per_aperture
        n = survey.n_channels
        return Scenario(
            name=self.name, description=f'Recording {self.number} of a survey', radar=radar,
            compressed=True, n_samples=survey.n_samples,
            prf_hz=_SPEED_M_PER_S * count / survey.aperture_m, n_pulses=count,
            pulses_per_aperture=count, trajectory=track, tx_offsets_m=((0.0, 0.0, 0.0),) * n,
            rx_offsets_m=receive_array(n, radar.wavelength_m / 2), scatterers=tuple(scatterers),
            clutter=clutter, grid=self.grid, cut_half_width_m=(8 * survey.spacing_m,) * 2,
            seed=survey.seed * 2**20 + self.number * 2**6 + number,
            resolution_bits=16, notes='Invented; looks along +x, flies along +y')


def _number(row: int, column: int) -> int:
    """A number of its own for each cell, not negative."""
    return (row + 2**19) * 2**20 + column + 2**19


def _noise(block: PulseBlock, seed: int) -> np.ndarray:
    """(P, C, N) complex128 noise as a receiver's filter leaves it: within the band alone."""
    shape, radar = block.samples.shape[1:], block.radar
    white = np.stack([complex_gaussian(seed, int(c), math.prod(shape)).reshape(shape)
                      for c in block.counter])
    spectrum = fft.fft(white, axis=-1)
    baseband_hz = fft.fftfreq(shape[-1], 1 / radar.sample_rate_hz)
    spectrum[..., np.abs(baseband_hz) > radar.bandwidth_hz / 2] = 0
    return _NOISE_STD * fft.ifft(spectrum, axis=-1)


def _uniform(seed: int, stream: int, n: int) -> np.ndarray:
    """(n, 2) float64 within 0 and 1, the same on every machine as `complex_gaussian` is."""
    power = np.abs(complex_gaussian(seed, stream, 2 * n)) ** 2
    return 1 - np.exp(-power.reshape(n, 2))  # its distribution function
