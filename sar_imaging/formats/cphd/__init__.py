# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Compensated phase history data (CPHD 1.0.1 and 1.1.0, NGA.STND.0068): reader and writer.

- `CphdReader`: the vectors of a file as blocks of pulses, in chunks of bounded memory;
- `write_cphd`: a stream of blocks as a file that the standard's checker accepts;
- `Collection`: names and kinds that a file has to tell and samples do not;
- `CphdError`: raised for every file that cannot be read, and for pulses that cannot be written.

Needs sarkit, of the extra ``formats``.
"""

from .collection import Collection
from .container import CphdError
from .reader import CphdReader
from .writer import write_cphd

__all__ = ['Collection', 'CphdError', 'CphdReader', 'write_cphd']
