# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files whose samples follow from the standard's formulas, read as pulses in closed form."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.formats.cphd import CphdError, CphdReader, write_cphd
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal.pulses import concatenate

from .conftest import (
    AMPLITUDES,
    DATUM,
    GRID,
    POINTS_M,
    by_formula,
    expected_phase_history,
    level_db,
    pulses,
)

ROUNDING_DB = -125.0  # float32 samples, turned once: 2**-24 of each of three reflectors


def template(folder, compressed=False, **options):
    n_channels = options.pop('n_channels', 1)
    write_cphd(folder / 'template.cphd', [pulses(compressed, n_channels)], DATUM, GRID, **options)
    return folder / 'template.cphd'


def read_whole(path, **options):
    with CphdReader(path, datum=DATUM, **options) as reader:
        return concatenate(list(reader.blocks())), reader.warnings


def moved(step_m):
    """Edit: the reference point moves along the scene, from vector to vector."""
    def edit(tree, pvps):
        for own in pvps.values():
            along = np.arange(len(own)) - len(own) / 2
            own['SRPPos'] += DATUM.vectors_to_ecef([0.3, 1.0, 0.0]) * step_m * along[:, None]
        for node in tree.iter('{*}SRPFixed', '{*}SRPFixedCPHD'):
            node.text = 'false'
    return edit


def both(*edits):
    def edit(tree, pvps):
        for one in edits:
            one(tree, pvps)
    return edit


@pytest.mark.parametrize('sign', [-1, 1])
@pytest.mark.parametrize('step_m', [0.0, 0.2], ids=['fixed', 'moving'])
@pytest.mark.parametrize('n_channels', [1, 3])
def test_phase_histories(tmp_path, sign, step_m, n_channels):
    path = by_formula(template(tmp_path, sign=sign, n_channels=n_channels), tmp_path / 'b',
                      moved(step_m))
    block, warnings = read_whole(path)
    assert warnings == [] and not block.compressed and block.n_channels == n_channels
    expected = expected_phase_history(block)
    assert level_db(block.samples - expected, expected) < ROUNDING_DB


@pytest.mark.parametrize('sign', [-1, 1])
@pytest.mark.parametrize(('step_m', 'rate'), [(0.0, 2.0), (0.2, 2.0), (0.0, 1.1), (0.2, 1.15)])
def test_range_profiles(tmp_path, sign, step_m, rate):
    """Each vector begins at its own part of a sample, and samples may be as few as in no image."""
    path = by_formula(template(tmp_path, True, sign=sign), tmp_path / 'b', both(
        moved(step_m), sampled(rate)))
    block, warnings = read_whole(path)
    assert [w for w in warnings if ('parts of a sample' if rate == 2.0 else f'{rate}') in w]
    assert block.radar.sample_rate_hz >= 1.25 * block.radar.bandwidth_hz
    time = (block.radar.first_sample_delay_s
            + np.arange(block.n_samples) / block.radar.sample_rate_hz)
    expected = echoes(block, np.broadcast_to(time, (block.n_pulses, block.n_samples)))
    # Sidelobes of 1 / (pi x) are cut off at the ends of the window, x = 120 or more away, -50 dB;
    # at a quarter of the filter's reach (24 / (rate - 1) cells) they changed by -65 dB or less.
    inner = slice(120, -120)
    assert level_db((block.samples[:, 0] - expected)[:, inner], expected) < -110


@pytest.mark.parametrize('rate', [1.1, 1.15, 1.2])
def test_sparse_range_profiles_are_imaged(tmp_path, rate):
    """Cuts through each reflector: place and width as of the same sum over the true echoes."""
    path = by_formula(template(tmp_path, True), tmp_path / 'b', sampled(rate))
    block, _ = read_whole(path)
    for point in POINTS_M:
        for axis in range(2):
            along = np.linspace(-3.0, 3.0, 241)
            points = point + np.eye(3)[axis] * along[:, None]
            delay = travel(block.tx_m, block.rx_m, points)
            exact = (echoes(block, delay) * np.exp(2j * np.pi * 9.6e9 * delay)).sum(axis=0)
            image = plan_image(points, block.radar, block.n_samples, target_db=-70.0)(block)
            # float32 and the target: far less than 0.2 cm of widths of 1 m and 2 m
            np.testing.assert_allclose(place_and_width(along, np.abs(image)),
                                       place_and_width(along, np.abs(exact)), atol=2e-3)


@pytest.mark.parametrize('rate', [1.1, 2.0])
def test_profiles_of_integers_keep_the_predicted_error(tmp_path, rate):
    """Rounding noise beyond the band was read as it came: -41 dB where -61 dB were predicted."""
    def larger(tree, pvps):  # the template's echoes peak elsewhere in a sample
        for own in pvps.values():
            own['AmpSF'] *= 1.3

    block, _ = read_whole(by_formula(template(tmp_path, True, sample_type='CI2'), tmp_path / 'b',
                                     both(larger, sampled(rate))))
    image = plan_image(GRID, block.radar, block.n_samples, method='exact')(block)
    assert measure_error(image, GRID, block).error_db < image.report.predicted_error_db + 3.0


def travel(tx_m, rx_m, points):
    """(P, K) two-way delays of points, s."""
    return (np.linalg.norm(tx_m - points, axis=-1)
            + np.linalg.norm(rx_m - points, axis=-1)) / 299_792_458.0


def echoes(block, time):
    """(P, K) range profiles of the reflectors at delays of the pulses, in closed form."""
    delay = travel(block.tx_m, block.rx_m, POINTS_M)[..., None]
    return np.einsum('s,psk->pk', AMPLITUDES, np.sinc(150e6 * (time[:, None] - delay))
                     * np.exp(-2j * np.pi * 9.6e9 * delay))


def place_and_width(along, magnitude):
    """Peak by a parabola, and the length above 3 dB below it, metres."""
    peak = int(magnitude[40:-40].argmax()) + 40
    before, most, after = magnitude[peak - 1:peak + 2]
    shift = 0.5 * (before - after) / (before - 2 * most + after)
    level = 10 ** -0.15 * magnitude[peak]
    ends = [np.interp(level, *((magnitude[s], along[s]) if magnitude[s][-1] > magnitude[s][0]
                               else (magnitude[s][::-1], along[s][::-1])))
            for s in (slice(falling(magnitude, peak, -1), peak + 1),
                      slice(peak, falling(magnitude, peak, 1) + 1))]
    return along[peak] + shift * (along[1] - along[0]), ends[1] - ends[0]


def falling(magnitude, peak, step):
    """How far a lobe falls from its peak."""
    while 0 < peak < len(magnitude) - 1 and magnitude[peak + step] < magnitude[peak]:
        peak += step
    return peak


def sampled(rate):
    """Edit: so many samples per 1 / bandwidth, and every vector begins at a part of one."""
    def edit(tree, pvps):
        for own in pvps.values():
            n, part = 512, np.linspace(0, 3.3, len(own)) * own['SCSS']
            middle = own['SC0'] + own['SCSS'] * n / 2 + part
            own['SCSS'] = 1 / (150e6 * rate)
            own['SC0'] = own['TOA1'] = middle - own['SCSS'] * n / 2
            own['TOA2'] = own['SC0'] + own['SCSS'] * (n - 1)
    return edit


@pytest.mark.parametrize('kind', ['CI2', 'CI4'])
def test_integer_samples_with_factors(tmp_path, kind):
    def edit(tree, pvps):
        for own in pvps.values():
            own['AmpSF'] *= np.linspace(1.0, 2.0, len(own))

    path = by_formula(template(tmp_path, sample_type=kind), tmp_path / 'b', edit)
    block, _ = read_whole(path)
    expected = expected_phase_history(block)
    # half a unit of the coarsest factor, in both parts: 2 * 2.2 / 127 or / 32767
    limit = 20 * np.log10(2 * 2.2 / (127 if kind == 'CI2' else 32767) / np.sqrt(2) / 2.2)
    assert limit - 12 < level_db(block.samples - expected, expected) < limit + 1


def test_band_narrower_than_the_samples(tmp_path):
    """Frequencies outside of every vector's band are cut, those outside of its own are zero."""
    def edit(tree, pvps):
        for own in pvps.values():
            step = own['SCSS'][0]
            own['FX1'] = own['SC0'] + 20 * step
            own['FX2'] = own['SC0'] + (200 + np.arange(len(own)) % 5) * step

    path = by_formula(template(tmp_path), tmp_path / 'b', edit)
    block, warnings = read_whole(path)
    assert block.n_samples == 204 - 20 + 1
    assert any('71 of 256 frequencies' in text for text in warnings)
    expected = expected_phase_history(block)
    index = np.arange(block.n_samples)
    expected[index > 180 + (np.arange(40) % 5)[:, None, None]] = 0
    assert level_db(block.samples - expected, expected) < ROUNDING_DB


def test_bands_that_step_from_vector_to_vector(tmp_path):
    def edit(tree, pvps):
        for own in pvps.values():
            offset = 8 * (np.arange(len(own)) % 4) * own['SCSS']
            for name in ('SC0', 'FX1', 'FX2'):
                own[name] += offset

    path = by_formula(template(tmp_path), tmp_path / 'b', edit)
    block, _ = read_whole(path)
    assert block.n_samples == 256 + 24
    expected = expected_phase_history(block)
    offset = 8 * (np.arange(40) % 4)[:, None, None]
    index = np.arange(block.n_samples)
    expected[(index < offset) | (index > offset + 255)] = 0
    assert level_db(block.samples - expected, expected) < ROUNDING_DB


@pytest.mark.parametrize(('name', 'factor', 'text'), [
    ('SC0', 1 + 1e-6 * np.arange(40), 'parts of a step'),
    ('SCSS', 1 + 1e-4 * np.arange(40), 'parts of a step')])
def test_frequencies_beside_one_lattice_are_refused(tmp_path, name, factor, text):
    def edit(tree, pvps):
        for own in pvps.values():
            own[name] *= factor

    path = by_formula(template(tmp_path), tmp_path / 'b', edit)
    with pytest.raises(CphdError, match=text):
        CphdReader(path)


def test_a_reference_that_moves_farther_than_the_window(tmp_path):
    """Satellites walk through many windows: blocks get longer, echoes do not fold."""
    def edit(tree, pvps):
        moved(6.0)(tree, pvps)  # 190 m of range in a window of 128 m, of which 64 m are told
        for own in pvps.values():
            own['TOA1'], own['TOA2'] = -0.2 / own['SCSS'], 0.2 / own['SCSS']

    path = by_formula(template(tmp_path), tmp_path / 'b', edit)
    block, warnings = read_whole(path)
    assert any('frequencies instead of 256' in text for text in warnings)
    assert any('do not overlap' in text for text in warnings)
    # Image of the vectors whose window holds all reflectors, beside that of the direct pulses.
    # Profiles are cut to the window: sidelobes of 1 / (pi x) beyond x = 60 are missing, -45 dB.
    own = slice(16, 25)
    direct = pulses().select(own)
    images = [plan_image(GRID, b.radar, b.n_samples, compressed=False, method='correlation')(b)
              for b in (direct, block.select(own))]
    assert level_db(images[0].samples - images[1].samples, images[0].samples) < -40


def test_a_squinted_satellite(tmp_path):
    """The range to one reference walks through five windows; every vector sees the scene."""
    import sarkit.cphd as skcphd

    def edit(tree, pvps):
        [own] = pvps.values()
        time = np.linspace(0, 0.6, len(own))
        place = DATUM.to_ecef(np.stack([-120e3 + 7500 * time, np.full(len(own), -500e3),
                                        np.full(len(own), 500e3)], -1))
        own['TxPos'], own['RcvPos'] = place, place + DATUM.vectors_to_ecef([35.0, 0, 0])
        own['TxTime'] = time
        own['RcvTime'] = time + 2 * np.linalg.norm(place - own['SRPPos'], axis=-1) / 3e8

    path = by_formula(template(tmp_path), tmp_path / 'b', edit)
    block, warnings = read_whole(path)
    assert any('frequencies instead of 256' in text for text in warnings)
    walk = np.ptp(np.linalg.norm(block.tx_m[:, 0], axis=-1))
    assert walk > 5 * 128.0  # metres; the unambiguous window
    grid = dataclasses.replace(GRID, n_x=24, n_y=24, spacing_m=1.5)
    image = plan_image(grid, block.radar, block.n_samples, compressed=False,
                       method='correlation')(block)
    # directly: each vector correlated with the standard's model of every pixel, float64
    with open(path, 'rb') as file, skcphd.Reader(file) as reader:
        signal, own = reader.read_channel('Channel_1')
    points = DATUM.to_ecef(grid.points().reshape(-1, 3))
    frequency = own['SC0'][:, None] + own['SCSS'][:, None] * np.arange(256)
    direct = np.zeros(len(points), complex)
    for vector, samples, f in zip(own, signal.astype(complex), frequency, strict=True):
        delay = sum(np.linalg.norm(points - vector[p], axis=-1)
                    - np.linalg.norm(vector['SRPPos'] - vector[p]) for p in ('TxPos', 'RcvPos'))
        direct += np.exp(2j * np.pi * np.multiply.outer(delay / 299_792_458.0, f)) @ samples / 256
    turned = image.samples.ravel()
    ratio = np.vdot(direct, turned) / np.vdot(direct, direct)
    # Each profile ends with its window: of sidelobes 1 / (pi x) those beyond x = 128 are missing,
    # which adds up to 4 / (pi^2 256), -56 dB.
    assert abs(ratio - 1) < 1e-3
    assert level_db(turned - ratio * direct, direct) < -55


def test_a_reference_that_moves_absurdly_far_is_refused(tmp_path):
    path = by_formula(template(tmp_path), tmp_path / 'b', moved(1000.0))
    with pytest.raises(CphdError, match='times their unambiguous window'):
        CphdReader(path)


def test_vectors_without_signal(tmp_path):
    def edit(tree, pvps):
        pvps['Channel_1']['SIGNAL'][[3, 4]] = 0
        pvps['Channel_2']['SIGNAL'][[4, 7]] = 0

    path = by_formula(template(tmp_path, n_channels=2), tmp_path / 'b', edit)
    block, warnings = read_whole(path)
    assert 4 not in block.counter and {3, 7} <= set(block.counter)
    expected = expected_phase_history(block)
    expected[block.counter == 3, 0] = expected[block.counter == 7, 1] = 0
    assert level_db(block.samples - expected, expected) < ROUNDING_DB
    assert len(warnings) == 2


def test_vectors_without_signal_take_their_share_of_memory(tmp_path):
    """One vector in ten has signal: no chunk reads ten times what it may."""
    def edit(tree, pvps):
        pvps['Channel_1']['SIGNAL'] = np.arange(40) % 10 == 0

    path = by_formula(template(tmp_path), tmp_path / 'b', edit)
    with CphdReader(path) as reader:
        read, spans = reader.container.read_samples, []

        def recorded(channel, start, stop):
            spans.append(stop - start)
            return read(channel, start, stop)

        reader.container.read_samples = recorded
        blocks = list(reader.blocks(memory_bytes=256 * (8 + 64) * 12))
    assert [list(b.counter) for b in blocks] == [[0, 10], [20, 30]] and max(spans) == 11
    expected = expected_phase_history(concatenate(blocks))
    assert level_db(concatenate(blocks).samples - expected, expected) < ROUNDING_DB


def test_troposphere_at_the_reference_is_told(tmp_path):
    def edit(tree, pvps):
        pvps['Channel_1']['TDTropoSRP'] = 12e-9

    block, warnings = read_whole(by_formula(template(tmp_path), tmp_path / 'b', edit))
    assert any('troposphere of 12 ns' in text for text in warnings)
    expected = expected_phase_history(block)
    assert level_db(block.samples - expected, expected) < ROUNDING_DB


def test_channels_of_other_times_are_chosen(tmp_path):
    def edit(tree, pvps):
        for name in ('TxTime', 'RcvTime'):
            pvps['Channel_2'][name] += 5e-3

    path = by_formula(template(tmp_path, n_channels=3), tmp_path / 'b', edit)
    with pytest.raises(CphdError, match='Channel_1, Channel_3; Channel_2'):
        CphdReader(path)
    with pytest.raises(CphdError, match='same times'):
        CphdReader(path, channels=['Channel_1', 'Channel_2'])
    with pytest.raises(CphdError, match='no channel x; it has Channel_1, Channel_2'):
        CphdReader(path, channels=['x'])
    block, _ = read_whole(path, channels=['Channel_3', 'Channel_1'])
    expected = expected_phase_history(block)
    assert level_db(block.samples - expected, expected) < ROUNDING_DB


def test_version_1_0_1(tmp_path):
    """The older version has the same arrays; its namespace and header differ."""
    from lxml import etree

    source = template(tmp_path).read_bytes()
    for new, old in ((b'cphd/1.1.0', b'cphd/1.0.1'), (b'CPHD/1.1.0', b'CPHD/1.0.1')):
        source = source.replace(new, old)
    (tmp_path / 'b').write_bytes(source)
    with CphdReader(tmp_path / 'b') as reader:
        assert reader.container.version == '1.0.1'
        assert etree.QName(reader.container.tree.getroot()).namespace.endswith('1.0.1')
        assert sum(b.n_pulses for b in reader.blocks()) == 40


def test_reference_surface_of_constant_height(tmp_path):
    """An area in latitude and longitude steps is where its corners are."""
    source = template(tmp_path).read_bytes()
    start, end = source.index(b'<Planar>'), source.index(b'</Planar>') + len(b'</Planar>')
    step = [np.radians(v) for v in (1 / 111_170.0, 1 / 76_060.0)]  # per metre at 47 degrees north
    surface = (f'<HAE><uIAXLL><Lat>0</Lat><Lon>{step[1]:.15g}</Lon></uIAXLL>'
               f'<uIAYLL><Lat>{step[0]:.15g}</Lat><Lon>0</Lon></uIAYLL></HAE>').encode()
    assert len(surface) <= end - start
    (tmp_path / 'b').write_bytes(source[:start] + surface.ljust(end - start) + source[end:])
    with CphdReader(tmp_path / 'template.cphd') as reader:
        planar = reader.area_m
    with CphdReader(tmp_path / 'b') as reader:
        np.testing.assert_allclose(reader.area_m, planar, atol=0.05)  # degrees were rounded


def test_chunks_are_as_small_as_memory_wants_and_equal_the_whole(tmp_path):
    path = template(tmp_path, n_channels=2)
    with CphdReader(path) as reader:
        whole = list(reader.blocks())
        parts = list(reader.blocks(memory_bytes=256 * (8 * 2 + 64) * 3))
        some = list(reader.blocks(start=10, stop=12))
    assert len(whole) == 1 and max(p.n_pulses for p in parts) == 3
    np.testing.assert_array_equal(concatenate(parts).samples, whole[0].samples)
    np.testing.assert_array_equal(some[0].counter, [10, 11])


@pytest.mark.parametrize(('vector', 'name', 'text'), [
    (17, 'TxPos', 'TxPos lies farther .* in 1 of 40 vectors, first in number 17'),
    (0, 'RcvPos', 'RcvPos lies farther .* in 1 of 40 vectors, first in number 0'),
    (39, 'TDTropoSRP', 'TDTropoSRP is not finite in 1 of 40 vectors, first in number 39')])
def test_one_bad_vector_is_named(tmp_path, vector, name, text):
    def edit(tree, pvps):
        own = pvps['Channel_1'][name]
        own[vector] = np.nan if name == 'TDTropoSRP' else own[vector] + 3000.0

    with pytest.raises(CphdError, match=text):
        CphdReader(by_formula(template(tmp_path), tmp_path / 'b', edit))
