"""What is wrong with a recording: `Finding`."""

from __future__ import annotations

import dataclasses

CERTAIN = 'certain'
LIKELY = 'likely'
ONE_OF_SEVERAL = 'one of several explanations that are as good'


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
    compared : str
        What else would look like it, and was looked for.
    sure : str
        ``'certain'``, ``'likely'`` where another cause is possible, or that it is one of several
        explanations that are as good.
    sizes : tuple of float
        Of the fault, where it was measured: offset of a clock in seconds, rate of a clock, factor
        of a slope, lever arm in metres.

    Examples
    --------
    >>> from sar_imaging.diagnosis.signals import Finding
    >>> finding = Finding('clipping', '3 % of the samples lie at the end of the scale',
    ...                   'lower the gain of the receiver', 'echoes that are strong')
    >>> print(finding)
    clipping: 3 % of the samples lie at the end of the scale. Compared with echoes that are
    strong: certain. Lower the gain of the receiver.
    """

    fault: str
    evidence: str
    advice: str
    compared: str = ''
    sure: str = CERTAIN
    sizes: tuple[float, ...] = ()

    def __str__(self) -> str:
        compared = f'Compared with {self.compared}: {self.sure}. ' if self.compared else ''
        advice = f'{self.advice[0].upper()}{self.advice[1:]}.'
        return f'{self.fault}: {self.evidence}. {compared}{advice}'
