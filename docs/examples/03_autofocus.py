# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""
Autofocus of a measured flight
==============================

Positions from navigation are rarely as good as a radar wants them: an error of an eighth of the
wavelength, 4 mm here, is visible. Autofocus estimates the error of the track from the image
itself. The recording is a pass of the AFRL Gotcha data set (X band, 10 km away). Its own positions
are excellent, so this example makes them wrong, and knows the truth.

The data may not be redistributed. Where no folder ``shared/data`` is found above the working
directory, a simulated flight takes their place, and the example says so.
"""

import dataclasses
import pathlib

import matplotlib.pyplot as plt
import numpy as np

from sar_imaging import MapGrid, RangeCompressor, plan_image
from sar_imaging.autofocus import Autofocus
from sar_imaging.recordings import load
from sar_imaging.simulation import flawed_aperture

places = [parent / 'shared' / 'data' / 'gotcha_pass1_hh'
          for parent in pathlib.Path().resolve().parents]
folder = next(filter(pathlib.Path.exists, places), None)
if folder is None:
    print('no measured data here: a simulated flight takes their place')
    flight = flawed_aperture('smooth', 4.0, seed=1, n_pulses=256)
    true, stated, grid = flight.true, flight.stated, flight.grid
else:
    pulses = load('gotcha', folder).block
    true = RangeCompressor.for_block(pulses)(pulses)
    # a smooth error of up to 0.1 m along each axis: Legendre polynomials of degree 1 to 5
    shapes = np.polynomial.legendre.legvander(np.linspace(-1, 1, true.n_pulses), 5)[:, 1:]
    error_m = shapes @ np.random.default_rng(1).standard_normal((5, 3))
    error_m *= 0.1 / np.abs(error_m).max()
    wrong_m = true.tx_m + error_m[:, None]
    stated = dataclasses.replace(true, tx_m=wrong_m, rx_m=wrong_m)
    grid = MapGrid.from_size((0.0, 0.0, 0.0), 100.0, 100.0, 0.2)

# %%
# Autofocus takes the pulses with the positions as they are stated, and returns an image, the
# pulses with better positions, and a report. The report says whether to believe the image.

result = Autofocus(grid, scale_m=0.1).process(stated)
print(result.report)

# %%
# Left with wrong positions, in the middle after autofocus, right with the true positions.

imager = plan_image(grid, true.radar, true.n_samples)
images = {'wrong positions': imager(stated), 'after autofocus': result.image,
          'true positions': imager(true)}
peak = max(np.abs(image).max() for image in images.values())
extent = (grid.x_m[0], grid.x_m[-1], grid.y_m[-1], grid.y_m[0])
figure, axes = plt.subplots(1, 3, figsize=(10, 3.7), sharey=True, layout='constrained')
for panel, (title, image) in zip(axes, images.items(), strict=True):
    level_db = 20 * np.log10(np.abs(image) / peak + 1e-6)
    panel.imshow(level_db, extent=extent, vmin=-45, vmax=0, cmap='gray')
    panel.set(title=title, xlabel='x (m)')
axes[0].set_ylabel('y (m)')

# %%
# What an image cannot show
# -------------------------
#
# A displacement of the whole track displaces the image and defocuses nothing; so does, to first
# order, a constant velocity. What autofocus found is therefore compared with the true error after
# both have lost their constant and linear parts, along the line of sight.


def bend_m(track_m):
    """Line-of-sight distance to the middle of the grid, less its constant and linear part."""
    distance_m = np.linalg.norm(track_m[:, 0] - grid.centre_m, axis=-1)
    number = np.arange(len(distance_m))
    return distance_m - np.polyval(np.polyfit(number, distance_m, 1), number)


figure, axes = plt.subplots(figsize=(7, 3.4), layout='constrained')
truth_m = bend_m(true.tx_m)
axes.plot(1e3 * (bend_m(stated.tx_m) - truth_m), label='before')
axes.plot(1e3 * (bend_m(result.block.tx_m) - truth_m), label='after autofocus')
axes.set(xlabel='pulse', ylabel='error along the line of sight (mm)')
axes.legend()
