# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Archives in calibrated brightness: a reflector has its cross section in every product."""

import dataclasses
import json
import types

import numpy as np
import pytest

pytest.importorskip('zarr', reason='the extra archive is not installed')

from benchmarks.support.radiometry_scenes import GAIN, Flight, rough_surface
from sar_imaging.archive.division import DividedPulses, divide
from sar_imaging.archive.job import Brightness, Job, Products
from sar_imaging.archive.provenance import check_mosaic
from sar_imaging.archive.recordings import brightness_scale, scan_recording
from sar_imaging.archive.scans import RecordingScan, load_scan, write_job, write_scan
from sar_imaging.archive.storage import MOSAIC, image_array
from sar_imaging.archive.windows import Window, surface_points
from sar_imaging.archive.workflow import compute
from sar_imaging.formats import read_sicd
from sar_imaging.geometry.antenna import Antenna
from sar_imaging.geometry.illumination import Illumination, Pointing
from sar_imaging.quality.impulse_response import measure_scatterer
from sar_imaging.radiometry import RadarConstant, brightness
from sar_imaging.recordings import open_pulses
from sar_imaging.recordings.bag_io import write_bag
from sar_imaging.recordings.truth import antenna_truth, make_truth
from sar_imaging.tools.products.brightness import respond

from .small_archive import DATUM

sksicd = pytest.importorskip('sarkit.sicd', reason='sarkit is not installed: it needs Python 3.11')

verification = pytest.importorskip('sarkit.verification')

FLIGHT = Flight(1e3, n=64)
SPACING_M, TILE, SIZE_M2 = FLIGHT.grid.spacing_m, 32, 37.7
PLACE = np.array(FLIGHT.grid.centre_m) + [4.2, -6.1, 0.0]
ANTENNA = Antenna('gaussian', azimuth_width_deg=float(np.degrees(0.014)))


def record(path, block=None, antenna=None):
    """A reflector by the radar equation, lit by an antenna that dims it."""
    flight, looks = FLIGHT, None
    if antenna is not None:
        looks = Pointing.steered(flight.tx_m[:, 0], flight.grid.centre_m)
        lit = Illumination.of_pulses(antenna.amplitudes(), looks, flight.tx_m, flight.rx_m)
        assert 20 * np.log10(lit.amplitude(PLACE[None]).mean()) < -2
        block = flight.block(PLACE[None], np.sqrt([SIZE_M2]), lit)
    block = dataclasses.replace(block, pointing=looks)
    truth = make_truth(scenario='bright', description='', scatterers=[], grid=flight.grid,
                       pulses_per_aperture=block.n_pulses, n_pulses=block.n_pulses, n_channels=1,
                       cut_half_width_m=(3, 3), radar=block.radar, compressed=True, datum=DATUM)
    write_bag(path, [block], truth if antenna is None else truth | antenna_truth(antenna))
    return path


def imaged(path, tmp_path, quantity='rcs', **options):
    """A job of one recording that is done, and its scan."""
    job = Job((str(path),), tmp_path / 'out', SPACING_M, datum=DATUM, tile=TILE, checked_pixels=10,
              radiometry=Brightness(quantity, GAIN, 1e-3), **options)
    write_job(job)
    found = scan_recording(path, 'bright', job, job.output)
    assert not found.losses
    write_scan(job.output, found)
    [scan] = load_scan(job.output, 'bright').apertures
    assert scan == found.apertures[0]
    for piece in divide(job, [scan]).pieces:
        compute(piece, job.output)
    return job, scan


def samples_of(job, scan):
    return image_array(job.output, scan.name, scan.window, TILE).read(scan.window)


def cross_section_db(samples, grid, place=PLACE):
    """Of the reflector in an image, between the pixels."""
    peak = measure_scatterer(
        samples, grid, place, aperture_centre_m=FLIGHT.tx_m.mean(axis=(0, 1)),
        wavenumber_rad_per_m=FLIGHT.radar.wavenumber_rad_per_m, cut_half_width_range_m=3.0,
        cut_half_width_azimuth_m=3.0).peak_amplitude
    return 20 * np.log10(peak)


def test_a_trihedral_has_its_cross_section_in_every_product(tmp_path):
    rasterio = pytest.importorskip('rasterio', reason='the extra formats is not installed')
    path = record(tmp_path / 'lit', antenna=ANTENNA)
    job, scan = imaged(path, tmp_path, products=Products(('geotiff', 'sicd')))
    wanted = 10 * np.log10(SIZE_M2)
    grid = scan.window.grid(SPACING_M)
    samples = samples_of(job, scan)
    # 0.008 dB measured: the scale differs over the cell, and the peak lies between pixels
    assert cross_section_db(samples, grid) == pytest.approx(wanted, abs=0.1)
    peak_db = 20 * np.log10(np.abs(samples).max())
    with rasterio.open(job.output / f'images/{scan.name}.tif') as file:
        assert np.nanmax(file.read(1)) == pytest.approx(peak_db, abs=1e-4)
        assert file.descriptions == ('rcs, dB',)
        assert file.tags()['QUANTITY'] == 'rcs' and file.tags()['UNIT'] == 'm^2'
    with rasterio.open(job.output / 'mosaic.tif') as file:
        assert 10 * np.log10(np.nanmax(file.read(1))) == pytest.approx(peak_db, abs=1e-4)
        assert file.descriptions == ('mean rcs',)
    told = json.loads((job.output / f'items/image-{scan.name}.json').read_text())['properties']
    assert told['sar_imaging:quantity'] == 'rcs'
    assert told['sar_imaging:noise_equivalent_db'] == scan.radiometry.noise_equivalent_db
    assert json.loads((job.output / MOSAIC / 'power/.zattrs').read_text())['quantity'] == 'rcs'
    check_sicd(job.output / f'images/{scan.name}.nitf', wanted)


def padded(spectrum, times):
    """Zeros between the positive and the negative frequencies, for values between the pixels."""
    size = times * np.array(spectrum.shape)
    out = np.zeros(size, complex)
    rows, columns = (np.rint(np.fft.fftfreq(n) * n).astype(int) for n in spectrum.shape)
    out[np.ix_(rows % size[0], columns % size[1])] = spectrum
    return out


def check_sicd(path, wanted_db):
    """Read by us, and its factors evaluated by sarkit where the file has its reflector."""
    with open(path, 'rb') as file:
        checker = verification.SicdConsistency.from_file(file)
    checker.check()
    assert not checker.failures()
    read = read_sicd(path)
    assert read.image.radiometry.quantity == 'rcs'
    points = DATUM.from_ecef(read.datum.to_ecef(read.image.grid.points()))
    distance = np.linalg.norm(points - FLIGHT.tx_m.mean(axis=(0, 1)), axis=-1)
    phase = FLIGHT.radar.wavenumber_rad_per_m * distance
    spectrum = np.fft.fft2(read.image.samples * np.exp(-1j * phase))
    fine = np.abs(np.fft.ifft2(padded(spectrum, 8))) * 8**2
    # 0.04 dB measured: an eighth of a pixel besides
    assert 20 * np.log10(fine.max()) == pytest.approx(wanted_db, abs=0.1)
    with open(path, 'rb') as file, sksicd.NitfReader(file) as reader:
        pixels, helper = reader.read_image(), sksicd.XmlHelper(reader.metadata.xmltree)
    at = np.unravel_index(np.abs(pixels).argmax(), pixels.shape)
    place = [(index - middle) * helper.load(f'{{*}}Grid/{{*}}{axis}/{{*}}SS')
             for index, middle, axis in zip(at, helper.load('{*}ImageData/{*}SCPPixel'),
                                            ('Row', 'Col'), strict=True)]
    factor = np.polynomial.polynomial.polyval2d(*place, helper.load('{*}Radiometric/{*}RCSSFPoly'))
    assert 10 * np.log10(factor) == pytest.approx(0.0, abs=0.01)  # calibrated already
    assert helper.load('{*}Antenna/{*}TwoWay/{*}Array/{*}GainPoly') is not None


def test_divided_images_have_the_same_brightness(tmp_path):
    """Windows and sub-apertures: partial images stay as they are, their sum is scaled once."""
    path = record(tmp_path / 'lit', antenna=ANTENNA)
    job, scan = imaged(path, tmp_path)
    whole = samples_of(job, scan)
    window = scan.window
    column = (window.column0 + window.column1) // 2 // TILE * TILE
    parts = tuple(dataclasses.replace(window, **edge)
                  for edge in ({'column1': column}, {'column0': column}))
    n = scan.n_pulses
    division = dataclasses.replace(scan.division, windows=parts, pulses=((0, n // 2), (n // 2, n)))
    divided = dataclasses.replace(scan, division=division)
    other = dataclasses.replace(job, output=tmp_path / 'other')
    (other.output / 'scans').mkdir(parents=True)
    (other.output / scan.centres).write_bytes((job.output / scan.centres).read_bytes())
    write_job(other)
    write_scan(other.output, RecordingScan('bright', (divided,)))
    for piece in divide(other, [divided]).pieces:
        compute(piece, other.output)
    factors = scan.brightness_scale(job.output).factors()  # large where the antenna dims
    error = np.linalg.norm((samples_of(other, divided) - whole) / factors)
    # 9e-4 measured, with and without brightness: the plans of parts aim at -60 dB each
    assert error < 2e-3 * np.linalg.norm(whole / factors)
    # -49 dB measured: sidelobes, as bright where the antenna dims them as elsewhere
    assert check_mosaic(other.output, 40).error_db < -40


def test_a_rough_surface_has_its_brightness(tmp_path):
    """That of the command `image`, for the same pixels, and of the surface as it was made."""
    block = FLIGHT.block(*rough_surface(FLIGHT, 0.07, np.random.default_rng(3)))
    path = record(tmp_path / 'rough', block)
    job, scan = imaged(path, tmp_path, 'sigma0', method='exact')
    level = np.abs(samples_of(job, scan)) ** 2
    formed = level / scan.brightness_scale(job.output).factors() ** 2
    grid = scan.window.grid(SPACING_M)
    response = respond(open_pulses(path), types.SimpleNamespace(grid=grid))
    for quantity in ('beta0', 'sigma0', 'gamma0'):
        wanted = dataclasses.replace(job, radiometry=Brightness(quantity, GAIN),
                                     output=tmp_path / quantity)
        [found] = scan_recording(path, 'bright', wanted, wanted.output).apertures
        np.testing.assert_allclose(  # 3e-7 measured: float32
            found.brightness_scale(wanted.output).factors() ** 2 * formed,
            brightness(np.sqrt(formed), response, RadarConstant(GAIN), quantity), rtol=3e-6)
    # 0.24 dB measured; 700 looks have a deviation of 0.16 dB
    assert 10 * np.log10(level[10:-10, 10:-10].mean() / 0.07) == pytest.approx(0.0, abs=0.5)


def test_incidence_follows_the_ellipsoid():
    """100 km from the origin the ground is tilted by 0.9 degrees; the normal is that of WGS 84."""
    flight = Flight(1e3, n=17)
    x, y, _ = np.array(flight.grid.centre_m) + [100e3, 0.0, 0.0]
    job = Job(('a',), None, 0.3, datum=DATUM, surface='ellipsoid',
              radiometry=Brightness('sigma0', GAIN))
    middle = surface_points(job, [(x, y)])[0]
    latitude, longitude, height = DATUM.to_geographic(middle)
    up = DATUM.from_geographic(latitude, longitude, height + 1.0) - middle
    assert np.degrees(np.arccos(up[2])) == pytest.approx(0.9, abs=0.05)
    centres = flight.tx_m + [100e3, 0.0, middle[2]]
    pulses = DividedPulses(flight.radar, flight.n_samples, centres, centres)
    scale = brightness_scale(job, pulses, Window.around([(x - 2, y - 2), (x + 2, y + 2)], 0.3))
    look = centres.mean(axis=(0, 1)) - middle
    incidence = np.degrees(np.arccos(look @ up / np.linalg.norm(look)))
    # 0.002 degrees measured: the median of pixels, half a pixel from the middle
    assert scale.radiometry.incidence_deg == pytest.approx(incidence, abs=0.02)


def test_a_radar_that_stands_still_is_lost_with_the_reason(tmp_path):
    block = FLIGHT.block(PLACE[None], np.ones(1))
    still = np.broadcast_to(block.tx_m[48:49], block.tx_m.shape).copy()
    path = record(tmp_path / 'still', dataclasses.replace(block, tx_m=still, rx_m=still))
    job = Job((str(path),), tmp_path / 'out', SPACING_M, datum=DATUM, tile=TILE, method='exact',
              radiometry=Brightness('sigma0', GAIN))
    [loss] = scan_recording(path, 'still', job, job.output).losses
    assert 'stood still' in loss.reason and '\n' not in loss.reason
