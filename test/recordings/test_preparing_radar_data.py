# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The example of docs/preparing_radar_data.md writes a recording that reads back."""

from __future__ import annotations

import pathlib
import re

import numpy as np

from benchmarks.support.references import exact_image
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings.bag_io import read_blocks, read_truth
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.range_compression import RangeCompressor

PAGE = pathlib.Path(__file__).parents[2] / 'docs' / 'preparing_radar_data.md'


def test_example_writes_a_recording(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    [example] = re.findall(r'^```python\n(.*?)^```', PAGE.read_text(), re.DOTALL | re.MULTILINE)
    names = {}
    exec(example, names)
    block = concatenate(list(read_blocks('out/bags/first_flight')))
    assert block.samples.shape == (256, 2, 1024)
    np.testing.assert_allclose(block.rx_m, names['rx_m'], rtol=0, atol=1e-8)
    truth = read_truth('out/bags/first_flight')
    profiles = RangeCompressor.for_block(block)(block)
    grid = MapGrid(truth['grid']['centre_m'], truth['grid']['n_x'], truth['grid']['n_y'],
                   truth['grid']['spacing_m'])
    image = np.abs(exact_image(grid, profiles))
    row, column = np.unravel_index(image.argmax(), image.shape)
    # Peaks of 0.75 m by 0.9 m that stand between pixels of 0.25 m.
    np.testing.assert_allclose((grid.x_m[column], grid.y_m[row]), names['reflector_m'][:2],
                               rtol=0, atol=0.26)
    # Every field that the page's table of the truth names is there.
    table = PAGE.read_text().split('## Truth of a recording')[1].split('## ')[0]
    fields = {name for row in re.findall(r'^\| (`.*?) \|', table, re.MULTILINE)
              for name in re.findall(r'`(\w+)`', row)}
    assert fields == {*truth, 'datum'}  # which this example does not know


def test_the_pages_write_different_recordings_to_different_places():
    """Who follows two pages would image the wrong one, or be refused."""
    written = {}
    for page in sorted(PAGE.parent.rglob('*.md')):
        text = page.read_text()
        found = re.findall(r"(write_bag)\('([^']+)'", text)
        found += re.findall(r'\b(simulate|load_\w+)\b.*--output ([^\s`]+)', text)
        for tool, name in found:
            written.setdefault(name, set()).add(tool)
    assert 'out/bags/first_flight' in written and 'out/bags/my_radar' in written
    assert {name: tools for name, tools in written.items() if len(tools) > 1} == {}
