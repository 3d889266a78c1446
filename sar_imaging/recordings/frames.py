# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames of raw radar messages as pulse blocks: order of samples, times, channels, lost frames.

A driver sends a frame of several chirps as one message. `FrameConverter` makes one pulse of each
turn of all transmitters. Its parameters come from a description and, where that is silent, from
the messages. When frames began is told from stamps that may come late.
"""

from __future__ import annotations

import collections
import dataclasses
import itertools
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..geometry.alignment import Alignment
from ..signal.positioning import without_range_bias
from ..signal.pulses import PulseBlock, concatenate
from ..signal.radar import RadarParameters
from . import radar as radar_section, samples as samples_section, virtual_array
from .description import DescriptionError, Section
from .samples import decode_iq
from .virtual_array import VirtualArray, calibration_weights, read_array

_DRIFT = 1e-4  # relative, of a radar's clock against the computer's
_JUDGED = 20  # intervals that tell whether the period is right
_MOST_OFF = 0.1  # of a period, that their median may be off
_LONGEST_PAUSE = 1000  # periods; after longer ones the radar was started anew


class FrameClock:
    """Give each frame its time and its number.

    Stamps taken at receipt come late by a time that varies and is never negative. Where the
    period of the frames is known, the earliest stamps tell the times of the others: a frame
    cannot have begun later than its stamp, nor later than the frames before it plus whole periods.

    Parameters
    ----------
    period_s : float
        From frame to frame, seconds; 0 where it is unknown. Frames are then counted as they come.
    late_s : float
        From the start of a frame to its stamp at the least, seconds.
    jitter : bool
        Stamps vary: follow the earliest ones.

    Attributes
    ----------
    missing : int
        Frames that did not come so far.
    """

    def __init__(self, period_s: float, late_s: float, *, jitter: bool):
        self._period_ns, self._late_ns = round(period_s * 1e9), round(late_s * 1e9)
        self._jitter = jitter
        self._last: tuple[int, int] | None = None
        self._stamp_ns: collections.deque[int] = collections.deque(maxlen=_JUDGED + 1)
        self.missing = 0

    def place(self, stamp_ns: int) -> tuple[int, int]:
        """Start of a frame, nanoseconds, and its number.

        Parameters
        ----------
        stamp_ns : int
            Time of the frame, nanoseconds.
        """
        self._stamp_ns.append(stamp_ns)
        start_ns = stamp_ns - self._late_ns
        if self._last is None:
            self._last = start_ns, 0
            return self._last
        before_ns, number = self._last
        steps = self._steps(start_ns - before_ns)
        self.missing += steps - 1
        if self._jitter and self._period_ns and steps <= _LONGEST_PAUSE:
            since_ns = steps * self._period_ns
            start_ns = min(start_ns, before_ns + round(since_ns * (1 + _DRIFT)))
        self._last = start_ns, number + steps
        return self._last

    def doubts(self) -> tuple[str, ...]:
        """Text on a period that the latest stamps contradict."""
        if not self._period_ns or len(self._stamp_ns) <= _JUDGED:
            return ()
        every_ns = [b - a for a, b in itertools.pairwise(self._stamp_ns)]
        # The median bears lost frames, the mean bears frames that arrive in bunches.
        usual = [middle(every_ns) / self._period_ns for middle in (statistics.median,
                                                                   statistics.fmean)]
        if any(abs(steps - max(1, round(steps))) <= _MOST_OFF for steps in usual):
            return ()
        return (f'frames come every {usual[0] * self._period_ns * 1e-9:.4g} s; expected '
                f'frames.period_s={self._period_ns * 1e-9:g} s or, with lost frames, a multiple: '
                'correct it (seconds from frame to frame)',)

    def _steps(self, since_ns: int) -> int:
        if not self._period_ns:
            return 1
        steps = max(1, round(since_ns / self._period_ns))
        return steps if steps <= _LONGEST_PAUSE else 1

    def settled(self, placed: Sequence[tuple[int, int]]) -> list[int]:
        """Starts of frames once all are known, nanoseconds: later ones tell of earlier ones, too.

        Parameters
        ----------
        placed : sequence of (int, int)
            What `place` gave for each frame.
        """
        starts = [start for start, _ in placed]
        if not (self._jitter and self._period_ns):
            return starts
        for i in range(len(starts) - 2, -1, -1):
            steps = placed[i + 1][1] - placed[i][1]
            if starts[i + 1] - starts[i] <= _LONGEST_PAUSE * self._period_ns:
                earliest = starts[i + 1] - round(steps * self._period_ns * (1 - _DRIFT))
                starts[i] = min(starts[i], earliest)
        return starts


KEYS = ('stamp', 'latency_s', 'chirp_s', 'period_s')
ALIGNMENT_KEYS = ('time_offset_s', 'range_bias_m', 'lever_arm_m')
STAMPS = ('start', 'end', 'receipt')
_OF_RAMP = ('start_frequency_hz', 'slope_hz_per_s', 'adc_start_s')


class FrameError(ValueError):
    """A message holds no usable frame; the text says why."""


@dataclasses.dataclass(frozen=True)
class RawFrame:
    """One message of a driver.

    Parameters
    ----------
    numbers : (K, R, n) array
        Numbers of K chirps in the order of sending and R receivers, as the converter wrote them;
        complex, or in the order `iq`.
    iq : str
        Order of the numbers, see `sar_imaging.recordings.samples.decode_iq`.
    stamp_ns : int
        Time that the message gives, nanoseconds; 0 where it gives none.
    stamp : str
        What that time is of: ``'start'`` or ``'end'`` of the frame, or ``'receipt'``.
    complete : bool
        False when the driver says that packets were lost.
    weights : (C,) complex128 or None
        Factors by which the driver wants the channels to be multiplied.
    range_bias_m : float
        Measured minus geometric range, metres.
    told : dict of str to float
        Numbers of the radar and of the times, by their keys in descriptions.
    n_transmitters : int or None
        Transmitters that take turns; None where the message does not tell.
    """

    numbers: np.ndarray
    iq: str
    stamp_ns: int
    stamp: str
    complete: bool = True
    weights: np.ndarray | None = None
    range_bias_m: float = 0.0
    told: Mapping[str, float] = dataclasses.field(default_factory=dict)
    n_transmitters: int | None = None


#: A frame, numbers that the driver told, or why a message holds no frame.
Received: TypeAlias = RawFrame | Mapping[str, float | str] | FrameError


@dataclasses.dataclass
class FrameStatistics:
    """Counts; ``received = converted + incomplete + rejected``."""

    received: int = 0
    converted: int = 0
    incomplete: int = 0
    rejected: int = 0
    missing: int = 0


class FrameConverter:
    """Make pulse blocks of frames, one after the other.

    Parameters
    ----------
    top : Section
        The whole description; its parts ``samples``, ``radar``, ``array``, ``frames``,
        ``alignment`` and ``calibration`` count.
    folder : path
        Where a calibration file of relative name lies.

    Attributes
    ----------
    statistics : FrameStatistics
        What happened so far.
    array : VirtualArray or None
        Array of the frames; None before the first one.
    placed : (int, int)
        Start of the latest frame, nanoseconds, and its number.

    Raises
    ------
    DescriptionError
        The description makes no sense.
    """

    def __init__(self, top: Section, folder: Path) -> None:
        self._top, self._folder = top, folder
        self._samples = top.section('samples', samples_section.KEYS)
        self._frames = top.section('frames', KEYS)
        self._frames.choice('stamp', STAMPS, None)
        self._latency_s = self._short('latency_s')
        for key in ('chirp_s', 'period_s'):
            if self._frames.number(key, 1.0) <= 0:
                raise self._frames.error(key, 'a positive number of seconds')
        self._conjugate, self._scale = (self._samples.flag('conjugate'),
                                        samples_section.read_scale(self._samples))
        self._told: dict[str, float | str] = {}
        self._setup: tuple[Any, ...] | None = None
        self._clock: FrameClock | None = None
        self.statistics = FrameStatistics()
        self.array: VirtualArray | None = None
        self.placed = (0, 0)

    def _short(self, key: str) -> float:
        """A time below a second, 0 where it is not given."""
        value = self._frames.number(key, 0.0)
        if not 0 <= value < 1:
            raise self._frames.error(key, 'seconds, 0 to 1', 'a latency of 3 ms is 0.003')
        return value

    def restart(self) -> None:
        """Count frames from 0 again, from the next one on; what was told stays."""
        self._setup = self._clock = None
        self.statistics = FrameStatistics()

    def tell(self, told: Mapping[str, float | str]) -> bool:
        """Take numbers that a message of the driver told; True when one of them is new."""
        new = dict(told) != {key: self._told.get(key) for key in told}
        if new:
            self._told |= told
            self._setup = None
        return new

    def convert(self, frame: RawFrame, received_ns: int) -> PulseBlock | None:
        """Pulses of a frame.

        Parameters
        ----------
        frame : RawFrame
            What the driver sent.
        received_ns : int
            When it came, for messages without a time, nanoseconds.

        Returns
        -------
        PulseBlock or None
            Without positions; stamped when the first chirp of each pulse was sent. None for a
            frame that is not complete.

        Raises
        ------
        FrameError
            The frame does not fit the description.
        DescriptionError
            A number is neither in the description nor in the messages so far.
        """
        self.statistics.received += 1
        try:
            return self._convert(frame, received_ns)
        except (FrameError, DescriptionError):
            self.statistics.rejected += 1
            raise

    def settled(self, placed: Sequence[tuple[int, int]]) -> list[int]:
        """Starts of all frames of a recording, see `FrameClock.settled`."""
        return ([start for start, _ in placed] if self._clock is None
                else self._clock.settled(placed))

    def doubts(self) -> tuple[str, ...]:
        """What the frames so far contradict; a person should know."""
        return self._clock.doubts() if self._clock is not None else ()

    def _convert(self, frame: RawFrame, received_ns: int) -> PulseBlock | None:
        self.tell(frame.told)
        samples = self._decoded(frame)
        shape = (*samples.shape, frame.range_bias_m)
        if self._setup is None or self._setup[0] != shape:
            try:
                self._setup = (shape, *self._prepare(samples, frame))
            except DescriptionError as error:
                if self._told or 'is missing' not in str(error):
                    raise
                raise DescriptionError(f'{error}; no message of the driver told it either '
                                       '(ChirpInfo, DeviceConfig): record or connect its topic'
                                       ) from error
        _, radar, turn, weights, chirp_s, clock = self._setup
        n_tx = len(turn)
        pulses = samples.reshape(len(samples) // n_tx, n_tx, *samples.shape[1:])[:, turn]
        pulses = pulses.reshape(len(pulses), -1, samples.shape[-1])
        stamp_ns, number = self.placed = clock.place(frame.stamp_ns or received_ns)
        self.statistics.missing = clock.missing
        if not frame.complete:
            self.statistics.incomplete += 1
            return None
        if frame.weights is not None:
            pulses = pulses * self._driver_weights(frame.weights, pulses.shape[1])
        count = np.arange(len(pulses))
        self.statistics.converted += 1
        return PulseBlock(
            radar, False, stamp_ns + np.rint(count * (n_tx * chirp_s * 1e9)).astype(np.int64),
            (number * len(pulses) + count) & 0xFFFFFFFF, pulses * weights)

    def _decoded(self, frame: RawFrame) -> np.ndarray:
        convention = self._samples.choice('iq', samples_section.IQ, frame.iq)
        if np.iscomplexobj(frame.numbers) != (convention == 'complex'):
            raise self._samples.error('iq', f'that of the messages, {frame.iq}', 'leave it out')
        group = {'pairs': 2, 'iiqq': 4, 'qqii': 4}.get(convention, 1)
        if frame.numbers.shape[-1] % group or not frame.numbers.size:
            raise FrameError(f'a chirp holds {frame.numbers.shape[-1]} numbers; expected a '
                             f'multiple of {group} for samples.iq={convention}')
        values = decode_iq(frame.numbers, convention)
        if self._conjugate:
            values = values.conj()
        return values if self._scale == 1.0 else values * self._scale

    def _prepare(self, samples: np.ndarray, frame: RawFrame) -> tuple[Any, ...]:
        """Radar, turns in order, weights of channels, seconds from chirp to chirp, clock."""
        n_chirps, n_receivers, n_samples = samples.shape
        keys = self._top.section('radar', radar_section.KEYS)
        keys = keys.with_defaults({k: v for k, v in self._told.items()
                                   if k in radar_section.KEYS and not (
                                       k in _OF_RAMP and 'carrier_hz' in keys)})
        radar, _ = radar_section.read_radar(keys, n_samples)
        is_real = not np.iscomplexobj(frame.numbers) and self._samples.choice(
            'iq', samples_section.IQ, frame.iq) == 'real'
        if is_real != radar.waveform.is_real:
            raise DescriptionError(f'radar.waveform={radar.waveform.name.lower()}: the messages '
                                   f'hold {"real" if is_real else "complex"} samples; use '
                                   f'{"fmcw_real or passband" if is_real else "fmcw"}')
        section = self._top.section('array', virtual_array.KEYS)
        n_tx = len(section.vectors('tx_m', np.zeros((1, 3))))
        if frame.n_transmitters not in (None, n_tx):
            raise section.error('tx_m', f'the places of {frame.n_transmitters} transmitters, '
                                'which send in turn by the messages',
                                f'it holds {n_tx if "tx_m" in section else "none"}')
        if n_chirps % n_tx:
            raise FrameError(f'a frame of {n_chirps} chirps; expected a multiple of {n_tx}, the '
                             'transmitters of array.tx_m that take turns')
        timing = self._frames.with_defaults(
            {k: v for k, v in self._told.items() if k in ('chirp_s', 'period_s')})
        chirp_s = timing.number('chirp_s') if n_chirps > 1 else timing.number('chirp_s', 0.0)
        self._check_times(timing, n_chirps, chirp_s)
        if n_tx > 1:
            turn_s = section.number('turn_interval_s', chirp_s)
            if turn_s > 1.01 * chirp_s:  # the time of a chirp may be rounded
                raise section.error('turn_interval_s', f'at most the {chirp_s:g} s of a chirp')
            section = section.with_defaults({'turn_interval_s': chirp_s})
        self.array = read_array(section, n_tx * n_receivers, n_receivers)
        clock = self._started_clock(timing, frame, n_chirps * chirp_s)
        turn = section.array('turn_order', np.arange(n_tx, dtype=float)).astype(int)
        return (self._unbiased(radar, frame), turn,
                self._weights(n_tx * n_receivers, is_real), chirp_s, clock)

    def _check_times(self, timing: Section, n_chirps: int, chirp_s: float) -> None:
        period_s = timing.number('period_s', 0.0)
        if period_s and n_chirps * chirp_s > 1.01 * period_s:
            raise timing.error('chirp_s', f'seconds, {n_chirps} of which fit into a frame every '
                               f'{period_s:g} s', f'they take {n_chirps * chirp_s:g} s')

    def _started_clock(self, timing: Section, frame: RawFrame, length_s: float) -> FrameClock:
        if self._clock is not None:
            return self._clock
        kind = timing.choice('stamp', STAMPS, frame.stamp)
        late_s = self._latency_s + (0.0 if kind == 'start' else length_s)
        self._clock = FrameClock(timing.number('period_s', 0.0), late_s,
                                 jitter=kind == 'receipt')
        return self._clock

    def _unbiased(self, radar: RadarParameters, frame: RawFrame) -> RadarParameters:
        if not frame.range_bias_m or 'range_bias_m' in self._top.section(
                'alignment', ALIGNMENT_KEYS):
            return radar
        return without_range_bias(radar, Alignment(range_bias_m=frame.range_bias_m))

    def _weights(self, n_channels: int, is_real: bool) -> np.ndarray:
        if 'calibration' not in self._top:
            return np.ones((n_channels, 1), np.complex64)
        return calibration_weights(self._folder / self._top.text('calibration'), n_channels,
                                   real_samples=is_real)

    def _driver_weights(self, weights: np.ndarray, n_channels: int) -> np.ndarray:
        if weights.size != n_channels:
            raise FrameError(f'the driver calibrates {weights.size} channels; the frame has '
                             f'{n_channels}: check array.tx_m and array.rx_m')
        # They multiply what was recorded; conjugated samples need conjugated factors.
        return (weights.conj() if self._conjugate else weights)[:, None]


def convert_all(converter: FrameConverter, items: Iterable[tuple[Received, int]]
                ) -> tuple[PulseBlock, tuple[str, ...]]:
    """Pulses of a whole recording, and what a person should know.

    Parameters
    ----------
    converter : FrameConverter
        New, with the description.
    items : iterable of (Received, int)
        `RawFrame`, numbers that the driver told (a mapping), or the `FrameError` of a message
        that holds no frame; each with the time of its receipt, nanoseconds.

    Raises
    ------
    DescriptionError
        There is no usable frame, or the description makes no sense.
    """
    blocks, placed, problem = [], [], None
    for item, received_ns in items:
        if isinstance(item, Mapping):
            converter.tell(item)
            continue
        try:
            if isinstance(item, FrameError):
                converter.statistics.received += 1
                converter.statistics.rejected += 1
                raise item
            block = converter.convert(item, received_ns)
        except FrameError as error:
            problem = str(error)
            continue
        if block is not None:
            blocks.append(block)
            placed.append(converter.placed)
    s = converter.statistics
    if not blocks:
        raise DescriptionError(f'none of {s.received} messages holds a complete frame'
                               + (f'; the last one: {problem}' if problem else ''))
    moved = [start - then for start, (then, _) in zip(converter.settled(placed), placed,
                                                      strict=True)]
    pulses = concatenate([dataclasses.replace(b, stamp_ns=b.stamp_ns + by)
                          for b, by in zip(blocks, moved, strict=True)])
    return pulses, converter.doubts() + tuple(text for n, text in (
        (s.incomplete, f'{s.incomplete} of {s.received} frames are incomplete and were left out: '
         'the driver lost packets'),
        (s.missing, f'{s.missing} frames never came, by the period of the frames'),
        (s.rejected, f'{s.rejected} of {s.received} messages were refused; the last one: '
         f'{problem}')) if n)
