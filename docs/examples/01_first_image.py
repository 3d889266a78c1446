# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""
A first image in ten lines
==========================

A synthetic aperture radar (SAR) image needs three things: pulses, the places where they were sent
and received, and a grid of pixels. This example takes the first two from the simulator: a light
aircraft flies 500 m high past ten reflectors, 1 km away. It needs no ROS.
"""

import matplotlib.pyplot as plt
import numpy as np

from sar_imaging import RangeCompressor, concatenate, plan_image
from sar_imaging.simulation import SCENARIOS

scenario = SCENARIOS['spotlight']()
raw = concatenate(list(scenario.blocks())).select(slice(0, scenario.pulses_per_aperture))
profiles = RangeCompressor.for_block(raw, window='hamming')(raw)
imager = plan_image(scenario.grid, profiles.radar, profiles.n_samples, target_db=-60.0)
image = imager(profiles)

# %%
# The image is complex: its magnitude is what we look at, its phase is for interferometry. The
# report says which method formed it and why, what error was predicted, and what it took.

print(image.report)

# %%
# Row 0 of the image is its northern edge, the largest *y*; so the picture needs no
# ``origin='lower'``.

grid = scenario.grid
extent = (grid.x_m[0], grid.x_m[-1], grid.y_m[-1], grid.y_m[0])
level_db = 20 * np.log10(np.abs(image) / np.abs(image).max())
figure, axes = plt.subplots(figsize=(6.5, 5.5), layout='constrained')
shown = axes.imshow(level_db, extent=extent, vmin=-45, vmax=0, cmap='inferno')
axes.set(title='Ten reflectors, seen from 1 km', xlabel='x (m)', ylabel='y (m)')
figure.colorbar(shown, label='dB below the brightest pixel')

# %%
# Before and after
# ----------------
#
# A single pulse knows distances only. The same pulses before imaging are curves: each reflector
# comes nearer and goes away again as the aircraft passes. Imaging adds the pulses along these
# curves.

time_s = (profiles.stamp_ns - profiles.stamp_ns[0]) * 1e-9
radar = profiles.radar
range_m = radar.range_start_m + radar.sample_spacing_m * np.arange(profiles.n_samples)
figure, axes = plt.subplots(figsize=(6.5, 4), layout='constrained')
power_db = 20 * np.log10(np.abs(profiles.samples[:, 0]) + 1e-3)
axes.pcolormesh(range_m, time_s, power_db, vmin=power_db.max() - 40, cmap='inferno')
axes.set(title='Range profiles of one channel', xlabel='distance (m)', ylabel='time (s)')
