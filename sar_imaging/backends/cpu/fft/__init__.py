"""Fourier transforms of many rows or columns at once, in place, in the registers of the processor.

`rows` and `columns` are the entries, `butterflies` and `vector_passes` what they are made of.
SciPy transforms what they do not, and everything where the environment says so (`choice`).
"""
