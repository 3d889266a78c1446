# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A scenario: a radar, its track and a scene, and the pulses that follow."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from ...geometry.antenna import Antenna, Mount
from ...geometry.grids import MapGrid
from ...geometry.illumination import Illumination, Pointing
from ...signal.pulses import PulseBlock
from ...signal.radar import RadarParameters
from ..echoes import EchoSimulator, quantise
from ..jammer import Jammer
from ..movers import Mover, mover_echoes
from ..noise import complex_gaussian
from ..scene import Clutter, Scatterer, positions_and_amplitudes
from ..trajectory import POSITION_STEP_M, RasterScan, Trajectory

START_NS = 1_700_000_000_000_000_000  # of every recording: the clock of a simulation is its own


@dataclasses.dataclass(frozen=True)
class Scenario:
    """A radar, its track and a scene: everything that a simulated recording follows from.

    Parameters
    ----------
    name : str
        Key in `SCENARIOS`.
    description : str
        One sentence for people.
    radar : RadarParameters
        Radar parameters of the recorded samples.
    compressed : bool
        True when range profiles are recorded, False for raw pulses.
    n_samples : int
        Fast-time samples per pulse and channel.
    prf_hz : float
        Pulses per second.
    n_pulses : int
        Pulses of the recording.
    pulses_per_aperture : int
        Pulses that make one image.
    trajectory : Trajectory or RasterScan
        Trajectory of the platform's reference point.
    tx_offsets_m, rx_offsets_m : tuple of (3,) floats
        Phase centres of each channel relative to the reference point, axes of the imaging frame,
        metres.
    scatterers : tuple of Scatterer
        The scene.
    grid : MapGrid
        Where to image it; the lowest layer of a volume.
    cut_half_width_m : (2,) floats
        Half widths of the cuts over which sidelobes are measured, in range and azimuth, metres.
    noise_std : float
        Standard deviation of complex noise per sample; 1 is the echo of a unit scatterer.
    seed : int
        Seed of the noise.
    resolution_bits : int
        Bits of the recorded samples, see `sar_imaging.simulation.echoes.quantise`.
    notes : str
        Where the parameters come from.
    movers : tuple of Mover
        What moves in the scene; time zero is the middle of the recording.
    jammers : tuple of Jammer
        Sources of noise.
    clutter : Clutter, optional
        Scatterers without names, of random phases.
    height_m : float
        Height of the scene above the grid, metres; 0 for one that is flat.
    antenna : Antenna, optional
        Pattern by which scatterers and clutter return; movers and jammers are lit alike.
    mount : Mount, optional
        What tells where it looks; needed with `antenna`.

    Examples
    --------
    >>> from sar_imaging.simulation import SCENARIOS
    >>> scenario = SCENARIOS['two_scatterers']()
    >>> print(scenario.name, scenario.n_pulses, 'pulses,', scenario.n_channels, 'channels')
    two_scatterers 200 pulses, 5 channels
    >>> [f'{s.name} {s.position_m[0]:.0f} m' for s in scenario.scatterers]
    ['centre 10000 m', 'corner 10003 m']
    >>> next(scenario.blocks(pulses_per_block=10)).samples.shape
    (10, 5, 126)
    """

    name: str
    description: str
    radar: RadarParameters
    compressed: bool
    n_samples: int
    prf_hz: float
    n_pulses: int
    pulses_per_aperture: int
    trajectory: Trajectory | RasterScan
    tx_offsets_m: tuple[tuple[float, float, float], ...]
    rx_offsets_m: tuple[tuple[float, float, float], ...]
    scatterers: tuple[Scatterer, ...]
    grid: MapGrid
    cut_half_width_m: tuple[float, float]
    noise_std: float = 0.0
    seed: int = 1
    resolution_bits: int = 20
    notes: str = ''
    movers: tuple[Mover, ...] = ()
    jammers: tuple[Jammer, ...] = ()
    clutter: Clutter | None = None
    height_m: float = 0.0
    antenna: Antenna | None = None
    mount: Mount | None = None

    @property
    def n_channels(self) -> int:
        """Number of channels C."""
        return len(self.rx_offsets_m)

    @property
    def full_scale(self) -> float:
        """Largest recorded part: the power of two above all echoes in phase and 5 sigma."""
        # A band-limited chirp overshoots by up to a fifth at its ends.
        noise_std = math.hypot(self.noise_std, *(jammer.std for jammer in self.jammers),
                               0.0 if self.clutter is None else self.clutter.std)
        sources: tuple[Scatterer | Mover, ...] = *self.scatterers, *self.movers
        peak = (1.25 * sum(abs(s.amplitude) for s in sources)
                + 5 * noise_std)
        return 2.0 ** math.ceil(math.log2(peak))

    def phase_centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Transmit and receive phase centres ``(n_pulses, C, 3)`` float64, metres."""
        track = self.trajectory.positions(self.times_s())[:, None]
        return track + _on_grid(self.tx_offsets_m), track + _on_grid(self.rx_offsets_m)

    def times_s(self) -> np.ndarray:
        """(n_pulses,) float64 times of the pulses from the middle of the recording, seconds."""
        return (np.arange(self.n_pulses) - (self.n_pulses - 1) / 2) / self.prf_hz

    def stamps_ns(self) -> np.ndarray:
        """(n_pulses,) int64 transmission times, nanoseconds."""
        period_ns = np.rint(np.arange(self.n_pulses) * (1e9 / self.prf_hz))
        return START_NS + period_ns.astype(np.int64)

    def blocks(self, pulses_per_block: int = 25) -> Iterator[PulseBlock]:
        """Simulate the recording block by block.

        Parameters
        ----------
        pulses_per_block : int
            Pulses per block; the last block has the rest. Samples do not depend on it.

        Yields
        ------
        PulseBlock
            With phase centres, in the order of the pulses.

        Raises
        ------
        ValueError
            `pulses_per_block` is not positive, or a scatterer lies outside the record.
        """
        if pulses_per_block < 1:
            raise ValueError(f'pulses_per_block={pulses_per_block}; expected at least 1')
        points, amplitudes = positions_and_amplitudes(self.scatterers)
        if self.clutter is not None:
            points = np.concatenate([points, self.clutter.positions_m])
            amplitudes = np.concatenate([amplitudes, self.clutter.amplitudes])
        simulator = EchoSimulator(self.radar, self.n_samples, compressed=self.compressed,
                                  points_m=points, amplitudes=amplitudes)
        tx_m, rx_m = self.phase_centres()
        pointing, illumination = self._illumination(tx_m, rx_m)
        stamps_ns, times_s = self.stamps_ns(), self.times_s()
        for first in range(0, self.n_pulses, pulses_per_block):
            counter = np.arange(first, min(first + pulses_per_block, self.n_pulses))
            samples = simulator(
                tx_m[counter], rx_m[counter],
                illumination and illumination.select(_echoes(counter, self.n_channels)))
            if self.movers:
                samples += mover_echoes(
                    self.movers, self.radar, self.n_samples, compressed=self.compressed,
                    tx_m=tx_m[counter], rx_m=rx_m[counter], time_s=times_s[counter])
            for jammer in self.jammers:
                samples += jammer.samples(self.radar, self.n_samples, rx_m[counter], counter)
            if self.noise_std:
                samples += self.noise_std * self._noise(counter)
            yield PulseBlock(self.radar, self.compressed, stamps_ns[counter], counter,
                             quantise(samples, self.resolution_bits, self.full_scale),
                             tx_m[counter], rx_m[counter],
                             pointing=pointing and pointing.select(counter))

    def _illumination(self, tx_m: np.ndarray, rx_m: np.ndarray
                      ) -> tuple[Pointing | None, Illumination | None]:
        """Where the antenna looks at each pulse, and the illumination of all echoes."""
        if self.antenna is None:
            return None, None
        assert self.mount is not None  # which every antenna has
        pointing = self.mount.pointing(self.stamps_ns(), 0.5 * (tx_m + rx_m).mean(axis=1))
        return pointing, Illumination.of_pulses(self.antenna.amplitudes(), pointing, tx_m, rx_m)

    def _noise(self, counter: np.ndarray) -> np.ndarray:
        shape = (self.n_channels, self.n_samples)
        return np.stack([complex_gaussian(self.seed, int(c), math.prod(shape)).reshape(shape)
                         for c in counter])


def _echoes(counter: np.ndarray, n_channels: int) -> np.ndarray:
    """Numbers of the echoes of some pulses, channel by channel of each."""
    return (counter[:, None] * n_channels + np.arange(n_channels)).reshape(-1)


def _on_grid(offsets_m: ArrayLike) -> np.ndarray:
    """Phase centres on the trajectory's grid of positions, so that sums with it are exact."""
    return np.round(np.array(offsets_m, float) / POSITION_STEP_M) * POSITION_STEP_M


def receive_array(n_channels: int, spacing_m: float) -> tuple[tuple[float, float, float], ...]:
    """Offsets of the receivers of an evenly spaced array along y.

    ``d_n = n spacing``, n from ``-(N-1)/2`` to ``(N-1)/2``.

    Rosenberg & Gray, equation 2; their ``(n - 1) spacing`` contradicts their range of n.

    Parameters
    ----------
    n_channels : int
        Receivers N.
    spacing_m : float
        From one to the next, metres.

    Returns
    -------
    tuple of (3,) floats
        Metres, the first receiver at the least y.

    Examples
    --------
    >>> from sar_imaging.simulation.scenarios import receive_array
    >>> [y for _, y, _ in receive_array(5, spacing_m=0.25)]
    [-0.5, -0.25, 0.0, 0.25, 0.5]
    """
    return tuple((0.0, (n - (n_channels - 1) / 2) * spacing_m, 0.0) for n in range(n_channels))
