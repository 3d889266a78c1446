# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Real node processes on a domain of their own, and an observer that sees what they publish."""

import collections
import contextlib
import os
import re
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='rclpy comes as wheels for Linux on x86-64 only')

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import MapMetaData
from rcl_interfaces.srv import SetParameters
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import Float32MultiArray, UInt32
from std_srvs.srv import Trigger

from sar_imaging.recordings import bag_io
from sar_imaging.tools.node_processes import (
    AFBP_NODES,
    NODES,
    PIPELINE,
    NodeProcessError,
    NodeProcesses,
    isolated_environment,
    parameters_from_truth,
    pipeline_parameters,
)

# Of every node, and those of type Trigger that only some have.
SERVICES = {'change_state': ChangeState, 'get_state': GetState, 'set_parameters': SetParameters,
            'reset': Trigger}
SOME = ('form_image', 'save_image', 'save_map', 'save_targets')
SETTLE_S = 0.5
PATIENCE_S = 90.0  # a deadline for what should take a second: kernels may have to be compiled
# Several, for maps that move on before they are looked at.
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
JOINED = 'subscriber on .* joined'
HEARD = 'publisher on .* joined'


def pytest_collection_modifyitems(items):
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.nodes)


@pytest.fixture(scope='module', autouse=True)
def _nodes_are_forked(forked_nodes):
    """Nodes take a tenth of a second to start."""


@pytest.fixture(scope='session')
def ros_environment(tmp_path_factory):
    """Environment of this process and its children: one free domain for all tests here."""
    environment = isolated_environment(
        {k: v for k, v in os.environ.items() if k != 'ROS_DOMAIN_ID'})
    environment['ROS_LOG_DIR'] = str(tmp_path_factory.mktemp('ros_log'))
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment.items():
            if name.startswith(('ROS_', 'FASTRTPS_')):
                patch.setenv(name, value)
        yield environment


@pytest.fixture
def whole_end(ros_environment, monkeypatch):
    """Nodes are started as users start them; forks have no end of the interpreter."""
    monkeypatch.setitem(ros_environment, 'NOT_FORKED', '1')


def wait(condition, what, *, describe=lambda: '', work=lambda: time.sleep(0.02),
         progress=lambda: None):
    """Value of `condition` once it is true, doing `work` meanwhile; fails after a long time.

    The time is that since `progress` last had another value, so that a slow machine may go on.
    """
    seen, deadline = progress(), time.monotonic() + PATIENCE_S
    while not (value := condition()):
        if (now := progress()) != seen:
            seen, deadline = now, time.monotonic() + PATIENCE_S
        if time.monotonic() > deadline:
            pytest.fail(f'waited {PATIENCE_S:g} s for {what}\n{describe()}')
        work()
    return value


def flatten(tree, prefix=''):
    """Names, joined by dots, and values of a section of a YAML file."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from flatten(value, f'{prefix}{key}.')
        else:
            yield prefix + key, value


class Nodes:
    """Node processes and their logs."""

    def __init__(self, folder, environment, parameters, arguments=(), namespace='', names=NODES):
        self._processes = NodeProcesses(parameters, folder, environment, namespace=namespace,
                                        arguments=dict.fromkeys(names, list(arguments)),
                                        nodes=names)
        self.names = names
        self.running = set()
        self._may_end = False

    def start(self, name):
        self._processes.start(name)
        self.running.add(name)

    def pid(self, name):
        return self._processes.pid(name)

    def signal(self, name, number):
        self._may_end = True
        os.kill(self.pid(name), number)

    def kill(self, name):
        self._processes.kill(name)
        self.running.remove(name)

    def exit_code(self, name):
        """Exit code of a node that ends by itself or was sent a signal."""
        def ended():
            try:
                self._processes.check()
            except NodeProcessError:
                return True

        wait(ended, f'the end of {name}', describe=self.all_logs)
        return self.stop(name)

    def stop(self, name):
        """End a node by Ctrl-C and return its exit code."""
        self.running.remove(name)
        return self._processes.stop(name)

    def stop_all(self):
        """End all nodes by Ctrl-C at once and return their exit codes."""
        self.running.clear()
        return self._processes.stop_all()

    def check(self):
        """Raise an error when a node has ended by itself."""
        self._processes.check()

    def check_while_waiting(self):
        """The same, unless a node was sent a signal: what is waited for would never come."""
        if not self._may_end:
            self.check()

    def log(self, name):
        return self._processes.log_file(name).read_text()

    def all_logs(self):
        return '\n'.join(f'--- {name}\n{self.log(name)}' for name in self.names)

    def wait_for_log(self, name, pattern, count=1):
        """Wait until the regular expression was found `count` times in the log of a node."""
        def found():
            self.check_while_waiting()
            return len(re.findall(pattern, self.log(name))) >= count

        wait(found, f'{count} x {pattern!r} in the log of {name}', describe=self.all_logs)


class Observer:
    """A ROS node in the test's process: sends pulses, collects all that the nodes publish."""

    def __init__(self, namespace, describe, pulses='pulses', check=lambda: None):
        self._describe, self._check = describe, check
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node('observer', context=self._context, namespace=namespace)
        self.messages = collections.defaultdict(list)
        self.joined = 0  # subscribers of the pulses, those that left included
        self._clients = collections.defaultdict(dict)  # by node
        self._pulses = self.node.create_publisher(
            Float32MultiArray, pulses, 1000,
            event_callbacks=PublisherEventCallbacks(matched=self._subscriber_matched))
        for topic in ('image', 'image_complex', 'image_quicklook'):
            self.subscribe(Image, topic)
        self.subscribe(MapMetaData, 'map_metadata', LATCHED)
        self.subscribe(DiagnosticArray, '/diagnostics', 100)
        for name in (*AFBP_NODES, *PIPELINE):
            self.subscribe(UInt32, f'{name}/progress', 1000)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def subscribe(self, message_type, topic, qos=50):
        """Collect the messages of a further topic."""
        self.node.create_subscription(message_type, topic, self.messages[topic].append, qos)

    def _subscriber_matched(self, event):
        self.joined = event.total_count

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def send(self, blocks):
        """Publish blocks, or serialised messages as they are in a recording."""
        self.send_messages(b if isinstance(b, bytes) else bag_io.serialise(b) for b in blocks)

    def send_messages(self, messages):
        """Publish messages, serialised or not."""
        for message in messages:
            self._pulses.publish(message)

    def wait(self, condition, what, **options):
        """Receive messages until a condition holds; returns its value. Options as of `wait`."""
        def receive():
            self._check()
            self._executor.spin_once(timeout_sec=0.1)

        return wait(condition, what, describe=self._describe, work=receive, **options)

    def call(self, node, service, **fields):
        """Response of a service of a node."""
        clients = self._clients[node]
        if not clients:
            for name, kind in (SERVICES | dict.fromkeys(SOME, Trigger)).items():
                clients[name] = self.node.create_client(kind, f'{node}/{name}')
            needed = [clients[name] for name in {*SERVICES, service}]
            self.wait(lambda: all(c.service_is_ready() for c in needed), f'services of {node}')
            # The server may know a client's requests before its inbox, and lose the answer.
            settled = time.monotonic() + SETTLE_S
            self.wait(lambda: time.monotonic() > settled, f'services of {node} to settle')
        future = clients[service].call_async(clients[service].srv_type.Request(**fields))
        self.wait(future.done, f'an answer of {node}/{service}')
        return future.result()

    def trigger(self, name):
        """Success and message of a service of type Trigger."""
        answer = self.call(*name.rsplit('/', 1))
        return answer.success, answer.message

    def change_state(self, node, transition):
        """Success of a life cycle transition, given by its label."""
        return self.call(node, 'change_state', transition=Transition(label=transition)).success

    def state(self, node):
        """Label of a node's life cycle state."""
        return self.call(node, 'get_state').current_state.label

    def set_parameter(self, node, name, value):
        """Success and reason of setting a parameter."""
        [result] = self.call(node, 'set_parameters', parameters=[
            Parameter(name, value=value).to_parameter_msg()]).results
        return result.successful, result.reason

    def wait_for(self, topic, count):
        """The first `count` messages of a topic."""
        self.wait(lambda: len(self.messages[topic]) >= count, f'{count} messages of {topic}')
        return self.messages[topic][:count]

    def wait_for_progress(self, name, counter):
        """Wait until a node has finished the block that ends with this pulse."""
        self.wait(lambda: any(m.data == counter for m in self.messages[f'{name}/progress']),
                  f'{name} to finish pulse {counter}')

    def status(self, node, part='stage'):
        """Latest diagnostics of a node, or of a part of it; None when there is none yet."""
        reports = [s for array in self.messages['/diagnostics'] for s in array.status
                   if s.name == f'{node}: {part}']
        return reports[-1] if reports else None

    def counters(self, node, part='stage'):
        """Latest diagnostics as numbers."""
        status, numbers = self.status(node, part), {}
        for pair in status.values if status else ():
            with contextlib.suppress(ValueError):  # texts
                numbers[pair.key] = float(pair.value)
        return numbers

    def wait_for_counters(self, node, part='stage', **expected):
        """Wait until the diagnostics have these values."""
        try:
            self.wait(lambda: expected.items() <= self.counters(node, part).items(), 'counters')
        except pytest.fail.Exception:
            # Compare once more: the difference is what one wants to see.
            latest = self.counters(node, part)
            assert {k: latest.get(k) for k in expected} == expected
            raise


class Chain(Nodes):
    """The nodes from pulses to images as processes, connected, and an observer."""

    def __init__(self, folder, environment, parameters, arguments=(), namespace='',
                 pulses='pulses', names=NODES):
        super().__init__(folder, environment, parameters, arguments, namespace, names)
        self.observer = Observer(namespace, self.all_logs, pulses, self.check_while_waiting)
        for name in names:
            self.start(name)

    def wait_until_connected(self):
        """Wait until each node sees its neighbours."""
        for name in self.names[:-1]:
            self.wait_for_log(name, JOINED)
        self.wait_for_log(self.names[-1], 'subscriber on .*image_complex joined')
        self.observer.wait(lambda: self.observer.joined, 'a subscriber of the pulses')

    def kill_and_restart(self, name):
        """SIGKILL, start again, wait until its neighbours see the new process."""
        joined = {n: len(re.findall(JOINED, self.log(n))) for n in NODES}
        heard = len(re.findall(HEARD, self.log(name)))
        to_observer = self.observer.joined
        self.kill(name)
        self.start(name)  # its log goes on in the same file
        outputs = {'pulse_buffer': 1, 'range_compression': 1, 'backprojection': 3}
        self.wait_for_log(name, JOINED, joined[name] + outputs[name])
        self.wait_for_log(name, HEARD, heard + 1)  # maybe later than its sender
        if name == 'pulse_buffer':
            self.observer.wait(lambda: self.observer.joined > to_observer, 'the new pulse_buffer')
        else:
            sender = NODES[NODES.index(name) - 1]
            self.wait_for_log(sender, JOINED, joined[sender] + 1)

    def close(self):
        """Ctrl-C for all; returns the check that every process ended orderly."""
        codes = self.stop_all()
        self.observer.close()

        def check():
            assert codes == dict.fromkeys(self.names, 0), self.all_logs()
            assert 'Traceback' not in self.all_logs()

        return check


@pytest.fixture
def make_chains(ros_environment, tmp_path):
    """Start chains side by side, each from a mapping of options; ended by Ctrl-C after the test.

    `truth` is that of a recording and `names` are the nodes; options of their names, or of those
    that a pipeline stands for, are parameters beside those of the truth.
    """
    chains = []

    def start(truth, *, arguments=(), namespace='', pulses='pulses', names=NODES, mode=None,
             **parameters):
        mode = mode or ('subapertures' if names == AFBP_NODES else 'image')
        values = parameters_from_truth(truth, mode)
        for node, extra in parameters.items():
            values[node] |= extra
        if names == PIPELINE:
            values = pipeline_parameters(values)
        chain = Chain(tmp_path / f'nodes{len(chains)}', ros_environment, values, arguments,
                      namespace, pulses, names)
        chains.append(chain)
        return chain

    def make(*all_options):
        made = [start(**options) for options in all_options]
        for chain in made:
            chain.wait_until_connected()
        return made

    yield make
    # All end before one is judged: what lives on would answer in the next test.
    ends = [chain.close() for chain in chains]
    for end in ends:
        end()


@pytest.fixture
def make_chain(make_chains):
    """Start one chain, as `make_chains` does."""
    return lambda truth, **options: make_chains({'truth': truth, **options})[0]


@pytest.fixture
def make_observer(ros_environment):
    """Start an observer in the root namespace; closed after the test."""
    observers = []

    def make(pulses='pulses'):
        observers.append(Observer('', lambda: '', pulses))
        return observers[-1]

    yield make
    for observer in observers:
        observer.close()


@pytest.fixture
def start_node(ros_environment, tmp_path):
    """Start a single node; ended by Ctrl-C after the test if it still runs."""
    started = []

    def start(name, parameters=None):
        if name != 'radar_driver':  # tests send at once what takes seconds of work
            parameters = {'max_age_s': 3600.0, **(parameters or {})}
        node = Nodes(tmp_path / f'node{len(started)}', ros_environment,
                     {name: parameters} if parameters else {})
        started.append(node)
        node.start(name)
        return node

    yield start
    # All end before one is judged: what lives on would take processor and memory for good.
    ends = [(name, node, node.stop(name)) for node in started for name in sorted(node.running)]
    for name, node, code in ends:
        assert code == 0, node.log(name)
