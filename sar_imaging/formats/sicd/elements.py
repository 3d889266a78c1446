"""The values of SICD's XML as elements: vectors, polynomials, dates."""

from __future__ import annotations

import datetime

import numpy as np

from ..extras import require


class Elements:
    """Makes elements of one version of SICD.

    Parameters
    ----------
    namespace : str
        Such as ``'urn:SICD:1.3.0'``.
    """

    def __init__(self, namespace: str):
        self._etree, self._namespace = require('lxml.etree', 'writing SICD'), namespace

    def __call__(self, name: str, /, *content, **attributes):
        """Element of a text, a number, a flag, a date, or of elements; None is left out."""
        element = self._etree.Element(f'{{{self._namespace}}}{name}',
                                      {key: str(value) for key, value in attributes.items()},
                                      nsmap={None: self._namespace})
        for part in content:
            if isinstance(part, self._etree._Element):
                element.append(part)
            elif part is not None:
                element.text = _text(part)
        return element

    def vector(self, name: str, value, axes=('X', 'Y', 'Z'), **attributes):
        """Element of the components of a vector."""
        return self(name, *(self(axis, float(part)) for axis, part in zip(axes, value,
                                                                         strict=True)),
                    **attributes)

    def pixel(self, name: str, row: int, column: int, **attributes):
        """Element of a row and a column."""
        return self(name, self('Row', int(row)), self('Col', int(column)), **attributes)

    def polynomial(self, name: str, coefficients, **attributes):
        """Element of a polynomial in one or two variables, by the power of each."""
        coefficients = np.asarray(coefficients, np.float64)
        orders = {f'order{axis + 1}': n - 1 for axis, n in enumerate(coefficients.shape)}
        return self(name, *(
            self('Coef', float(value), **{f'exponent{axis + 1}': power
                                          for axis, power in enumerate(powers)})
            for powers, value in np.ndenumerate(coefficients)), **orders, **attributes)

    def path(self, name: str, coefficients, **attributes):
        """Element of a polynomial (3, n) for each coordinate."""
        return self(name, *(self.polynomial(axis, part) for axis, part in zip(
            'XYZ', coefficients, strict=True)), **attributes)

    def indexed(self, name: str, children):
        """Element that tells the number of its children."""
        return self(name, *children, size=len(children))


def _text(value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, datetime.datetime):
        return value.strftime('%Y-%m-%dT%H:%M:%S.%fZ')
    return repr(float(value)) if isinstance(value, float) else str(value)
