"""Predict phase centres by continuing the track of the pulses received so far."""

from __future__ import annotations

import numpy as np

_LEAST_FOR_CURVE = 8  # pulses
_SHARE_FOR_CURVE = 0.25  # of the wanted length that must be known to tell a curve from noise
_PATTERN = 16  # pulses in which antennas that take turns come round


def predict_track(known, tx_m, rx_m, wanted) -> tuple[np.ndarray, np.ndarray]:
    """Carry phase centres on, from some pulses to others.

    A line, or a parabola once enough is known, through each coordinate of the latest pulses; what
    it leaves over, such as vibration or antennas that take turns, is repeated.

    Parameters
    ----------
    known : (K,) int array
        Numbers of the known pulses, ascending.
    tx_m, rx_m : (K, C, 3) float64
        Their phase centres, metres.
    wanted : (W,) int array
        Numbers of the wanted pulses.

    Returns
    -------
    tx_m, rx_m : (W, C, 3) float64
        Metres; of known pulses as given.

    Raises
    ------
    ValueError
        Nothing is known.
    """
    known, wanted = np.asarray(known, np.int64), np.asarray(wanted, np.int64)
    if not len(known):
        raise ValueError('no phase centre is known; expected at least that of one pulse')
    values = np.concatenate([np.asarray(a, float).reshape(len(known), -1) for a in (tx_m, rx_m)],
                            axis=1)
    _, at, source = np.intersect1d(wanted, known, assume_unique=True, return_indices=True)
    given = values[source]
    latest = known > known[-1] - len(wanted)
    known, values = known[latest], values[latest]
    origin, span = known[-1], max(int(np.ptp(known)), 1)
    basis = _basis((known - origin) / span, _order(known, wanted))
    coefficients = np.linalg.lstsq(basis, values, rcond=None)[0]
    left = values - basis @ coefficients
    # the residual of the pulse a whole number of patterns before
    count = span + 1
    period = count // _PATTERN * _PATTERN or count
    like = known[0] + count - period + (wanted - known[0] - count) % period
    near = np.clip(np.searchsorted(known, like), 0, len(known) - 1)
    result = (_basis((wanted - origin) / span, basis.shape[1] - 1) @ coefficients) + left[near]
    result[at] = given
    shape = (2, len(wanted), *np.shape(tx_m)[1:])
    half = result.shape[1] // 2
    return tuple(np.stack([result[:, :half], result[:, half:]]).reshape(shape))


def _order(known, wanted) -> int:
    if len(known) == 1:
        return 0
    enough = np.ptp(known) >= _SHARE_FOR_CURVE * np.ptp(wanted)
    return 2 if enough and len(known) >= _LEAST_FOR_CURVE else 1


def _basis(t, order: int) -> np.ndarray:
    return np.asarray(t, float)[:, None] ** np.arange(order + 1)
