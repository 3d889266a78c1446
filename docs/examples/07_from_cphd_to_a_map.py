# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""
From a CPHD file to a map
=========================

CPHD (compensated phase history data, NGA.STND.0068) is how radar programs exchange pulses before
imaging. The commands ``sar-imaging info`` and ``sar-imaging image`` read it; this example does the
same in Python, and puts the image on the Earth as a GeoTIFF.

Needs ``pip install sar_imaging[formats]``.
"""

import pathlib
import tempfile

import matplotlib.pyplot as plt
import numpy as np
import rasterio

from sar_imaging import MapGrid, plan_image
from sar_imaging.formats import write_geotiff
from sar_imaging.formats.cphd import Collection, CphdReader, write_cphd
from sar_imaging.geometry import Datum
from sar_imaging.recordings import read_blocks

# %%
# A file to begin with
# --------------------
#
# Farmland with a hall, a house, trees and a car park, as an aircraft recorded it: the recording
# ``bags/countryside`` of the repository, which ``sar-imaging simulate countryside`` makes, too. If
# you have a CPHD file of your own, begin with the next section.

folder = pathlib.Path(tempfile.mkdtemp())
bag = next(f / 'bags' / 'countryside' for f in pathlib.Path().resolve().parents
           if (f / 'bags' / 'countryside').exists())
grid = MapGrid.from_size((0.0, 0.0, 0.0), 150.0, 118.0, 0.2)
write_cphd(folder / 'flight.cphd', read_blocks(bag), Datum(47.3, 8.5, 430.0), grid,
           collection=Collection(collector_name='demonstrator'))

# %%
# Pulses to image
# ---------------
#
# The reader hands out blocks of pulses that fit the memory it is allowed. Each is added to the
# image, so a file may be much larger than the memory.

with CphdReader(folder / 'flight.cphd') as reader:
    print(reader.collection, *reader.warnings, sep='\n')
    imager = plan_image(reader.map_grid(), reader.radar, reader.n_samples,
                        compressed=reader.compressed)
    image = imager.new_image()
    for block in reader.blocks(memory_bytes=256e6):
        imager.accumulate(block, image)
    datum = reader.datum
print(image.report)

# %%
# Image to map
# ------------
#
# The GeoTIFF opens in QGIS and in every other geographic information system.

write_geotiff(folder / 'map.tif', image, datum)
with rasterio.open(folder / 'map.tif') as file:
    level_db, bounds, crs = file.read(1), file.bounds, file.crs
print(f'{crs}, {level_db.shape[1]} by {level_db.shape[0]} pixels')

middle = np.nanmedian(level_db)
figure, axes = plt.subplots(figsize=(7, 5.5), layout='constrained')
axes.imshow(level_db, extent=(bounds.left, bounds.right, bounds.bottom, bounds.top),
            vmin=middle - 15, vmax=middle + 30, cmap='gray')
axes.set(title='Fields, a hall, a house, trees, a car park', xlabel='easting (m)',
         ylabel='northing (m)')
axes.ticklabel_format(style='plain', useOffset=False)
axes.tick_params(axis='x', labelrotation=30)
