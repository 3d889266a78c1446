# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Divisions: every pixel and pulse once, within memory, the same whoever works; plans printed."""

import dataclasses
import functools
import pickle
import re
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from sar_imaging.archive import division as dividing
from sar_imaging.archive.division import (
    PROCESS_BYTES,
    ArchivePlan,
    ArchiveTooLargeError,
    DividedPulses,
    UndividableError,
    divide,
    divide_aperture,
    duration,
    predict,
    size,
)
from sar_imaging.archive.job import Job, Products
from sar_imaging.archive.pieces import (
    ImagePiece,
    ProductPiece,
    SumPiece,
)
from sar_imaging.archive.scans import ApertureScan, Division
from sar_imaging.archive.windows import Window
from sar_imaging.geometry.earth import Datum
from sar_imaging.planning.costs import DEFAULT, CostModel, using
from sar_imaging.signal.radar import RadarParameters
from sar_imaging.simulation.survey import Survey

RADAR = RadarParameters(10e9, 300e6, 400e6, 1e-6)
JOB = Job(('x',), Path('/nowhere/out'), 0.5, Datum(47.0, 8.0), tile=64)


@functools.cache
def _pulses(pixels):
    """Pulses of one aperture of a survey, and the window of its square."""
    survey = Survey(n_recordings=1, pixels=pixels, clutter=0, reflectors=0, spacing_m=0.5)
    [recording] = survey.recordings()
    [scenario] = recording.scenarios()
    half = pixels // 2
    return (DividedPulses(survey.radar, survey.n_samples, *scenario.phase_centres()),
            Window(-half, half, -half, half))


def _scan(name, window, *, windows=None, pulses=((0, 100),), recording=None, first_ns=0,
          centre_m=(-500.0, 0.0, 500.0), memory=600e6, seconds=1.0):
    division = Division(windows or (window,), pulses, seconds, seconds, int(memory), 'exact')
    return ApertureScan(
        name=name, path=Path(name), recording=recording or name, aperture=0, fingerprint='f',
        kind='recording', radar=RADAR, n_pulses=100, n_channels=1, n_samples=50, compressed=True,
        first_ns=first_ns, last_ns=first_ns + 1, datum=JOB.datum,
        footprint_m=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), window=window, centre_m=centre_m,
        reads_bytes=40_000, division=division, centres=f'scans/{name}.npz')


def _divide(job, scans, free_bytes=1e15):
    """Division for a disk with so much room."""
    with mock.patch.object(dividing, 'free_disk', lambda folder: free_bytes):
        return divide(job, scans)


# ------------------------------------------------------------------ one aperture


def test_what_fits_is_imaged_as_a_whole():
    pulses, window = _pulses(256)
    division = divide_aperture(JOB, pulses, window)
    assert (division.windows, division.pulses) == ((window,), ((0, pulses.n_pulses),))
    assert division.seconds == division.total_seconds


@pytest.mark.parametrize(('memory', 'longest', 'tile', 'several'), [
    (0.46e9, 600, 256, 'either'), (2e9, 0.15, 256, 'either'), (0.46e9, 0.12, 256, 'either'),
    (2e9, 0.15, 4096, 'pulses')])
def test_divisions_cover_every_pixel_and_pulse_once(memory, longest, tile, several, monkeypatch):
    monkeypatch.setattr(dividing, 'PIECE_S', 0.0)  # imaging alone
    monkeypatch.setattr(dividing, 'WRITE_S_PER_BYTE', 0.0)
    pulses, window = _pulses(2048)
    if several == 'pulses':  # all of it in one tile
        window = Window(0, 2048, 0, 2048)
        middle = (512.0, -512.0, 0.0)
        pulses = dataclasses.replace(pulses, tx_m=pulses.tx_m + middle,
                                     rx_m=pulses.rx_m + middle)
    job = dataclasses.replace(JOB, memory_bytes=memory, longest_piece_s=longest, tile=tile)
    division = divide_aperture(job, pulses, window)
    image = np.zeros(window.shape, int)
    for part in division.windows:
        image[part.within(window)] += 1
        # windows are cut between tiles, so that no tile is written by two pieces
        for edge, own in zip(part.as_tuple, window.as_tuple, strict=True):
            assert edge == own or edge % job.tile == 0
    np.testing.assert_array_equal(image, 1)
    counts = np.zeros(pulses.n_pulses, int)
    for start, stop in division.pulses:
        counts[start:stop] += 1
    np.testing.assert_array_equal(counts, 1)
    assert division.memory_bytes <= memory
    assert division.seconds <= longest
    found = {'pulses': len(division.pulses),
             'either': len(division.windows) * len(division.pulses)}
    assert found[several] > 1


def test_short_pieces_are_not_worth_double_the_work():
    pulses, window = _pulses(1024)
    whole = divide_aperture(JOB, pulses, window)
    hasty = dataclasses.replace(JOB, longest_piece_s=0.01)
    assert divide_aperture(hasty, pulses, window).total_seconds <= 2 * whole.total_seconds


def test_the_same_division_however_little_memory_is_free(monkeypatch):
    pulses, window = _pulses(1024)
    before = divide_aperture(JOB, pulses, window)
    monkeypatch.setattr('sar_imaging.memory._machine_bytes', lambda: 1000)
    assert divide_aperture(JOB, pulses, window) == before


def test_the_cheapest_of_what_fits_is_taken():
    """Beside every division that was possible."""
    pulses, window = _pulses(2048)
    job = dataclasses.replace(JOB, memory_bytes=0.46e9, tile=512)
    division = divide_aperture(job, pulses, window)
    for cut in (512, 256):
        for parts in (1, 2, 4):
            some = predict(job, pulses.part(0, pulses.n_pulses // parts),
                           Window(-cut, cut, -cut, cut))
            if some is not None:
                assert division.total_seconds <= 1.1 * some.seconds * parts * (1024 // cut) ** 2


def test_a_worker_that_is_too_small_is_told_what_would_do():
    pulses, window = _pulses(2048)
    job = dataclasses.replace(JOB, memory_bytes=0.45e9, tile=2048)
    with pytest.raises(UndividableError, match=r'allow memory_gb: ([\d.]+), or take') as caught:
        divide_aperture(job, pulses, window)
    enough = float(str(caught.value).split('memory_gb: ')[1].split(',')[0])
    divide_aperture(dataclasses.replace(job, memory_bytes=1e9 * enough), pulses, window)
    divide_aperture(dataclasses.replace(job, tile=256), pulses, window)


def test_pixels_on_the_ellipsoid_take_their_places_too():
    pulses, window = _pulses(1024)
    plane = predict(JOB, pulses, window)
    rounded = predict(dataclasses.replace(JOB, surface='ellipsoid'), pulses, window)
    assert rounded.memory_bytes > plane.memory_bytes + 24 * window.n_pixels
    assert rounded.seconds > plane.seconds and plane.memory_bytes > PROCESS_BYTES


# ------------------------------------------------------------------ all pieces


@pytest.mark.parametrize('leaves', [1, 2, 3, 5, 8])
def test_sub_apertures_are_summed_in_a_tree(leaves):
    """Each partial image once, to the left first, however many there are."""
    cuts = [100 * i // leaves for i in range(leaves + 1)]
    scan = _scan('a', Window(0, 64, 0, 64), pulses=tuple(zip(cuts[:-1], cuts[1:], strict=True)))
    pieces = _divide(JOB, [scan]).pieces
    values, final = {}, []
    for piece in pieces:
        if isinstance(piece, ImagePiece):
            values[piece.partial] = list(range(*piece.pulses))
            final += [] if piece.partial else [piece]
        elif isinstance(piece, SumPiece):
            values[piece.partial] = values.pop(piece.parts[0]) + values.pop(piece.parts[1])
            final += [] if piece.partial else [piece]
    assert values == {'': list(range(100))}
    [mosaic] = [p for p in pieces if p.KIND == 'mosaic']
    assert mosaic.needs == (final[0].key,)
    assert sum(isinstance(p, SumPiece) for p in pieces) == leaves - 1


def test_pieces_need_what_comes_before_them_and_exist():
    window = Window(-100, 150, -70, 90)
    halves = (Window(-100, 0, -70, 90), Window(0, 150, -70, 90))
    scans = [_scan('one', window, windows=halves, pulses=((0, 50), (50, 100))),
             _scan('two', Window(0, 200, 0, 100), first_ns=10**9, recording='flight'),
             _scan('far', Window(5000, 5100, 0, 64), recording='flight')]
    job = dataclasses.replace(JOB, products=Products(('geotiff', 'sicd'), True, True, 5))
    plan = _divide(job, scans)
    seen = set()
    for piece in plan.pieces:
        assert set(piece.needs) <= seen, piece.key
        assert piece.key not in seen
        seen.add(piece.key)
        assert piece.seconds > 0 and piece.memory_bytes > 0
    assert plan.pieces[-1].product == 'catalogue' and len(plan.pieces[-1].needs) > 10
    assert pickle.loads(pickle.dumps(plan)) == plan
    assert max(len(pickle.dumps(piece)) for piece in plan.pieces) < 8000


def test_images_and_their_sums_write_eight_bytes_a_pixel():
    plan = _divide(JOB, [_scan('one', Window(0, 60, 0, 100), pulses=((0, 50), (50, 100)))])
    written = [p.writes_bytes for p in plan.pieces if isinstance(p, ImagePiece | SumPiece)]
    assert written == [8 * 60 * 100] * 3


def test_tiles_of_the_mosaic_need_the_images_that_have_pixels_there():
    halves = (Window(0, 64, 0, 128), Window(64, 128, 0, 128))
    scans = [_scan('one', Window(0, 128, 0, 128), windows=halves),
             _scan('two', Window(100, 200, 70, 130))]
    plan = _divide(JOB, scans)
    assert plan.window == Window(0, 200, 0, 130)
    tiles = {p.tile: p for p in plan.pieces if p.KIND == 'mosaic'}
    assert len(tiles) == 4 + 6 - 1  # of both, one of them common
    assert tiles[Window(0, 64, 0, 64)].needs == ('image one tile 0,0..1',)
    assert set(tiles[Window(64, 128, 64, 128)].needs) == {'image one tile 1,0..1', 'image two'}
    assert [name for name, _ in tiles[Window(64, 128, 64, 128)].images] == ['one', 'two']
    assert all(p.extent == Window(0, 256, 0, 192) for p in tiles.values())


def test_strips_are_those_of_recordings():
    scans = [_scan('a1', Window(0, 64, 0, 64), recording='a'),
             _scan('a2', Window(60, 120, 0, 64), recording='a'),
             _scan('b1', Window(0, 64, 0, 64), recording='b')]
    job = dataclasses.replace(JOB, products=Products(strips=True, mosaic=False))
    pieces = _divide(job, scans).pieces
    strips = [(p.subject, p.tile, len(p.images)) for p in pieces if p.KIND == 'strip']
    assert strips == [('a', Window(0, 64, 0, 64), 2), ('a', Window(64, 128, 0, 64), 1),
                      ('b', Window(0, 64, 0, 64), 1)]
    assert not [p for p in pieces if p.KIND == 'mosaic']
    files = {p.subject: p for p in pieces if isinstance(p, ProductPiece) and p.subject}
    assert files['a'].extent == Window(0, 120, 0, 64)


def test_stacks_compare_the_first_pass_with_every_other_one():
    window = Window(0, 100, 0, 100)
    day = 86400 * 10**9
    scans = [
        _scan('third', Window(5, 105, 0, 100), first_ns=2 * day),
        _scan('first', window), _scan('second', window, first_ns=day),
        _scan('neighbour', Window(80, 180, 0, 100), first_ns=day),  # a fifth is common
        _scan('across', window, first_ns=day, centre_m=(500.0, 0.0, 500.0)),
        _scan('same flight', window, first_ns=day, recording='first')]
    job = dataclasses.replace(JOB, products=Products(coherence_window=7))
    pieces = [p for p in _divide(job, scans).pieces if p.KIND == 'coherence']
    assert {p.subject for p in pieces} == {'first__second', 'first__third'}
    third = [p for p in pieces if p.subject == 'first__third']
    assert {p.tile for p in third} == set(Window(5, 100, 0, 100).tiles(64))
    assert all(set(p.needs) == {'image first', 'image third'} for p in third)


def test_without_a_datum_no_files_of_maps_are_made():
    local = dataclasses.replace(JOB, datum=None, products=Products(('geotiff',)))
    plan = _divide(local, [_scan('a', Window(0, 64, 0, 64))])
    assert [p.product for p in plan.pieces if isinstance(p, ProductPiece)] == ['catalogue']
    assert 'no recording tells a datum: no GeoTIFF' in str(plan)


def test_an_archive_of_losses_is_a_plan_of_nothing():
    plan = _divide(JOB, [])
    assert plan.pieces == () and 'no aperture can be imaged' in str(plan)


def test_the_order_of_the_scans_does_not_matter():
    scans = [_scan(name, Window(10 * i, 10 * i + 100, 0, 100))
             for i, name in enumerate('abcd')]
    assert _divide(JOB, scans) == _divide(JOB, scans[::-1])


def test_measured_costs_change_predicted_times_and_nothing_else():
    scans = [_scan('a', Window(0, 64, 0, 64), seconds=10.0)]
    usual = _divide(JOB, scans)
    slower = {name: 3 * value for name, value in dataclasses.asdict(DEFAULT).items()}
    with using(CostModel(**slower)):
        slow = _divide(JOB, scans)
        division = divide_aperture(JOB, *_pulses(256))
    assert division == divide_aperture(JOB, *_pulses(256))
    assert slow.seconds == pytest.approx(3 * usual.seconds)
    assert [p.fingerprint() for p in slow.pieces] == [p.fingerprint() for p in usual.pieces]


def test_geotiff_is_as_large_as_the_pixels_that_it_has():
    """Not as whole tiles, nor as the rectangle around apertures that lie far apart."""
    scans = [_scan('a', Window(0, 70, 0, 70)), _scan('b', Window(6400, 6410, 6400, 6410))]
    [file] = [p for p in _divide(JOB, scans).pieces if getattr(p, 'product', '')
              == 'mosaic geotiff']
    assert 4 * (70**2 + 10**2) < file.writes_bytes < 6 * (4 * 64**2 + 10**2)


# ------------------------------------------------------------------ refusals and the table


def test_a_piece_larger_than_a_worker_is_refused_with_what_would_do():
    scan = _scan('a', Window(0, 64, 0, 64), memory=3.21e9)
    with pytest.raises(ArchiveTooLargeError) as caught:
        _divide(JOB, [scan])
    assert str(caught.value) == (
        'image a takes 3.21 GB, and a worker may take 2 GB; allow memory_gb: 3.3, or take '
        'smaller tiles (tile: 32)')
    _divide(dataclasses.replace(JOB, memory_bytes=3.3e9), [scan])


def test_a_full_disk_is_refused_with_what_would_do(tmp_path):
    scans = [_scan('a', Window(0, 6400, 0, 6400))]
    plan = _divide(JOB, scans)
    with pytest.raises(ArchiveTooLargeError, match='results take .* has 100 MB free') as caught:
        _divide(JOB, scans, 1e8)
    spacing = float(str(caught.value).split('for instance ')[1].rstrip(')'))
    assert (JOB.spacing_m / spacing) ** 2 * plan.disk_bytes <= 1.1e8  # two digits are told
    job = dataclasses.replace(JOB, output=tmp_path / 'out')  # the real disk holds a small one
    assert divide(job, [_scan('a', Window(0, 64, 0, 64))]).disk_bytes < 1e7


def test_the_table_tells_what_a_person_asks(capsys):
    scans = [_scan(f'flight-{i:03d}', Window(0, 200, 150 * i, 150 * i + 200), seconds=100.0)
             for i in range(20)]
    plan = _divide(JOB, scans)
    text = str(plan)
    assert '20 apertures on a map of 3,050 by 200 pixels of 0.5 m (0.61 Mpixel)' in text
    assert 'frame at 47.00000, 8.00000' in text
    assert re.search('^image +20 +33 min', text, re.MULTILINE)
    assert 'time on 1, 2, 4, 16, 64 workers of one core: 33 min, 17 min' in text
    assert 'memory of a worker: 600 MB of 2 GB, for image flight-000' in text
    assert all(len(line) <= 100 for line in text.splitlines())


def test_time_on_workers_is_bounded_by_the_longest_chain():
    plan = _divide(JOB, [_scan('a', Window(0, 64, 0, 64), seconds=10.0),
                         _scan('b', Window(0, 64, 0, 64), seconds=30.0)])
    assert plan.seconds_on(1) == plan.seconds > 40.0
    assert plan.seconds_on(1000) == plan.longest_chain_s
    assert 30.0 < plan.longest_chain_s < 32.0
    assert isinstance(plan, ArchivePlan)


def test_numbers_for_people():
    assert [duration(s) for s in (0.04, 89, 90, 7200, 86400 * 3)] == [
        '0.04 s', '89 s', '1.5 min', '2 h', '3 d']
    assert [size(n) for n in (0, 999, 1000, 12345678, 2e9, 1e16)] == [
        '0 B', '999 B', '1 kB', '12.3 MB', '2 GB', '10 PB']
