# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""localization: images and odometry over DDS become poses in a map, and faults are named."""

import dataclasses
import math
import re
import shutil
import sys
import types

import numpy as np
import pytest
import rclpy
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import MapMetaData, Odometry
from scipy.ndimage import gaussian_filter, map_coordinates
from sensor_msgs.msg import Image as ImageMessage
from std_msgs.msg import Header

from msg_conversions.images import (
    amplitude_to_message,
    complex_to_message,
    map_metadata_to_message,
)
from msg_conversions.planar_poses import UNKNOWN_VARIANCE
from sar_imaging import Image, MapGrid, plan_image
from sar_imaging.exploitation.registration import LookDirection, Speckle
from sar_imaging.formats.reference_map import (
    Pass,
    ReferenceMap,
    read_reference_map,
    write_reference_map,
)
from sar_imaging.geometry.track import plane_rotation
from sar_imaging.imaging.image import Report
from sar_imaging.nodes import localization
from sar_imaging.nodes.runtime.managed import AUTOSTART
from sar_imaging.signal.pulses import concatenate
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.simulation.trajectory import Trajectory

from .conftest import LATCHED, flatten

NAME = 'localization'
MAP_POSE_JOINED = 'subscriber on .*map_pose joined'
ODOM_IN_MAP = (5.0, -4.0, math.radians(30.0))  # the truth; the node is told a bit less
SPEED = 4.0  # m/s along x of the odometry's frame
RATE_HZ = 25
PLACE = 'place'


class World:
    """Ground of a map, images of it from a robot that drives, and its odometry."""

    def __init__(self):
        self.rng = np.random.default_rng(3)
        level = gaussian_filter(self.rng.standard_normal((300, 300)), 3.0)
        self.level = level / level.std()

    def power(self, grid, frame=(0.0, 0.0, 0.0), away_m=0.0):
        x, y = np.meshgrid(grid.x_m, grid.y_m)
        c, s = math.cos(frame[2]), math.sin(frame[2])
        east, north = frame[0] + c * x - s * y + away_m, frame[1] + s * x + c * y
        return 10 ** (0.5 * map_coordinates(
            self.level, [149.5 - north / 0.5, east / 0.5 + 149.5], order=1, mode='grid-wrap'))

    def _image(self, *where):
        power = self.power(*where)
        speckle = self.rng.standard_normal((*power.shape, 2)).view(complex)[..., 0]
        return (np.sqrt(power / 2) * speckle).astype(np.complex64)

    def write_map(self, folder):
        grid = MapGrid((0.0, 0.0, 0.0), 300, 300, 0.5)
        whole = Image(self._image(grid), grid, 10e9, Report('exact', '', -60.0))
        image = dataclasses.replace(whole, samples=np.abs(whole.samples))
        one = Pass('monday', LookDirection(210.0, 20.0), 0, Speckle(whole, (-8.0, -5.0, 2.0)))
        write_reference_map(folder, ReferenceMap(
            image, (one,), np.ones(grid.shape, np.uint16), 0.5, -20.0))

    def seen(self, at_s, away_m=0.0):
        """Samples and grid of an image ahead of the robot at a time."""
        grid = MapGrid((SPEED * at_s + 10.0, 0.0, 0.0), 120, 120, 0.5)
        return self._image(grid, ODOM_IN_MAP, away_m), grid

    @staticmethod
    def truth(at_s):
        """x, y and heading of the robot in the map."""
        x = SPEED * at_s
        return np.array([ODOM_IN_MAP[0] + math.cos(ODOM_IN_MAP[2]) * x,
                         ODOM_IN_MAP[1] + math.sin(ODOM_IN_MAP[2]) * x, ODOM_IN_MAP[2]])


def stamp_of(at_s):
    nanoseconds = round(1e9 * at_s)
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


class Robot:
    """What imager and odometry publish."""

    def __init__(self, observer, world, localization, joined=1):
        self.world, self._observer = world, observer
        node = observer.node
        self._images = node.create_publisher(ImageMessage, 'image', 10)
        self._metadata = node.create_publisher(MapMetaData, 'map_metadata', LATCHED)
        self._odometry = node.create_publisher(Odometry, 'odometry', 1000)
        observer.subscribe(PoseWithCovarianceStamped, 'map_pose')
        observer.wait(lambda: all(p.get_subscription_count() for p in (
            self._images, self._metadata, self._odometry)), 'the subscriptions')
        localization.wait_for_log(NAME, MAP_POSE_JOINED, joined)

    def drive(self, from_s, to_s, speed=SPEED, frame='odom'):
        """Send odometry, evenly."""
        for n in range(round(from_s * RATE_HZ), round(to_s * RATE_HZ)):
            message = Odometry(header=Header(stamp=stamp_of(n / RATE_HZ), frame_id=frame))
            message.pose.pose.position.x = speed * n / RATE_HZ
            message.pose.pose.position.z = 2.0
            message.pose.pose.orientation.w = 1.0
            self._odometry.publish(message)

    def image(self, at_s, frame='odom', away_m=0.0, as_complex=False):
        samples, grid = self.world.seen(at_s, away_m)
        header = Header(stamp=stamp_of(at_s), frame_id=frame)
        self._metadata.publish(map_metadata_to_message(grid, header.stamp))
        self._images.publish(complex_to_message(samples, header) if as_complex
                             else amplitude_to_message(np.abs(samples), header))

    def poses(self, count):
        """The first poses that came."""
        return self._observer.wait_for('map_pose', count)


def check(message, at_s):
    """A pose lies within its own covariance of the truth."""
    covariance = np.array(message.pose.covariance).reshape(6, 6)
    planar = covariance[np.ix_((0, 1, 5), (0, 1, 5))]
    q, p = message.pose.pose.orientation, message.pose.pose.position
    error = np.array([p.x, p.y, 2 * math.atan2(q.z, q.w)]) - World.truth(at_s)
    # chi-squared with three degrees of freedom exceeds it once in a thousand
    assert error @ np.linalg.solve(planar, error) < 16.3, (error, planar)
    assert 0 < planar[0, 0] < 1.0 and 0 < planar[1, 1] < 1.0 and 0 < planar[2, 2] < 0.01
    assert np.diag(covariance)[2:5].tolist() == [UNKNOWN_VARIANCE] * 3 and p.z == 2.0
    assert message.header.frame_id == 'map' and message.header.stamp == stamp_of(at_s)


def parameters(folder, **more):
    return {'map.folder': str(folder), 'frame_id': 'odom', 'start.x': ODOM_IN_MAP[0] + 2.0,
            'start.y': ODOM_IN_MAP[1] + 1.5, 'start.heading_deg': 29.0, 'pose.wait_s': 0.5,
            'search_m': 10.0, **more}


def test_a_drive_with_all_that_may_go_wrong(start_node, make_observer, tmp_path):
    node = start_node(NAME, parameters(tmp_path / PLACE))
    observer = make_observer()
    robot = Robot(observer, World(), node)
    node.wait_for_log(NAME, 'no reference map, images are refused: ')
    robot.drive(0.0, 8.0)
    robot.image(0.6)
    observer.wait_for_counters(NAME, refused_no_map=1, images_received=1)
    assert observer.status(NAME).level > DiagnosticStatus.OK

    robot.world.write_map(tmp_path / PLACE)  # it comes later
    node.wait_for_log(NAME, 'map of 300 x 300 pixels of 0.5 m from 1 passes')
    node.wait_for_log(NAME, 'the reference map is there')
    robot.image(1.0)
    observer.wait_for_counters(NAME, refused_unconfirmed=1, poses_published=0)
    robot.image(1.2)  # may have pulses in common with it
    observer.wait_for_counters(NAME, refused_unconfirmed=2, poses_published=0)
    robot.image(2.6, as_complex=True)
    check(robot.poses(1)[0], 2.6)
    robot.image(2.6)
    observer.wait_for_counters(NAME, refused_common_pulses=1, poses_published=1)

    robot.image(4.0, frame='map')
    observer.wait_for_counters(NAME, images_in_other_frame=1)
    node.wait_for_log(NAME, "images are in frame 'map'; expected frame_id=odom")
    robot.image(4.0, away_m=55.0)  # a place that is not near
    observer.wait_for_counters(NAME, refused_not_found=1)
    robot.drive(8.0, 9.0, frame='map')
    observer.wait_for_counters(NAME, poses_in_other_frame=RATE_HZ)
    robot.image(8.6)  # the odometry is late
    observer.wait_for_counters(NAME, refused_no_odometry=1)
    robot.image(4.2)
    check(robot.poses(2)[1], 4.2)

    # in the log and in the diagnostics stands why
    last = {pair.key: pair.value for pair in observer.status(NAME).values}
    assert 'newer than the newest pose' in last['last_refusal']
    shutil.rmtree(tmp_path / PLACE)
    node.wait_for_log(NAME, 'the map that was read serves on')
    robot.image(5.6)
    check(robot.poses(3)[2], 5.6)

    robot.drive(0.0, 8.0)  # the clock goes back
    observer.wait_for_counters(NAME, odometry_restarts=1)
    robot.image(5.0)  # near where the robot was last
    observer.wait_for_counters(NAME, refused_unconfirmed=3, poses_published=3)
    robot.image(6.4)
    check(robot.poses(4)[3], 6.4)


@pytest.mark.usefixtures('whole_end')
def test_a_node_that_is_restarted_or_deactivated_needs_two_images_again(start_node, make_observer,
                                                                        tmp_path):
    world = World()
    world.write_map(tmp_path / PLACE)
    # well enough for the first image; odometry of a busy machine comes late, but it comes
    known = {'start.std_m': 2.0, 'start.std_deg': 1.0, 'pose.wait_s': 60.0}
    node = start_node(NAME, parameters(tmp_path / PLACE, **known))
    observer = make_observer()
    robot = Robot(observer, world, node)
    robot.drive(0.0, 14.0)
    robot.image(2.5)
    check(robot.poses(1)[0], 2.5)
    assert observer.change_state(NAME, 'deactivate') and observer.change_state(NAME, 'activate')
    observer.wait(lambda: getattr(observer.status(NAME), 'message', '') == 'waiting for input',
                  'activation')
    robot.drive(3.0, 14.0)
    robot.image(5.0)
    observer.wait_for_counters(NAME, refused_unconfirmed=1, poses_published=1)
    joined = len(re.findall(MAP_POSE_JOINED, node.log(NAME)))
    node.kill(NAME)
    node.start(NAME)
    node.wait_for_log(NAME, 'ready: ', 3)
    robot = Robot(observer, world, node, joined + 1)
    robot.drive(0.0, 8.0, speed=0.0)
    robot.image(2.0)  # while the robot stands
    observer.wait_for_counters(NAME, refused_no_motion=1)
    robot.drive(8.0, 14.0)
    robot.image(10.0)
    check(robot.poses(2)[1], 10.0)
    assert observer.trigger(f'{NAME}/reset') == (True, 'the estimates are forgotten')
    robot.image(13.0)
    observer.wait_for_counters(NAME, refused_unconfirmed=1, poses_published=1)


def test_a_map_grows_by_images_that_are_sure_and_is_written_on_request(start_node, make_observer,
                                                                       tmp_path):
    world, place = World(), tmp_path / PLACE
    world.write_map(place)
    before = read_reference_map(place)
    node = start_node(NAME, parameters(place, **{'map.update': True, 'height_std_m': 0.1}))
    observer = make_observer()
    robot = Robot(observer, world, node)
    robot.drive(0.0, 8.0)
    robot.image(1.0)
    robot.image(2.6)  # confirms it, and is not added: two images may agree in being wrong
    check(robot.poses(1)[0], 2.6)
    node.wait_for_log(NAME, 'not added to the map: its place was not expected')
    robot.image(4.0, away_m=55.0)
    observer.wait_for_counters(NAME, refused_not_found=1, images_added=0)
    robot.image(4.4)
    check(robot.poses(2)[1], 4.4)
    robot.image(5.8)
    check(robot.poses(3)[2], 5.8)
    observer.wait_for_counters(NAME, images_added=2, images_unsaved=2)

    answer = observer.call(NAME, 'save_map')
    assert answer.success and '2 images more: wrote amplitude.npy' in answer.message
    observer.wait_for_counters(NAME, images_added=2, images_unsaved=0)
    after = read_reference_map(place)
    assert [p.name for p in after.passes] == ['monday', NAME]  # both images look from one side
    # the radar looks from 2 m high and 10 m behind the middle, 30 degrees off the map's x
    assert after.passes[1].look.azimuth_deg % 360 == pytest.approx(210.0, abs=1.0)
    assert np.unique(after.seen).tolist() == [1, 2, 3]
    # 60 m each, which moved by 5.6 m along one side
    assert np.count_nonzero(after.seen == 3) == pytest.approx(54.4 * 60.0 / 0.5**2, rel=0.05)
    np.testing.assert_array_equal(after.speckle[0].image.samples,
                                  before.speckle[0].image.samples)
    alone = after.seen == 1
    assert np.array_equal(after.image.samples[alone], before.image.samples[alone])

    def scatter(reference):
        """Variance of the logarithm of power, about the ground, where all passes saw it."""
        power = np.square(reference.image.samples) / world.power(before.image.grid)
        return np.var(np.log(power[after.seen == 3]))

    # speckle of one look has 1.64, of three 0.39; interpolation makes it less, a wrong place more
    assert scatter(before) == pytest.approx(1.64, rel=0.1) and scatter(after) < 0.45


class Repeated:
    """Flights past the ground of first_pass, textured, in a frame that drifted.

    A leg is 40 m in 8 s; in as many more the robot goes to where the next one begins. Images are
    formed of simulated pulses, by the positions that the odometry tells; half of the power of the
    ground has other speckle than before.
    """

    FRAME = np.array([30.0, -20.0, math.radians(25.0)])  # of the odometry in the map
    LEG_S, SPEED = 16.0, 5.0

    def __init__(self, observer, baselines_m):
        self._rotation = plane_rotation(self.FRAME[2])
        node, self._observer = observer.node, observer
        self._images = node.create_publisher(ImageMessage, 'image', 10)
        self._metadata = node.create_publisher(MapMetaData, 'map_metadata', LATCHED)
        self._odometry = node.create_publisher(Odometry, 'odometry', 5000)
        observer.subscribe(PoseWithCovarianceStamped, 'map_pose')
        observer.wait(lambda: all(p.get_subscription_count() for p in (
            self._images, self._metadata, self._odometry)), 'the subscriptions')
        self._middles = np.array(baselines_m) + [-707.0, 0.0, 707.0]

    def to_odometry(self, points_m):
        """(..., 3) places of the map in the frame of the odometry."""
        return np.concatenate([(points_m[..., :2] - self.FRAME[:2]) @ self._rotation,
                               points_m[..., 2:]], axis=-1)

    def fly(self):
        """Send the odometry of all legs."""
        reach = np.array([0.0, 20.0, 0.0])
        at = np.concatenate([[m - reach, m + reach] for m in self._middles])
        times = self.LEG_S / 2 * np.arange(len(at))
        for t in np.arange(0.0, times[-1], 0.04):
            place = self.to_odometry(np.array([np.interp(t, times, v) for v in at.T]))
            message = Odometry(header=Header(stamp=stamp_of(t), frame_id='odom'))
            p, q = message.pose.pose.position, message.pose.pose.orientation
            p.x, p.y, p.z = place.tolist()
            q.z, q.w = math.sin(-self.FRAME[2] / 2), math.cos(self.FRAME[2] / 2)
            self._odometry.publish(message)

    @staticmethod
    def pulses(middle, new, seed):
        """Range profiles from a track, some power of whose ground has other speckle; its radar."""
        scenario, rng = SCENARIOS['first_pass'](), np.random.default_rng(seed)
        x, y, _ = scenario.clutter.positions_m.T
        ground = scenario.clutter.amplitudes * np.exp(
            0.8 * np.sin(x / 2.3) * np.cos(y / 1.7) + 0.6 * np.sin(x * y / 35.0))
        other = rng.standard_normal((len(x), 2)).view(complex)[:, 0] / math.sqrt(2)
        now = math.sqrt(1 - new) * ground + math.sqrt(new) * np.abs(ground) * other
        return concatenate(list(dataclasses.replace(
            scenario, seed=seed, clutter=dataclasses.replace(scenario.clutter, amplitudes=now),
            trajectory=Trajectory(tuple(middle), (0.0, 100.0, 0.0))).blocks()))

    @classmethod
    def write_map(cls, folder):
        """Map of the first pass, with its complex image."""
        block = cls.pulses((-707.0, 0.0, 707.0), 0.0, 1)
        grid = MapGrid.from_size((0.0, 0.0, 0.0), 48.0, 48.0, 0.25)
        image = plan_image(grid, block.radar, block.n_samples)(block)
        one = Pass('monday', LookDirection(180.0, 45.0), 0, Speckle(
            image, tuple(block.tx_m.reshape(-1, 3).mean(axis=0))))
        write_reference_map(folder, ReferenceMap(
            dataclasses.replace(image, samples=np.abs(image.samples)), (one,),
            np.ones(grid.shape, np.uint16), 0.5, -20.0))

    def image(self, leg):
        """Complex image of a leg, on a map in the frame of the odometry."""
        block = self.pulses(self._middles[leg], 0.5, 20 + leg)
        block = dataclasses.replace(block, **{name: self.to_odometry(getattr(block, name))
                                              for name in ('tx_m', 'rx_m')})
        centre = self.to_odometry(np.zeros(3))
        grid = MapGrid.from_size(tuple(centre), 34.0, 34.0, 0.25)
        return plan_image(grid, block.radar, block.n_samples)(block)

    def located(self, image, leg, as_complex):
        """Error of the place of the image's middle, by a pose, and its standard deviation."""
        count = len(self._observer.messages['map_pose'])
        header = Header(stamp=stamp_of(self.LEG_S * leg + 4.0), frame_id='odom')
        self._metadata.publish(map_metadata_to_message(image.grid, header.stamp))
        self._images.publish(complex_to_message(image.samples, header) if as_complex
                             else amplitude_to_message(np.abs(image.samples), header))
        message = self._observer.wait_for('map_pose', count + 1)[-1]
        q, p = message.pose.pose.orientation, message.pose.pose.position
        planar = np.array(message.pose.covariance).reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
        error = np.array([p.x, p.y, 2 * math.atan2(q.z, q.w)]) - [*self._middles[leg][:2], 0.0]
        assert error @ np.linalg.solve(planar, error) < 16.3, (error, planar)
        turned = error[2] * np.array([self._middles[leg][1], -self._middles[leg][0]])
        return float(np.hypot(*(error[:2] + turned))), math.sqrt(planar[2, 2])


def test_a_second_pass_along_the_track_is_located_by_its_speckle(start_node, make_observer,
                                                                 tmp_path):
    Repeated.write_map(tmp_path / PLACE)
    node = start_node(NAME, {
        'map.folder': str(tmp_path / PLACE), 'frame_id': 'odom', 'aperture_s': 7.0,
        'pose.wait_s': 60.0, 'pose.jump_m': 3.0, 'start.x': 30.6, 'start.y': -20.4,
        'start.heading_deg': 25.03, 'start.std_m': 1.0, 'start.std_deg': 0.05, 'drift': 0.002,
        'drift_deg_per_m': 1e-4, 'search_m': 15.0, 'height_std_m': 0.2})
    node.wait_for_log(NAME, 'from 1 passes, 1 of them complex: .* remap image to image_complex')
    observer = make_observer()
    near = [(0.3, 0.0, 1.4), (-0.5, 0.0, 0.9), (0.8, 0.0, -1.2)]
    far = (42.0, 0.0, 42.0)  # across the line of sight; speckle is shared within some 30 m
    robot = Repeated(observer, np.repeat([*near, far], 2, axis=0))
    node.wait_for_log(NAME, MAP_POSE_JOINED)
    robot.fly()
    told = []
    for leg in range(0, 2 * len(near), 2):
        image = robot.image(leg)
        told.append([robot.located(image, leg + k, bool(k)) for k in (0, 1)])
    amplitude, phases = np.median(told, axis=0)
    observer.wait_for_counters(NAME, poses_published=6, poses_by_speckle=3)
    # the root of the half of the power that is the same is 0.71; reflector and noise change it
    assert observer.counters(NAME)['last_coherence'] == pytest.approx(0.7, abs=0.1)
    node.wait_for_log(NAME, 'by speckle of coherence 0.')
    # a hundredth of a cell, which is 0.7 m by 0.4 m, and standard deviations of the heading alike
    assert phases[0] < 0.01 and (phases < 0.5 * amplitude).all(), told
    robot.located(robot.image(6), 6, True)
    observer.wait_for_counters(NAME, poses_published=7, poses_by_speckle=3, last_coherence=0.0)


def test_maps_of_other_radars_and_damaged_ones_are_named(start_node, make_observer, tmp_path):
    world = World()
    world.write_map(tmp_path / PLACE)
    (tmp_path / PLACE / 'amplitude.npy').write_bytes(b'no array')
    node = start_node(NAME, parameters(tmp_path / PLACE, carrier_hz=77e9, publish_tf=False))
    node.wait_for_log(NAME, r'no reference map, images are refused: .*amplitude\.npy')
    robot = Robot(observer := make_observer(), world, node)
    world.write_map(tmp_path / PLACE)
    node.wait_for_log(NAME, 'the reference map is there')
    robot.drive(0.0, 4.0)
    robot.image(1.0)
    observer.wait_for_counters(NAME, refused_other_image=1)
    node.wait_for_log(NAME, 'the image was taken at 77 GHz, the reference at 10 GHz')


@pytest.mark.parametrize(('values', 'message'), [
    ({}, 'parameter map.folder is empty; name a folder'),
    ({'map.folder': 'place', 'publish_tf': True}, 'map.frame_id and frame_id are both map'),
    ({'map.folder': 'place', 'pose.source': 'block'}, "parameter pose.source: 'block' is")])
def test_what_cannot_work_is_told_at_the_start(start_node, values, message):
    node = start_node(NAME, values)
    assert node.exit_code(NAME) == 1
    assert message in node.log(NAME)


@pytest.fixture
def in_process(ros_environment, tmp_path, monkeypatch):
    """The node in this process, with a tf2_ros that remembers what it was told."""
    told = []
    monkeypatch.setitem(sys.modules, 'tf2_ros', types.SimpleNamespace(
        TransformBroadcaster=lambda node: types.SimpleNamespace(
            pub_tf=node.create_publisher(PoseWithCovarianceStamped, 'tf', 1),
            sendTransform=told.append)))
    rclpy.init(args=['--ros-args', '-p', f'map.folder:={tmp_path}', '-p', 'publish_tf:=true',
                     '-p', 'frame_id:=odom'])
    node = localization.LocalizationNode()
    yield node, told
    node.destroy_node()
    rclpy.try_shutdown()


def test_the_transform_is_told_once_there_is_one_and_not_of_odometry_that_began_anew(in_process):
    node, told = in_process
    assert node.start()
    node._send_transform()
    assert not told
    node._shown = np.array([1.0, 2.0, 0.5])
    node._send_transform()
    [transform] = told
    assert (transform.header.frame_id, transform.child_frame_id) == ('map', 'odom')
    for n in (*range(50), *range(10)):
        node._poses._take(n * 10**8, (0.1 * n, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    node._look_around()
    node._send_transform()
    assert len(told) == 1


def test_images_that_are_none_are_rejected_with_the_reason(in_process):
    node, _ = in_process
    node.start()
    node._localizer = types.SimpleNamespace(reference=types.SimpleNamespace(carrier_hz=1e10),
                                            restart=lambda: None)
    header = Header(stamp=stamp_of(1.0), frame_id='odom')
    small = amplitude_to_message(np.ones((3, 4), np.float32), header)
    with pytest.raises(ValueError, match='3 x 4 pixels, and no map_metadata tell where'):
        node._located(small, None)
    node._take_metadata(map_metadata_to_message(MapGrid((0.0, 0.0, 0.0), 8, 8, 0.5),
                                                header.stamp))
    with pytest.raises(ValueError, match='map_metadata tell of 8 x 8; remap map_metadata'):
        node._located(small, None)
    small.encoding = 'mono8'
    with pytest.raises(ValueError, match="encoding='mono8'; expected '32FC1'"):
        node._located(small, None)
    turned = map_metadata_to_message(MapGrid((0.0, 0.0, 0.0), 8, 8, 0.5), header.stamp)
    turned.origin.orientation.z = 0.7
    node._take_metadata(turned)
    assert node.health.get('images_rejected') == 1


def test_a_grid_that_moves_is_that_of_the_stamp_of_an_image(in_process):
    node, _ = in_process
    node.start()
    grids = [MapGrid((float(n), 0.0, 0.0), 8, 8, 0.5) for n in range(3)]
    for at_s, grid in zip((100.0, 1.0, 2.0), grids, strict=True):  # the first by another clock
        node._take_metadata(map_metadata_to_message(grid, stamp_of(at_s)))
    assert node._grid_of(1_500_000_000) == grids[1]
    assert node._grid_of(2_000_000_000) == grids[2]
    assert node._grid_of(500_000_000) == grids[2]  # none is told for it


def test_file_and_page_say_what_the_table_of_parameters_does(pytestconfig):
    sections = yaml.safe_load((pytestconfig.rootpath / 'sar_imaging' / 'config'
                               / 'sar_imaging.yaml').read_text())
    listed = dict(flatten(sections[f'/**/{NAME}']['ros__parameters']))
    common = dict(flatten(sections['/**']['ros__parameters']))
    table = {p.name: p.default for p in (*localization.PARAMETERS, AUTOSTART)}
    assert listed.items() <= table.items()
    assert {name: common[name] for name in table.keys() - listed.keys()} == {
        name: table[name] for name in table.keys() - listed.keys()}
    page = (pytestconfig.rootpath / 'docs' / 'nodes' / f'{NAME}.md').read_text()
    for p in (*localization.PARAMETERS, AUTOSTART):
        default = str(p.default).lower() if isinstance(p.default, bool) else str(p.default)
        row = next(line for line in page.splitlines() if line.startswith(f'| `{p.name}` |'))
        assert [cell.strip() for cell in row.split('|')][3] == default
    for key in (*localization.COUNTERS, *localization.FAULTS):
        assert f'`{key}`' in page
