# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Archives of recordings with an antenna: images are weighed by it as `sar-imaging image` does."""

import dataclasses
import types

import numpy as np
import pytest

pytest.importorskip('zarr', reason='the extra archive is not installed')

from sar_imaging.archive.division import divide
from sar_imaging.archive.job import Job
from sar_imaging.archive.pieces import ImagePiece, ProductPiece
from sar_imaging.archive.provenance import check_mosaic
from sar_imaging.archive.recordings import scan_recording
from sar_imaging.archive.scans import write_job, write_scan
from sar_imaging.archive.storage import image_array
from sar_imaging.archive.workflow import compute
from sar_imaging.geometry import Datum, MapGrid
from sar_imaging.geometry.antenna import Antenna
from sar_imaging.geometry.illumination import Illumination, Pointing
from sar_imaging.imaging.image import Image
from sar_imaging.recordings import open_pulses
from sar_imaging.recordings.bag_io import write_bag
from sar_imaging.recordings.truth import antenna_truth, make_truth
from sar_imaging.tools.products import forming

from .small_archive import DATUM, N_PULSES, SPACING_M, TILE, fly, scene

ANTENNA = Antenna('gaussian', azimuth_width_deg=2.5)


def record(path, *, pointing=True, antenna=ANTENNA):
    """A pass whose antenna looks squinted at one half of the scene."""
    block = fly(0.0)
    looks = Pointing.steered(block.phase_centre_m, (40.0, 0.0, 0.0))
    points, _ = scene()
    lit = Illumination.of_pulses(ANTENNA.amplitudes(), looks, block.tx_m, block.rx_m)
    assert (lit.amplitude(points) == 0).any()  # some of it is dark
    block = dataclasses.replace(block, pointing=looks if pointing else None)
    truth = make_truth(scenario='lit', description='', scatterers=[],
                       grid=MapGrid((0.0, 0.0, 0.0), 128, 128, SPACING_M),
                       pulses_per_aperture=N_PULSES, n_pulses=N_PULSES, n_channels=1,
                       cut_half_width_m=(5, 5), radar=block.radar, compressed=True, datum=DATUM)
    write_bag(path, [block.select(slice(a, a + 16)) for a in range(0, N_PULSES, 16)],
              truth | antenna_truth(antenna))
    return path


def archive_of(path, tmp_path, datum=DATUM, **options):
    """Pieces of an archive of one recording, after its scan, and the scan."""
    job = Job((str(path),), tmp_path / 'out', SPACING_M, datum=datum, tile=TILE,
              **{'checked_pixels': 40, 'target_db': -50.0} | options)
    write_job(job)
    found = scan_recording(path, 'lit', job, job.output)
    assert not found.losses
    write_scan(job.output, found)
    [scan] = found.apertures
    return job, scan, divide(job, [scan]).pieces


def test_its_tiles_are_those_of_the_image_of_the_recording(tmp_path):
    """To the bit: the same method of the same pulses and pixels."""
    path = record(tmp_path / 'lit')
    job, scan, pieces = archive_of(path, tmp_path)
    [result] = [compute(piece, job.output) for piece in pieces if isinstance(piece, ImagePiece)]
    assert result.measured_error_db < job.target_db
    source = open_pulses(path)
    grid = scan.window.grid(SPACING_M)
    image, _ = forming.form(source, types.SimpleNamespace(grid=grid), job.target_db, 1e9)
    assert isinstance(image, Image)
    stored = image_array(job.output, scan.name, scan.window, TILE).read(scan.window)
    np.testing.assert_array_equal(stored.view(np.float32), image.samples.view(np.float32))
    assert 0.02 < (stored == 0).mean() < 0.98  # some of it is dark


def test_its_sicd_has_the_antenna(tmp_path):
    """Pattern and frame as sarkit reads them, in a map whose frame is turned by 90 degrees."""
    sksicd = pytest.importorskip('sarkit.sicd', reason='sarkit needs Python 3.11')
    verification = pytest.importorskip('sarkit.verification')
    path = record(tmp_path / 'lit')
    turned = dataclasses.replace(DATUM, heading_deg=DATUM.heading_deg + 90)
    job, scan, _ = archive_of(path, tmp_path, turned, area_m=(-100.0, -100.0, 100.0, 100.0))
    [name] = compute(ProductPiece(key='s', product='image sicd', scan=scan),
                     job.output).files
    with open(job.output / name, 'rb') as file:
        checker = verification.SicdConsistency.from_file(file)
        checker.check()
        assert not checker.failures()
        file.seek(0)
        with sksicd.NitfReader(file) as reader:
            helper, pixels = sksicd.XmlHelper(reader.metadata.xmltree), reader.read_image()
    gain = helper.load('{*}Antenna/{*}TwoWay/{*}Array/{*}GainPoly')
    axes = [helper.load(f'{{*}}Antenna/{{*}}TwoWay/{{*}}{name}AxisPoly') for name in 'XY']
    start_s = helper.load('{*}ImageFormation/{*}TStartProc')
    block = fly(0.0)
    looks = Pointing.steered(block.phase_centre_m, (40.0, 0.0, 0.0))
    lit = Illumination.of_pulses(ANTENNA.amplitudes(), looks, block.tx_m, block.rx_m)
    for pulse, place in ((0, (40.0, 0.0, 0.0)), (20, (50.0, -30.0, 0.0)), (47, (25.0, 9.0, 0.0))):
        time_s = start_s + (block.stamp_ns[pulse] - block.stamp_ns[0]) * 1e-9
        x, y = (np.polynomial.polynomial.polyval(time_s, part) for part in axes)
        look = DATUM.to_ecef(place) - DATUM.to_ecef(block.tx_m[pulse, 0])
        look /= np.linalg.norm(look)
        expected_db = 20 * np.log10(lit.amplitude(np.array(place))[pulse])
        # 0.04 dB measured: the polynomial of a Gaussian
        assert np.polynomial.polynomial.polyval2d(x @ look, y @ look, gain) == pytest.approx(
            expected_db, abs=0.1)
    assert 0.02 < (pixels == 0).mean() < 0.98  # weighed: some of it is dark


def test_the_mosaic_counts_what_is_lit_alone(tmp_path):
    job, scan, pieces = archive_of(record(tmp_path / 'lit'), tmp_path)
    for piece in pieces:
        if piece.KIND in ('image', 'mosaic'):
            compute(piece, job.output)
    checked = check_mosaic(job.output, 60)
    # on the very edge of the beam exact backprojection interpolates to 1e-6 of what is inside
    differ = checked.looks != checked.reference_looks
    assert differ.mean() < 0.05
    assert not (checked.power[differ] > 1e-6 * checked.power.max()).any()
    assert checked.error_db < job.target_db


def test_an_antenna_turns_with_the_frame_of_the_map(tmp_path):
    path = record(tmp_path / 'lit')
    other = Datum(DATUM.latitude_deg, DATUM.longitude_deg, DATUM.height_m, 120.0)
    job, scan, _ = archive_of(path, tmp_path, other, area_m=(-100.0, -100.0, 100.0, 100.0))
    pattern, looks = scan.antenna(job.output)
    source = open_pulses(path)
    np.testing.assert_array_equal(pattern.azimuth.amplitude, source.illumination.azimuth.amplitude)
    _, _, tx_m, _ = scan.phase_centres(job.output)
    # to a nanometre in what is lit: a place on the Earth is seen under the same angle
    place = np.array([40.0, 0.0, 0.0])
    there = other.from_ecef(DATUM.to_ecef(place))
    ahead = (there - tx_m[:, 0]) / np.linalg.norm(there - tx_m[:, 0], axis=1, keepdims=True)
    np.testing.assert_allclose(looks.boresight, ahead, atol=1e-9)


@pytest.mark.parametrize(('record_options', 'job_options', 'text'), [
    ({'pointing': False}, {}, 'pulses do not tell where it looked; add their pointing'),
    ({}, {'method': 'ffbp'}, 'illumination')])
def test_what_cannot_be_weighed_is_lost_with_the_reason(tmp_path, record_options, job_options,
                                                        text):
    path = record(tmp_path / 'lit', **record_options)
    job = Job((str(path),), tmp_path / 'out', SPACING_M, datum=DATUM, tile=TILE, **job_options)
    [loss] = scan_recording(path, 'lit', job, job.output).losses
    assert text in loss.reason and '\n' not in loss.reason
