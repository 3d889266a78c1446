"""Range compression of every waveform: matched filter, phase history, passband, to profiles."""

from .compressor import RANGE_FILTERS, RangeCompressor

__all__ = ['RANGE_FILTERS', 'RangeCompressor']
