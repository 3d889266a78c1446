# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Small scenes whose profiles come straight from the signal model."""

import pytest

from sar_imaging.backends import checks


@pytest.fixture(scope='session')
def make_scene():
    return checks.make_scene


@pytest.fixture(scope='session')
def error_db():
    return checks.error_db
