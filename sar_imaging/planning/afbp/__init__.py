"""Plans of accelerated fast backprojection (AFBP): sub-apertures, their grids, beams and errors.

`sampling` cuts the aperture, `subapertures` plans the images of its parts, `beams` with
`beam_geometry` and `beam_gain` those that come from beams, `polar_grids` the fusion.
"""
