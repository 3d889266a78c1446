"""AFBP while the pulses arrive, against exact backprojection of the same pulses."""

import dataclasses

import numpy as np
import pytest

from msg_conversions import subaperture_wire
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.afbp import AfbpImager
from sar_imaging.imaging.backprojection import Backprojector
from sar_imaging.imaging.verification import measure_error
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures

from .conftest import LENGTH, TRACKS

CUT = 16  # pulses of a sub-aperture, where a test needs to know it


@pytest.fixture(name='fly', scope='module')
def fly_fixture(make_case):
    made = {}

    def fly(name='straight', n_pulses=2 * LENGTH):
        if (name, n_pulses) not in made:
            made[name, n_pulses] = make_case(**{'range_m': 1e3} | {
                'n': 64, 'pulses': n_pulses, 'n_points': 20} | TRACKS[name])
        return made[name, n_pulses]

    return fly


def _error_db(image, reference):
    return 10 * np.log10(np.sum(np.abs(image - reference) ** 2)
                         / np.sum(np.abs(reference) ** 2))


def _exact(case, pulses, grid=None):
    grid = case.grid if grid is None else grid
    return Backprojector(grid, case.block.radar, case.block.n_samples, target_db=-90.0)(
        case.block.select(pulses))


def _stage(case, **options):
    return LiveSubapertures(case.grid, **{'pulses_per_aperture': LENGTH} | options)


def _pieces(block, size=12):
    return [block.select(slice(i, i + size)) for i in range(0, block.n_pulses, size)]


def _subapertures(stage, blocks):
    return [s for block in blocks for s in stage.add(block)] + stage.flush()


def _fuse(fusion, subapertures):
    return [image for s in subapertures for image in fusion.add(s)]


def _events(stage, kind):
    return [e.text for e in stage.take_events() if e.kind == kind]


# ------------------------------------------------------------------------------- the numbers

@pytest.mark.parametrize('target_db', [-60.0, -70.0])
@pytest.mark.parametrize('track', TRACKS)
def test_target_is_met_on_any_track(fly, track, target_db):
    case = fly(track)
    stage, fusion = _stage(case, target_db=target_db), LiveFusion()
    images = _fuse(fusion, _subapertures(stage, _pieces(case.block)))
    assert [(i.aperture, i.final, i.n_pulses, i.n_missing) for i in images] == [
        (0, True, LENGTH, 0), (1, True, LENGTH, 0)]
    for k, result in enumerate(images):
        error = _error_db(result.image, _exact(case, slice(k * LENGTH, (k + 1) * LENGTH)))
        # Scatterers reach the edges of the grid, where the fusion errs; see test_afbp.
        assert error <= target_db and error <= result.predicted_error_db + 3.0
    assert stage.statistics.imaged == 2 * LENGTH and fusion.statistics.images == 2


def test_live_is_as_good_as_offline_and_both_agree_with_correlation(fly):
    case = fly('shaken')
    images = _fuse(LiveFusion(), _subapertures(_stage(case, target_db=-70.0),
                                               _pieces(case.block)))
    block = case.block.select(slice(0, LENGTH))
    offline = AfbpImager(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                         target_db=-70.0)(block)
    assert _error_db(images[0].image, offline) <= -65.0  # two errors of -70 dB at most
    checked = measure_error(images[0].image, case.grid, [block], n_pixels=100, n_brightest=50)
    assert checked.error_db <= -70.0


def test_same_images_whatever_the_blocks(fly):
    case = fly()
    images = [_fuse(LiveFusion(), _subapertures(_stage(case, pulses_per_subaperture=CUT),
                                                _pieces(case.block, size)))
              for size in (1, CUT, 50, 2 * LENGTH)]
    for other in images[1:]:
        difference = np.linalg.norm(other[1].image - images[0][1].image)
        assert difference <= 1e-3 * np.linalg.norm(images[0][1].image)
        assert [i.stamp_ns for i in other] == [i.stamp_ns for i in images[0]]


def test_images_so_far(fly):
    case = fly()
    stage, fusion = _stage(case, pulses_per_subaperture=CUT), LiveFusion(images_every=2)
    images = _fuse(fusion, _subapertures(stage, _pieces(case.block)))
    assert [(i.aperture, i.n_subapertures, i.final) for i in images] == [
        (k, n, n == 6) for k in (0, 1) for n in (2, 4, 6)]
    for result in images:
        start = result.aperture * LENGTH
        stop = start + result.n_subapertures * CUT
        assert _error_db(result.image, _exact(case, slice(start, stop))) <= -60.0
        # the stamps of the pulses are their numbers
        assert abs(result.stamp_ns - (start + stop - 1) / 2) <= 1
        assert (result.n_pulses, result.n_missing) == (stop - start, 0)


# ------------------------------------------------------------------------------- what may go wrong

def test_missing_pulses_do_not_move_the_cuts(fly):
    case = fly()
    rng = np.random.default_rng(0)
    kept = np.flatnonzero(rng.random(2 * LENGTH) > 0.2)
    kept = kept[(kept // CUT != 2) & (kept != LENGTH - 1)]  # one sub-aperture is missing wholly
    subapertures = _subapertures(_stage(case, pulses_per_subaperture=CUT),
                                 _pieces(case.block.select(kept)))
    assert [s.first_counter for s in subapertures] == [
        CUT * i for i in range(2 * LENGTH // CUT) if i != 2]
    assert all(s.n_pulses + s.n_missing == CUT for s in subapertures)
    images = _fuse(LiveFusion(min_pulse_fraction=0.1), subapertures)
    for k, result in enumerate(images):
        pulses = kept[kept // LENGTH == k]
        assert _error_db(result.image, _exact(case, pulses)) <= -60.0
        assert (result.n_pulses, result.n_missing) == (len(pulses), LENGTH - len(pulses))
        assert abs(result.stamp_ns - (k + 0.5) * LENGTH) <= 2


def test_pulses_twice_and_late(fly):
    case = fly()
    pieces = _pieces(case.block, CUT)
    stage = _stage(case, pulses_per_subaperture=CUT)
    subapertures = _subapertures(stage, [pieces[0], pieces[2], pieces[2], pieces[1], *pieces[3:]])
    # The second sub-aperture had been given up when the third one came.
    assert [s.number for s in subapertures if s.aperture == 0] == [0, 2, 3, 4, 5]
    assert (stage.statistics.late, stage.statistics.duplicate) == (CUT, CUT)
    assert _events(stage, 'duplicate') and not stage.statistics.restarts


@pytest.fixture(name='sent', scope='module')
def sent_fixture(fly):
    return _subapertures(_stage(fly(), pulses_per_subaperture=CUT), _pieces(fly().block))


def test_subapertures_in_any_order_and_twice(fly, sent):
    rng = np.random.default_rng(1)
    fusion, order = LiveFusion(), [*rng.permutation(6), *6 + rng.permutation(6)]
    images = _fuse(fusion, [sent[i] for i in order for _ in range(2)])
    for k, result in enumerate(images):
        assert _error_db(result.image,
                         _exact(fly(), slice(k * LENGTH, (k + 1) * LENGTH))) <= -60.0
    assert fusion.statistics.fused == 12
    # The last one of each completes its aperture; when it comes again, that is closed.
    assert (fusion.statistics.duplicate, fusion.statistics.late) == (10, 2)


def test_subapertures_that_never_come(fly, sent):
    fusion = LiveFusion()
    images = _fuse(fusion, [s for s in sent if s.number not in (1, 5)]) + fusion.flush()
    pulses = np.r_[0:CUT, 2 * CUT:5 * CUT]
    for k, result in enumerate(images):
        assert _error_db(result.image, _exact(fly(), k * LENGTH + pulses)) <= -60.0
        assert (result.n_pulses, result.n_missing) == (4 * CUT, 2 * CUT)
        assert abs(result.stamp_ns - (k + 0.5) * LENGTH) <= 1
    assert len(images) == 2 and fusion.add(sent[1]) == []
    assert fusion.statistics.late == 1 and 'closed before' in _events(fusion, 'late')[0]


@pytest.mark.parametrize('lost', [{3}, {0, 3}, {1, 2}, {0, 1, 2}])
def test_pulses_of_a_shorter_last_subaperture_are_counted_as_they_are(fly, lost):
    """Apertures of 96 pulses in sub-apertures of 28, 28, 28 and 12."""
    subapertures = _subapertures(_stage(fly(), pulses_per_subaperture=28), _pieces(fly().block))
    fusion = LiveFusion(min_pulse_fraction=0.0)
    images = _fuse(fusion, [s for s in subapertures if s.number not in lost]) + fusion.flush()
    n_pulses = LENGTH - sum(12 if number == 3 else 28 for number in lost)
    assert [(i.n_pulses, i.n_missing) for i in images] == 2 * [(n_pulses, LENGTH - n_pulses)]
    if lost == {1, 2}:  # from one sub-aperture alone no line of time is known
        assert all(abs(i.stamp_ns - (k + 0.5) * LENGTH) <= 1 for k, i in enumerate(images))


def test_too_little_for_an_image(sent):
    fusion = LiveFusion(min_pulse_fraction=0.5)
    assert _fuse(fusion, [s for s in sent if s.number < 2]) + fusion.flush() == []
    assert fusion.statistics.apertures_dropped == 2
    assert 'aperture 0 dropped: 32 of 96 pulses' in _events(fusion, 'aperture')[0]


def test_a_sender_that_was_started_again(fly, sent):
    again = _subapertures(_stage(fly(), pulses_per_subaperture=CUT), _pieces(fly().block))
    fusion = LiveFusion(min_pulse_fraction=0.0)
    images = _fuse(fusion, [*sent[:3], *again[:2], sent[3], *again[2:6]])
    assert [(i.n_subapertures, i.n_missing) for i in images] == [(3, 3 * CUT), (6, 0)]
    np.testing.assert_array_equal(images[1].image, _fuse(LiveFusion(), sent[:6])[0].image)
    assert (fusion.statistics.restarts, fusion.statistics.late) == (1, 1)


def test_a_looping_recording_gives_the_same_images_again(fly):
    pieces = _pieces(fly().block)
    stage = _stage(fly(), pulses_per_subaperture=CUT)
    images = _fuse(LiveFusion(), _subapertures(stage, pieces * 2))
    assert [i.aperture for i in images] == [0, 1, 0, 1]
    for first, second in zip(images[:2], images[2:], strict=True):
        np.testing.assert_array_equal(first.image, second.image)
    assert stage.statistics.restarts == 1


def test_the_counter_wraps_around(fly):
    case = fly()
    number = (2**32 - 1) // LENGTH
    short = 2**32 - number * LENGTH  # pulses of the last aperture
    counter = (np.arange(2 * LENGTH) + 2**32 - short - LENGTH) % 2**32
    block = dataclasses.replace(case.block, counter=counter.astype(np.uint32))
    stage = _stage(case, pulses_per_subaperture=CUT)
    images = _fuse(LiveFusion(), _subapertures(stage, _pieces(block)))
    assert [(i.aperture, i.n_pulses) for i in images] == [
        (number - 1, LENGTH), (number, short)]
    assert _error_db(images[1].image, _exact(case, slice(LENGTH, LENGTH + short))) <= -60.0
    assert stage.statistics.restarts == 0


def test_geometry_that_polar_images_do_not_suit(make_case):
    case = make_case(12.0, n=64, pulses=LENGTH)
    stage = _stage(case)
    assert _subapertures(stage, _pieces(case.block)) == []
    [text] = _events(stage, 'aperture')  # once, whatever the number of blocks
    assert 'aperture 0 cannot be imaged by sub-apertures' in text and 'use mode image' in text
    assert stage.statistics.apertures_dropped == 1


def test_subapertures_that_contradict_are_refused(sent):
    fusion = LiveFusion()
    fusion.add(sent[0])
    other = dataclasses.replace(sent[1].map_grid, spacing_m=0.3)
    with pytest.raises(ValueError, match='another grid, map'):
        fusion.add(dataclasses.replace(sent[1], map_grid=other))
    with pytest.raises(ValueError, match='map, length or number'):
        fusion.add(dataclasses.replace(sent[1], pulses_per_aperture=LENGTH + 1))
    far = MapGrid((5e3, 0.0, 0.0), 64, 64, 0.25)
    with pytest.raises(ValueError, match='does not cover its map'):
        fusion.add(dataclasses.replace(sent[6], map_grid=far))
    with pytest.raises(ValueError, match='max_image_pixels=100'):
        LiveFusion(max_image_pixels=100).add(sent[0])
    assert len(_fuse(fusion, sent[1:6])) == 1 and fusion.statistics.refused == 3


def test_a_map_whose_messages_do_not_fit_into_memory_is_refused(sent):
    grid = sent[0].map_grid
    vast = dataclasses.replace(grid, n_x=400_000, n_y=400_000,
                               spacing_m=grid.spacing_m * grid.n_x / 400_000)
    # 24 bytes a pixel: the image, its message, the message serialised; the spectra need 1 MB
    with pytest.raises(MemoryError, match='needs 38400[0-9]{2} MB, .* choose a smaller map'):
        LiveFusion(max_image_pixels=2**40).add(dataclasses.replace(sent[0], map_grid=vast))


def test_reset_forgets(fly, sent):
    stage, fusion = _stage(fly(), pulses_per_subaperture=CUT), LiveFusion()
    pieces = _pieces(fly().block)
    _fuse(fusion, [s for piece in pieces[:4] for s in stage.add(piece)])
    assert (stage.reset(), fusion.reset()) == (48, 3)
    assert (stage.flush(), fusion.flush()) == ([], [])
    images = _fuse(fusion, _subapertures(stage, pieces))
    np.testing.assert_array_equal(images[0].image, _fuse(LiveFusion(), sent[:6])[0].image)


def test_messages_and_objects_give_the_same_bits(sent):
    through = [subaperture_wire.from_array(*subaperture_wire.to_array(s)) for s in sent]
    direct = [subaperture_wire.as_received(s) for s in sent]
    for one, other in zip(_fuse(LiveFusion(), through), _fuse(LiveFusion(), direct), strict=True):
        np.testing.assert_array_equal(one.image, other.image)


# ------------------------------------------------------------------------------- planning

def test_an_aperture_is_imaged_anew_when_its_track_was_foreseen_badly(make_case):
    """The turn that begins in the first aperture cannot be foreseen from its first pulses."""
    u = np.arange(2 * LENGTH)
    case = make_case(1e3, n=64, pulses=2 * LENGTH, n_points=20, track_m=np.c_[
        -0.0005 * np.maximum(u - 24, 0) ** 2, 0.3 * u - 30, 0 * u])
    stage, fusion = _stage(case, pulses_per_subaperture=CUT), LiveFusion()
    subapertures = _subapertures(stage, _pieces(case.block))
    last = {s.aperture: s.revision for s in subapertures}
    assert last[0] > 0 == last[1]
    newest = [s for s in subapertures if s.revision == last[s.aperture]]
    assert [s.number for s in newest] == [*range(6), *range(6)]  # all of it, again
    images = _fuse(fusion, subapertures)
    for k, result in enumerate(images):
        assert _error_db(result.image,
                         _exact(case, slice(k * LENGTH, (k + 1) * LENGTH))) <= -60.0
    assert fusion.statistics.revisions == last[0] == stage.statistics.plans_anew
    assert 'planned anew' in _events(stage, 'plan')[0]
    # What was replaced does not come back.
    assert fusion.add(subapertures[0]) == []


def test_a_track_that_sways_a_little_is_planned_once(make_case):
    """Its slopes differ from those foreseen by more than they spread, and yet by next to nothing.

    Both apertures had been planned anew while that counted.
    """
    u = np.arange(2 * LENGTH)
    case = make_case(1e3, n=64, pulses=2 * LENGTH, n_points=20, track_m=np.c_[
        0.3 * np.sin(u / 40), 0.3 * u - 30, 300 + 0.2 * np.cos(u / 40)], height_m=300.0)
    stage = _stage(case, pulses_per_subaperture=CUT)
    images = _fuse(LiveFusion(), _subapertures(stage, _pieces(case.block)))
    assert stage.statistics.plans_anew == 0
    for k, result in enumerate(images):
        assert _error_db(result.image,
                         _exact(case, slice(k * LENGTH, (k + 1) * LENGTH))) <= -60.0


def test_the_end_of_a_track_that_cannot_be_foreseen_is_awaited(make_case):
    u, cut = np.arange(LENGTH), 8
    leaps = 0.7 * (-1) ** (u // cut) * (u // cut)
    case = make_case(1e3, n=64, pulses=LENGTH, n_points=20,
                     track_m=np.c_[leaps, 0.3 * u - 15 + leaps, 0 * u])
    stage = _stage(case, pulses_per_subaperture=cut)
    [result] = _fuse(LiveFusion(), _subapertures(stage, _pieces(case.block)))
    assert 'its end is awaited' in ' '.join(e.text for e in stage.take_events())
    assert result.n_pulses == LENGTH
    assert _error_db(result.image, _exact(case, slice(None))) <= result.predicted_error_db + 3.0


def _legs(case, starts, length=LENGTH):
    """One aperture after the other as its counters go on: pulses from these starts of the case."""
    parts = []
    for number, start in enumerate(starts):
        counter = np.arange(number * length, (number + 1) * length)
        parts.append(dataclasses.replace(
            case.block.select(slice(start, start + length)), counter=counter.astype(np.uint32),
            stamp_ns=case.block.stamp_ns[0] + counter * 10**6))
    return parts


@pytest.mark.parametrize('sliding', [False, True])
def test_a_leg_flown_again_is_not_planned_anew_every_time(fly, sliding):
    """A player in a loop, or a rail that goes back: the track carried on is not the one flown."""
    case, starts = fly(), [0, 0, 0, 0, 0]
    stage = _stage(case, pulses_per_subaperture=CUT, sliding=sliding)
    fusion, images = LiveFusion(), []
    for leg in _legs(case, starts):
        for piece in _pieces(leg, CUT):
            images += _fuse(fusion, stage.add(piece))
            images += _fuse(fusion, stage.catch_up())
            stage.plan_ahead()
    images += _fuse(fusion, stage.flush()) + fusion.flush()
    # The second leg alone shows that it comes again; before, two sliding windows were begun.
    assert stage.statistics.plans_anew <= 2 * sliding
    assert any('takes over its plan' in text for text in _events(stage, 'plan'))
    whole = {i.stamp_ns: i for i in images if i.n_pulses == LENGTH}
    exact = _exact(case, slice(0, LENGTH))
    for number in range(len(starts)):
        middle = case.block.stamp_ns[0] + (number * LENGTH + (LENGTH - 1) / 2) * 10**6
        [image] = [i for stamp, i in whole.items() if abs(stamp - middle) <= 1]
        assert _error_db(image.image, exact) <= -60.0


def test_a_leg_that_goes_on_after_all_is_planned(fly):
    case = fly(n_pulses=4 * LENGTH)
    starts = [0, 0, 0, LENGTH, 2 * LENGTH, 3 * LENGTH]
    stage = _stage(case, pulses_per_subaperture=CUT)
    fusion, images = LiveFusion(), []
    for leg in _legs(case, starts):
        for piece in _pieces(leg, CUT):
            images += _fuse(fusion, stage.add(piece))
            stage.plan_ahead()
    assert len(images) == len(starts)
    for image, start in zip(images, starts, strict=True):
        assert _error_db(image.image, _exact(case, slice(start, start + LENGTH))) <= -60.0
    assert stage.statistics.plans_anew <= 2  # where it goes on, and the first again


def test_profiles_that_end_in_the_guards_are_warned_about_once(fly):
    case, cut = fly(), 40  # samples at both ends
    radar = case.block.radar
    radar = dataclasses.replace(radar, first_sample_delay_s=radar.first_sample_delay_s
                                + cut / radar.sample_rate_hz)
    short = dataclasses.replace(case.block, radar=radar, samples=case.block.samples[..., cut:-cut])
    stage = _stage(case)
    _subapertures(stage, _pieces(short))
    assert len([text for text in _events(stage, 'plan') if 'profiles end' in text]) == 1


@pytest.mark.parametrize('n_before', [LENGTH, LENGTH - CUT])
def test_plans_ahead_are_used(fly, n_before):
    case = fly()
    stage = _stage(case, pulses_per_subaperture=CUT)
    stage.plan_ahead()  # nothing is known yet
    images = stage.add(case.block.select(slice(0, 2 * CUT)))
    stage.plan_ahead()  # too little is known
    assert stage.statistics.plans == 1
    images += stage.add(case.block.select(slice(2 * CUT, n_before)))
    for _ in range(2):  # the second time it is planned already
        stage.plan_ahead()
        assert stage.statistics.plans == 2
    images += stage.add(case.block.select(slice(n_before, None)))
    assert stage.statistics.plans == 2
    images = _fuse(LiveFusion(), images)
    assert _error_db(images[1].image, _exact(case, slice(LENGTH, None))) <= -60.0


def test_planning_ahead_leaves_the_cuts_of_the_aperture_underway(fly):
    # Every aperture leaps back to where the one before began, so plans ahead are in vain.
    once = fly('bowed').block.select(slice(0, LENGTH))
    stage, fusion, images = _stage(fly('bowed')), LiveFusion(), []
    for number in range(4):
        block = dataclasses.replace(
            once, counter=once.counter + np.uint32(number * LENGTH),
            stamp_ns=once.stamp_ns + number * 10**9)
        for piece in _pieces(block):
            for subaperture in stage.add(piece):
                images += fusion.add(subaperture)  # refuses what was cut otherwise
            stage.plan_ahead()
    assert [(image.aperture, image.n_pulses) for image in images] == [
        (number, LENGTH) for number in range(4)]
