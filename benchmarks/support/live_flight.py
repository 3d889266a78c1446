# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The simulated flight that the live system is measured with, and its images formed offline."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import pathlib
from collections.abc import Iterator

import numpy as np

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.recordings import bag_io
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.scenarios import WAVELENGTH_M
from sar_imaging.simulation.scenarios.scenario import Scenario, receive_array
from sar_imaging.simulation.scene import Scatterer
from sar_imaging.simulation.trajectory import Trajectory, Vibration
from sar_imaging.tools.simulate import scenario_truth

SECONDS = 60
PRF_HZ = 256.0
PULSES_PER_APERTURE = 1024  # four seconds, 80 m of track, 0.9 m resolution along it
PULSES_PER_MESSAGE = 16  # 0.38 MB
EXTENT_M = 255.5


def scenario() -> Scenario:
    """Small aircraft at 20 m/s, 5 km from 256 m x 256 m: 5 channels, 10 GHz, 150 MHz, raw LFM."""
    rng = np.random.default_rng(60)
    scatterers = tuple(Scatterer(f'point_{i}', (float(x), float(y), 0.0), float(10 ** (db / 20)))
                       for i, (x, y, db) in enumerate(rng.uniform(
                           (-120, -120, -20), (120, 120, 0), (24, 3))))
    n_pulse, sample_rate_hz = 180, 180e6
    pulse_length_s = n_pulse / sample_rate_hz
    radar = RadarParameters(
        carrier_hz=10e9, bandwidth_hz=150e6, sample_rate_hz=sample_rate_hz,
        first_sample_delay_s=2 * 4860.0 / SPEED_OF_LIGHT, pulse_length_s=pulse_length_s,
        chirp_rate_hz_per_s=150e6 / pulse_length_s, waveform=Waveform.LFM)
    return Scenario(
        name='live_flight', description='One minute of a small aircraft beside a small scene',
        radar=radar, compressed=False, n_samples=592, prf_hz=PRF_HZ,
        n_pulses=int(SECONDS * PRF_HZ), pulses_per_aperture=PULSES_PER_APERTURE,
        trajectory=Trajectory(
            centre_m=(-4770.0, 0.0, 1500.0), velocity_m_per_s=(0.0, 20.0, 0.0),
            vibrations=(Vibration((0.4, 0.1, 0.3), 0.11), Vibration((0.01, 0.0, 0.02), 1.3))),
        tx_offsets_m=((0.0, 0.0, 0.0),) * 5, rx_offsets_m=receive_array(5, WAVELENGTH_M / 2),
        scatterers=scatterers, grid=grid(512), cut_half_width_m=(5.0, 5.0), noise_std=0.5)


def grid(n_side: int) -> MapGrid:
    """The scene with so many pixels along each side."""
    spacing = EXTENT_M / (n_side - 1)
    return MapGrid((0.0, 0.0, 0.0), n_side, n_side, spacing)


@dataclasses.dataclass(frozen=True)
class Message:
    """A serialised message of the flight."""

    time_s: float  # of its last pulse, from the first pulse of the flight
    cdr: bytes
    first: int  # counter
    n_pulses: int


class Flight:
    """The recording of the flight, simulated when it is not there yet.

    Parameters
    ----------
    path : Path
        Bag folder.
    """

    def __init__(self, path: pathlib.Path):
        self.path = path
        if not path.exists():
            made = scenario()
            bag_io.write_bag(path, made.blocks(PULSES_PER_MESSAGE), scenario_truth(made))
        self.truth = bag_io.read_truth(path)

    def blocks(self, loop: int = 0) -> Iterator[PulseBlock]:
        """Its pulses, with the counters and times of the flight's `loop`-th repetition."""
        for block in bag_io.read_blocks(self.path):
            yield dataclasses.replace(
                block, stamp_ns=block.stamp_ns + loop * SECONDS * 10**9,
                counter=block.counter + np.uint32(loop * int(SECONDS * PRF_HZ)))

    def messages(self, loop: int = 0) -> Iterator[Message]:
        """Its messages."""
        start_ns = None
        for block in self.blocks(loop):
            start_ns = int(block.stamp_ns[0]) if start_ns is None else start_ns
            yield Message((int(block.stamp_ns[-1]) - start_ns) / 1e9, bag_io.serialise(block),
                          int(block.counter[0]), block.n_pulses)

    def endless(self) -> Iterator[Message]:
        """Its messages again and again; counters and times go on."""
        for loop in itertools.count():
            for message in self.messages(loop):
                yield dataclasses.replace(message, time_s=message.time_s + loop * SECONDS)

    @functools.lru_cache(maxsize=1)  # noqa: B019 there is one flight
    def offline_images(self, map_grid: MapGrid) -> list[np.ndarray]:
        """The exact images of its whole apertures, complex64."""
        return list(self._form_images(map_grid))

    def _form_images(self, map_grid: MapGrid) -> Iterator[np.ndarray]:
        imager = compressor = image = None
        for block in self.blocks():
            if imager is None:
                compressor = RangeCompressor.for_block(block)
                profiles = compressor(block)
                imager = plan_image(map_grid, profiles.radar, profiles.n_samples,
                                    method='exact', target_db=-80.0)
            if block.counter[0] % PULSES_PER_APERTURE == 0:
                image = imager.new_image()
            imager.accumulate(compressor(block), image)
            if (block.counter[-1] + 1) % PULSES_PER_APERTURE == 0:
                yield image.samples
