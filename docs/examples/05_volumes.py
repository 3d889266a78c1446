# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""
Volumes: images with three axes
===============================

An aperture with two dimensions, here a scan over a plane as in package inspection, resolves
distance and two directions. The grid is then a volume. Nothing else changes: ``plan_image`` takes
any grid.
"""

import matplotlib.pyplot as plt
import numpy as np

from sar_imaging import RangeCompressor, concatenate, plan_image
from sar_imaging.geometry import VolumeGrid
from sar_imaging.simulation import SCENARIOS

scenario = SCENARIOS['raster_scan']()
pulses = concatenate(list(scenario.blocks()))
profiles = pulses if pulses.compressed else RangeCompressor.for_block(pulses)(pulses)
volume = VolumeGrid.above(scenario.grid, scenario.height_m, scenario.grid.spacing_m)
image = plan_image(volume, profiles.radar, profiles.n_samples)(profiles)
print(scenario.description)
print(f'{image.shape} pixels: layers from below, rows from the largest y, columns')

# %%
# Three views: the brightest pixel along each axis.

level_db = 20 * np.log10(np.abs(image.samples) / np.abs(image.samples).max() + 1e-6)
points = volume.points()
(x0, y0, z0), (x1, y1, z1) = points.reshape(-1, 3).min(axis=0), points.reshape(-1, 3).max(axis=0)
views = (('from above', 'x (m)', 'y (m)', level_db.max(axis=0), (x0, x1, y0, y1)),
         ('from the front', 'x (m)', 'z (m)', level_db.max(axis=1)[::-1], (x0, x1, z0, z1)),
         ('from the side', 'y (m)', 'z (m)', level_db.max(axis=2)[::-1, ::-1], (y0, y1, z0, z1)))
figure, axes = plt.subplots(1, 3, figsize=(10, 3.6), layout='constrained')
for panel, (title, x, y, view, extent) in zip(axes, views, strict=True):
    shown = panel.imshow(view, extent=extent, vmin=-30, vmax=0, cmap='inferno')
    panel.set(title=title, xlabel=x, ylabel=y)
figure.colorbar(shown, ax=axes, label='dB', shrink=0.8)

# %%
# A point cloud holds the cells that are bright, as the nodes publish them in mode ``volume``, and
# ``sar_imaging.formats.write_ply`` writes them.

bright = level_db > -18
figure = plt.figure(figsize=(6, 5), layout='constrained')
axes = figure.add_subplot(projection='3d')
axes.scatter(*points[bright].T, c=level_db[bright], s=8, cmap='inferno', vmin=-22)
axes.set(xlabel='x (m)', ylabel='y (m)', zlabel='z (m)', title='Cells above -18 dB')
