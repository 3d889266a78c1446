# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Satellite navigation through real processes: the datum, and poses without odometry."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu, NavSatFix
from std_msgs.msg import Float32MultiArray

from msg_conversions.images import complex_from_message, map_metadata_from_message
from msg_conversions.navigation import datum_from_message
from msg_conversions.pulse_block import from_message
from sar_imaging.geometry.earth import Datum
from sar_imaging.tools.node_processes import NODES, PIPELINE

from ..conftest import LATCHED
from .test_odometry import OFFSET_NS, QUARTER_LEFT, Platform, pulses_of, without_positions

DATUM = Datum(69.5, 18.75, 95.0, heading_deg=-35.0)
ARM = np.array([0.8, -0.3, 1.2])  # of the navigation's antenna
# What sensors send in bursts here, faster than in flight, must not be lost.
RELIABLE = {f'qos_overrides./{topic}.subscription.reliability': 'reliable'
            for topic in ('fix', 'imu', 'radar0/fix', 'radar0/imu', 'radar1/fix', 'radar1/imu')}


class Satellites:
    """Publishes fixes and attitudes of an antenna that is somewhere in the frame."""

    def __init__(self, observer, datum=DATUM, imu=False):
        self._datum = datum
        self._publishers = {
            kind: observer.node.create_publisher(kind, topic, 1000)
            for kind, topic in ((NavSatFix, 'fix'), (Imu, 'imu')) if imu or kind is NavSatFix}
        for kind, publisher in self._publishers.items():
            observer.wait(publisher.get_subscription_count, f'a subscriber of {kind.__name__}')

    def send_fix(self, stamp_ns, place_m, *, status=0, std_m=0.0):
        message = NavSatFix()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(stamp_ns), 10**9)
        latitude, longitude, height = self._datum.to_geographic(place_m)
        message.latitude, message.longitude = float(latitude), float(longitude)
        message.altitude, message.status.status = float(height), status
        if std_m:
            message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_APPROXIMATED
            message.position_covariance = (std_m**2 * np.eye(3)).ravel().tolist()
        self._publishers[NavSatFix].publish(message)

    def send_attitude(self, stamp_ns, place_m, turn):
        """Attitude by its rotation from the body into the frame."""
        message = Imu()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(stamp_ns), 10**9)
        latitude, longitude, _ = self._datum.to_geographic(place_m)
        local = Datum(float(latitude), float(longitude))
        enu = Rotation.from_matrix(local.axes_ecef @ self._datum.axes_ecef.T) * turn
        q = message.orientation
        q.x, q.y, q.z, q.w = enu.as_quat().tolist()
        self._publishers[Imu].publish(message)


def announced(observer, count=1):
    """The latest datum of a frame that was published, by its frame."""
    messages = observer.wait_for('datum', count)
    return messages[-1].child_frame_id, datum_from_message(messages[-1])


def assert_same(found, datum, tolerance_m):
    points = np.vstack([np.zeros(3), 100 * np.eye(3)])
    np.testing.assert_allclose(found.to_ecef(points), datum.to_ecef(points), rtol=0,
                               atol=tolerance_m)


def test_a_flight_without_odometry_is_imaged_at_its_place_on_the_earth(make_chains, psf):
    pulses = psf.pulses
    seconds = (pulses.stamp_ns - pulses.stamp_ns[0]) * 1e-9
    track = np.polynomial.polynomial.polyfit(seconds, pulses.tx_m[:, 0], 1)
    arms = (pulses.rx_m - pulses.tx_m[:, :1])[0][:, [1, 0, 2]] * [1, -1, 1]  # into the body
    datum = {f'datum.{name}': value for name, value in vars(DATUM).items()}
    chains = make_chains(*({
        'truth': psf.truth, 'names': names, 'namespace': f'radar{number}', 'pulse_buffer': {
            'pose.source': 'fix_imu', 'pose.time_offset_s': OFFSET_NS * 1e-9,
            'pose.wait_s': 60.0, 'antenna.rx': arms.ravel().tolist(),
            'gnss.antenna': ARM.tolist(), 'datum.source': 'parameters'} | datum | RELIABLE}
        for number, names in enumerate((NODES, PIPELINE))))
    turn = Rotation.from_quat(QUARTER_LEFT)
    for number, chain in enumerate(chains):
        observer = chain.observer
        observer.subscribe(TransformStamped, 'datum', LATCHED)
        sky = Satellites(observer, imu=True)
        observer.send([without_positions(b) for b in psf.blocks(25)])
        for step in range(-60, 131):  # hundredths of a second; fixes ten times a second
            t = 0.01 * step
            stamp, place = pulses.stamp_ns[0] + OFFSET_NS + step * 10**7, track[0] + t * track[1]
            sky.send_attitude(stamp, place, turn)
            if step % 10 == 0:
                sky.send_fix(stamp, place + turn.apply(ARM), std_m=0.02)
        image = complex_from_message(observer.wait_for('image_complex', 1)[0])
        grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
        # The recorded track is rounded to 2^-20 m, 0.3 um from the line: -76 dB here.
        assert psf.error_db(image, grid, np.arange(200)) < -70.0
        # The reflector is at its latitude and longitude, to half a pixel of the peak.
        frame, found = announced(observer)
        assert frame == psf.truth['frame']
        row, column = np.unravel_index(np.abs(image).argmax(), image.shape)
        peak_m = np.array([grid.x_m[column], grid.y_m[row], grid.centre_m[2]])
        expected = DATUM.to_ecef(psf.truth['scatterers'][0]['position_m'])
        assert np.linalg.norm(found.to_ecef(peak_m) - expected) < 0.75 * grid.spacing_m
        name, part = (('radar0/pulse_buffer', 'stage'), ('radar1/sar_pipeline', 'pulse_buffer')
                      )[number]
        # 41 attitudes on each side are needed by no fix; the last three wait for fixes.
        observer.wait_for_counters(name, part, pulses_emitted=200, pulses_without_pose=0,
                                   fixes_received=20, fixes_rejected=0, attitudes_unused=0,
                                   pose_gaps=0, pose_jumps=0, poses_rejected=0)


class FixedFrame:
    """A pulse_buffer that compares odometry with fixes."""

    def __init__(self, start_node, observer, **parameters):
        self.observer = observer
        self.node = start_node('pulse_buffer', {
            'pose.source': 'odometry', 'frame_id': 'odom', 'datum.source': 'fix',
            'gnss.antenna': ARM.tolist(), 'gnss.max_std_m': 2.0,
            'reorder_window_pulses': 0} | RELIABLE | parameters)
        observer.subscribe(TransformStamped, 'datum', LATCHED)
        observer.subscribe(Float32MultiArray, 'pulse_blocks')
        self.platform, self.sky = Platform(observer), Satellites(observer)

    def fly(self, first, stop, *, shift_m=0.0, **quality):
        """Poses 50 times a second along x, turned to the left; fixes five times a second."""
        turn = Rotation.from_quat(QUARTER_LEFT)
        for step in range(first, stop):
            stamp, place = 10**9 + step * 20_000_000, np.array([0.2 * step, 30.0, 50.0])
            self.platform.send(stamp, place + [shift_m, 0, 0], QUARTER_LEFT)
            if step % 10 == 5:
                self.sky.send_fix(stamp, place + turn.apply(ARM), **quality)

    def text(self):
        status = self.observer.status('pulse_buffer')
        return {v.key: v.value for v in status.values}.get('datum') if status else None


def test_the_first_good_fix_and_the_pose_at_its_time_place_the_frame(start_node, make_observer):
    observer = make_observer()
    frame = FixedFrame(start_node, observer, **{'datum.heading_deg': DATUM.heading_deg})
    frame.fly(0, 50, status=-1)
    frame.fly(50, 100, std_m=5.0)
    observer.wait_for_counters('pulse_buffer', fixes_received=10, fixes_rejected=10)
    assert observer.messages['datum'] == []
    assert frame.text() == 'not determined: no good fix yet'
    assert observer.status('pulse_buffer').level > DiagnosticStatus.OK
    frame.fly(100, 150, std_m=1.0)
    name, found = announced(observer)
    assert name == 'odom'
    assert_same(found, DATUM, 1e-6)  # positions of messages are float64
    observer.wait_for_counters('pulse_buffer', fixes_received=15, fixes_rejected=10,
                               fixes_without_pose=0, errors=0)
    assert frame.text().startswith('69.5')
    for text in ('dropped messages of /fix: status -1: no fix',
                 'dropped messages of /fix: standard deviation 5 m, more than 2 m',
                 'messages of /fix are good again', 'origin of frame odom at 69.500000000, 18.75',
                 'from a fix and the pose at its time'):
        frame.node.wait_for_log('pulse_buffer', text)
    late = make_observer()  # latched: who comes late knows it too
    late.subscribe(TransformStamped, 'datum', LATCHED)
    assert announced(late) == (name, found)


def test_the_heading_is_found_once_fixes_are_far_enough_apart(start_node, make_observer):
    observer = make_observer()
    frame = FixedFrame(start_node, observer, **{'datum.heading_baseline_m': 40.0})
    frame.fly(0, 150)
    expected = ('not determined: 15 good fixes at places up to 28 m apart; the heading needs 3 '
                'and 40 m')
    observer.wait(lambda: frame.text() == expected, expected)
    assert observer.messages['datum'] == []
    frame.fly(150, 250)
    assert_same(announced(observer)[1], DATUM, 1e-5)  # 1e-9 m over 40 m, 100 m from the origin
    frame.node.wait_for_log('pulse_buffer', 'the heading is good to about')
    # A frame that begins anew has another datum.
    frame.fly(250, 500, shift_m=500.0)
    moved = Datum(*(float(v) for v in DATUM.to_geographic([-500.0, 0.0, 0.0])), DATUM.heading_deg)
    # North at the new origin differs from that at the old one by the convergence of meridians.
    assert_same(announced(observer, 2)[1], moved, 0.05)
    frame.node.wait_for_log('pulse_buffer', 'its datum is looked for again')


def test_parameters_give_the_datum_at_once_and_to_the_pipeline(start_node, make_observer):
    observer = make_observer()
    parameters = {'datum.source': 'parameters', 'datum.latitude_deg': -33.0,
                  'datum.longitude_deg': 151, 'datum.height_m': 30.5, 'datum.heading_deg': 90}
    start_node('sar_pipeline', parameters)
    observer.subscribe(TransformStamped, 'datum', LATCHED)
    frame, found = announced(observer)
    assert frame == 'map'
    assert_same(found, Datum(-33.0, 151.0, 30.5, 90.0), 1e-8)


def test_pulses_get_places_by_fixes_alone_from_the_first_one_on(start_node, make_observer):
    observer = make_observer()
    start_node('pulse_buffer', {
        'pose.source': 'fix', 'datum.source': 'fix', 'reorder_window_pulses': 0,
        'datum.heading_deg': DATUM.heading_deg, 'pulses_per_aperture': 100,
        'pose.time_offset_s': 1.0, 'pose.wait_s': 60.0} | RELIABLE)
    blocks = []
    observer.node.create_subscription(Float32MultiArray, 'pulse_blocks',
                                      lambda m: blocks.append(from_message(m)), 100)
    observer.subscribe(TransformStamped, 'datum', LATCHED)
    observer.wait(lambda: observer.joined, 'the subscription of the pulses')
    sky = Satellites(observer)
    observer.send([pulses_of(0, 50)])  # every 10 ms, from 5 ms on
    places = {step: np.array([0.05 * step, 2.0, 1.0]) for step in range(-10, 80)}
    for step, place in places.items():
        sky.send_fix(10**9 + 10**7 * step, place)
    observer.wait(lambda: sum(b.n_pulses for b in blocks) >= 50, 'the pulses')
    first = Datum(*(float(v) for v in DATUM.to_geographic(places[-10])), DATUM.heading_deg)
    assert_same(announced(observer)[1], first, 1e-8)
    # From the first fix, 0.5 m before the first pulse was sent; at 69 degrees north the axes of
    # both frames differ by 1e-6 rad.
    t = np.concatenate([b.stamp_ns for b in blocks]) * 1e-9
    np.testing.assert_allclose(np.concatenate([b.tx_m[:, 0] for b in blocks]), np.stack(
        [5 * t + 0.5, 0 * t, 0 * t], axis=1), atol=1e-5)


IMPOSSIBLE = [
    ({'datum.latitude_deg': 47.0}, 'datum.latitude_deg=47, but datum.source is none: set'),
    ({'datum.source': 'gps'}, "parameter datum.source: 'gps' is unknown; use one of none, param"),
    ({'datum.source': 'parameters', 'datum.latitude_deg': 91.0},
     'parameter datum.latitude_deg=91.0; expected a number from -90.0 to 90.0 (degrees)'),
    ({'datum.source': 'fix', 'pose.source': 'tf', 'datum.height_m': 4.0},
     'datum.height_m=4, but datum.source is fix, which tells them'),
    ({'datum.source': 'fix'}, 'pose.source=block has none: set datum.source to parameters'),
    ({'pose.source': 'fix'}, 'pose.source=fix needs to know where the frame is: set datum.source'),
    ({'pose.source': 'fix', 'datum.source': 'fix', 'antenna.rx': [0.0, 0.1, 0.0]},
     'antenna.rx: lever arms turn with the platform, and pose.source=fix has no attitude'),
    ({'pose.source': 'fix_imu', 'datum.source': 'fix', 'datum.heading_baseline_m': 5.0},
     'datum.heading_baseline_m=5 compares fixes with other poses'),
    ({'pose.source': 'odometry', 'datum.source': 'fix', 'datum.heading_baseline_m': 5.0,
      'datum.heading_deg': 3.0}, 'the heading is either given or found; set one to 0.0'),
    ({'gnss.antenna': [0.0, 1.0]}, 'parameter gnss.antenna: 2 numbers; expected x, y, z'),
]


def test_an_impossible_datum_ends_the_node_with_one_clear_line(start_node):
    nodes = [start_node('pulse_buffer', parameters) for parameters, _ in IMPOSSIBLE]
    for node, (_, message) in zip(nodes, IMPOSSIBLE, strict=True):
        assert node.exit_code('pulse_buffer') == 1
        [line] = node.log('pulse_buffer').splitlines()
        assert message in line


@pytest.mark.parametrize('name', ['range_compression', 'backprojection'])
def test_every_node_refuses_a_datum_that_nobody_asked_for(start_node, name):
    node = start_node(name, {'datum.height_m': 3.0})
    assert node.exit_code(name) == 1
    assert 'datum.height_m=3, but datum.source is none' in node.log(name)
