# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How long the tests of this folder wait: while there is progress, and no longer."""

import pytest

from . import conftest


def test_patience_ends_without_progress_alone(monkeypatch):
    clock = iter(range(1000))
    monkeypatch.setattr(conftest.time, 'monotonic', lambda: next(clock))
    monkeypatch.setattr(conftest, 'PATIENCE_S', 10.0)
    steps = iter(range(1000))
    # 100 readings of the clock, with progress at every fifth
    assert conftest.wait(lambda: (n := next(steps)) >= 100 and n, 'the end',
                         work=lambda: None, progress=lambda: next(clock) // 4) == 100
    with pytest.raises(pytest.fail.Exception, match='waited 10 s for nothing'):
        conftest.wait(lambda: False, 'nothing', work=lambda: None)
