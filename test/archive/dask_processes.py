# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Scheduler and workers as processes of their own, as on a cluster."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import threading


class Processes:
    """Ends what it started; use it in a `with` statement."""

    def __init__(self):
        self._stack = contextlib.ExitStack()

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self._stack.close()

    def scheduler(self, host='127.0.0.1', before=()):
        """Start a scheduler on a free port; returns its address."""
        process = self._start([*before, sys.executable, '-m', 'dask', 'scheduler', '--host', host,
                               '--port', '0', '--no-dashboard'])
        for line in process.stderr:
            found = re.search(r'Scheduler at:\s+(tcp://\S+)', line)
            if found:
                self._drain(process)
                return found[1]
        raise AssertionError('the scheduler did not start')

    def worker(self, address, before=(), memory='3GB', environment=None, threads=1):
        """Start a worker; returns the process after it is registered."""
        process = self._start([*before, sys.executable, '-m', 'dask', 'worker', address,
                               '--nthreads', str(threads), '--no-dashboard', '--memory-limit',
                               memory], environment)
        for line in process.stderr:
            if 'Registered to' in line:
                self._drain(process)
                return process
        raise AssertionError('the worker did not start')

    def _start(self, command, environment=None):
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            start_new_session=True, env={**os.environ, **(environment or {})})
        self._stack.callback(self._end, process)
        return process

    @staticmethod
    def _drain(process):
        threading.Thread(target=process.stderr.read, daemon=True).start()

    @staticmethod
    def _end(process):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def can(*command):
    """Whether a command of the system works here, and for this user."""
    return shutil.which(command[0]) is not None and subprocess.run(
        command, capture_output=True).returncode == 0
