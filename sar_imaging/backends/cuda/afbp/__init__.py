"""Both stages of AFBP on a device.

- `subapertures`: images of sub-apertures, from `beams` or directly;
- `forming`, `reading`: kernels that sum echoes to beams, and read lines from these;
- `fusion`: spectra of the images joined, and the map; `bands` has the kernels;
- `aperture`: both for a whole aperture, some sub-apertures in one launch of each kernel.
"""
