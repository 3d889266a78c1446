# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""`sar-imaging radar-constant`, and images as brightness by it."""

import dataclasses
import json
import pathlib
import types

import numpy as np
import pytest
import yaml

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, PatternCut, Pointing
from sar_imaging.recordings import open_pulses
from sar_imaging.tools.products.brightness import respond

PSF = pathlib.Path(__file__).parents[3] / 'bags' / 'psf'  # amplitude 1, 10 km away
AT = ('--reflector', '10000', '0', '0')


def test_a_reflector_calibrates_the_image(run, tmp_path):
    constant = tmp_path / 'radar.yaml'
    status, out, err = run('radar-constant', PSF, *AT, '--cross-section', '10',
                           '--output', constant)
    assert status == 0, err
    assert 'reflector of 10 m^2 (10.0 dB)' in out
    # amplitude 1 is gain sqrt(10) / 10 km^2; 3e-4 measured: the peak between pixels
    assert yaml.safe_load(constant.read_text())['gain_m'] == pytest.approx(
        1e8 / np.sqrt(10), rel=2e-3)
    status, _, err = run('image', PSF, '--output', tmp_path, '--brightness', 'rcs',
                         '--radar-constant', constant)
    assert status == 0, err
    power = np.abs(np.load(tmp_path / 'image.npy')) ** 2
    assert 10 * np.log10(power.max()) == pytest.approx(10.0, abs=0.05)  # its pixel
    told = json.loads((tmp_path / 'quality.json').read_text())['brightness']
    assert told['quantity'] == 'rcs'
    assert told['noise_equivalent_db'] < -40


@pytest.mark.parametrize(('arguments', 'message'), [
    (('radar-constant', PSF, *AT, '--cross-section', '-3', '--output', 'x.yaml'), 'positive'),
    (('radar-constant', PSF, '--reflector', '10', '0', '0', '--trihedral', '0.3', '--output',
      'x.yaml'), 'the profiles cover'),
    (('image', PSF, '--output', 'out', '--brightness', 'sigma0'), 'give both'),
    (('image', PSF, '--output', 'out', '--brightness', 'sigma0', '--radar-constant', PSF),
     'no file of a radar constant'),
])
def test_what_cannot_be_is_refused(run, arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, _, err = run(*arguments)
    assert status == 1
    assert message in err
    assert not (tmp_path / 'out').exists()


def test_the_antenna_of_a_recording_is_in_the_response():
    """Images of such recordings are weighed by the antenna: amplitudes come in twice."""
    pattern = AntennaPattern(PatternCut.gaussian(0.002))
    source = open_pulses(PSF)

    def blocks(n_bytes=1e8):
        for block in source.blocks(n_bytes / 1e5):
            yield dataclasses.replace(block, pointing=Pointing.steered(
                block.phase_centre_m, (10_000.0, 0.0, 0.0)))

    lit = dataclasses.replace(source, illumination=pattern, blocks=blocks)
    grid = MapGrid((10_000.0, 0.0, 0.0), 5, 41, 0.5)
    response = respond(lit, types.SimpleNamespace(grid=grid))
    row = 8  # 6 m off the middle, 0.6 mrad off boresight
    point = grid.positions(row, 2)
    there, back = (np.linalg.norm(c - point, axis=-1) for c in (source.tx_m, source.rx_m))
    expected = (2.0 ** -(2 * 0.0006 / 0.002) ** 2) ** 2 * (1 / (there * back)).sum()
    # each pulse sees the point under an angle of its own, 1e-3 of this one
    assert response.amplitude[row, 2] == pytest.approx(expected, rel=5e-3)
