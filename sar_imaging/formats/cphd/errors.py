"""The one exception of files that cannot be read or written as CPHD."""

class CphdError(ValueError):
    """A file is no CPHD, is damaged, or holds what cannot be imaged; or pulses are no CPHD.

    Examples
    --------
    >>> from sar_imaging.formats.cphd import CphdError, CphdReader
    >>> with open('notes.cphd', 'w') as file:
    ...     _ = file.write('no phase histories')
    >>> try:
    ...     CphdReader('notes.cphd')
    ... except CphdError as error:
    ...     print(error)
    notes.cphd is no CPHD: it begins with b'no phase histori', not with b'CPHD/1.1.0'
    """
