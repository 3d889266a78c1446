"""Real node processes on a domain of their own, and an observer that sees what they publish."""

import collections
import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.fft

pytest.importorskip('rclpy', reason='rclpy comes as wheels for Linux on x86-64 only')

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import MapMetaData
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import Float32MultiArray, UInt32

from sar_imaging.imaging.correlation import correlate
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.signal.waveforms import lfm_spectrum, n_pulse_samples
from sar_imaging.tools import bag_io

ROOT = Path(__file__).resolve().parents[2]
NODES = ('pulse_buffer', 'range_compression', 'backprojection')
PATIENCE_S = 90.0  # a deadline for what should take a second: kernels may have to be compiled


def pytest_collection_modifyitems(items):
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.nodes)


def free_domain() -> int:
    """Domain whose first participant's port is free: nobody uses it on this machine."""
    domains = list(range(1, 100))
    random.SystemRandom().shuffle(domains)
    for domain in domains:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(('', 7400 + 250 * domain + 10))
            except OSError:
                continue
        return domain
    raise RuntimeError('all ROS domains from 1 to 99 are in use on this machine')


@pytest.fixture(scope='session')
def ros_environment(tmp_path_factory):
    """Environment variables for this process and its children."""
    patch = pytest.MonkeyPatch()
    patch.setenv('ROS_DOMAIN_ID', str(free_domain()))
    patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('ros_log')))
    patch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE',
                 str(ROOT / 'sar_imaging' / 'config' / 'fastdds_large_segment.xml'))
    yield
    patch.undo()


class Waiter:
    """Wait for conditions that other threads bring about."""

    def __init__(self):
        self._changed = threading.Condition()

    def notify(self):
        with self._changed:
            self._changed.notify_all()

    def wait(self, condition, what, describe=lambda: ''):
        """Value of `condition` once it is true; fails with `what` after a long time."""
        deadline = time.monotonic() + PATIENCE_S
        with self._changed:
            while not (value := condition()):
                left = deadline - time.monotonic()
                if left <= 0:
                    pytest.fail(f'waited {PATIENCE_S:g} s for {what}\n{describe()}')
                self._changed.wait(min(left, 1.0))
        return value


class NodeProcess(Waiter):
    """One of the package's nodes as a process of its own; its log is kept line by line."""

    def __init__(self, name, parameters=None, arguments=()):
        super().__init__()
        command = [sys.executable, '-m', f'sar_imaging.nodes.{name}', '--ros-args']
        for key, value in (parameters or {}).items():
            command += ['-p', f'{key}:={value}']
        self.name = name
        self.lines = []
        self._process = subprocess.Popen([*command, *arguments], cwd=ROOT, text=True,
                                         stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        for line in self._process.stderr:
            self.lines.append(line.rstrip())
            self.notify()
        self.notify()

    @property
    def log(self):
        return '\n'.join(self.lines)

    def wait_for_log(self, pattern, count=1):
        """Wait until `count` log lines contain the regular expression; returns the last one."""
        def found():
            matching = [line for line in self.lines if re.search(pattern, line)]
            return matching[count - 1] if len(matching) >= count else None

        return self.wait(found, f'{pattern!r} in the log of {self.name}', lambda: self.log)

    @property
    def running(self):
        return self._process.poll() is None

    def signal(self, number):
        self._process.send_signal(number)

    def join(self):
        """Exit code, after the process has ended and its log is complete."""
        try:
            code = self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            pytest.fail(f'{self.name} did not end\n{self.log}')
        self._reader.join()
        self._process.stderr.close()
        return code

    def kill(self):
        """End it without a chance to clean up."""
        self._process.kill()
        assert self.join() == -signal.SIGKILL


class Observer(Waiter):
    """A ROS node in the test's process: sends pulses, collects all that the nodes publish."""

    def __init__(self, namespace='', pulses_depth=1000):
        super().__init__()
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node('observer', context=self._context, namespace=namespace)
        self.messages = collections.defaultdict(list)
        self.joined = 0  # subscribers of the pulses, those that left included
        self._pulses = self.node.create_publisher(
            Float32MultiArray, 'pulses', pulses_depth,
            event_callbacks=PublisherEventCallbacks(matched=self._subscriber_matched))
        for topic in ('image', 'image_complex', 'image_quicklook'):
            self._subscribe(Image, topic, 50)
        self._subscribe(MapMetaData, 'map_metadata',
                        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        self._subscribe(DiagnosticArray, '/diagnostics', 100)
        for name in NODES:
            self._subscribe(UInt32, f'{name}/progress', 1000)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _subscribe(self, message_type, topic, qos):
        def receive(message):
            self.messages[topic].append(message)
            self.notify()

        self.node.create_subscription(message_type, topic, receive, qos)

    def _subscriber_matched(self, event):
        self.joined = event.total_count
        self.notify()

    def _spin(self):
        try:
            self._executor.spin()
        except ExternalShutdownException:
            pass

    def close(self):
        self._executor.shutdown()
        self._thread.join()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def send(self, blocks):
        """Publish blocks, or serialised messages as they are in a recording."""
        for block in blocks:
            self._pulses.publish(block if isinstance(block, bytes) else bag_io.serialise(block))

    def wait_for(self, topic, count, describe=lambda: ''):
        """The first `count` messages of a topic."""
        self.wait(lambda: len(self.messages[topic]) >= count, f'{count} messages of {topic}',
                  lambda: f'{len(self.messages[topic])} came\n{describe()}')
        return self.messages[topic][:count]

    def counters(self, node):
        """Latest diagnostics of a node as numbers."""
        for array in reversed(self.messages['/diagnostics']):
            for status in array.status:
                if status.name == f'{node}: stage':
                    return {v.key: float(v.value) for v in status.values}
        return {}

    def wait_for_counters(self, node, **expected):
        """Wait until the node's diagnostics have these values."""
        self.wait(lambda: expected.items() <= self.counters(node).items(),
                  f'{expected} in the diagnostics of {node}', lambda: self.counters(node))

    def level(self, node):
        """Level of the latest diagnostics of a node."""
        return [s.level for a in self.messages['/diagnostics'] for s in a.status
                if s.name == f'{node}: stage'][-1]


class Chain:
    """The three nodes as processes and an observer."""

    def __init__(self, parameters, arguments=(), namespace=''):
        self._parameters, self._arguments = parameters, arguments
        self.observer = Observer(namespace)
        self.processes = {}
        for name in NODES:
            self.start(name)
        for name in NODES:
            self.processes[name].wait_for_log('ready: ')
        self.observer.wait(lambda: self.observer.joined, 'a subscriber of the pulses', self.log)
        self.processes['pulse_buffer'].wait_for_log('subscriber on .*pulse_blocks joined')
        self.processes['range_compression'].wait_for_log('subscriber on .*range_profiles joined')
        self.processes['backprojection'].wait_for_log('subscriber on .*image_complex joined')

    def start(self, name):
        self.processes[name] = NodeProcess(name, self._parameters.get(name), self._arguments)

    def kill_and_restart(self, name):
        """SIGKILL, start again, wait until its neighbours see the new process."""
        before = {n: len(re.findall('subscriber on .* joined', p.log))
                  for n, p in self.processes.items()}
        joined = self.observer.joined
        self.processes[name].kill()
        self.start(name)
        outputs = {'pulse_buffer': 1, 'range_compression': 1, 'backprojection': 3}
        self.processes[name].wait_for_log('subscriber on .* joined', outputs[name])
        if name == 'pulse_buffer':
            self.observer.wait(lambda: self.observer.joined > joined, 'the new pulse_buffer')
        else:
            sender = NODES[NODES.index(name) - 1]
            self.processes[sender].wait_for_log('subscriber on .* joined', before[sender] + 1)

    def log(self):
        return '\n'.join(f'--- {name}\n{p.log}' for name, p in self.processes.items())

    def wait_for_images(self, count):
        """The first `count` complex images."""
        return self.observer.wait_for('image_complex', count, self.log)

    def close(self):
        """Ctrl-C for all; every process must end orderly."""
        for process in self.processes.values():
            if process.running:
                process.signal(signal.SIGINT)
        codes = {name: process.join() for name, process in self.processes.items()}
        self.observer.close()
        assert codes == dict.fromkeys(self.processes, 0), self.log()
        assert 'Traceback' not in self.log(), self.log()


@pytest.fixture
def make_chain(ros_environment):
    """Start the three nodes for a recording's truth; ended by Ctrl-C after the test."""
    chains = []

    def make(truth, *, arguments=(), namespace='', **parameters):
        chain = Chain(parameters_for(truth, parameters), arguments, namespace)
        chains.append(chain)
        return chain

    yield make
    for chain in chains:
        chain.close()


def parameters_for(truth, extra=None):
    """Parameters of the nodes for a recording; `extra` by node name."""
    x, y, z = truth['grid']['centre_m']
    spacing = truth['grid']['spacing_m']
    parameters = {
        'pulse_buffer': {'pulses_per_aperture': truth['pulses_per_aperture']},
        'range_compression': {'window': truth['window']},
        'backprojection': {
            'pulses_per_aperture': truth['pulses_per_aperture'], 'grid.spacing': spacing,
            'grid.centre_x': x, 'grid.centre_y': y, 'grid.centre_z': z,
            'grid.size_x': (truth['grid']['n_x'] - 1) * spacing,
            'grid.size_y': (truth['grid']['n_y'] - 1) * spacing}}
    for node, values in (extra or {}).items():
        parameters[node] |= values
    return parameters


def chirp_band_spectrum(raw):
    """Frequencies and spectra of raw LFM pulses divided by the pulse's own spectrum.

    From the whole record, since the edges of cut range profiles leak over the band: correlating
    those instead differs by -67 dB in the noise of the spotlight recording.
    """
    radar = raw.radar
    n = scipy.fft.next_fast_len(raw.n_samples + n_pulse_samples(radar))
    baseband = scipy.fft.fftfreq(n, 1.0 / radar.sample_rate_hz)
    inside = np.flatnonzero(np.abs(baseband) <= radar.bandwidth_hz / 2)
    inside = inside[np.argsort(baseband[inside])]
    baseband = baseband[inside]
    spectra = scipy.fft.fft(raw.samples.astype(np.complex128), n, axis=-1)[..., inside]
    spectra /= lfm_spectrum(baseband, radar) * radar.sample_rate_hz * len(baseband)
    spectra *= np.exp(-2j * np.pi * baseband * radar.first_sample_delay_s)
    return radar.carrier_hz + baseband, spectra


@pytest.fixture(scope='session', params=['psf', 'spotlight'])
def any_recording(request):
    return Recording(request.param)


@pytest.fixture(scope='session')
def spotlight():
    return Recording('spotlight')


class Recording:
    """A recording of bags/ with its truth and the exact image of any of its pulses."""

    def __init__(self, name):
        path = ROOT / 'bags' / name
        self.truth = bag_io.read_truth(path)
        self.raw = [cdr for _, cdr in bag_io.raw_messages(path)]
        self.pulses = concatenate(list(bag_io.read_blocks(path)))

    def blocks(self, n_pulses):
        """The recorded pulses in blocks of this length."""
        return [self.pulses.select(slice(i, i + n_pulses))
                for i in range(0, self.pulses.n_pulses, n_pulses)]

    def correlation(self, counters, points):
        """(n,) complex128 exact image of recorded pulses at points (n, 3), in float64."""
        pulses = self.pulses.select(np.isin(self.pulses.counter, counters))
        spectrum = band_spectrum if pulses.compressed else chirp_band_spectrum
        return correlate(*spectrum(pulses), pulses.tx_m, pulses.rx_m, points)

    def error_db(self, image, grid, counters):
        """Error of an image against the exact one of `counters`, over a subset of pixels.

        Half of the pixels are the brightest ones, the others are spread over the image.
        """
        flat = image.ravel()
        chosen = np.union1d(np.argsort(np.abs(flat))[-100:],
                            np.random.default_rng(7).integers(0, flat.size, 100))
        exact = self.correlation(counters, grid.points().reshape(-1, 3)[chosen])
        return 20 * np.log10(np.linalg.norm(flat[chosen] - exact) / np.linalg.norm(exact))


@pytest.fixture
def start_node(ros_environment):
    """Start single node processes; killed after the test if they still run."""
    started = []

    def start(name, parameters=None, arguments=()):
        started.append(NodeProcess(name, parameters, arguments))
        return started[-1]

    yield start
    for process in started:
        if process.running:
            os.kill(process._process.pid, signal.SIGKILL)
            process.join()
