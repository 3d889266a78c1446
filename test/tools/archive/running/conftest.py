"""Workers of this machine, shared by the tests of a module that do not break them for good."""

import os
from pathlib import Path

import pytest

pytest.importorskip('distributed', reason='Dask comes with the extra `archive`')

from sar_imaging.tools.archive.running.cluster import open_cluster


@pytest.fixture(scope='session', autouse=True)
def toys_are_importable():
    """By this process and by the workers that it starts."""
    with pytest.MonkeyPatch.context() as patch:
        folder = str(Path(__file__).parent)
        patch.syspath_prepend(folder)
        root = str(Path(__file__).resolve().parents[4])
        patch.setenv('PYTHONPATH', os.pathsep.join([folder, root]))
        yield


@pytest.fixture(scope='module')
def client(toys_are_importable, tmp_path_factory):
    with open_cluster(tmp_path_factory.mktemp('cluster'), workers=2) as client:
        yield client
