"""Exact backprojection onto arbitrary points: `kernels` adds the pulses.

`transposed_loads` reads the profiles of neighbouring points into whole vectors.
"""
