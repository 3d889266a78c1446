"""What backends may offer besides their four entries: published methods, for comparison.

Signatures and formulas are those of `backends.reference`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np

    from ..planning.baselines.ffbp import FfbpPlan
    from ..planning.baselines.wavenumber import WavenumberPlan
    from ..planning.baselines.zero_padding import ZeroPaddingPlan
    from ..signal.pulses import PulseBlock


class FactorisedImager(Protocol):
    """Forms images by one plan of fast factorised backprojection.

    Attributes
    ----------
    plan : FfbpPlan
        As given.
    """

    plan: FfbpPlan

    def image(self, block: PulseBlock, *, progress: bool = False) -> np.ndarray:
        """Image of the range profiles of the planned aperture, complex64, with the carrier."""


class Baselines(Protocol):
    """Entries for comparison; a backend may lack any of them."""

    def FactorisedImager(self, plan: FfbpPlan) -> FactorisedImager:
        """Fast factorised backprojection by a plan."""

    def image_zero_padded(self, plan: ZeroPaddingPlan, block: PulseBlock) -> np.ndarray:
        """Image of zero-padded profiles, complex64."""

    def image_wavenumber(self, plan: WavenumberPlan, block: PulseBlock) -> np.ndarray:
        """Image of the pulses of the planned aperture in the wavenumber domain, complex64."""
