# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A block of multichannel pulses, the data that pass from stage to stage, and its checks."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...device_arrays import alike, are_finite, beside, on_device, to_host
from ...geometry.track import mean_centres
from ..radar import RadarParameters
from .sequence import COUNTER_MASK, describe_counters

if TYPE_CHECKING:
    from ...geometry.illumination import Pointing

# An image adds up to a million echoes, and its power is a float32, too.
_MOST_ENERGY = float(np.finfo(np.float32).max) / 2.0**40
CORRUPT = f'dropped pulses with samples that are not finite numbers below {_MOST_ENERGY**0.5:.0e}'
_MOST_SECONDS = 1e11  # of times since any epoch


def integer_stamps(stamp_ns: ArrayLike) -> np.ndarray:
    """(P,) int64 times; ValueError for floats, which are seconds more often than not."""
    stamps = np.asarray(stamp_ns)
    if stamps.size and stamps.dtype.kind not in 'iu':
        text = (f'stamp_ns is {stamps.dtype}; expected whole nanoseconds as int64, which float64 '
                'rounds to 256 ns')
        if stamps.dtype.kind == 'f':
            largest = float(np.abs(stamps).max())
            seconds = largest < _MOST_SECONDS and np.any(stamps != np.rint(stamps))
            text += (f'; {largest:.6g} is probably in seconds: pass '
                     'np.rint(1e9 * seconds).astype(np.int64)' if seconds else
                     '; pass np.rint(stamp_ns).astype(np.int64)')
        raise ValueError(text)
    return stamps.astype(np.int64, copy=False)


def running_counters(counter: ArrayLike) -> np.ndarray:
    """(P,) uint32 numbers of the pulses; ValueError where they cannot number them."""
    values = np.asarray(counter)
    if values.size and values.dtype.kind not in 'iu':
        raise ValueError(f'counter is {values.dtype}; expected whole numbers, one more for each '
                         'pulse')
    if values.dtype != np.uint32 and values.size and not (
            0 <= int(values.min()) and int(values.max()) <= COUNTER_MASK):
        raise ValueError(f'counter reaches from {values.min()} to {values.max()}; expected 0 to '
                         f'{COUNTER_MASK}; pass counter % 2**32')
    return values.astype(np.uint32, copy=False)


def complex_samples(samples: Any) -> np.ndarray:
    """Samples as complex64, where they lie: of NumPy, or of CuPy on a device."""
    if on_device(samples):
        return samples.astype(np.complex64, copy=False)
    return np.asarray(samples, np.complex64)


def check_counted(counter: np.ndarray, stamp_ns: np.ndarray) -> None:
    """Raise ValueError when pulses of different times all have one number."""
    if counter.ndim != 1 or counter.shape != stamp_ns.shape:
        raise ValueError(f'counter.shape={counter.shape} does not match stamp_ns.shape='
                         f'{stamp_ns.shape}; expected one of each per pulse, (pulses,)')
    # One pulse that came twice has one number and one time.
    if len(counter) > 1 and np.all(counter == counter[0]) and np.any(stamp_ns != stamp_ns[0]):
        raise ValueError(f'counter is {counter[0]} for all {len(counter)} pulses; expected a '
                         'number that grows by one from pulse to pulse, such as '
                         'np.arange(n_pulses)')


def check_shapes(samples: np.ndarray, n_pulses: int, tx_m: np.ndarray | None,
                 rx_m: np.ndarray | None) -> None:
    """Check samples and positions against the number of stamps.

    Raises
    ------
    ValueError
        They do not belong together; transposed samples are named as such.
    """
    if samples.ndim != 3:
        raise ValueError(f'samples.shape={samples.shape}; expected (pulses, channels, samples)'
                         + ('; one channel is samples[:, None]' if samples.ndim == 2 else ''))
    channels = tx_m.shape[1] if tx_m is not None and tx_m.ndim == 3 else None
    if samples.shape[0] != n_pulses:
        _refuse_samples(samples.shape, n_pulses, channels)
    for name, centres in (('tx_m', tx_m), ('rx_m', rx_m)):
        if centres is not None and centres.shape != (*samples.shape[:2], 3):
            _refuse_positions(name, centres.shape, samples.shape)


def _refuse_samples(shape: tuple[int, ...], n_pulses: int, channels: int | None) -> None:
    text = f'samples.shape={shape} is for {shape[0]} pulses, stamp_ns has {n_pulses}'
    if n_pulses in shape[1:]:
        pulse_axis = 2 if shape[2] == n_pulses else 1
        others = [axis for axis in range(3) if axis != pulse_axis]
        if channels is not None and shape[others[0]] != channels == shape[others[1]]:
            others.reverse()
        elif channels is None and shape[others[0]] > shape[others[1]]:
            others.reverse()  # channels are fewer than samples
        order = (pulse_axis, *others)
        text += (f': the samples are transposed; expected (pulses, channels, samples), pass '
                 f'samples.transpose{order}')
    else:
        text += '; pass one stamp and one row of samples per pulse'
    raise ValueError(text)


def _refuse_positions(name: str, shape: tuple[int, ...], samples_shape: tuple[int, ...]) -> None:
    pulses, channels, n = samples_shape
    expected = (pulses, channels, 3)
    text = f'{name}.shape={shape} does not match samples.shape={samples_shape}; '
    if shape == (pulses, 3):
        advice = f'positions of one channel are {name}[:, None]'
    elif len(shape) == 3 and shape[::2] == (pulses, 3) and shape[1] == n != channels:
        advice = ('channels and samples are transposed: pass samples.transpose(0, 2, 1)')
    elif len(shape) in (2, 3) and shape[-1] == 3 and shape[0] < pulses:
        advice = (f'{pulses - shape[0]} of {pulses} pulses have no position: give every pulse '
                  'its own, interpolated at its time')
    elif len(shape) in (2, 3) and shape[0] == 3:
        advice = f'{name} is transposed: x, y, z come last'
    else:
        advice = 'one position per pulse and channel is needed'
    raise ValueError(f'{text}expected {expected}: {advice}')


def check_positions(tx_m: np.ndarray, rx_m: np.ndarray) -> None:
    """Raise ValueError when a phase centre is NaN or infinite; names the pulses."""
    if np.isfinite(tx_m).all() and np.isfinite(rx_m).all():
        return
    bad = ~(np.isfinite(tx_m) & np.isfinite(rx_m)).all(axis=(1, 2))
    raise ValueError(f'phase centres of {np.count_nonzero(bad)} of {len(bad)} pulses contain NaN '
                     f'or infinity (pulses {describe_counters(np.flatnonzero(bad).tolist())} of '
                     'the block); every pulse needs a finite transmit and receive position')


def sound_pulses(samples: np.ndarray) -> np.ndarray:
    """(P,) bool: pulses that images may be made of; one of another kind would spoil all of it.

    Their energy, of samples (P, C, N) complex64, is a finite number and so is that of an image.
    """
    values = np.ascontiguousarray(samples).view(np.float32)
    with np.errstate(over='ignore', invalid='ignore'):
        return np.einsum('pcn,pcn->p', values, values) < _MOST_ENERGY


def check_samples(samples: np.ndarray, counter: np.ndarray) -> None:
    """Raise ValueError when a sample is NaN or infinite; counts them and names the pulses.

    Parameters
    ----------
    samples : (P, C, N) complex64
        Samples.
    counter : (P,) uint32
        Numbers of the pulses, for the message.
    """
    if not samples.size or are_finite(samples):
        return
    finite = np.isfinite(to_host(samples))
    bad = ~finite.all(axis=(1, 2))
    raise ValueError(
        f'{np.count_nonzero(~finite)} of {finite.size} samples are NaN or infinite, in '
        f'{np.count_nonzero(bad)} of {len(bad)} pulses '
        f'({describe_counters([int(c) for c in counter[bad]])}); leave these out: '
        'block.select(np.isfinite(block.samples).all(axis=(1, 2)))')


@dataclasses.dataclass(frozen=True)
class PulseBlock:
    """Pulses of one radar with everything needed to image them.

    Raw samples follow the waveform; compressed samples follow the signal model
    ``s(tau) = sum_p a_p p(tau - tau_p) exp(-j 2 pi f_c tau_p)`` (Rosenberg & Gray, section 2).

    Parameters
    ----------
    radar : RadarParameters
        Waveform and sampling, the same for all pulses and channels.
    compressed : bool
        True when the samples are range profiles.
    stamp_ns : (P,) int64
        Transmission time of each pulse, nanoseconds since the epoch of the clock in use.
    counter : (P,) uint32
        Running number that the radar gave each pulse; gaps mean lost pulses.
    samples : (P, C, N) complex64
        Fast-time samples of each pulse and channel; an array of CuPy stays on its device.
    tx_m, rx_m : (P, C, 3) float64 or None
        Transmit and receive phase centre of each pulse and channel in the imaging frame,
        metres; None when positions come from elsewhere.
    frame : str
        Name of the imaging frame; empty where the sender does not tell.
    pointing : Pointing or None
        Where the antenna looked at each pulse, in the imaging frame; None where nobody tells.

    Raises
    ------
    ValueError
        Shapes disagree, only one of the position arrays is given, a position is not finite, times
        are no integers, all pulses have the same number, or the pointing is for other pulses. The
        text names what was probably meant: seconds, transposed samples, positions left out.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import PulseBlock, RadarParameters
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6.6e-6)
    >>> track = np.zeros((3, 1, 3))
    >>> track[:, 0, 1] = [-0.3, 0.0, 0.3]  # three pulses along y
    >>> block = PulseBlock(radar, compressed=True, stamp_ns=np.arange(3) * 1_500_000,
    ...                    counter=np.arange(3), samples=np.ones((3, 1, 126)), tx_m=track,
    ...                    rx_m=track)
    >>> block.n_pulses, block.n_channels, block.n_samples, block.samples.dtype.name
    (3, 1, 126, 'complex64')
    >>> block.select(slice(1, 3)).phase_centre_m.tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.3, 0.0]]
    """

    radar: RadarParameters
    compressed: bool
    stamp_ns: np.ndarray
    counter: np.ndarray
    samples: np.ndarray
    tx_m: np.ndarray | None = None
    rx_m: np.ndarray | None = None
    frame: str = ''
    pointing: Pointing | None = None

    def __post_init__(self) -> None:
        if (self.tx_m is None) != (self.rx_m is None):
            raise ValueError('tx_m and rx_m must be given together or not at all')
        fields = {'stamp_ns': integer_stamps(self.stamp_ns),
                  'counter': running_counters(self.counter),
                  'samples': complex_samples(self.samples)}
        if self.has_positions:
            fields |= {name: np.asarray(getattr(self, name), np.float64)
                       for name in ('tx_m', 'rx_m')}
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        check_counted(self.counter, self.stamp_ns)
        check_shapes(self.samples, len(self.stamp_ns), self.tx_m, self.rx_m)
        if self.tx_m is not None and self.rx_m is not None:
            check_positions(self.tx_m, self.rx_m)
        if self.pointing is not None and len(self.pointing) != self.n_pulses:
            raise ValueError(f'pointing is for {len(self.pointing)} pulses, the block has '
                             f'{self.n_pulses}; give every pulse its boresight')

    @property
    def n_pulses(self) -> int:
        """Number of pulses P."""
        return self.samples.shape[0]

    @property
    def n_channels(self) -> int:
        """Number of channels C."""
        return self.samples.shape[1]

    @property
    def n_samples(self) -> int:
        """Number of fast-time samples N."""
        return self.samples.shape[2]

    @property
    def has_positions(self) -> bool:
        """True when phase centres travel with the pulses."""
        return self.tx_m is not None

    @property
    def centres_m(self) -> tuple[np.ndarray, np.ndarray]:
        """`tx_m` and `rx_m`, of pulses that need them.

        Raises
        ------
        ValueError
            The pulses have none.
        """
        if self.tx_m is None or self.rx_m is None:
            raise ValueError('the pulses have no phase centres; give tx_m and rx_m to the block')
        return self.tx_m, self.rx_m

    @property
    def phase_centre_m(self) -> np.ndarray:
        """(P, 3) float64 mean of all transmit and receive phase centres of each pulse, metres.

        Raises
        ------
        ValueError
            The pulses have none.
        """
        return mean_centres(*self.centres_m)

    def select(self, index: Any) -> PulseBlock:
        """Pulses at `index` (slice, mask or integers along the pulse axis) as a block."""
        def pick(a: np.ndarray | None) -> np.ndarray | None:
            return None if a is None else a[index]

        there = index if isinstance(index, slice) else beside(np.asarray(index), self.samples)
        return dataclasses.replace(
            self, stamp_ns=self.stamp_ns[index], counter=self.counter[index],
            samples=self.samples[there], tx_m=pick(self.tx_m), rx_m=pick(self.rx_m),
            pointing=None if self.pointing is None else self.pointing.select(index))

    def matches(self, other: PulseBlock) -> bool:
        """True when `other` is of the same radar, frame, channels and samples."""
        return (self.radar == other.radar and self.compressed == other.compressed
                and self.frame == other.frame
                and self.samples.shape[1:] == other.samples.shape[1:]
                and self.has_positions == other.has_positions
                and (self.pointing is None) == (other.pointing is None))

    def difference(self, other: PulseBlock) -> str:
        """Words on what of radar, frame, channels and samples is another in `other`."""
        before, after = ({f.name: getattr(block.radar, f.name)
                          for f in dataclasses.fields(block.radar)} | {
            'compressed': block.compressed, 'frame': block.frame, 'channels': block.n_channels,
            'samples': block.n_samples, 'positions': block.has_positions,
            'pointing': block.pointing is not None} for block in (self, other))
        return 'the pulses have changed: ' + ', '.join(
            f'{name} from {before[name]} to {after[name]}' for name in before
            if before[name] != after[name])


def concatenate(blocks: Sequence[PulseBlock]) -> PulseBlock:
    """Join blocks of the same radar along the pulse axis, in the order given.

    Parameters
    ----------
    blocks : sequence of PulseBlock
        Blocks, in the order of their pulses.

    Returns
    -------
    PulseBlock
        All their pulses, on the device where the first ones lie there.

    Raises
    ------
    ValueError
        There is no block, or the blocks do not match.

    Examples
    --------
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.simulation import SCENARIOS
    >>> blocks = list(SCENARIOS['psf']().blocks(pulses_per_block=25))
    >>> len(blocks), blocks[0].n_pulses, concatenate(blocks).n_pulses
    (8, 25, 200)
    """
    if not blocks:
        raise ValueError('concatenate needs at least one block')
    first = blocks[0]
    if len(blocks) == 1:
        return first
    if not all(first.matches(b) for b in blocks[1:]):
        raise ValueError('blocks differ in radar parameters, frame, channels or samples; '
                         'concatenate blocks of one configuration only')

    def join(name: str) -> np.ndarray:
        return np.concatenate([getattr(b, name) for b in blocks])

    positions: dict[str, Any] = {}
    if first.has_positions:
        positions = {'tx_m': join('tx_m'), 'rx_m': join('rx_m')}
    if first.pointing is not None:
        positions['pointing'] = first.pointing.join(
            [b.pointing for b in blocks if b.pointing is not None])
    samples = np.concatenate([alike(b.samples, first.samples) for b in blocks])
    return dataclasses.replace(first, stamp_ns=join('stamp_ns'), counter=join('counter'),
                               samples=samples, **positions)


def check_frame(block: PulseBlock, frame: str) -> None:
    """Check that phase centres are in the frame that the grid is in.

    Parameters
    ----------
    block : PulseBlock
        Pulses with phase centres; one that names no frame passes.
    frame : str
        Name of the grid's frame.

    Raises
    ------
    ValueError
        The block names another frame.

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging.signal.pulses import check_frame
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = dataclasses.replace(next(SCENARIOS['psf']().blocks(1)), frame='odom')
    >>> check_frame(block, 'odom')
    >>> check_frame(block, 'map')
    Traceback (most recent call last):
        ...
    ValueError: the phase centres are in frame 'odom', the image grid is in ...
    """
    if block.has_positions and block.frame and block.frame.lstrip('/') != frame.lstrip('/'):
        raise ValueError(f'the phase centres are in frame {block.frame!r}, the image grid is in '
                         f'frame_id={frame!r}; set frame_id to the same frame in all nodes, with '
                         'the grid in it, or send positions in that of the grid')


def check_profiles(block: PulseBlock, radar: RadarParameters, n_samples: int, *,
                   compressed: bool = True) -> None:
    """Check that a block holds what an imager was planned for.

    Parameters
    ----------
    block : PulseBlock
        Pulses.
    radar : RadarParameters
        For which the imager was planned.
    n_samples : int
        Samples of a pulse for which it was planned.
    compressed : bool
        Whether range profiles are expected.

    Raises
    ------
    ValueError
        The pulses are raw where profiles are expected or the other way round, have no phase
        centres, are of another radar or length, or hold samples that are not finite.

    Examples
    --------
    >>> from sar_imaging.signal.pulses import check_profiles
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(2))
    >>> check_profiles(block, block.radar, block.n_samples)
    >>> check_profiles(block, block.radar, block.n_samples, compressed=False)
    Traceback (most recent call last):
        ...
    ValueError: the block holds range profiles; this plan is for raw pulses
    """
    if compressed and not block.compressed:
        raise ValueError('the block holds raw pulses; apply range compression first')
    if block.compressed and not compressed:
        raise ValueError('the block holds range profiles; this plan is for raw pulses')
    if not block.has_positions:
        raise ValueError('the block has no phase centres; backprojection needs the transmit '
                         'and receive position of every pulse and channel')
    if block.radar != radar or block.n_samples != n_samples:
        raise ValueError(f'the block has {block.n_samples} samples of {block.radar}; this '
                         f'plan is for {n_samples} samples of {radar}')
    check_samples(block.samples, block.counter)
