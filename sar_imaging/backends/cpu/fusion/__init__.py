"""Second stage of AFBP: sub-aperture images fused by their spectra, and read onto a map.

`spectra` is the imager; `lines` and `bands` bring sub-apertures to their place in the fused
spectrum, `to_map` reads the map.
"""
