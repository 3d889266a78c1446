# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""
SICD: an image that other programs understand
=============================================

SICD (sensor independent complex data, NGA.STND.0024) is a complex image with all that is known of
its acquisition: where the radar was at each time, which frequencies each pixel holds, where on the
Earth it lies. This example forms an image on a grid of SICD, writes it, and reads it back.

Needs ``pip install sar_imaging[formats]``.
"""

import pathlib
import tempfile

import matplotlib.pyplot as plt
import numpy as np

from sar_imaging import RangeCompressor, concatenate, plan_image
from sar_imaging.formats import Acquisition, read_sicd, sicd_grid, write_sicd
from sar_imaging.geometry import Datum
from sar_imaging.simulation import SCENARIOS

scenario = SCENARIOS['spotlight']()
raw = concatenate(list(scenario.blocks())).select(slice(0, scenario.pulses_per_aperture))
profiles = RangeCompressor.for_block(raw, window='hamming')(raw)

# %%
# The datum says where on the Earth the frame of the pulses stands. Rows of a SICD grid lead away
# from the radar; ``sicd_grid`` lays them so that nothing has to be resampled.

datum = Datum(47.0, 8.0, 450.0)
acquisition = Acquisition.of([raw], polarisation='V:V', collector='demonstrator')
grid = sicd_grid(acquisition, centre_m=(0.0, 0.0, 0.0), range_size_m=40.0, cross_size_m=40.0)
image = plan_image(grid, profiles.radar, profiles.n_samples, target_db=-60.0)(profiles)

path = pathlib.Path(tempfile.mkdtemp()) / 'image.nitf'
write_sicd(path, image, datum, acquisition)
print(f'{path.name}: {path.stat().st_size / 1e6:.1f} MB')

# %%
# Reading gives image, grid, datum and acquisition. Every sample is the same, to the bit.

product = read_sicd(path)
same = np.array_equal(product.image.samples, image.samples)
print(f'{product.image.shape} samples, {"all equal" if same else "some differ"}')
row, column = np.unravel_index(np.abs(product.image.samples).argmax(), product.image.shape)
place = product.image.grid.positions(row, column)
latitude, longitude, height = product.datum.to_geographic(place)
print(f'brightest pixel: {latitude:.6f} N, {longitude:.6f} E, {height:.1f} m')

# %%
# As a SICD viewer shows it: range downward, so that shadows fall down.

level_db = 20 * np.log10(np.abs(product.image.samples) / np.abs(image.samples).max() + 1e-6)
figure, axes = plt.subplots(figsize=(6, 5), layout='constrained')
shown = axes.imshow(level_db, vmin=-45, vmax=0, cmap='inferno', aspect='auto')
axes.set(title='SICD: rows lead away from the radar', xlabel='column', ylabel='row')
figure.colorbar(shown, label='dB below the brightest pixel')
