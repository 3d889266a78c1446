# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images that are pinned while the imaging core is rebuilt: geometries and how they are formed.

Radars on tracks from 100 m to 50 km, of 1 and 5 channels, straight, curved, squinted and
climbing, over planes, terrain and points, whole and while the pulses arrive. Everything follows
from the case: no random number is drawn by a generator that may change.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import scipy.fft

from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters, Waveform
from sar_imaging.simulation.echoes import scene_spectrum, two_way_delays
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures

_CARRIER_HZ, _OVERSAMPLING = 10e9, 1.4
_N_SCATTERERS = 40
_BLOCK_PULSES = 16  # of live images


@dataclasses.dataclass(frozen=True)
class GoldenImage:
    """What is pinned of an image.

    Attributes
    ----------
    image : (...) complex64
        Samples.
    predicted_error_db : float or None
        As the imager predicts it.
    plan : str
        Method, sizes and cut.
    """

    image: np.ndarray
    predicted_error_db: float | None
    plan: str


@dataclasses.dataclass(frozen=True)
class GoldenCase:
    """One radar, track and map, and the imager that is pinned on them.

    Attributes
    ----------
    imager : callable
        ``imager(case, block) -> (plan, form)``: `plan()` plans anew and returns what `form(plan)`
        makes a `GoldenImage` of.
    range_m, height_m : float
        From the middle of the track to that of the map, and above the map, metres.
    n_side, n_pulses, n_channels : int
        Pixels of a side, pulses, channels.
    spacing_m : float
        Of the pixels, metres; half of the resolution.
    track : str
        One of `TRACKS`.
    heading_rad : float
        By which radar and map are turned about the vertical.
    stepped : bool
        Phase histories instead of profiles.
    options : dict
        Of the imager.
    """

    imager: Callable
    range_m: float
    n_side: int = 96
    n_pulses: int = 96
    n_channels: int = 1
    spacing_m: float = 0.25
    height_m: float = 0.0
    track: str = 'straight'
    heading_rad: float = 0.0
    stepped: bool = False
    options: dict = dataclasses.field(default_factory=dict)

    @property
    def grid(self) -> MapGrid:
        """The map, around the origin."""
        return MapGrid((0.0, 0.0, 0.0), self.n_side, self.n_side, self.spacing_m)

    @property
    def aperture_m(self) -> float:
        """Length of the track, metres: a resolution of two pixels."""
        return SPEED_OF_LIGHT / _CARRIER_HZ * self.range_m / (4 * self.spacing_m)

    def phase_centres(self) -> tuple[np.ndarray, np.ndarray]:
        """(P, C, 3) float64 transmit and receive phase centres, metres."""
        ground = math.sqrt(self.range_m ** 2 - self.height_m ** 2)
        path = TRACKS[self.track](np.linspace(-0.5, 0.5, self.n_pulses), self.aperture_m)
        tx = np.repeat((path + [-ground, 0.0, self.height_m])[:, None], self.n_channels, axis=1)
        rx = tx.copy()
        rx[..., 1] += (np.arange(self.n_channels) - (self.n_channels - 1) / 2) * (
            SPEED_OF_LIGHT / _CARRIER_HZ / 2)
        cos, sin = math.cos(self.heading_rad), math.sin(self.heading_rad)
        turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        return tx @ turn, rx @ turn

    def block(self) -> PulseBlock:
        """Profiles, or phase histories, of scatterers in and around the map."""
        tx, rx = self.phase_centres()
        extent = 1.2 * self.n_side * self.spacing_m
        golden = (np.arange(_N_SCATTERERS)[:, None] * [0.7548776662, 0.5698402910]) % 1.0 - 0.5
        points = np.c_[golden * extent, np.zeros(_N_SCATTERERS)]
        amplitudes = np.exp(2j * np.pi * 0.6180339887 * np.arange(_N_SCATTERERS) ** 2)
        bandwidth = SPEED_OF_LIGHT / (4 * self.spacing_m)
        delays = two_way_delays(tx, rx, points)
        corners = self.grid.points()[::self.n_side - 1, ::self.n_side - 1].reshape(-1, 3)
        edges = two_way_delays(tx, rx, corners)
        low, high = float(edges.min()), float(edges.max())
        rate = _OVERSAMPLING * bandwidth
        n = scipy.fft.next_fast_len(math.ceil((high - low) * rate) + 160)
        half = int(0.5 * bandwidth / (rate / n))
        number = np.arange(self.n_pulses)
        if self.stepped:
            step, reference = bandwidth / (2 * half + 1), 0.5 * (low + high)
            spectrum = scene_spectrum(_CARRIER_HZ, -half, 2 * half + 1, step, delays, amplitudes,
                                      reference)
            radar = RadarParameters(_CARRIER_HZ, bandwidth, bandwidth, reference,
                                    waveform=Waveform.STEPPED_FREQUENCY)
            return PulseBlock(radar, False, number, number, spectrum, tx, rx)
        start = 0.5 * (low + high) - 0.5 * n / rate
        padded = np.zeros((*delays.shape[:2], n), complex)
        padded[..., np.arange(-half, half + 1)] = scene_spectrum(
            _CARRIER_HZ, -half, 2 * half + 1, rate / n, delays, amplitudes, start)
        radar = RadarParameters(_CARRIER_HZ, bandwidth, rate, start)
        return PulseBlock(radar, True, number, number, scipy.fft.ifft(padded, axis=-1), tx, rx)


# Positions (P, 3) seen from the middle of the track, from shares of it and its length.
TRACKS = {
    'straight': lambda u, length: np.outer(u * length, [0.0, 1.0, 0.0]),
    'curved': lambda u, length: np.c_[0.1 * length * (4 * u ** 2 - 1), u * length, 0 * u],
    'squinted': lambda u, length: np.outer(u * length, [0.5, 1.0, 0.02]),
    'climbing': lambda u, length: np.outer(u * length, [0.0, 1.0, 0.4]),
    'around': lambda u, length: np.c_[0.3 * length * np.cos(5 * u), 0.3 * length * np.sin(5 * u),
                                      0 * u],
}


# ------------------------------------------------------------------------------------- imagers
# Each returns a function that plans and one that forms the image of a plan.

def _planned(case: GoldenCase, block: PulseBlock, method: str, target_db: float, **options):
    return plan_image(case.grid, block.radar, block.n_samples, method=method,
                      compressed=block.compressed,
                      **{'target_db': target_db, **case.options, **options})


def exact(case: GoldenCase, block: PulseBlock, **options):
    """Backprojection onto the map; it plans while it images."""
    def form(imager):
        image = imager(block)
        return GoldenImage(image.samples, image.report.predicted_error_db,
                           image.report.plan.method)
    return lambda: _planned(case, block, 'exact', -80.0, **options), form


def terrain(case: GoldenCase, block: PulseBlock):
    """Backprojection onto a hill of 3 m."""
    points = case.grid.points()
    height = 3.0 * np.exp(-(points[..., 0] ** 2 + points[..., 1] ** 2)
                          / (0.3 * case.n_side * case.spacing_m) ** 2)
    return exact(case, block, height_m=height)


def afbp(case: GoldenCase, block: PulseBlock):
    """AFBP from profiles or phase histories."""
    def form(imager):
        planned = imager.report  # images change its error
        return GoldenImage(imager(block).samples, planned.predicted_error_db, str(planned.plan))
    return lambda: _planned(case, block, 'afbp', -50.0, tx_m=block.tx_m, rx_m=block.rx_m), form


def ffbp(case: GoldenCase, block: PulseBlock):
    """FFBP with sampling as asked for."""
    def form(imager):
        plan = imager.report.plan
        return GoldenImage(imager(block).samples, plan.predicted_error_db, str(len(plan.levels)))
    return lambda: _planned(case, block, 'ffbp', -60.0, tx_m=block.tx_m, rx_m=block.rx_m), form


def wavenumber(case: GoldenCase, block: PulseBlock):
    """The imager in the wavenumber domain."""
    return (lambda: _planned(case, block, 'wavenumber', -60.0),
            lambda imager: GoldenImage(imager(block).samples, None, ''))


def live(case: GoldenCase, block: PulseBlock):
    """The last image of sub-apertures that come in one after the other."""
    length = case.n_pulses // (2 if case.options.get('sliding') else 1)

    def plan():
        return LiveSubapertures(case.grid, pulses_per_aperture=length, **case.options)

    def form(stage):
        fusion, blocks = LiveFusion(), [block.select(slice(i, i + _BLOCK_PULSES))
                                        for i in range(0, case.n_pulses, _BLOCK_PULSES)]
        parts = [s for some in blocks for s in stage.add(some)] + stage.flush()
        images = [image for part in parts for image in fusion.add(part)] + fusion.flush()
        return GoldenImage(images[-1].image, images[-1].predicted_error_db,
                           f'{len(images)} images of {len(parts)} sub-apertures')
    return plan, form


CASES = {
    'exact_100m': GoldenCase(exact, 100.0, spacing_m=0.05),
    'exact_1km_5_channels': GoldenCase(exact, 1e3, n_pulses=48, n_channels=5),
    'exact_10km_few_pulses': GoldenCase(exact, 1e4, n_pulses=8),
    'exact_50km_5_channels': GoldenCase(exact, 5e4, n_pulses=48, n_channels=5, height_m=2e4,
                                        heading_rad=0.7),
    'exact_squinted': GoldenCase(exact, 2e3, track='squinted', heading_rad=2.0, height_m=800.0),
    'exact_curved': GoldenCase(exact, 1e3, track='curved', n_pulses=160),
    'exact_near': GoldenCase(exact, 20.0, n_side=64, spacing_m=0.05, height_m=8.0),
    'exact_around': GoldenCase(exact, 60.0, n_side=64, track='around', height_m=40.0),
    'exact_per_channel': GoldenCase(exact, 1e3, n_side=64, n_pulses=32, n_channels=3,
                                    options={'per_channel': True}),
    'exact_phase_history': GoldenCase(exact, 1e3, n_pulses=64, n_channels=2, stepped=True),
    'terrain': GoldenCase(terrain, 500.0, height_m=200.0, n_side=64),
    'afbp_1km': GoldenCase(afbp, 1e3, n_side=128, n_pulses=128, options={'target_db': -50.0}),
    'afbp_10km_5_channels': GoldenCase(afbp, 1e4, n_side=128, n_pulses=96, n_channels=5,
                                       height_m=4e3, heading_rad=2.5,
                                       options={'target_db': -60.0}),
    'afbp_phase_history': GoldenCase(afbp, 5e3, n_side=256, n_pulses=2048, stepped=True,
                                     options={'target_db': -50.0}),
    'afbp_curved': GoldenCase(afbp, 1e3, n_side=128, n_pulses=128, track='curved',
                              options={'target_db': -60.0}),
    'afbp_climbing': GoldenCase(afbp, 2e3, n_side=128, n_pulses=128, track='climbing',
                                height_m=600.0, options={'target_db': -50.0}),
    'ffbp': GoldenCase(ffbp, 1e3, n_pulses=64, options={
        'merge_factor': 4, 'kernel': 'knab8', 'range_oversampling': 1.8,
        'angle_oversampling': 1.8}),
    'wavenumber': GoldenCase(wavenumber, 1e3, n_pulses=128, options={'taps': 16}),
    'live': GoldenCase(live, 1e3, n_side=128, n_pulses=128, options={'target_db': -50.0}),
    'live_sliding': GoldenCase(live, 1e3, n_side=128, n_pulses=192,
                               options={'target_db': -50.0, 'sliding': True}),
}
