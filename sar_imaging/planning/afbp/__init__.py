"""Plans of accelerated fast backprojection (AFBP): sub-apertures, their grids, beams and errors.

`aperture_cut` and `sampling` cut the aperture, `subapertures` plans their images, `beams` with
`beam_geometry` and `beam_gain` those that come from beams, `polar_grids` the fusion.
"""
