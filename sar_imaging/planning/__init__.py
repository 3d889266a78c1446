# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What is computed for an image, with which error and at which cost, before any pulse is touched.

Plans are float64 NumPy and know no processor; `sar_imaging.backends` computes them.

- `exact`: backprojection along the lines of a map, over a polar image, or point by point;
- `afbp`: sub-apertures, their beams and polar grids, and what the fusion of their spectra costs;
- `profiles`: the part of the range profiles that an image needs, and how finely it is resampled;
- `polar_cover`: the polar grid that covers a map, and how the map is read from it;
- `interpolators`, `aliasing_error`, `echo_power`, `echo_pixels`: the error;
- `costs`: nanoseconds; `transform_lengths`: lengths of Fourier transforms that are quick.

Names that mean the same in all modules, here and in the backends, are described once:

- `radar`, `n_samples`: `RadarParameters` of the range profiles, and their samples; of phase
  histories, and their frequencies, where these are imaged as they come;
- `tx_m`, `rx_m`: float64 phase centres, metres: (R, 3), one of each echo (a pulse of a channel),
  or (P, C, 3) where pulses and channels are told apart;
- `samples`: (R, N) complex64 profiles of the echoes;
- `grid`: where the pixels are; `polar`: the `PolarGrid` of the image meant;
- `target_db` and others in dB: mean squared error against time-domain correlation over the mean
  square of the image; `errors_db` of a plan: the predicted one by cause;
- `range_m`: least and largest half path that is read, metres;
- `window`, `source`: part of the profiles that is needed, or the phase histories in their place;
  `resampling`: how it is resampled;
- `weight`: (R,) float64 share of each echo in the power of the image, see `echo_power`, or (W, R)
  for the worst of W scenes, of which one may be noise;
- `wavelength_m`: at the carrier, metres; `warnings`: what makes the image worse than wanted.
"""
