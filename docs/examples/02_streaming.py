# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""
An image that grows while the radar flies
=========================================

A robot cannot wait for the end of its drive. Accelerated fast backprojection (AFBP) forms a coarse
image of every few pulses, a sub-aperture, and adds the spectra of these images: the picture
sharpens with each of them. The nodes ``backprojection`` and ``afbp_fusion`` do this with messages;
this example does it with arrays.
"""

import matplotlib.pyplot as plt
import numpy as np

from sar_imaging import RangeCompressor
from sar_imaging.simulation import SCENARIOS
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures

# %%
# The pulses come in blocks of 16, as a driver would deliver them. Every 32 pulses make a sub-
# aperture, and four of these an image of the whole aperture of 128 pulses.

scenario = SCENARIOS['spotlight']()
subapertures = LiveSubapertures(scenario.grid, pulses_per_aperture=128, pulses_per_subaperture=32)
fusion = LiveFusion(images_every=1)
images, compressor = [], None
for raw in scenario.blocks(16):
    compressor = compressor or RangeCompressor.for_block(raw, window='hamming')
    for coarse in subapertures.add(compressor(raw)):
        images += fusion.add(coarse)
print(*(f'aperture {image.aperture}: {image.n_pulses} pulses, error predicted '
        f'{image.predicted_error_db:.0f} dB' for image in images), sep='\n')

# %%
# An aperture is planned before it is flown. Where the flight differs from what was foreseen, the
# aperture is planned anew and its sub-apertures are formed again: their first image comes twice.
#
# The resolution along the flight is inversely proportional to the length that was flown: it halves
# from the first picture to the second, and again to the last.

grid = scenario.grid
extent = (grid.x_m[0], grid.x_m[-1], grid.y_m[-1], grid.y_m[0])
figure, axes = plt.subplots(1, 3, figsize=(10, 3.6), sharey=True, layout='constrained')
for panel, shown in zip(axes, (images[-4], images[-3], images[-1]), strict=True):
    level_db = 20 * np.log10(np.abs(shown.image) / np.abs(shown.image).max())
    panel.imshow(level_db, extent=extent, vmin=-40, vmax=0, cmap='inferno')
    panel.set(title=f'after {shown.n_pulses} pulses', xlabel='x (m)')
axes[0].set_ylabel('y (m)')

# %%
# A sliding aperture
# ------------------
#
# With ``sliding=True`` each new sub-aperture replaces the oldest one: after the first 128 pulses
# there is an image of the latest 128 with every 32 further pulses, and none of them is formed from
# scratch.

sliding = LiveSubapertures(grid, pulses_per_aperture=128, pulses_per_subaperture=32, sliding=True)
fusion = LiveFusion()
windows = []
for raw in scenario.blocks(16):
    for coarse in [*sliding.add(compressor(raw)), *sliding.catch_up()]:
        windows += fusion.add(coarse)
start_ns = windows[0].stamp_ns
print(*(f'{(w.stamp_ns - start_ns) * 1e-9:4.1f} s: {w.n_pulses} pulses' for w in windows),
      sep='\n')
