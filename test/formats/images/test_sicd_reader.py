# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of others, damaged files, and files that lie."""

import os
import pathlib

import numpy as np
import pytest
from hypothesis import given, settings

from sar_imaging.formats import read_sicd, write_sicd
from sar_imaging.formats.sicd.layout import lay_out

from .damage import PROPERTY, Content, damaged, mutations

sksicd = pytest.importorskip('sarkit.sicd', reason='sarkit is not installed: it needs Python 3.11')

ROOT = pathlib.Path(__file__).resolve().parents[3]
# croppedNitfs/SICD of ngageoint/six-library
SAMPLES = pathlib.Path(os.environ.get('SICD_SAMPLES', ROOT.parent / 'shared/data/sicd_samples'))
NO_SAMPLES = f'no {SAMPLES}: croppedNitfs/SICD of ngageoint/six-library, or SICD_SAMPLES'


@pytest.mark.data
def test_public_samples():
    paths = sorted(SAMPLES.glob('*sicd*.nitf'))
    if not paths:
        pytest.skip(NO_SAMPLES)
    for path in paths:
        product = read_sicd(path)
        assert product.image.shape == (5, 5)
        # what all of these files tell of one acquisition of TerraSAR-X
        assert product.acquisition.radar.carrier_hz == pytest.approx(9.65e9)
        assert (product.datum.latitude_deg, product.datum.longitude_deg) == pytest.approx(
            (47.858400, 12.138994), abs=1e-6)
        track = product.acquisition.centre_m[:, 2]
        assert 470e3 < track.min() <= track.max() < 530e3
        spacing = np.linalg.norm(product.image.grid.steps_m, axis=1)
        np.testing.assert_allclose(spacing, (0.909403, 1.0), rtol=0.3)


@pytest.mark.data
def test_public_samples_as_the_reference_reads_them():
    paths = [SAMPLES / f'cropped_sicd_{name}.nitf' for name in ('110', 'extra_des')]
    if not all(path.exists() for path in paths):
        pytest.skip(NO_SAMPLES)
    for path in paths:
        with open(path, 'rb') as file, sksicd.NitfReader(file) as reader:
            pixels, tree = reader.read_image(), reader.metadata.xmltree
        samples = pixels['real'] + 1j * pixels['imag']
        # the carrier along rows, KCtr, is back: by so many turns a row from the middle
        turns = [float(tree.findtext(f'{{*}}Grid/{{*}}{name}/{{*}}KCtr'))
                 * float(tree.findtext(f'{{*}}Grid/{{*}}{name}/{{*}}SS')) * (
                     np.arange(5) + int(tree.findtext(f'{{*}}ImageData/{{*}}First{name}'))
                     - int(tree.findtext(f'{{*}}ImageData/{{*}}SCPPixel/{{*}}{name}')))
                 for name in ('Row', 'Col')]
        expected = samples * np.exp(2j * np.pi * np.add.outer(*turns))
        # float32 of the product
        np.testing.assert_allclose(read_sicd(path).image.samples, expected,
                                   atol=1e-6 * np.abs(samples).max())


@pytest.fixture(scope='module')
def written(flight, tmp_path_factory):
    """Bytes of a small file."""
    flown = flight()
    path = tmp_path_factory.mktemp('sicd') / 'image.nitf'
    write_sicd(path, flown.sicd_image(size_m=8.0), flown.datum, flown.acquisition)
    return Content(path.read_bytes())


def read(tmp_path, content):
    path = tmp_path / 'damaged.nitf'
    path.write_bytes(content)
    return read_sicd(path)


def test_of_any_length_that_is_cut_off(written, tmp_path):
    for length in [0, 3, 4, 300, *range(400, len(written), len(written) // 40), len(written) - 1]:
        with pytest.raises(ValueError, match='damaged.nitf cannot be read as SICD: '):
            read(tmp_path, written[:length])


@pytest.mark.parametrize(('old', 'new', 'told'), [
    (b'<NumRows>', b'<NumRows>9', 'its segments hold .* rows .*, its XML tells of 9'),
    (b'<NumRows>', b'<NumRows>-', r'ImageData/NumRows=-\d+; expected a whole number of 1 to'),
    (b'<NumRows>', b'<NumRows>x', "ImageData/NumRows='x.*; expected a number"),
    (b'>RE32F_IM32F<', b'>RE64F_IM64F<', "PixelType='RE64F_IM64F'; expected one of RE32F"),
    (b'<SS>', b'<SS>-', 'Grid/Row/SS=-.*; expected metres between pixels'),
    (b'<Sgn>-1', b'<Sgn>0', 'Grid/Row/Sgn=0, Grid/Col/Sgn=-1; expected -1 of both'),
    (b'>WGS_84<', b'>MARS<', 'EarthModel=MARS; expected WGS_84'),
    (b'<ECF><X>', b'<ECF><X>999999', 'SCP is no place near the Earth'),
    (b'<SCP>', b'<SCQ>', 'its XML is damaged'),
    (b'<X>', b'<X>nan', 'expected a number'),
    (b'<TEndProc>', b'<TEndProc>-', 'expected an interval of less than a day'),
    (b'<CollectStart>', b'<CollectStart>about ', 'expected a date such as'),
    (b'NITF02.10', b'PITF02.10', 'does not begin with NITF'),
    (b'urn:SICD:1.3.0"><CollectionInfo', b'urn:SICD:1.3.0"><CollectionInfi', 'XML is damaged')])
def test_absurd_values(written, tmp_path, old, new, told):
    assert old in written
    grown = len(new) - len(old)
    text = written.replace(old, new, 1)
    if grown:  # the header tells the length of the XML
        length = len(written) - written.index(b'<SICD')
        text = text.replace(b'%09d' % length, b'%09d' % (length + grown), 1)
    with pytest.raises(ValueError, match=told):
        read(tmp_path, text)


def test_a_mark_of_bytes_before_the_xml(written, tmp_path):
    length = len(written) - written.index(b'<SICD')
    text = written.replace(b'<SICD', b'\xef\xbb\xbf<SICD', 1)
    text = text.replace(b'%09d' % length, b'%09d' % (length + 3), 1)
    assert read(tmp_path, text).image.shape == read(tmp_path, written).image.shape


def test_other_files(tmp_path):
    with pytest.raises(ValueError, match='does not begin with NITF'):
        read(tmp_path, b'II*\0 no such file')
    with pytest.raises(FileNotFoundError):
        read_sicd(tmp_path / 'none.nitf')


def test_conjugate_samples(written, tmp_path):
    """Sgn +1: frequencies count the other way round, and so does the carrier."""
    ours = read(tmp_path, written)
    other = read(tmp_path, written.replace(b'<Sgn>-1</Sgn>', b'<Sgn>+1</Sgn>'))
    samples = at_baseband(ours).conj()
    np.testing.assert_array_equal(at_baseband(other), samples)


def at_baseband(product):
    return lay_out(product.image.grid, product.acquisition).at_baseband(product.image.samples)


def test_frequencies_relative_to_a_secret_one(written, tmp_path):
    """RefFreqIndex: the carrier is that of the samples, by KCtr on this ground plane."""
    index = b'</TxFrequency><RefFreqIndex>3</RefFreqIndex>'
    text = written.replace(b'</TxFrequency>', index, 1)
    length = len(written) - written.index(b'<SICD')
    text = text.replace(b'%09d' % length, b'%09d' % (length + len(index) - 14), 1)
    product, ours = read(tmp_path, text), read(tmp_path, written)
    assert ours.acquisition.radar.carrier_hz == pytest.approx(9.6e9)
    assert product.acquisition.radar.carrier_hz == pytest.approx(
        9.6e9 * 3000 / np.hypot(3000, 1500), rel=0.001)
    np.testing.assert_array_equal(product.image.samples, ours.image.samples)


def test_image_of_several_segments(flight, tmp_path, monkeypatch):
    """Files of 10 GB and more have them; here of 5 kB."""
    constants = pytest.importorskip('sarkit.sicd._constants')
    flown = flight()
    image, path = flown.sicd_image(size_m=8.0), tmp_path / 'image.nitf'
    monkeypatch.setattr(constants, 'IS_SIZE_MAX', 3000)
    write_sicd(path, image, flown.datum, flown.acquisition)
    assert path.read_bytes().count(b'IMSICD00') > 2
    np.testing.assert_array_equal(read_sicd(path).image.samples, image.samples)


def survives(tmp_path, written, changes):
    """A damaged file is read, or refused with one clear line, within the memory of its size."""
    start = written.index(b'<SICD')
    headers = [(0, 900), (start - 1200, start), (start, len(written))]
    try:
        product = read(tmp_path, damaged(written, changes, headers))
    except ValueError as error:
        assert 'cannot be read as SICD' in str(error) and '\n' not in str(error)
    else:
        assert product.image.samples.nbytes <= len(written)
        assert np.prod(product.image.shape) == product.image.samples.size


@settings(max_examples=300, derandomize=True, **PROPERTY)
@given(mutations())
def test_damaged_files(written, tmp_path, little_memory, changes):
    survives(tmp_path, written, changes)


@pytest.mark.campaign
@settings(max_examples=10_000, **PROPERTY)
@given(mutations())
def test_many_damaged_files(written, tmp_path, little_memory, changes):
    survives(tmp_path, written, changes)
