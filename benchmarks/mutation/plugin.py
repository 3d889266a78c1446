# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""For pytest under `coverage`: each test is a context, and its time is noted if it passes."""

from __future__ import annotations

import json
import os
import pathlib
import time

import coverage
import pytest

_seconds: dict[str, float] = {}
_failed: set[str] = set()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    measuring, begun = coverage.Coverage.current(), time.perf_counter()
    if not os.environ.get('MUTATION_TEST'):  # else the context is that of all processes
        measuring.switch_context(item.nodeid)
    yield
    _seconds[item.nodeid] = round(time.perf_counter() - begun, 3)
    if not os.environ.get('MUTATION_TEST'):
        measuring.switch_context('')


def pytest_runtest_logreport(report):
    if not report.passed:
        _failed.add(report.nodeid)


def pytest_sessionfinish():
    path = pathlib.Path(os.environ['MUTATION_SECONDS'])
    known = json.loads(path.read_text()) if path.exists() else {}
    known |= {test: s for test, s in _seconds.items() if test not in _failed}
    path.write_text(json.dumps(known, indent=0))
