"""Range compression of all waveforms: matched filter, phase history and passband samples."""

from .compressor import RANGE_FILTERS, RangeCompressor

__all__ = ['RANGE_FILTERS', 'RangeCompressor']
