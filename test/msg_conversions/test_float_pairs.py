# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from msg_conversions import WireFormatError, float_pairs
from msg_conversions.float_pairs import MAX_OFFSET_NS

MAGNITUDES = st.floats(1e-30, 1e38) | st.floats(-1e38, -1e-30)
# 1.5 ulp of the high part less a little: the low part rounds up to a tie of the high part.
TIE = 1.0 + 2**-23 + 2**-24 - 2**-51


@given(MAGNITUDES)
@example(TIE)
def test_pair_keeps_48_bits(value):
    joined = float_pairs.join_double(float_pairs.split_double(value))
    assert abs(joined - value) <= 2**-48 * abs(value)


@given(st.floats(-3e38, 3e38))
@example(TIE)
@example(5e-324)
def test_split_and_join_settle_after_the_first_time(value):
    pairs = float_pairs.split_double(value)
    again = float_pairs.split_double(float_pairs.join_double(pairs))
    np.testing.assert_array_equal(again, pairs)  # -0.0 may become 0.0


@given(st.floats(-2**23, 2**23))
@example(6.4e6 + 1 / 3)
@example(2**23 - 2**-30)
def test_positions_of_earth_radius_keep_ten_nanometres(value):
    # Below 2**23 m the high part leaves at most 2**-2 m, whose float rounds by 2**-27 m.
    joined = float_pairs.join_double(float_pairs.split_double(value))
    assert abs(joined - value) <= 2**-27 < 1e-8


@pytest.mark.parametrize('value', [3.5e38, -1e300, np.inf, np.nan])
def test_values_outside_float32_are_refused(value):
    with pytest.raises(WireFormatError, match='does not fit; expected finite numbers below'):
        float_pairs.split_double([1.0, value])


@given(st.integers(-MAX_OFFSET_NS, MAX_OFFSET_NS))
@example(MAX_OFFSET_NS)
@example(-MAX_OFFSET_NS)
@example(2**18 * 10**9 + 1)
def test_nanoseconds_are_exact_up_to_the_limit(offset):
    pairs = float_pairs.split_nanoseconds(np.array([offset]))
    assert int(float_pairs.join_nanoseconds(pairs)[0]) == offset


def test_nanoseconds_are_exact_where_rounding_is_worst():
    rng = np.random.default_rng(5)
    offsets = np.concatenate([rng.integers(MAX_OFFSET_NS * 3 // 4, MAX_OFFSET_NS, 300_000),
                              MAX_OFFSET_NS - np.arange(100_000)])
    received = float_pairs.join_nanoseconds(float_pairs.split_nanoseconds(offsets))
    np.testing.assert_array_equal(received.astype(np.int64), offsets)


@given(st.integers(-2**63, 2**63 - 1))
def test_limbs_hold_any_int64(value):
    limbs = np.array(float_pairs.split_limbs(value, 4), np.float32)
    assert float_pairs.are_limbs(limbs)
    assert float_pairs.join_int64(limbs) == value


@pytest.mark.parametrize('value', [-1.0, 0.5, 65536.0, 3e38])
def test_numbers_that_are_no_limbs(value):
    assert not float_pairs.are_limbs(np.array([0.0, value], np.float32))
