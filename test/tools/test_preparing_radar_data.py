"""The example of docs/preparing_radar_data.md writes a recording that reads back."""

from __future__ import annotations

import pathlib
import re

import numpy as np

from sar_imaging.signal.pulses import concatenate
from sar_imaging.tools.bag_io import read_blocks, read_truth

PAGE = pathlib.Path(__file__).parents[2] / 'docs' / 'preparing_radar_data.md'


def test_example_writes_a_recording(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    [example] = re.findall(r'^```python\n(.*?)^```', PAGE.read_text(), re.DOTALL | re.MULTILINE)
    names = {}
    exec(example, names)
    block = concatenate(list(read_blocks('out/bags/my_radar')))
    assert block.samples.shape == (256, 2, 1024)
    np.testing.assert_allclose(block.rx_m, names['rx_m'], rtol=0, atol=1e-8)
    truth = read_truth('out/bags/my_radar')
    # Every field that the page's table of the truth names is there.
    table = PAGE.read_text().split('## Truth of a recording')[1].split('## ')[0]
    fields = {name for row in re.findall(r'^\| (`.*?) \|', table, re.MULTILINE)
              for name in re.findall(r'`(\w+)`', row)}
    assert fields == set(truth)
