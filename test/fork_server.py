# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node processes forked from one that has loaded their libraries already.

A node loads rclpy, SciPy and Numba for a second, and the tests start hundreds. A server process
loads them once; each node is a fork of it and a process like any other: with its own number,
environment, session and log, its own participant of DDS, ended by signals, by itself or by force.
It finds the kernels loaded that any process has compiled so far.
It ends without the interpreter's own end, half of the processor time of a small node. That end is
not safe in a fork: lttng cancels threads that the fork does not have.
Nodes whose environment tells the libraries something else are started as users start them.
"""

import atexit
import contextlib
import gc
import importlib
import inspect
import json
import os
import runpy
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import traceback
import types
from pathlib import Path

from numba.core import config
from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.np.ufunc import parallel

from sar_imaging.tools import node_processes

ROOT = Path(__file__).resolve().parents[1]
NODES = ('afbp_fusion', 'backprojection', 'localization', 'moving_targets', 'pulse_buffer',
         'radar_driver', 'range_compression', 'sar_pipeline')
LOADED = (*(f'sar_imaging.nodes.{name}' for name in NODES), 'sar_imaging.tools.evaluate')
LOADED_LATER = (
    'matplotlib.figure', 'matplotlib.backends.backend_agg', 'PIL.JpegImagePlugin',
    'rosbags.highlevel', 'rosbags.typesys.stores.ros2_jazzy',
    'rosidl_generator_py.import_type_support_impl', 'sar_imaging.backends.cpu.backprojection',
    'sar_imaging.backends.cpu.beams', 'sar_imaging.backends.cpu.beforehand',
    'sar_imaging.backends.cpu.fusion', 'sar_imaging.backends.cpu.groups',
    'sar_imaging.backends.cpu.lines', 'sar_imaging.backends.cpu.points',
    'sar_imaging.imaging.exact')
# Read where a node is made, or by pytest alone; all others may be read while libraries are loaded.
READ_LATER = ('ROS_', 'FASTRTPS_', 'PYTEST_')


def libraries_see(environment):
    """What the libraries that are loaded may read of an environment."""
    seen = {name: value for name, value in environment.items()
            if not name.startswith(READ_LATER) and name != 'PYTHONPATH'}
    paths = environment.get('PYTHONPATH', '').split(os.pathsep)
    return seen | {'PYTHONPATH': sorted(set(paths) - {'', str(ROOT)})}


class Forks:
    """Starts processes by the server that listens at an address."""

    def __init__(self, address, server=None):
        self._address, self._environment = str(address), libraries_see(os.environ)
        self._server = server

    def popen(self, command, *, env, **options):
        """What `subprocess.Popen` does; a fork where that is the same."""
        if command[:2] != [sys.executable, '-m'] or command[2] not in LOADED or (
                libraries_see(env) != self._environment):
            return subprocess.Popen(command, env=env, **options)
        return Fork(self._address, command, env, **options)

    def run(self, command, folder, *, env, timeout, **options):
        """What `subprocess.run` returns, with the outputs as text, which go through files."""
        files = [tempfile.TemporaryFile('w+', dir=folder) for _ in range(2)]
        with files[0] as out, files[1] as err:
            process = self.popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                                 env=env, start_new_session=True, **options)
            try:
                process.wait(timeout)
            except BaseException:
                process.kill()
                raise
            for file in files:
                file.seek(0)
            return subprocess.CompletedProcess(command, process.returncode, *(
                file.read() for file in files))

    def running(self):
        """Numbers of the forks that have not ended; with /proc alone."""
        lists = Path(f'/proc/{self._server}/task').glob('*/children')
        return {int(number) for path in lists for number in path.read_text().split()}

    def take_over(self, set_attribute=setattr):
        """Let `NodeProcesses` start nodes so."""
        set_attribute(node_processes, 'subprocess',
                      types.SimpleNamespace(**{**vars(subprocess), 'Popen': self.popen}))


@contextlib.contextmanager
def running(folder):
    """The server, while the tests run that need it."""
    address = folder / 'forks'
    with subprocess.Popen([sys.executable, __file__, address], cwd=ROOT, stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE,
                          env=os.environ | {'PYTHONPATH': str(ROOT)}) as server:
        assert server.stdout.readline() == b'listens\n'
        yield Forks(address, server.pid)


class Fork:
    """What is used of `subprocess.Popen`, for a fork of the server."""

    def __init__(self, address, command, env, *, stdout, stderr, stdin=subprocess.DEVNULL,
                 cwd=None, start_new_session=True):
        assert stdin == subprocess.DEVNULL and start_new_session
        self.args, self.returncode = command, None
        self._server = socket.socket(socket.AF_UNIX)
        self._server.connect(address)
        socket.send_fds(self._server, [b' '], [stdout.fileno(), stderr.fileno()])
        self._server.sendall(json.dumps({'command': command, 'env': dict(env),
                                         'cwd': str(cwd or os.getcwd())}).encode())
        self._server.shutdown(socket.SHUT_WR)
        self._answers = self._server.makefile()
        self.pid = int(self._answers.readline())

    def poll(self):
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(timeout=0)
        return self.returncode

    def wait(self, timeout=None):
        if self.returncode is None:
            with selectors.DefaultSelector() as selector:
                selector.register(self._server, selectors.EVENT_READ)
                if not selector.select(timeout):
                    raise subprocess.TimeoutExpired(self.args, timeout)
            self.returncode = int(self._answers.readline())
            self._answers.close()
            self._server.close()
        return self.returncode

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)


# --------------------------------------------------------------------------- in the server

class Kernels:
    """Machine code for the forks, each of which would load it from the cache for half a second."""

    def __init__(self):
        values = (value for name, module in sys.modules.items() if name.startswith('sar_imaging.')
                  for value in vars(module).values())
        self._kernels = {value for value in values if isinstance(value, Dispatcher)
                         and isinstance(value._cache, FunctionCache)}
        self._read_ns, self._n_threads = {}, parallel.NUM_THREADS
        try:
            importlib.import_module('numba.np.ufunc.omppool')
        except ImportError:  # Debian without its package libgomp1, for one
            self._kernels.clear()
            return
        # Parallel loops are linked with OpenMP; threads that it started here no fork would have.
        config.THREADING_LAYER, parallel.NUM_THREADS = 'omp', 0
        parallel._launch_threads()

    def load(self):
        """Load what some process has compiled since the last time."""
        for kernel in self._kernels:
            with contextlib.suppress(FileNotFoundError):  # nothing yet, or not all of it
                written_ns = os.stat(kernel._cache._cache_file._index_path).st_mtime_ns
                if self._read_ns.get(kernel) != written_ns:
                    self._load(kernel)
                    self._read_ns[kernel] = written_ns
                    gc.freeze()  # what lies here for good is not looked through, and copied, there

    @staticmethod
    def _load(kernel):
        files = kernel._cache._cache_file
        for key, name in files._load_index().items():
            if key == kernel._cache._index_key(key[0], kernel.targetctx.codegen()):
                os.stat(files._data_path(name))
                kernel.compile(key[0])

    def start_threads(self):
        """Let parallel loops have threads, in a fork."""
        if self._kernels:
            parallel.NUM_THREADS, parallel._is_initialized = self._n_threads, False
            parallel._launch_threads()


def serve(address, kernels):
    """Fork until the tests end; returns in the fork, with the module to run, and at the end."""
    woken, wake = socket.socketpair()
    for end in woken, wake:
        end.setblocking(False)
    signal.set_wakeup_fd(wake.fileno())
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal is for the tests
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(address)
    listener.listen()
    with selectors.DefaultSelector() as selector:
        for source in (sys.stdin, woken, listener):
            selector.register(source, selectors.EVENT_READ)
        print('listens', flush=True)
        clients = {}  # by process number
        while True:
            ready = [key.fileobj for key, _ in selector.select()]
            if sys.stdin in ready:  # closed
                return None
            if woken in ready:
                woken.recv(4096)
                report_ends(clients)
            if listener in ready:
                client, _ = listener.accept()
                request, files = receive(client)
                kernels.load()
                pid = os.fork()
                if pid == 0:
                    break
                for file in files:
                    os.close(file)
                client.sendall(f'{pid}\n'.encode())
                clients[pid] = client
    for connection in (woken, wake, listener, client, *clients.values()):
        connection.close()
    kernels.start_threads()
    return become(request, files)


def report_ends(clients):
    with contextlib.suppress(ChildProcessError):  # there is none
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            with contextlib.suppress(OSError), clients.pop(ended[0]) as client:
                client.sendall(f'{os.waitstatus_to_exitcode(ended[1])}\n'.encode())


def receive(client):
    _, files, _, _ = socket.recv_fds(client, 1, 2)
    with client.makefile('rb') as stream:
        return json.loads(stream.read()), files


def become(request, files):
    """Be the process that was asked for; returns the module to run."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.setsid()
    os.chdir(request['cwd'])
    nothing = os.open(os.devnull, os.O_RDWR)
    for file, number in zip((nothing, *files), range(3), strict=True):
        os.dup2(file, number)
        os.close(file)
    os.environ.clear()
    os.environ.update(request['env'])
    _, _, module, *arguments = request['command']
    sys.argv[:] = [importlib.util.find_spec(module).origin, *arguments]
    sys.modules.pop(module)  # is run anew, as `python -m` does
    return module


def run(module):
    """Run a module as the program that this process is, until its end.

    Threads are waited for and what is to be done at exit is done. But the interpreter does not
    take itself to pieces then: it would write to all that it shares with the server, for which
    the system would have to copy it first.
    """
    try:
        runpy.run_module(module, run_name='__main__', alter_sys=True)
        code = 0
    except SystemExit as end:
        if not isinstance(end.code, int):
            raise
        code = end.code
    except Exception:
        traceback.print_exc()
        code = 1
    threading._shutdown()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == '__main__':
    for name in (*LOADED, *LOADED_LATER):
        importlib.import_module(name)
    # What Numba looks up before its first kernel, and rclpy with its first line of log.
    inspect.getmodule(inspect.currentframe())
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    Forks(sys.argv[1]).take_over()  # for nodes that a fork starts
    gc.freeze()  # the forks need not look through it
    if (module := serve(sys.argv[1], Kernels())) is not None:
        run(module)
