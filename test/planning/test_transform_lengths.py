# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lengths of transforms: powers of small numbers cost little, other factors much."""

import pytest

from sar_imaging.planning.transform_lengths import cost_per_sample, quick_length, smooth_lengths


def test_cost_counts_the_passes():
    assert cost_per_sample(960) == pytest.approx(3 * 0.83 + 0.85 + 1.16)  # 4 4 4 3 5
    assert cost_per_sample(2 * 7 * 11) == pytest.approx(0.46 + 1.54 + 2.3)
    assert cost_per_sample(1024) == pytest.approx(5 * 0.83 + 0.7)  # rows share cache lines
    assert cost_per_sample(13 * 64) == cost_per_sample(997) == 20.0


@pytest.mark.parametrize('least', [1, 13, 97, 1009, 1023, 4099, 12345])
def test_the_quickest_of_all_lengths_up_to_an_eighth_more(least):
    found = quick_length(least)
    allowed = [n for n in range(least, int(1.12 * least) + 1) if cost_per_sample(n) < 20.0]
    allowed = allowed or smooth_lengths(least, 1.0)
    assert found in allowed
    assert found * cost_per_sample(found) == min(n * cost_per_sample(n) for n in allowed)
