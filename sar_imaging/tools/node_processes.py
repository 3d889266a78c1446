# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Run the nodes as child processes, for programs and tests that need the whole chain."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import random
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import sar_imaging
from sar_imaging.configuration.antenna import antenna_parameters
from sar_imaging.files import replacing
from sar_imaging.geometry.antenna import Antenna, Mount

NODES = ('pulse_buffer', 'range_compression', 'backprojection')
AFBP_NODES = (*NODES, 'afbp_fusion')
PIPELINE = ('sar_pipeline',)
MODES = ('image', 'subapertures')
PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
STOP_TIMEOUT_S = 10.0
_TARGET_DB = -80.0  # of replayed recordings, so that small mistakes show
SHARED_MEMORY = Path('/dev/shm')
TAIL_LINES = 15
_claims: list[socket.socket] = []  # names of the domains that this process has found
NO_LOG_FILES = ('--ros-args', '--disable-external-lib-logs')  # stderr is kept instead


class NodeProcessError(RuntimeError):
    """A node could not be started or ended by itself; the text has the end of its log."""


def node_names(mode: str, *, pipeline: bool) -> tuple[str, ...]:
    """Nodes from pulses to images, in their order, for a mode of backprojection."""
    if pipeline:
        return PIPELINE
    return AFBP_NODES if mode == 'subapertures' else NODES


def parameters_from_truth(truth: Mapping[str, Any], mode: str = 'image', *,
                          pattern_file: str = '') -> dict[str, dict[str, Any]]:
    """Parameters of the nodes for a recording.

    Parameters
    ----------
    truth : mapping
        Truth of the recording, see `recordings.make_truth`.
    mode : str
        Mode of backprojection, `MODES` or another that forms what is in the truth.
    pattern_file : str
        Where the table of a measured antenna is.

    Returns
    -------
    dict
        Parameters by node; lengths in metres. `target_db` is lower than the nodes' own.
    """
    looks, pattern = _antenna_parameters(truth, pattern_file)
    grid = truth['grid']
    x, y, z = (float(v) for v in grid['centre_m'])
    spacing = float(grid['spacing_m'])
    # A replay may be faster than a busy machine takes it.
    frame = {'frame_id': truth['frame'], 'max_age_s': 3600.0} | _datum_parameters(truth)
    pulses = {'pulses_per_aperture': int(truth['pulses_per_aperture'])} | frame
    return {
        'pulse_buffer': pulses | _alignment_parameters(truth) | looks,
        'range_compression': {'window': truth.get('window', 'none')} | frame,
        # the same poses, for autofocus
        'backprojection': pulses | _alignment_parameters(truth) | pattern | {
            'mode': mode, 'target_db': _TARGET_DB,
            'grid.centre_x': x, 'grid.centre_y': y, 'grid.centre_z': z,
            'grid.size_x': (grid['n_x'] - 1) * spacing,
            'grid.size_y': (grid['n_y'] - 1) * spacing, 'grid.spacing': spacing},
        'afbp_fusion': dict(frame),
    }


def _antenna_parameters(truth: Mapping[str, Any], pattern_file: str
                        ) -> tuple[dict[str, Any], dict[str, Any]]:
    """Parameters of pulse_buffer and backprojection for a recording that tells its antenna."""
    antenna = Antenna.from_dict(truth['antenna']) if 'antenna' in truth else None
    mount = Mount.from_dict(truth['mount']) if 'mount' in truth else None
    return antenna_parameters(antenna, mount, pattern_file)


def _datum_parameters(truth: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters for a recording that says where on the Earth its frame stands."""
    if 'datum' not in truth:
        return {}
    return {'datum.source': 'parameters'} | {
        f'datum.{name}': float(value) for name, value in truth['datum'].items()}


def _alignment_parameters(truth: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters for a recording whose positions come from odometry."""
    if 'alignment' not in truth:
        return {}
    alignment = truth['alignment']
    # All poses are recorded, and a replay may be faster than a busy machine takes them.
    return {'pose.source': 'odometry', 'pose.wait_s': 60.0,
            'pose.time_offset_s': float(alignment['time_offset_s']),
            'pose.range_bias_m': float(alignment['range_bias_m']),
            'antenna.tx': [float(v) for arm in alignment['tx_m'] for v in arm],
            'antenna.rx': [float(v) for arm in alignment['rx_m'] for v in arm]}


def pipeline_parameters(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Parameters of the separate nodes as those of sar_pipeline, which has all of them."""
    merged: dict[str, Any] = {}
    for values in parameters.values():
        merged |= values
    return dict.fromkeys(PIPELINE, merged)


def write_parameters(path: Path, parameters: Mapping[str, Mapping[str, Any]]) -> None:
    """Write a ROS parameter file that applies in every namespace.

    Parameters
    ----------
    path : Path
        File to write.
    parameters : mapping
        Parameters by node.
    """
    lines = []
    for node, values in parameters.items():
        lines += [f'/**/{node}:', '  ros__parameters:']
        lines += [f'    {name}: {json.dumps(value)}' for name, value in values.items()]
    with replacing(path) as part:
        part.write_text('\n'.join(lines) + '\n')


def profile_variable(environment: Mapping[str, str]) -> dict[str, str]:
    """Fast DDS profile of this package; nothing where one was chosen already."""
    if environment.get(PROFILE):
        return {}
    return {PROFILE: str(resources.files('sar_imaging') / 'config' / 'fastdds_large_segment.xml')}


def isolated_environment(environment: Mapping[str, str] | None = None) -> dict[str, str]:
    """Environment in which the nodes meet nobody but the processes started with it.

    A free ROS_DOMAIN_ID unless one is set, discovery on this machine only, the shared memory
    profile of this package, and this package on the path.

    Parameters
    ----------
    environment : mapping, optional
        What to start from; by default the environment of this process.

    Returns
    -------
    dict
        Environment variables.
    """
    env = dict(os.environ if environment is None else environment)
    env.setdefault('ROS_DOMAIN_ID', str(free_domain()))
    env['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    env |= profile_variable(env)
    root = str(Path(sar_imaging.__file__).resolve().parents[1])
    env['PYTHONPATH'] = os.pathsep.join(filter(None, [root, env.get('PYTHONPATH')]))
    return env


def free_domain() -> int:
    """A ROS domain in which no participant runs on this machine, chosen at random.

    This process keeps it until it ends: others that look for one at the same time get another.
    """
    candidates = list(range(1, 101))
    random.SystemRandom().shuffle(candidates)
    for domain in candidates:
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f'\0sar_imaging ROS domain {domain}')  # the kernel forgets it with us
            # the port of a domain's first participant (RTPS 9.6.1.1): 7400 + 250 domain + 10
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind(('', 7410 + 250 * domain))
        except OSError:
            claim.close()
            continue
        _claims.append(claim)
        return domain
    raise NodeProcessError('every ROS domain from 1 to 100 is in use on this machine; '
                           'set ROS_DOMAIN_ID')


class NodeProcesses:
    """Node processes that live as long as the ``with`` block.

    Parameters
    ----------
    parameters : mapping
        Parameters by node.
    folder : Path
        Where the parameter file and the log of every node go.
    environment : mapping
        Environment variables, see `isolated_environment`.
    arguments : mapping, optional
        Further ROS arguments by node, such as ``['-r', 'pulses:=radar/pulses']``.
    namespace : str
        Namespace of the nodes and their topics, such as ``radar1``; empty for none.
    nodes : sequence of str
        Which nodes.
    files : sequence of Path
        Further parameter files, which count over `parameters`, the last one most.
    """

    def __init__(self, parameters: Mapping[str, Mapping[str, Any]], folder: Path,
                 environment: Mapping[str, str], *,
                 arguments: Mapping[str, list[str]] | None = None, namespace: str = '',
                 nodes: Sequence[str] = NODES, files: Sequence[Path] = ()) -> None:
        self._folder = Path(folder)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._environment = dict(environment)
        self._arguments = arguments or {}
        self._namespace = ['-r', f'__ns:=/{namespace}'] if namespace else []
        written = self._folder / 'parameters.yaml'
        write_parameters(written, parameters)
        self._files = [word for path in ((written,) if parameters else ()) + tuple(files)
                       for word in ('--params-file', str(path))]
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._nodes = nodes
        for name in nodes:
            with replacing(self.log_file(name)) as log:
                log.touch()

    def __enter__(self) -> NodeProcesses:
        try:
            for name in self._nodes:
                self.start(name)
        except BaseException:
            self.stop_all()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        self.stop_all()

    def start(self, name: str) -> None:
        """Start a node that does not run; its log goes on in the same file.

        Raises
        ------
        NodeProcessError
            The node runs already, or the system cannot start it.
        """
        if name in self._processes:
            raise NodeProcessError(f'{name} runs already')
        command = [sys.executable, '-m', f'sar_imaging.nodes.{name}', *NO_LOG_FILES,
                   *self._files, *self._namespace,
                   *self._arguments.get(name, [])]
        with open(self.log_file(name), 'ab') as log:
            try:
                # a session of its own: Ctrl-C in the terminal ends the caller, who ends the nodes
                self._processes[name] = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                    env=self._environment, start_new_session=True)
            except OSError as error:
                raise NodeProcessError(f'{name} cannot be started: {error}') from error

    def stop(self, name: str) -> int:
        """Stop a node as Ctrl-C does, by force when it does not end; return its exit status."""
        self._interrupt(name)
        return self._wait(name)

    def kill(self, name: str) -> None:
        """End a node at once, as a crash does."""
        self._kill(self._processes.pop(name))

    def stop_all(self) -> dict[str, int]:
        """Stop all nodes that run; returns the exit status of each."""
        for name in self._processes:  # all at once, then wait for each
            self._interrupt(name)
        return {name: self._wait(name) for name in list(self._processes)}

    def _interrupt(self, name: str) -> None:
        if self._processes[name].poll() is None:
            self._processes[name].send_signal(signal.SIGINT)

    def _wait(self, name: str) -> int:
        process = self._processes.pop(name)
        try:
            return process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            return self._kill(process)

    def _kill(self, process: subprocess.Popen[bytes]) -> int:
        segments = held_segments(process.pid)
        process.kill()
        status = process.wait()
        for segment in segments:
            _remove_segment(segment)
        return status

    def check(self) -> None:
        """Raise `NodeProcessError` when a node has ended by itself."""
        for name, process in self._processes.items():
            if (status := process.poll()) is not None:
                raise NodeProcessError(f'{name} ended with status {status}; the end of '
                                       f'{self.log_file(name)}:\n{self.log_tail(name)}')

    def pid(self, name: str) -> int:
        """Process number of a node that was started."""
        return self._processes[name].pid

    def log_file(self, name: str) -> Path:
        """File with everything a node printed."""
        return self._folder / f'{name}.log'

    def log_tail(self, name: str) -> str:
        """Last lines that a node printed."""
        lines = self.log_file(name).read_text(errors='replace').splitlines()
        return '\n'.join(lines[-TAIL_LINES:])


def held_segments(pid: int) -> list[Path]:
    """Shared memory of Fast DDS that belongs to a process, found by its open lock files."""
    segments = []
    with contextlib.suppress(OSError):  # it has ended by itself
        for descriptor in Path(f'/proc/{pid}/fd').iterdir():
            with contextlib.suppress(OSError):
                target = descriptor.readlink()
                if target.parent == SHARED_MEMORY and (
                        name := re.fullmatch(r'(fastrtps_[0-9a-f]{16})_el', target.name)):
                    segments.append(SHARED_MEMORY / name[1])
    return segments


def _remove_segment(segment: Path) -> None:
    """Remove what a killed process left behind: 70 MB each with the profile of this package."""
    lock = segment.with_name(f'{segment.name}_el')
    with contextlib.suppress(OSError), open(lock) as held:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails while a process lives that has it
        segment.unlink(missing_ok=True)
        lock.unlink()
