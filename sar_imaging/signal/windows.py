# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Spectral weighting: trades the width of the main lobe against the height of the sidelobes.

A window is named by a string, so that it can be a ROS parameter or a command-line option:
``'none'``, ``'hamming'``, ``'hann'``, ``'taylor'`` or ``'taylor:NBAR:SIDELOBE_DB'``, ``'kaiser'``
or ``'kaiser:BETA'``. Responses for a band of width B:
width of the main lobe at -3 dB and distance of its first null from the peak in units of 1/B,
highest sidelobe, and the loss of signal to noise ratio against no window.

=========== ====== ========== ========= ==========================================
name        -3 dB  first null sidelobe  remark
=========== ====== ========== ========= ==========================================
none        0.886  1.00       -13.3 dB  no loss of signal to noise
hamming     1.303  2.00       -42.7 dB  loses 1.34 dB; sidelobes level off
hann        1.441  2.00       -31.5 dB  loses 1.76 dB; sidelobes fall 18 dB per octave
taylor:4:35 1.184  1.66       -35.2 dB  loses 0.91 dB; designed sidelobe level
kaiser:6    1.402  2.16       -43.8 dB  loses 1.66 dB; beta 0 is 'none', more is lower
=========== ====== ========== ========= ==========================================
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_FROM_EDGE_TO_EDGE: dict[str, Callable[..., np.ndarray]] = {
    'hamming': np.hamming, 'hann': np.hanning, 'kaiser': np.kaiser}
_DEFAULTS = {'none': (), 'hamming': (), 'hann': (), 'taylor': (4.0, 35.0), 'kaiser': (6.0,)}
WINDOW_NAMES = tuple(_DEFAULTS)


def parse_window(name: str) -> tuple[str, tuple[float, ...]]:
    """Family and parameters of a window by its name, such as ``'taylor:4:35'``.

    Parameters
    ----------
    name : str
        Such as ``'hamming'``, ``'taylor:4:35'`` (number of nearly equal sidelobes, sidelobe level
        below the peak in dB) or ``'kaiser:6'`` (shape parameter beta).

    Returns
    -------
    family : str
        One of `WINDOW_NAMES`.
    parameters : tuple of float
        ``(nbar, sidelobe_db)`` for Taylor, ``(beta,)`` for Kaiser, empty otherwise.

    Raises
    ------
    ValueError
        The family is unknown, or its parameters are of the wrong number or out of range.

    Examples
    --------
    >>> from sar_imaging.signal.windows import parse_window
    >>> parse_window('taylor')
    ('taylor', (4.0, 35.0))
    >>> parse_window('kaiser:6')
    ('kaiser', (6.0,))
    """
    family, *given = name.split(':')
    if family not in _DEFAULTS:
        raise ValueError(f'window={name!r} is unknown; use one of {", ".join(WINDOW_NAMES)}, '
                         'for example taylor:4:35 or kaiser:6')
    defaults = _DEFAULTS[family]
    if len(given) > len(defaults):
        raise ValueError(f'window={name!r} has {len(given)} parameters; {family} takes '
                         f'{len(defaults)}')
    try:
        values = tuple(float(v) for v in given)
    except ValueError:
        raise ValueError(f'window={name!r}: parameters must be numbers, such as '
                         'taylor:4:35') from None
    values += defaults[len(values):]
    _check_range(name, family, values)
    return family, values


def _check_range(name: str, family: str, values: tuple[float, ...]) -> None:
    if not np.isfinite(values).all():
        raise ValueError(f'window={name!r}: parameters must be finite')
    if family == 'taylor' and (values[0] < 1 or values[0] % 1 or values[1] <= 0):
        raise ValueError(f'window={name!r}: NBAR must be a positive whole number and SIDELOBE_DB '
                         'positive (35 means 35 dB below the peak)')
    if family == 'kaiser' and values[0] < 0:
        raise ValueError(f'window={name!r}: BETA must not be negative')


def window(name: str, n: int) -> np.ndarray:
    """Weights of a spectral window over `n` adjoining frequency bins that fill the band.

    The continuous window spans the band from the lower edge of the first bin to the upper edge
    of the last and is sampled at the bins' middles, so that ``'none'`` has exactly the width
    ``n`` bins and no weight is lost at the edges.

    Parameters
    ----------
    name : str
        See `parse_window`.
    n : int
        Number of bins.

    Returns
    -------
    (n,) float64
        Symmetric weights with maximum 1 in the middle of the band (n odd).

    Raises
    ------
    ValueError
        `name` is not a window, or `n` is not positive.

    Examples
    --------
    >>> from sar_imaging.signal.windows import window
    >>> window('hamming', 5).round(3).tolist()
    [0.168, 0.682, 1.0, 0.682, 0.168]
    """
    family, values = parse_window(name)
    if n < 1:
        raise ValueError(f'n={n}; a window needs at least one bin')
    if family == 'none':
        return np.ones(n)
    if family == 'taylor':
        # takes over half a second to import, for which other windows need not wait
        from scipy.signal import windows as scipy_windows
        # sampled at the middles of the bins already
        return scipy_windows.taylor(n, nbar=int(values[0]), sll=values[1])
    # Of 2n + 1 points from edge to edge, those with odd index are the middles of n bins.
    return _FROM_EDGE_TO_EDGE[family](2 * n + 1, *values)[1::2]
