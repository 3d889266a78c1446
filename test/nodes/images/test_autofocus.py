# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Autofocus in the nodes: accepted, not needed, refused; and always told."""

import dataclasses
import re

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation
from std_msgs.msg import Float32MultiArray

from benchmarks.support.drone_flights import POSE_NOISE_M, drone_flight
from benchmarks.support.references import exact_image
from msg_conversions import pulse_block
from msg_conversions.images import complex_from_message
from msg_conversions.planar_poses import UNKNOWN_VARIANCE
from msg_conversions.subaperture_wire import as_received
from sar_imaging.autofocus.live import compile_autofocus
from sar_imaging.backends import compile_beforehand
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.poses import PoseTable
from sar_imaging.nodes.backprojection import PARAMETERS, BackprojectionStep
from sar_imaging.nodes.images import autofocus as nodes_autofocus
from sar_imaging.nodes.images.autofocus import ImageFocus, Note
from sar_imaging.nodes.images.corrected_pose import CorrectedPose
from sar_imaging.nodes.poses import known_positions
from sar_imaging.nodes.poses.known_positions import KnownPositions
from sar_imaging.nodes.runtime.parameters import ConfigurationError
from sar_imaging.nodes.runtime.stage import COMMON_PARAMETERS
from sar_imaging.nodes.sar_pipeline import SarPipelineNode
from sar_imaging.quality import contrast, error_db
from sar_imaging.recordings.bag_io import odometry_messages, split
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation import flawed_aperture
from sar_imaging.streaming.aperture import ApertureImage, ApertureImager
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures
from sar_imaging.tools.node_processes import NODES, PIPELINE

LENGTH = 128
EXPECTED = {'autofocus.track_error': 0.05}
GATE = 16.27  # chi-squared of three, exceeded once in a thousand


def moved(block, offset_m):
    return dataclasses.replace(block, tx_m=block.tx_m + offset_m, rx_m=block.rx_m + offset_m)


@pytest.fixture(scope='module')
def case():
    return flawed_aperture('smooth', 1e-6, 2, n_pulses=LENGTH, half_scene_m=12.0)


@pytest.fixture(scope='module')
def offset_m():
    """(P, 1, 3) smooth error of the positions, 1.7 wavelengths, without a constant and a line."""
    shapes = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, LENGTH), 3)[:, 2:]
    return (shapes @ [[0.0, 0.03, 0.02], [0.0, -0.02, 0.03]])[:, None]


@pytest.fixture(scope='module')
def truth(case):
    grid = case.grid
    return {'frame': 'map', 'pulses_per_aperture': LENGTH,
            'grid': {'centre_m': grid.centre_m, 'n_x': grid.n_x, 'n_y': grid.n_y,
                     'spacing_m': grid.spacing_m}}


@pytest.fixture(scope='module')
def compiled():
    """Kernels as users compile them once: a process that compiles its own rounds differently."""
    compile_beforehand('Backprojection')
    compile_autofocus()


def scaled_error_db(image, wanted):
    """Error of an image times the factor that fits best, dB."""
    return error_db(np.vdot(image, wanted) / np.vdot(image, image) * image, wanted)


def listen_to_poses(chain):
    chain.observer.subscribe(PoseWithCovarianceStamped, 'corrected_pose')
    chain.wait_for_log(chain.names[-1], 'subscriber on .*corrected_pose joined')


def position_of(message):
    """Stamp in nanoseconds, position (3,) and covariance (3, 3); nothing else is known."""
    stamp, p = message.header.stamp, message.pose.pose.position
    covariance = np.array(message.pose.covariance).reshape(6, 6)
    assert (covariance[3:, 3:] == UNKNOWN_VARIANCE * np.eye(3)).all()
    assert not covariance[:3, 3:].any() and not covariance[3:, :3].any()
    return (stamp.sec * 10**9 + stamp.nanosec, np.array([p.x, p.y, p.z]), covariance[:3, :3])


def check_along_sight(message, true, sight, wrong_m):
    """The pose is right and known along the line of sight, where it had been wrong, alone."""
    stamp_ns, position_m, covariance_m2 = position_of(message)
    [at] = np.flatnonzero(true.stamp_ns == stamp_ns)
    assert abs(at - LENGTH / 2) <= 1
    error_m = position_m - true.tx_m[at, 0]
    assert error_m @ np.linalg.solve(covariance_m2, error_m) < GATE
    std_m, axes = np.linalg.eigh(covariance_m2)
    std_m = np.sqrt(std_m)
    # A radian of phase is 2.4 mm, what is expected without an image 50 mm times 1/2 to 5/8, of
    # the second and the fourth polynomial in the middle.
    assert abs(axes[:, 0] @ sight) > 0.999 and std_m[0] < 2e-3 and (std_m[1:] > 0.02).all()
    assert abs(wrong_m[at, 0] @ sight) > 5 * std_m[0] or not wrong_m.any()


def test_images_are_focused_and_the_report_tells(make_chain, case, truth, offset_m, compiled):
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((2, *case.true.samples.shape))
    apertures = [moved(case.true, offset_m), case.true,
                 dataclasses.replace(case.true, samples=noise[0] + 1j * noise[1])]
    later = [dataclasses.replace(
        block, counter=block.counter + np.uint32(k * LENGTH),
        stamp_ns=block.stamp_ns + k * 10**10) for k, block in enumerate(apertures)]
    blocks = [block.select(slice(i, i + 32)) for block in later for i in range(0, LENGTH, 32)]
    chain = make_chain(truth, names=PIPELINE, namespace='radar0',
                       backprojection=EXPECTED | {'autofocus.position_std': 1e-3})
    observer = chain.observer
    listen_to_poses(chain)
    observer.subscribe(Float32MultiArray, 'range_profiles')
    chain.wait_for_log('sar_pipeline', 'subscriber on .*range_profiles joined')
    observer.send(blocks)
    published = [complex_from_message(m) for m in observer.wait_for('image_complex', 3)]
    profiles = [pulse_block.from_message(m)
                for m in observer.wait_for('range_profiles', len(blocks))]

    # What the images would be without autofocus, and what the first one should be.
    imager = ApertureImager(case.grid, pulses_per_aperture=LENGTH, target_db=-80.0)
    plain = [product.image for block in profiles for product in imager.add(block)]
    first = concatenate(profiles[:LENGTH // 32])
    wanted = exact_image(case.grid, moved(first, -offset_m))

    assert scaled_error_db(plain[0], wanted) > -1.0
    assert scaled_error_db(published[0], wanted) < -20.0  # -31 measured
    # An image that is right already stays, and so does one that noise alone would sharpen.
    np.testing.assert_array_equal(published[1], plain[1])
    np.testing.assert_array_equal(published[2], plain[2])

    for text in ('autofocus for track errors of 0.05 m',
                 'aperture 0: 128 pulses, missing none, focused by autofocus; ',
                 'aperture 1: 128 pulses, missing none, focused already; ',
                 'aperture 2: 128 pulses, missing none, not changed by autofocus, focus not '
                 'confirmed; '):  # an image is published before it is told
        chain.wait_for_log('sar_pipeline', re.escape(text))
    observer.wait_for_counters('radar0/sar_pipeline', 'backprojection', images_published=3,
                               autofocus_attempted=3, autofocus_accepted=1, autofocus_claimed=2,
                               autofocus_failed=0, corrected_poses_published=2)
    sight = case.true.tx_m[LENGTH // 2, 0] - case.grid.centre_m
    for k, message in enumerate(observer.wait_for('corrected_pose', 2)):
        true = dataclasses.replace(case.true, stamp_ns=later[k].stamp_ns)
        check_along_sight(message, true, sight / np.linalg.norm(sight), (1 - k) * offset_m)
    observer.wait(lambda: observer.counters('radar0/sar_pipeline', 'backprojection')[
        'autofocus_contrast_before'] == pytest.approx(contrast(plain[2]), rel=1e-3),
        'contrast of the third image')
    last = observer.counters('radar0/sar_pipeline', 'backprojection')
    assert last['autofocus_contrast_after'] == last['autofocus_contrast_before']

    # The node alone makes the same of the same profiles.
    alone = make_chain(truth, names=('backprojection',), namespace='radar1',
                       pulses='range_profiles', backprojection=EXPECTED).observer
    alone.send_messages(observer.messages['range_profiles'][:LENGTH // 32])
    [image] = alone.wait_for('image_complex', 1)
    np.testing.assert_array_equal(complex_from_message(image), published[0])
    alone.wait_for_counters('radar1/backprojection', autofocus_attempted=1, autofocus_accepted=1,
                            autofocus_claimed=1)
    counters = alone.counters('radar1/backprojection')
    assert counters['autofocus_contrast_before'] == pytest.approx(contrast(plain[0]), rel=1e-3)
    assert counters['autofocus_contrast_after'] == pytest.approx(contrast(published[0]), rel=1e-3)
    assert counters['autofocus_error_db'] < -22.0  # what a claim stands for
    # 0.050 m of error less what no image shows
    assert counters['autofocus_largest_move_m'] == pytest.approx(0.05, abs=0.01)
    assert counters['autofocus_seconds'] < counters['last_image_seconds']


def test_fused_images_are_focused_and_the_report_tells(make_chain, case, truth, offset_m):
    offset_m = 0.3 * offset_m  # half a wavelength: the same phase for the whole scene
    noise = np.random.default_rng(0).standard_normal((2, *case.true.samples.shape))
    second = dataclasses.replace(
        case.true, samples=noise[0] + 1j * noise[1], counter=case.true.counter + np.uint32(LENGTH),
        stamp_ns=case.true.stamp_ns + 10**10)
    blocks = [block.select(slice(i, i + 32)) for block in (moved(case.true, offset_m), second)
              for i in range(0, LENGTH, 32)]
    chain = make_chain(truth, names=PIPELINE, mode='subapertures',
                       afbp_fusion={'autofocus.phase_gradient': True})
    observer = chain.observer
    observer.subscribe(Float32MultiArray, 'range_profiles')
    chain.wait_for_log('sar_pipeline', 'subscriber on .*range_profiles joined')
    observer.send(blocks)
    published = [complex_from_message(m) for m in observer.wait_for('image_complex', 2)]
    profiles = [pulse_block.from_message(m)
                for m in observer.wait_for('range_profiles', len(blocks))]

    subapertures, fusion = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH), LiveFusion()
    plain = []
    for block in profiles:
        plain += [fused.image for sub in subapertures.add(block)
                  for fused in fusion.add(as_received(sub))]
        subapertures.plan_ahead()  # as the node does between two blocks
    first = concatenate(profiles[:LENGTH // 32])
    wanted = exact_image(case.grid, moved(first, -offset_m))

    assert scaled_error_db(plain[0], wanted) > -3.0
    assert scaled_error_db(published[0], wanted) < -20.0  # -23.7 measured
    np.testing.assert_array_equal(published[1], plain[1])
    observer.wait_for_counters('sar_pipeline', 'afbp_fusion', images_final=2,
                               autofocus_attempted=2, autofocus_accepted=1, autofocus_failed=0)
    log = chain.log('sar_pipeline')
    assert re.search('image of aperture 0: .*sharpened by autofocus, focus not confirmed; '
                     '.*contrast .* -> ', log)
    assert re.search('image of aperture 1: .*not changed by autofocus, focus not confirmed; ', log)


@pytest.fixture(scope='module')
def flight():
    return drone_flight(3, motion='turn', radar_kind='uwb', n_pixels=120, n_pulses=160)


def true_image(flight):
    located = locate(flight.block, flight.track(), flight.alignment)
    profiles = RangeCompressor.for_block(located)(located)
    return exact_image(flight.grid, profiles)


def test_a_clock_that_is_a_second_wrong_is_found_with_poses_from_odometry(make_chains, flight):
    grid = flight.grid
    truth = {'frame': 'map', 'pulses_per_aperture': flight.block.n_pulses, 'grid': {
        'centre_m': grid.centre_m, 'n_x': grid.n_x, 'n_y': grid.n_y,
        'spacing_m': grid.spacing_m}, 'alignment': flight.misaligned(1.0).as_dict()}
    chains = make_chains(*({
        'truth': truth, 'names': names, 'namespace': f'radar{number}',
        'backprojection': {'autofocus.time_offset': 1.5, 'autofocus.position_std': POSE_NOISE_M}}
        for number, names in enumerate((PIPELINE, NODES))))
    poses = PoseTable(flight.stamp_ns, flight.position_m, flight.quaternion)
    images = []
    for chain in chains:
        listen_to_poses(chain)
        node = chain.observer.node
        publisher = node.create_publisher(Odometry, 'odometry', 2000)
        # two subscribers: pulse_buffer's positions and backprojection's autofocus
        chain.observer.wait(lambda p=publisher: p.get_subscription_count() == 2, 'subscribers')
        for _, cdr in odometry_messages(poses):
            publisher.publish(cdr)
        chain.wait_for_log(chain.names[-1], 'poses in frame map')
        chain.observer.send(list(split(flight.block)))
    for chain in chains:
        images.append(complex_from_message(chain.observer.wait_for('image_complex', 1)[0]))
        chain.wait_for_log(chain.names[-1], 'image of aperture 0: 160 pulses, missing none, '
                           'focused by autofocus; ')
    # The pulses, their positions and the track are the same to the last bit.
    np.testing.assert_array_equal(*images)
    # 0.993 measured; the two images differ by what the offset found lacks, milliseconds
    assert contrast(images[0]) > 0.97 * contrast(true_image(flight))
    chains[0].observer.wait_for_counters('radar0/sar_pipeline', 'backprojection',
                                         autofocus_accepted=1, autofocus_claimed=1)
    found = chains[0].observer.counters('radar0/sar_pipeline', 'backprojection')
    # what 0.01 s is seen as at 0.5 m/s of changing speed: 0.8 rad at most
    assert found['autofocus_time_offset_s'] == pytest.approx(-1.0, abs=0.01)
    poses = [chain.observer.wait_for('corrected_pose', 1)[0] for chain in chains]
    assert poses[0] == poses[1] and len(chains[0].observer.messages['corrected_pose']) == 1
    check_time_is_right(poses[0], flight)


def check_time_is_right(message, flight):
    """The pose is that of the drone at its stamp, less well known along the motion."""
    stamp_ns, position_m, covariance_m2 = position_of(message)
    flown_s = (flight.stamp_ns - stamp_ns) * 1e-9 - flight.alignment.time_offset_s
    near = np.abs(flown_s) < 0.1  # where a parabola halves the noise of the poses
    _, velocity, true_m = np.polyfit(flown_s[near], flight.position_m[near], 2)
    error_m = position_m - true_m
    assert error_m @ np.linalg.solve(covariance_m2, error_m) < GATE
    assert 1.0 * np.linalg.norm(velocity) > 100 * np.linalg.norm(error_m)  # with the wrong clock
    along = covariance_m2 - POSE_NOISE_M**2 * np.eye(3)
    along_m2 = velocity @ along @ velocity / (velocity @ velocity)
    # Noise of poses turns a velocity from 10 ms of them by some degrees, squared a hundredth.
    assert along_m2 == pytest.approx(np.trace(along), rel=0.03) and along_m2 > 0
    q = message.pose.pose.orientation
    # 5 ms to the nearest pose at less than 60 degrees a second
    turned = np.abs(flight.quaternion[np.argmin(np.abs(flown_s))] @ [q.x, q.y, q.z, q.w])
    assert turned > np.cos(np.radians(0.15))


@pytest.mark.parametrize('changes', [
    {'mode': 'image'}, {'mode': 'subapertures', 'subapertures.sliding': True}])
def test_phase_gradient_needs_whole_fused_images(changes):
    class Node:
        parameters = {'subapertures.sliding': False, 'autofocus.phase_gradient': True} | changes

    with pytest.raises(ConfigurationError, match='set mode subapertures without sliding, or use'):
        SarPipelineNode.steps(Node)


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'mode': 'subapertures'}, 'autofocus.time_offset=0.1 are of no use in mode: subapertures, '
     'whose images have no pulses; .* use autofocus.phase_gradient of afbp_fusion'),
    ({'terrain.file': 'hill.npz'}, r'autofocus \(autofocus.time_offset\) is not possible here: '
     'it works on a plane; leave terrain.file empty'),
    ({'autofocus.time_offset': 0.0, 'autofocus.range_bias': 0.1}, 'autofocus.range_bias=0.1 is '
     'of use beside an expected error of the track or the clock; set autofocus.track_error or '
     'autofocus.time_offset, too'),
    ({'autofocus.time_offset': 0.0, 'autofocus.position_std': 0.1}, 'autofocus.position_std=0.1 '
     'is of use beside ')])
def test_what_cannot_be_focused_is_refused(changes, reason):
    parameters = {p.name: p.default for p in (*PARAMETERS, *COMMON_PARAMETERS)}
    parameters |= {'autofocus.time_offset': 0.1} | changes
    with pytest.raises(ConfigurationError, match=reason):
        BackprojectionStep.create(parameters, None)


class Log:
    """Takes what a node's health would."""

    def __init__(self):
        self.lines = []

    def count(self, *arguments):
        pass

    set = tell = warning = count

    def info(self, text):
        self.lines.append(text)


def image_focus(log=None, **changes):
    parameters = {p.name: p.default for p in (*PARAMETERS, *COMMON_PARAMETERS)}
    return ImageFocus(parameters | {'pulses_per_aperture': LENGTH} | changes,
                      MapGrid((0.0, 1000.0, 0.0), 16, 16, 0.25), log or Log())


def test_controls_reach_autofocus(case, monkeypatch):
    seen = {}
    monkeypatch.setattr(nodes_autofocus, 'live_autofocus',
                        lambda grid, **options: seen.update(options) or FailingAutofocus())
    log = Log()
    focus = image_focus(log, **{
        'autofocus.track_error': 0.05, 'autofocus.range_bias': 0.2,
        'autofocus.residual_phases': False, 'autofocus.coherence_limit': 0.6})
    [image] = focus.take([product(case.true, 0)])
    assert image.focus.verdict == 'autofocus failed'
    monkeypatch.setattr(nodes_autofocus, 'FIRST_PROGRESS_S', -1.0)
    seen.pop('progress')(3, 12)
    assert re.fullmatch(r'autofocus of aperture 0: 3 of 12 clock offsets tried in \d+ s, \d+ s to '
                        'go', log.lines[-1])
    assert seen == {'track_error_m': 0.05, 'time_offset_s': 0.0, 'range_bias_m': 0.2,
                    'track': None, 'target_db': -60.0, 'n_phases': 0, 'least_coherence': 0.6,
                    'illumination': None, 'backend': 'auto'}


class Output:
    """A node whose outputs have a subscriber."""

    def __init__(self):
        self.published = []

    def create_output(self, *arguments):
        return self

    def get_subscription_count(self):
        return 1

    def publish(self, message):
        self.published.append(message)


def fails():
    raise ValueError('1 bright points do not tell 4 unknowns')


def test_poses_that_are_not_told_are_not_published(case):
    output, log = Output(), Log()
    focused = dataclasses.replace(product(case.true, 7), focus=Note('focused', '', fails))
    poses = CorrectedPose(output, {'antenna.offset_s': [0.0], 'frame_id': 'odom'}, log, None)
    poses.publish(focused)
    assert log.lines == ['no corrected pose of aperture 7: 1 bright points do not tell 4 unknowns']
    poses.publish(dataclasses.replace(focused, focus=Note('not changed', '')))
    assert not output.published


def test_the_body_is_told_by_the_pose_of_the_time_found(flight):
    parameters = {p.name: p.default for p in (*PARAMETERS, *COMMON_PARAMETERS)}
    known = KnownPositions(parameters | {'pose.source': 'odometry'}, Log(), None, 1.0)
    known._alignment, known._poses = flight.misaligned(0.5), flight.track()
    at = 400  # poses from now
    stamp_ns = int(flight.stamp_ns[at]) - round(1e9 * flight.alignment.time_offset_s)
    quaternion, arm_m = known.body(stamp_ns, -0.5)
    turned = Rotation.from_quat(flight.quaternion[at])
    assert abs(quaternion @ flight.quaternion[at]) == pytest.approx(1.0, abs=1e-12)
    assert arm_m == pytest.approx(turned.apply(flight.alignment.tx_m[0]), abs=1e-9)
    with pytest.raises(ValueError, match='no pose is known of'):
        known.body(stamp_ns, 100.0)


class FailingAutofocus:
    def process(self, pulses, image):
        raise ValueError('on purpose')


def product(pulses, aperture):
    return ApertureImage(np.zeros((16, 16), np.complex64), None, 0, aperture, pulses.counter,
                         np.zeros(0, np.int64), -80.0, pulses.radar.carrier_hz, pulses)


def test_an_image_waits_for_the_pulses_behind_its_aperture(case, monkeypatch):
    monkeypatch.setattr(known_positions, '_PAUSE_S', 1e9)
    monkeypatch.setattr(nodes_autofocus, 'BEYOND_S', 0.1)
    focus = image_focus(**{'autofocus.time_offset': 0.32})  # 0.4 s, and 0.1 s, to each side
    monkeypatch.setattr(focus, '_focused', lambda image: (
        image.aperture, focus.positions.around(image.pulses)))
    step_ns = int(case.true.stamp_ns[1] - case.true.stamp_ns[0])  # 10 ms
    behind = dataclasses.replace(case.true, stamp_ns=case.true.stamp_ns + LENGTH * step_ns)
    focus.positions.add(case.true)
    assert focus.take([product(case.true, 0)]) == []
    focus.positions.add(behind.select(slice(0, 32)))
    assert focus.take([]) == [] and focus.positions.awaited
    focus.positions.add(behind.select(slice(32, 64)))
    [(number, track)] = focus.take([])
    assert number == 0 and not focus.positions.awaited
    stamp_ns = case.true.stamp_ns
    assert track.covers(stamp_ns, 0.5)  # those behind are known
    assert track.covers(stamp_ns, -0.1) and not track.covers(stamp_ns, -0.5)
    # Nothing is waited for where the input ends, and nothing kept that was given up.
    assert len(focus.take([product(behind, 1)], final=True)) == 1
    focus.take([product(behind, 2)])
    assert focus.discard() == LENGTH and focus.take([], final=True) == []


def test_poses_of_the_body_are_known_and_not_waited_for(case, monkeypatch):
    focus = image_focus(**EXPECTED, **{'autofocus.position_std': 0.01,
                                       'pose.source': 'odometry'})
    monkeypatch.setattr(focus, '_focused', lambda image: image.aperture)
    assert focus.take([product(case.true, 3)]) == [3] and focus.positions is not None
    assert image_focus(**EXPECTED, **{'autofocus.position_std': 0.01}).positions is None


def test_times_that_go_back_begin_another_track(case):
    focus = image_focus(**{'autofocus.time_offset': 0.4})
    for _ in range(2):
        focus.positions.add(case.true)
    assert focus.positions.around(case.true).covers(case.true.stamp_ns, 0.0)
