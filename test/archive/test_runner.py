# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pieces on real workers: order, losses, retries, what is never computed twice."""

import json
import os
import random
import signal

import pytest

pytest.importorskip('distributed', reason='the extra archive is not installed')

import sar_imaging
from sar_imaging.archive import cluster
from sar_imaging.archive.runner import WITH_LOSSES, run_piece, run_pieces


@pytest.fixture
def run(client, tmp_path, toys):
    def run(pieces, output=tmp_path, **options):
        return run_pieces(pieces, toys.compute, client, output, **options)
    return run


def test_all_pieces_are_computed_once_and_found_again(run, toys, tmp_path):
    pieces, results = toys.tree(9), []
    summary = run(pieces)
    assert (summary.n_computed, summary.losses, summary.exit_status) == (20, (), 0)
    assert sorted(toys.calls(tmp_path)) == sorted(p.key for p in pieces)
    before = toys.bits(tmp_path)
    again = run(pieces, on_result=lambda piece, result: results.append((piece.key, result)))
    assert (again.n_computed, again.n_found, again.exit_status) == (0, 20, 0)
    assert len(toys.calls(tmp_path)) == 20 and toys.bits(tmp_path) == before
    assert dict(results)['sum 1.0']['files'] == [toys.name_of('sum 1.0')]


def test_what_changed_is_computed_anew_with_what_needs_it(run, toys, tmp_path):
    pieces = toys.tree(4)
    run(pieces)
    changed = [toys.Toy(key=pieces[0].key, value=99, seconds=5.0), *pieces[1:]]
    assert run(changed).n_computed == 3  # itself, its sum, the sum of all
    (tmp_path / toys.name_of(pieces[3].key)).unlink()
    assert run(changed).n_computed == 1  # the same bits again: what needs them stays


def test_forecasts_spoil_no_record(run, toys):
    pieces = toys.tree(2)
    run(pieces)
    import dataclasses
    other = [dataclasses.replace(p, seconds=7.0, memory_bytes=10 ** 9) for p in pieces]
    assert run(other).n_found == 3


def test_corrupt_data_are_lost_at_once_and_the_rest_goes_on(run, toys, tmp_path):
    pieces = toys.tree(4)
    pieces[1] = toys.Toy(key=pieces[1].key, does='corrupt')
    summary = run(pieces)
    assert summary.exit_status == WITH_LOSSES
    assert [(loss.key, loss.reason) for loss in summary.losses] == [
        (pieces[1].key, 'ValueError: the recording ends after 3 of 10 pulses'),
        ('sum 1.0', f'needs {pieces[1].key}, which is lost'),
        ('sum 2.0', 'needs sum 1.0, which is lost')]
    assert 'archive_toys.py' in summary.losses[0].where
    assert toys.calls(tmp_path).count(pieces[1].key) == 1
    told = summary.told(tmp_path)
    assert f'lost: {pieces[1].key}: ValueError: the recording ends' in told
    assert '4 of 7 pieces done, 3 lost' in told


def test_a_mosaic_may_lack_an_aperture_until_it_is_there(run, toys, tmp_path):
    images = [toys.Toy(key=f'image {i}', value=i) for i in range(3)]
    mosaic = toys.Toy(key='mosaic', needs=tuple(p.key for p in images))
    broken = toys.Toy(key='image 1', does='corrupt')

    def may_lack(piece, lost):
        return piece.key == 'mosaic' and len(lost) < 3

    summary = run([images[0], broken, images[2], mosaic], may_lack=may_lack)
    assert [loss.key for loss in summary.losses] == ['image 1']
    partial = toys.bits(tmp_path)[toys.name_of('mosaic')]
    mended = run([*images, mosaic], may_lack=may_lack)
    assert (mended.n_computed, mended.n_found, mended.losses) == (2, 2, ())
    assert toys.bits(tmp_path)[toys.name_of('mosaic')] != partial


def test_a_worker_that_always_dies_for_one_piece_costs_that_piece_alone(run, toys, tmp_path):
    pieces = toys.tree(8)
    pieces[2] = toys.Toy(key=pieces[2].key, does='die')
    summary = run(pieces, retries=1)
    assert [loss.key for loss in summary.losses] == [
        pieces[2].key, 'sum 1.1', 'sum 2.0', 'sum 3.0'], summary.told(tmp_path)
    assert summary.losses[0].reason.startswith('its worker died 2 times while computing it')
    assert toys.calls(tmp_path).count(pieces[2].key) == 2


def test_one_worker_whose_piece_always_kills_it_spares_those_that_wait(toys, tmp_path):
    """All others stand behind it in the queue of the only worker, time after time."""
    pieces = [toys.Toy(key='killer', does='die'), toys.Toy(key='a'), toys.Toy(key='b')]
    with cluster.open_cluster(tmp_path, workers=1) as client:
        summary = run_pieces(pieces, toys.compute, client, tmp_path, retries=2)
    assert [loss.key for loss in summary.losses] == ['killer']
    assert sorted(toys.calls(tmp_path)) == ['a', 'b', 'killer', 'killer', 'killer']


def test_a_worker_that_is_gone_for_good_is_replaced(toys, tmp_path, monkeypatch):
    """Dask's nannies start workers again, but not always: some give up."""
    monkeypatch.setitem(cluster._SETTINGS, 'distributed.deploy.lost-worker-timeout', '1s')
    removed = []

    def remove(piece, result):
        if not removed:
            [nanny] = client.cluster.workers.values()
            nanny.instantiate = None  # it cannot start another
            client.cluster.sync(nanny.kill)
            removed.append(nanny)

    with cluster.open_cluster(tmp_path, workers=1) as client:
        summary = run_pieces(toys.tree(4), toys.compute, client, tmp_path, on_result=remove)
        assert removed[0] not in client.cluster.workers.values()
    assert summary.exit_status == 0


def test_a_piece_whose_answer_was_lost_is_not_computed_again(toys, client, tmp_path):
    """Dask asks a worker again, and its record tells what it was."""
    [piece] = toys.tree(1)
    (tmp_path / 'records').mkdir()
    answers = [client.submit(
        run_piece, piece, 'mark', key=f'piece {number}', compute=toys.compute, output=tmp_path,
        run='run', memory_bytes=None, version=sar_imaging.__version__).result()
        for number in range(2)]
    assert json.dumps(answers[0].record) == json.dumps(answers[1].record)
    assert toys.calls(tmp_path) == [piece.key]


@pytest.mark.parametrize('does', ['die once', 'trouble once'])
def test_what_goes_wrong_once_is_tried_again(run, toys, tmp_path, does):
    pieces = toys.tree(4)
    pieces[0] = toys.Toy(key=pieces[0].key, does=does)
    assert run(pieces).exit_status == 0
    assert toys.calls(tmp_path).count(pieces[0].key) == 2


def test_trouble_with_files_is_tried_so_often_and_no_more(run, toys, tmp_path):
    summary = run([toys.Toy(key='a', does='trouble'), toys.Toy(key='b')], retries=3)
    assert toys.calls(tmp_path).count('a') == 4
    assert "Input/output error: 'flight.cphd'" in summary.losses[0].reason


def test_a_full_disk_stops_the_job_which_goes_on_later(run, toys, tmp_path):
    pieces = toys.tree(4)
    full = [*pieces[:2], toys.Toy(key=pieces[2].key, value=2, does='full'), *pieces[3:]]
    summary = run(full)
    assert summary.exit_status == 1 and summary.losses == ()
    assert summary.stopped == ('no space is left; make room and start the job again: it goes on '
                               'where it stopped')
    assert 'stopped: no space is left' in summary.told(tmp_path)
    later = run(pieces)
    assert later.exit_status == 0 and later.n_computed + later.n_found == 7


def test_memory_beyond_the_bound_is_a_loss_that_says_so(run, toys):
    pieces = [toys.Toy(key='large', memory_bytes=3_000_000_000, does='hog'), toys.Toy(key='small')]
    summary = run(pieces, memory_bytes=1_500_000_000)
    assert [loss.key for loss in summary.losses] == ['large']
    assert 'its memory did not suffice within 1.5 GB of a worker' in summary.losses[0].reason
    assert 0 < summary.peak_bytes < 1_500_000_000


def test_the_peak_of_a_piece_is_recorded(run, toys, tmp_path):
    run([toys.Toy(key='large', memory_bytes=400_000_000, does='hog')])
    run([toys.Toy(key='large', memory_bytes=400_000_000, does='hog'), toys.Toy(key='small')])
    peaks = {record['key']: record['peak_bytes'] for path in tmp_path.glob('records/*/*.json')
             for record in [json.loads(path.read_text())]}
    # Not below what it allocates; the small one ran in such a process and is far below.
    assert peaks['large'] > 400_000_000 > peaks['small']


def test_the_dashboard_groups_pieces_by_kind(toys):
    from dask.utils import key_split
    assert key_split(('image', 'image flight-012 aperture 3, tile 4-7')) == 'image'


def test_wrong_lists_of_pieces_are_refused(run, toys):
    with pytest.raises(ValueError, match="two pieces are called 'a'"):
        run([toys.Toy(key='a'), toys.Toy(key='a')])
    with pytest.raises(ValueError, match="'a' needs 'b', which is not among the pieces"):
        run([toys.Toy(key='a', needs=('b',))])
    with pytest.raises(ValueError, match="'a' needs itself"):
        run([toys.Toy(key='a', needs=('b',)), toys.Toy(key='b', needs=('a',))])


class Deleted:
    """As a future of Dask that Ctrl-C meets: Python ignores what is raised here."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize('press', [lambda: os.kill(os.getpid(), signal.SIGINT), Deleted],
                         ids=['while it works', 'while it deletes an object'])
def test_ctrl_c_stops_and_the_next_run_goes_on(run, toys, tmp_path, press):
    pieces, seen = toys.tree(8), []

    def interrupt(piece, result):
        seen.append(piece.key)
        if len(seen) == 3:
            press()

    summary = run(pieces, on_result=interrupt)
    assert summary.exit_status == 130
    assert 'the same command goes on where it stopped' in summary.told(tmp_path)
    later = run(pieces)
    assert later.exit_status == 0 and later.n_found >= 3


def test_workers_killed_at_random_moments_change_no_bits(run, toys, tmp_path, client):
    kill_and_compare(run, toys, tmp_path, client, range(2))


@pytest.mark.campaign
def test_campaign_of_killed_workers(run, toys, tmp_path, client):
    kill_and_compare(run, toys, tmp_path, client, range(100, 120))


def kill_and_compare(run, toys, folder, client, seeds):
    """Jobs whose workers are killed at random moments make the bits of one that was left alone."""
    pieces = toys.tree(12)
    (folder / 'quiet').mkdir()
    run(pieces, folder / 'quiet')
    expected = toys.bits(folder / 'quiet')
    for seed in seeds:
        run_and_kill(run, toys, pieces, folder / str(seed), client, random.Random(seed))
        assert toys.bits(folder / str(seed)) == expected


def run_and_kill(run, toys, pieces, output, client, rng):
    """Kill a worker after some of the pieces, which are chosen by chance."""
    output.mkdir()
    moments = set(rng.sample(range(1, len(pieces)), 3))
    seen = []

    def kill(piece, result):
        seen.append(piece.key)
        if len(seen) in moments:
            pids = [nanny.pid for nanny in client.cluster.workers.values() if nanny.pid]
            os.kill(rng.choice(pids), signal.SIGKILL)

    summary = run(pieces, output, on_result=kill, retries=3)
    assert summary.exit_status == 0, summary.told(output)


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 4 MB, and what makes it larger."""
    import subprocess

    from dask_processes import can
    folder = tmp_path / 'disk'
    folder.mkdir()
    if not can('mount', '-t', 'tmpfs', '-o', 'size=4m', 'none', str(folder)):
        pytest.skip('no file system can be mounted here: needs root')
    yield folder, lambda: subprocess.run(
        ['mount', '-o', 'remount,size=64m', str(folder)], check=True)
    subprocess.run(['umount', '-l', str(folder)], check=True)


def test_a_disk_that_is_full_indeed(run, toys, small_disk):
    folder, enlarge = small_disk
    pieces = [toys.Toy(key=f'image {i}', value=i, does='write', memory_bytes=1_000_000)
              for i in range(12)]
    summary = run(pieces, folder)
    assert summary.exit_status == 1 and summary.losses == ()
    assert summary.stopped.startswith('no space is left') and '\n' not in summary.stopped
    enlarge()
    later = run(pieces, folder)
    assert later.exit_status == 0 and later.n_found >= 1 and len(toys.bits(folder)) == 12
