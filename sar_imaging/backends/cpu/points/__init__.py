"""Exact backprojection onto arbitrary points: `images` prepares, `kernels` adds the pulses.

`transposed_loads` reads the profiles of neighbouring points into whole vectors.
"""
