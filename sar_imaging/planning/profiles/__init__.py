"""How range profiles are prepared for an image: cut to the ranges it needs, and resampled.

`range_gate` cuts, `range_resampling` chooses spacing and interpolator, `transform_length` lengths
of Fourier transforms that are quick; `phase_history` describes profiles that were never
compressed, and `profile_reach` the pixels whose ranges no profile reaches.
"""
