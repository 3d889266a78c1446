"""Look for faults in raw pulses themselves: samples, times and channels, before any image.

- `samples`: clipping, missing or unequal I and Q, the order of I and Q, pulses cut short, bursts;
- `timing`: lost pulses, stamps of receipt, stamps of whole frames;
- `channels`: dead, equal and unbalanced channels;
- `slope`: chirps that another slope compresses better;
- `coupling`: an echo that does not move with the platform.
"""

from .channels import channel_findings
from .coupling import coupling_findings
from .finding import CERTAIN, LIKELY, ONE_OF_SEVERAL, Finding
from .samples import sample_findings
from .slope import slope_findings
from .timing import timing_findings

__all__ = ['CERTAIN', 'LIKELY', 'ONE_OF_SEVERAL', 'Finding', 'channel_findings',
           'coupling_findings', 'sample_findings', 'slope_findings', 'timing_findings']
