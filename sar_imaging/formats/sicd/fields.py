"""Values of SICD's XML by their place, each checked where it is read."""

from __future__ import annotations

import datetime
import math

import numpy as np

_HIGHEST_POWER = 30  # of a polynomial; no standard product exceeds 15


class Fields:
    """Elements of a SICD of any version.

    Parameters
    ----------
    root : lxml element
        Of the XML.
    """

    def __init__(self, root):
        self._root = root

    def find(self, path: str):
        """Element at a path such as ``'Grid/Row'``; None where there is none."""
        return self._root.find('/'.join(f'{{*}}{name}' for name in path.split('/')))

    def text(self, path: str, default: str | None = None) -> str:
        """Text at a path.

        Raises
        ------
        ValueError
            There is none, and no default.
        """
        element = self.find(path)
        text = (element.text or '').strip() if element is not None else ''
        if text:
            return text
        if default is None:
            raise ValueError(f'its XML has no {path}, which SICD prescribes')
        return default

    def number(self, path: str, default: float | None = None) -> float:
        """Finite number at a path.

        Raises
        ------
        ValueError
            There is none, and no default, or it is none.
        """
        if default is not None and self.find(path) is None:
            return default
        return _number(path, self.text(path))

    def integer(self, path: str, least: int, most: int = 2**31 - 1) -> int:
        """Whole number within bounds."""
        value = self.number(path)
        if value != round(value) or not least <= value <= most:
            raise ValueError(f'{path}={value:g}; expected a whole number of {least} to {most}')
        return int(value)

    def vector(self, path: str, axes=('X', 'Y', 'Z')) -> np.ndarray:
        """(3,) float64 vector."""
        return np.array([self.number(f'{path}/{axis}') for axis in axes])

    def unit_vector(self, path: str) -> np.ndarray:
        """(3,) float64 vector of length one."""
        vector = self.vector(path)
        length = np.linalg.norm(vector)
        if abs(length - 1) > 1e-3:
            raise ValueError(f'{path} has the length {length:g}; expected a unit vector')
        return vector / length

    def path(self, path: str) -> np.ndarray:
        """(3, n) float64 coefficients of a polynomial for each coordinate."""
        parts = [self._polynomial(f'{path}/{axis}') for axis in 'XYZ']
        n = max(map(len, parts))
        return np.stack([np.pad(part, (0, n - len(part))) for part in parts])

    def _polynomial(self, path: str) -> np.ndarray:
        element = self.find(path)
        if element is None:
            raise ValueError(f'its XML has no {path}, which SICD prescribes')
        out = np.zeros(_HIGHEST_POWER + 1)
        for child in element:
            power = _number(f'exponent in {path}', child.get('exponent1', ''))
            if power not in range(_HIGHEST_POWER + 1):
                raise ValueError(f'{path} has a coefficient of power {power:g}; expected 0 to '
                                 f'{_HIGHEST_POWER}')
            out[int(power)] = _number(path, child.text or '')
        last = np.flatnonzero(out)
        return out[:last[-1] + 1] if len(last) else out[:1]

    def date(self, path: str) -> datetime.datetime:
        """Date and time, UTC; digits beyond the microsecond are left out."""
        text = self.text(path).removesuffix('Z')
        whole, _, fraction = text.partition('.')
        try:
            date = datetime.datetime.fromisoformat(f'{whole}.{fraction[:6]:0<6}')
        except ValueError:
            raise ValueError(f'{path}={text!r}; expected a date such as '
                             '2026-01-31T12:00:00.000000Z') from None
        return date.replace(tzinfo=datetime.timezone.utc)

    def parameter(self, name: str) -> str | None:
        """Text of a parameter of the collection; None where there is none of this name."""
        for element in self._root.findall('{*}CollectionInfo/{*}Parameter'):
            if element.get('name') == name:
                return element.text
        return None

    def table(self, path: str) -> np.ndarray | None:
        """(256,) float64 amplitudes by their index; None where there is no such table."""
        element = self.find(path)
        if element is None:
            return None
        out = np.full(256, np.nan)
        for child in element:
            index = _number(f'index in {path}', child.get('index', ''))
            if index in range(256):
                out[int(index)] = _number(path, child.text or '')
        if np.isnan(out).any():
            raise ValueError(f'{path} has {np.isnan(out).sum()} gaps; expected 256 amplitudes')
        return out


def _number(path: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f'{path}={text[:40]!r}; expected a number') from None
    if not math.isfinite(value):
        raise ValueError(f'{path}={text[:40]}; expected a finite number')
    return value
