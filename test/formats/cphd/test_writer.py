# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that the standard's own checker accepts, that other readers read, of right samples."""

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings, strategies as st

from sar_imaging.formats.cphd import Collection, CphdError, CphdReader, write_cphd
from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.earth import Datum
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.pulses import concatenate

from .conftest import DATUM, GRID, level_db, pulses

PLACES = {'equator': Datum(0.0, 8.0), '70 north': Datum(70.0, -30.0, 120.0),
          'date line': Datum(-17.0, 180.0, 30.0, 40.0)}


def problems(path):
    """What sarkit's consistency checker finds, its mere wishes included.

    Where transmitter and receiver are one, rounding may leave it no number for the bistatic angle;
    a file that then tells 0 is right.
    """
    import sarkit.cphd
    from sarkit.verification import CphdConsistency

    with open(path, 'rb') as file:
        checker = CphdConsistency.from_file(file, thorough=True)
        checker.check()
        file.seek(0)
        with sarkit.cphd.Reader(file) as reader:
            angle = reader.metadata.xmltree.findtext(
                '{*}ReferenceGeometry/{*}Bistatic/{*}BistaticAngle')
    assert checker.passes()  # it did look
    found = [(name, detail['details']) for name, result in checker.all().items()
             for detail in result['details'] if not detail['passed']]
    return [(name, text) for name, text in found
            if not (angle == '0.0' and text.startswith('BistaticAngle'))]


def read_whole(path, **options):
    with CphdReader(path, **options) as reader:
        return concatenate(list(reader.blocks()))


@pytest.mark.parametrize('side', [1, -1], ids=['right', 'left'])
@pytest.mark.parametrize(('place', 'compressed', 'n_channels', 'options'), [
    ('equator', False, 1, {}), ('70 north', False, 3, {'sign': 1}),
    ('date line', False, 2, {'domain': 'TOA'}), ('70 north', True, 1, {'sample_type': 'CI4'}),
    ('date line', True, 3, {'sample_type': 'CI2', 'sign': 1})])
def test_checker_accepts(tmp_path, place, side, compressed, n_channels, options):
    block = pulses(compressed, n_channels, side=side)
    write_cphd(tmp_path / 'a.cphd', [block], PLACES[place], GRID, **options)
    assert problems(tmp_path / 'a.cphd') == []


@pytest.mark.parametrize('heading_deg', [20.0, 190.0], ids=['ascending', 'descending'])
def test_checker_accepts_bistatic_pulses(tmp_path, heading_deg):
    block = pulses(False, 2, heading_deg=heading_deg, apart_m=400.0)
    write_cphd(tmp_path / 'a.cphd', [block], DATUM, GRID)
    assert problems(tmp_path / 'a.cphd') == []
    with CphdReader(tmp_path / 'a.cphd') as reader:
        assert reader.collection.collect_type == 'BISTATIC'


# Float32 samples are turned to another reference and back, each time rounded to 2**-24 of their
# magnitude, -144 dB; of a sum of pulses over many pixels the largest difference is some 10 dB up.
@pytest.mark.parametrize('place', PLACES)
@pytest.mark.parametrize('compressed', [False, True])
@pytest.mark.parametrize('n_channels', [1, 3])
def test_image_is_that_of_the_pulses(tmp_path, place, compressed, n_channels):
    block = pulses(compressed, n_channels)
    write_cphd(tmp_path / 'a.cphd', [block.select(slice(0, 13)), block.select(slice(13, None))],
               PLACES[place], GRID)
    again = read_whole(tmp_path / 'a.cphd', datum=PLACES[place])
    images = [plan_image(GRID, b.radar, b.n_samples, compressed=compressed,
                         method='correlation')(b) for b in (block, again)]
    assert level_db(images[0].samples - images[1].samples, images[0].samples) < -120
    np.testing.assert_array_equal(again.stamp_ns, block.stamp_ns)
    np.testing.assert_allclose(again.tx_m, block.tx_m, atol=3e-9)  # rounding of 6,400 km
    np.testing.assert_allclose(again.rx_m, block.rx_m, atol=3e-9)


def test_sarkit_reads_what_the_standard_says(tmp_path):
    """Peak phases in both domains by the formulas of the standard, through sarkit's reader."""
    import sarkit.cphd as skcphd

    for domain, block in (('FX', pulses()), ('TOA', pulses(True))):
        # one reflector alone, 30 m behind the reference point
        write_cphd(tmp_path / domain, [block], DATUM, GRID)
        with open(tmp_path / domain, 'rb') as file, skcphd.Reader(file) as reader:
            signal, pvps = reader.read_channel('Channel_1')
        assert signal.shape == (40, block.n_samples)
        delay = (np.linalg.norm(pvps['TxPos'] - pvps['SRPPos'], axis=-1)
                 + np.linalg.norm(pvps['RcvPos'] - pvps['SRPPos'], axis=-1)) / 299_792_458.0
        np.testing.assert_allclose(pvps['RcvTime'] - pvps['TxTime'], delay, atol=1e-12)
        # a reflector of amplitude 1 stands at the reference: phase 0 there, whatever the domain
        axis = pvps['SC0'][:, None] + pvps['SCSS'][:, None] * np.arange(signal.shape[1])
        if domain == 'FX':
            peak = signal.mean(axis=-1)
        else:
            bandwidth = (pvps['FX2'] - pvps['FX1'])[0]
            peak = (signal * np.sinc(bandwidth * axis)).sum(axis=-1) * bandwidth * pvps['SCSS'][0]
        # the other reflectors are 10 m and more away in range: their sidelobes reach -23 dB
        np.testing.assert_allclose(peak, 1.0, atol=0.08)


def test_velocities_and_doppler(tmp_path):
    import sarkit.cphd as skcphd

    block = pulses()
    write_cphd(tmp_path / 'a.cphd', [block], DATUM, GRID)
    with open(tmp_path / 'a.cphd', 'rb') as file, skcphd.Reader(file) as reader:
        pvps = reader.read_pvps('Channel_1')
    expected = DATUM.vectors_to_ecef([100.0, 0.0, 0.0])  # of the straight flight
    np.testing.assert_allclose(pvps['TxVel'], np.tile(expected, (40, 1)), atol=1e-5)
    line = block.tx_m[:, 0] / np.linalg.norm(block.tx_m[:, 0], axis=-1, keepdims=True)
    np.testing.assert_allclose(pvps['aFDOP'], -2 * 100 * line[:, 0] / 299_792_458.0, rtol=1e-6)


def test_sarpy_reads_it(tmp_path):
    converter = pytest.importorskip('sarpy.io.phase_history.converter',
                                    reason='sarpy is the second reader, for development')
    block = pulses(False, 2)
    write_cphd(tmp_path / 'a.cphd', [block], DATUM, GRID)
    other = converter.open_phase_history(str(tmp_path / 'a.cphd'))
    assert other.cphd_meta.Channel.RefChId == 'Channel_1'
    again = read_whole(tmp_path / 'a.cphd', datum=DATUM)
    for channel in range(2):
        signal = np.asarray(other.read(index=channel))
        tx = other.read_pvp_variable('TxPos', channel)
        np.testing.assert_allclose(DATUM.from_ecef(tx), block.tx_m[:, channel], atol=3e-9)
        # the same magnitudes: only phases are referred to another point
        np.testing.assert_allclose(np.abs(signal), np.abs(again.samples[:, channel]), atol=1e-6)
    other.close()


def test_collection_is_told(tmp_path):
    told = Collection(collector_name='Aircraft', core_name='2023-11-14', mode_type='STRIPMAP',
                      illuminator_name='Transmitter', collect_type='BISTATIC', mode_id='strip 3',
                      country_code='CH', classification='PRIVATE', release_info='SOMEBODY',
                      channels=('fore', 'aft'), polarisations=(('H', 'V'), ('V', 'V')))
    write_cphd(tmp_path / 'a.cphd', [pulses(n_channels=2)], DATUM, GRID, collection=told)
    assert problems(tmp_path / 'a.cphd') == []
    with CphdReader(tmp_path / 'a.cphd') as reader:
        assert reader.collection == told
        assert reader.datum.latitude_deg == pytest.approx(DATUM.latitude_deg, abs=1e-12)
        assert reader.datum.height_m == pytest.approx(DATUM.height_m, abs=1e-8)
        half = GRID.n_x * GRID.spacing_m / 2
        np.testing.assert_allclose(reader.area_m[2], [half, half, 0], atol=1e-6)


def test_grid_beside_the_origin_is_the_reference(tmp_path):
    grid = dataclasses.replace(GRID, centre_m=(120.0, -80.0, 3.0))
    write_cphd(tmp_path / 'a.cphd', [pulses()], DATUM, grid)
    assert problems(tmp_path / 'a.cphd') == []
    with CphdReader(tmp_path / 'a.cphd', datum=DATUM) as reader:
        np.testing.assert_allclose(reader.area_m.mean(axis=0), grid.centre_m, atol=1e-6)
        assert reader.map_grid().centre_m == pytest.approx(grid.centre_m, abs=1e-6)


def test_pulses_of_silence_are_flagged(tmp_path):
    block = pulses()
    samples = block.samples.copy()
    samples[5] = 0
    write_cphd(tmp_path / 'a.cphd', [dataclasses.replace(block, samples=samples)], DATUM, GRID)
    assert problems(tmp_path / 'a.cphd') == []
    with CphdReader(tmp_path / 'a.cphd') as reader:
        assert any('1 of 40 vectors have no signal' in text for text in reader.warnings)
        again = concatenate(list(reader.blocks(memory_bytes=1)))
    assert 5 not in again.counter and again.n_pulses == 39


def test_the_same_pulses_give_the_same_bytes_however_they_come(tmp_path):
    block = pulses(n_channels=2)
    write_cphd(tmp_path / 'a.cphd', [block], DATUM, GRID)
    write_cphd(tmp_path / 'b.cphd', [block.select(slice(i, i + 7)) for i in range(0, 40, 7)],
               DATUM, GRID)
    assert (tmp_path / 'a.cphd').read_bytes() == (tmp_path / 'b.cphd').read_bytes()


def test_a_failed_writing_leaves_nothing(tmp_path):
    block = pulses()

    def interrupted():
        yield block
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_cphd(tmp_path / 'a.cphd', interrupted(), DATUM, GRID)
    assert list(tmp_path.iterdir()) == []
    write_cphd(tmp_path / 'a.cphd', [block], DATUM, GRID)
    before = (tmp_path / 'a.cphd').read_bytes()
    with pytest.raises(CphdError, match='exists already'):
        write_cphd(tmp_path / 'a.cphd', [block], DATUM, GRID)
    with pytest.raises(KeyboardInterrupt):
        write_cphd(tmp_path / 'a.cphd', interrupted(), DATUM, GRID, overwrite=True)
    assert (tmp_path / 'a.cphd').read_bytes() == before


@pytest.mark.parametrize(('change', 'text'), [
    (lambda b: dataclasses.replace(b, tx_m=None, rx_m=None), 'no phase centres'),
    (lambda b: b.select(slice(0, 1)), 'two or more'),
    (lambda b: b.select(slice(0, 0)), 'no pulse'),
    (lambda b: b.select(slice(None, None, -1)), 'order of time'),
    (lambda b: dataclasses.replace(b, tx_m=b.tx_m * 0 + [0, -3e3, 1e3],
                                   rx_m=b.rx_m * 0 + [0, -3e3, 1e3]), 'do not move'),
    (lambda b: dataclasses.replace(b, radar=dataclasses.replace(
        b.radar, propagation_speed_m_per_s=1e8)), 'in air'),
    (lambda b: dataclasses.replace(b, samples=b.samples * np.nan), 'NaN')])
def test_pulses_that_are_no_cphd(tmp_path, change, text):
    with pytest.raises(CphdError, match=text):
        write_cphd(tmp_path / 'a.cphd', [change(pulses())], DATUM, GRID)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(('options', 'text'), [
    ({'domain': 'FX'}, 'only phase histories'), ({'domain': 'XY'}, 'expected FX or TOA'),
    ({'sign': 0}, 'sign=0'), ({'sample_type': 'CF16'}, 'sample_type'),
    ({'collection': Collection(channels=('a', 'b'))}, 'channels are 2')])
def test_options_that_do_not_exist(tmp_path, options, text):
    with pytest.raises(CphdError, match=text):
        write_cphd(tmp_path / 'a.cphd', [pulses(True)], DATUM, GRID, **options)


def test_profiles_sampled_too_coarsely(tmp_path):
    block = pulses(True)
    radar = dataclasses.replace(block.radar, bandwidth_hz=290e6)
    with pytest.raises(CphdError, match='oversampling'):
        write_cphd(tmp_path / 'a.cphd', [dataclasses.replace(block, radar=radar)], DATUM, GRID)


def test_no_scene_on_one_plane(tmp_path):
    with pytest.raises(CphdError, match='no scene on one'):
        write_cphd(tmp_path / 'a.cphd', [pulses()], DATUM, MapGrid((0, 0, 0), 10**5, 10**5, 100.0))


def test_a_channel_may_send_and_receive_at_one_place_beside_others(tmp_path):
    """Its bistatic angle is the arc cosine of 1, or of what rounding puts above it."""
    middle = 4139.874406901519 * np.array([0.5468 * np.cos(0.3), 0.5468 * np.sin(0.3), 0.8373])
    velocity = np.array([249.975469768916, 0.0, -55.211885])
    tx = np.repeat((middle + (np.arange(11) - 5.5)[:, None] * 0.01 * velocity)[:, None], 2, 1)
    rx = tx + np.arange(2)[:, None] * velocity
    block = dataclasses.replace(pulses(False, 2, 11), tx_m=tx, rx_m=rx)
    for latitude in np.linspace(-80.0, 80.0, 33):
        write_cphd(tmp_path / 'a.cphd', [block], Datum(latitude, 16.25, 0.0, 3.6), GRID,
                   overwrite=True)
        assert problems(tmp_path / 'a.cphd') == []


@settings(max_examples=20, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_checker_accepts_any_geometry(tmp_path, data):
    """Anywhere on the Earth, with tracks of any direction, climb and squint, far and near."""
    def number(low, high):
        return data.draw(st.floats(low, high))

    n_pulses, n_channels = data.draw(st.integers(2, 12)), data.draw(st.integers(1, 3))
    away, elevation, bearing = number(200, 20e3), number(5, 80), number(0, 2 * np.pi)
    course, speed, climb = number(0, 2 * np.pi), number(1, 300), number(-0.3, 0.3)
    assume(abs(np.sin(course - bearing)) > 1e-3)  # straight over the scene: not defined
    up = np.radians(elevation)
    middle = away * np.array([np.cos(up) * np.cos(bearing), np.cos(up) * np.sin(bearing),
                              np.sin(up)])
    velocity = speed * np.array([np.cos(course), np.sin(course), climb])
    time = (np.arange(n_pulses) - n_pulses / 2) * 0.01
    tx = np.repeat((middle + time[:, None] * velocity)[:, None], n_channels, 1)
    rx = tx + np.arange(n_channels)[:, None] * velocity / speed * number(0, 2 * away)
    model = pulses(data.draw(st.booleans()), n_channels, n_pulses)
    radar = dataclasses.replace(model.radar, first_sample_delay_s=2 * away / 299_792_458.0)
    block = dataclasses.replace(model, radar=radar, tx_m=tx, rx_m=rx)
    datum = Datum(number(-89.5, 89.5), number(-180, 180), number(-400, 5000), number(-180, 180))
    write_cphd(tmp_path / 'a.cphd', [block], datum, GRID, overwrite=True,
               sign=data.draw(st.sampled_from([-1, 1])),
               sample_type=data.draw(st.sampled_from(['CF8', 'CI4', 'CI2'])))
    assert problems(tmp_path / 'a.cphd') == []
    again = read_whole(tmp_path / 'a.cphd', datum=datum)
    np.testing.assert_allclose(again.tx_m, tx, atol=1e-8)
    np.testing.assert_allclose(again.rx_m, rx, atol=1e-8)
    np.testing.assert_array_equal(again.stamp_ns, block.stamp_ns)
