"""What is computed for an image, with which error and at which cost, before any pulse is touched.

Plans are float64 NumPy and know no processor; `sar_imaging.backends` computes them.

- `exact`: backprojection along the lines of a map, over a polar image, or point by point;
- `afbp`: sub-apertures, their beams and polar grids, and what the fusion of their spectra costs;
- `baselines`: methods for comparison, fast factorised backprojection among them;
- `profiles`: the part of the range profiles that an image needs, and how finely it is resampled;
- `polar_cover`, `polar_to_map`: the polar grid that covers a map, and how the map is read from it;
- `interpolators`, `aliasing_error`, `local_spectrum`, `echo_power`, `error_budget`: the error;
- `costs`, `memory`: nanoseconds and bytes.
"""
