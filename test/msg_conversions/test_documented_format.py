# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""docs/wire_format.md is what others implement: its Python example must write valid blocks."""

from __future__ import annotations

import pathlib
import re

import numpy as np
import pytest

from msg_conversions import wire

PAGE = pathlib.Path(__file__).parents[2] / 'docs' / 'wire_format.md'


def test_python_example_writes_blocks(make_block):
    hours = np.array([0, 71, -71, 1, 0])  # the example's times are exact to 72 h
    block = make_block(n_pulses=5, stamp_ns=1_700_000_000_123_456_789
                       + hours * 3_600_000_000_000 + np.arange(5) * 123_456_789)
    program = re.search(r'```python\n(.*?)```', PAGE.read_text(), re.DOTALL)[1]
    example = {}
    exec(program, example)
    data, dims, offset = example['to_arrays'](block.samples, block.stamp_ns, block.counter,
                                              block.tx_m, block.rx_m)
    received = wire.from_array(data, dims, offset)
    for name in ('stamp_ns', 'counter', 'samples'):
        np.testing.assert_array_equal(getattr(received, name), getattr(block, name))
    np.testing.assert_allclose(received.tx_m, block.tx_m, rtol=0, atol=1e-8)
    np.testing.assert_allclose(received.rx_m, block.rx_m, rtol=0, atol=1e-8)
    assert received.radar.first_sample_delay_s == pytest.approx(66.7e-6, rel=2**-48)
