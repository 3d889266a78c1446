# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""
An archive of many flights
==========================

A survey leaves many recordings, and its map has more pixels than a computer has memory. An archive
job names the recordings and what to make of them; ``sar-imaging archive`` divides the work into
pieces and computes them on all cores, or on a cluster. Run the same command again after a power
failure: no finished piece is computed twice.

Needs ``pip install sar_imaging[archive]``.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import matplotlib.pyplot as plt
import numpy as np
import zarr

from sar_imaging.simulation.survey import Survey
from sar_imaging.tools.simulate_archive import write_archive

# %%
# Eight short flights over neighbouring squares, one of them broken: real archives are like that.

folder = pathlib.Path(tempfile.mkdtemp())
survey = Survey(n_recordings=8, lines=2, pixels=256, overlap=0.25, reflectors=3)
truth = write_archive(survey, folder / 'flights', broken=1)

# %%
# The job is five lines.

job = """\
recordings: flights
output: survey
spacing_m: 0.25
memory_gb: 1
products: {mosaic: true}
"""
(folder / 'survey.yaml').write_text(job)


# %%
# The same as ``sar-imaging archive survey.yaml --workers 2`` in a terminal. It prints the plan
# before it begins: what each kind of piece takes, and how long the job takes with more workers.

run = subprocess.run([sys.executable, '-m', 'sar_imaging.tools.command', 'archive', 'survey.yaml',
                      '--workers', '2'], cwd=folder, capture_output=True, text=True)
print(run.stdout.replace(f'{folder}/', ''))

# %%
# Exit status 3 says that all is done and something is lost: the broken recording.

print('exit status', run.returncode)
summary = json.loads((folder / 'survey' / 'summary.json').read_text())
for loss in summary['losses']:
    print(loss['key'], '-', loss['reason'].replace(f'{folder}/', ''))

# %%
# The mosaic is a Zarr group, in tiles that are read as they are needed. The tiles go on beyond the
# ground that was seen, which is cut out here.

mosaic = zarr.open_group(folder / 'survey' / 'mosaic.zarr', mode='r')
power = mosaic['power'][:]
rows, columns = np.nonzero(power > 0)
power = power[rows.min():rows.max() + 1, columns.min():columns.max() + 1]
level_db = 10 * np.log10(np.where(power > 0, power, np.nan))
middle = np.nanmedian(level_db)
figure, axes = plt.subplots(figsize=(5, 6.5), layout='constrained')
axes.imshow(level_db, vmin=middle - 12, vmax=middle + 20, cmap='gray')
axes.set(title='Mosaic of seven flights', xlabel='column', ylabel='row')
