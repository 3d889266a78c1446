"""Both stages of AFBP on a device.

- `subapertures`: images of sub-apertures, from beams or directly; `beam_kernels` computes beams;
- `fusion`: their spectra joined, and the map.
"""
