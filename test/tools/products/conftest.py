"""Recordings and CPHD files of one scene."""

from __future__ import annotations

import pathlib

import pytest

from sar_imaging.geometry.earth import Datum
from sar_imaging.tools.command import main
from sar_imaging.tools.products.sources import open_source

BAGS = pathlib.Path(__file__).parents[3] / 'bags'
DATUM = Datum(47.3, 8.5, 430.0, 20.0)


@pytest.fixture(scope='session')
def spotlight():
    """Recording of ten scatterers, two apertures."""
    return BAGS / 'spotlight'


@pytest.fixture(scope='session')
def cphd(spotlight, tmp_path_factory):
    """Its second aperture as CPHD, at DATUM."""
    pytest.importorskip('sarkit', reason='the extra formats is not installed')
    from sar_imaging.formats.cphd import write_cphd

    source = open_source(spotlight)
    path = tmp_path_factory.mktemp('cphd') / 'spotlight.cphd'
    write_cphd(path, source.read(1e7), DATUM, source.grid)
    return path


@pytest.fixture
def run(capfd):
    """Function that runs a command and returns status, output and errors."""
    def run(*words):
        status = main([str(word) for word in words])
        captured = capfd.readouterr()
        return status, captured.out, captured.err

    return run
