"""Formats that radar engineers exchange, and where on the Earth their images are.

The libraries that read and write them are an extra, ``pip install sar_imaging[formats]``; nothing
else in the package needs them.
"""

from .extras import MissingExtraError, require

__all__ = ['MissingExtraError', 'require']
