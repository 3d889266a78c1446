# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings and CPHD files of one scene."""

from __future__ import annotations

import pytest

from sar_imaging.tools.command import main


@pytest.fixture(scope='session')
def spotlight(spotlight_bag):
    """Recording of ten scatterers, two apertures."""
    return spotlight_bag


@pytest.fixture(scope='session')
def cphd(spotlight_cphd):
    """Its second aperture as CPHD."""
    return spotlight_cphd


@pytest.fixture
def run(capfd):
    """Function that runs a command and returns status, output and errors."""
    def run(*words):
        status = main([str(word) for word in words])
        captured = capfd.readouterr()
        return status, captured.out, captured.err

    return run
