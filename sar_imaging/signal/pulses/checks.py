"""Check the arrays of a pulse block; each error says what was probably meant."""

from __future__ import annotations

import numpy as np

from ...device_arrays import are_finite, on_device, to_host
from .sequence import COUNTER_MASK, describe_counters

_MOST_SECONDS = 1e11  # of times since any epoch


def integer_stamps(stamp_ns) -> np.ndarray:
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


def running_counters(counter) -> np.ndarray:
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


def complex_samples(samples):
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


def _refuse_samples(shape, n_pulses: int, channels: int | None) -> None:
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


def _refuse_positions(name: str, shape, samples_shape) -> None:
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
