"""How an aperture is cut into sub-apertures, told from those that came."""

from __future__ import annotations

from .subaperture_image import SubapertureImage


class SubapertureCut:
    """How many pulses the sub-apertures of an aperture have: all alike, but for a shorter last.

    Parameters
    ----------
    n_parts : int
        Sub-apertures of an aperture.
    """

    def __init__(self, n_parts: int):
        self._n = n_parts
        self._usual = self._last = 0  # 0 while unknown

    def learn(self, sub: SubapertureImage) -> None:
        """Take note of a sub-aperture: counters of pulses tell where its aperture begins."""
        length, part, before = sub.n_pulses + sub.n_missing, sub.number % self._n, self._n - 1
        if part < before or not before:
            self._usual = length
            if sub.aperture and not self._last:
                aperture = (sub.first_counter - part * length) // sub.aperture
                self._last = min(max(aperture - before * length, 0), length)
        else:
            self._last = length
            if not self._usual:
                self._usual = max(length, (sub.first_counter - sub.aperture * length)
                                  // ((sub.aperture + 1) * before))

    def start(self, number: int) -> int:
        """First pulse of a sub-aperture, from the first one of sub-aperture 0."""
        aperture, part = divmod(number, self._n)
        whole = (self._n - 1) * self._usual + (self._last or self._usual)
        return aperture * whole + part * self._usual
