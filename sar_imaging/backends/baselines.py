"""What backends may offer besides their four entries: methods that images are compared with.

Signatures and formulas are those of `backends.reference`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np

    from ..geometry.illumination import Illumination
    from ..planning.baselines.ffbp import FfbpPlan
    from ..planning.baselines.wavenumber import WavenumberPlan
    from ..planning.baselines.zero_padding import ZeroPaddingPlan
    from ..signal.pulses import PulseBlock
    from ..signal.radar import RadarParameters


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

    def correlate_spectra(self, cycles_per_m: tuple[float, float], spectra: np.ndarray,
                          tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray,
                          illumination: Illumination | None = None) -> np.ndarray:
        """Time-domain correlation of spectra, (N,) complex128 at points (N, 3)."""

    def correlate_profiles(self, radar: RadarParameters, samples: np.ndarray, tx_m: np.ndarray,
                           rx_m: np.ndarray, points_m: np.ndarray, half: int, sharpness: float,
                           illumination: Illumination | None = None
                           ) -> tuple[np.ndarray, np.ndarray]:
        """Time-domain correlation of profiles at points, and which of these they cover."""

    def image_zero_padded(self, plan: ZeroPaddingPlan, block: PulseBlock) -> np.ndarray:
        """Image of zero-padded profiles, complex64."""

    def image_wavenumber(self, plan: WavenumberPlan, block: PulseBlock) -> np.ndarray:
        """Image of the pulses of the planned aperture in the wavenumber domain, complex64."""
