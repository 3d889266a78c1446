"""What is wrong with a recording: `Finding`."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Finding:
    """One fault of a recording.

    Parameters
    ----------
    fault : str
        Its name, the same for all recordings: ``'clipping'``.
    evidence : str
        What was measured, a sentence with figures.
    advice : str
        What to change, a sentence.

    Examples
    --------
    >>> from sar_imaging.diagnosis.signals import Finding
    >>> finding = Finding('clipping', '3 % of the samples lie at the end of the scale',
    ...                   'lower the gain of the receiver')
    >>> print(finding)
    clipping: 3 % of the samples lie at the end of the scale. Lower the gain of the receiver.
    """

    fault: str
    evidence: str
    advice: str

    def __str__(self) -> str:
        return f'{self.fault}: {self.evidence}. {self.advice[0].upper()}{self.advice[1:]}.'
