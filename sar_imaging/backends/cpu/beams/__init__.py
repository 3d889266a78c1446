"""Sub-aperture images by way of beams: few sums over the pulses, from which many lines are read.

`subaperture` is the imager, `forming` sums pulses to beams, `interpolation` reads lines from them.
"""
