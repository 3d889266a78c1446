# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Memory that is available: of the machine, of control groups, of the process."""

import subprocess
import sys

import pytest

from sar_imaging import memory
from sar_imaging.memory import available_bytes, check_memory, container_bytes, granting

MOST = sys.maxsize


def make_group(folder, **files):
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name.replace('__', '.')).write_text(text)


@pytest.fixture
def system(tmp_path):
    """Bytes that remain for the text of a membership file, over a tree of groups."""
    mount = tmp_path / 'cgroup'
    make_group(mount / 'robot', memory__max='1000', memory__current='700',
               memory__stat='file 400\ninactive_file 150\n')
    make_group(mount / 'robot' / 'radar', memory__max='max', memory__current='600',
               memory__stat='inactive_file 100\n')
    make_group(mount / 'memory', memory__limit_in_bytes='5000', memory__usage_in_bytes='1500',
               memory__stat='inactive_file 7\ntotal_inactive_file 50\n')

    def remaining(text):
        (tmp_path / 'membership').write_text(text)
        return container_bytes(tmp_path / 'membership', mount)

    return remaining


@pytest.mark.parametrize(('membership', 'expected'), [
    ('0::/robot/radar\n', 1000 - 700 + 150),  # the limit is of the group above
    ('0::/robot\n', 1000 - 700 + 150),
    ('0::/elsewhere\n', MOST),
    ('4:memory:/of/the/host\n1:cpu:/x\n0::/\n', 5000 - 1500 + 50),  # version 1 in a container
    ('4:cpu,memory:/\n0::/robot\n', 450),
    ('0::/../../odd\n', MOST),
    ('', MOST)])
def test_the_tightest_group_counts(system, membership, expected):
    assert system(membership) == expected


def test_without_groups_nothing_limits(tmp_path):
    assert container_bytes(tmp_path / 'none', tmp_path) == MOST


def test_the_limit_of_the_process_counts(pytestconfig):
    pytest.importorskip('resource', reason='a limit of Unix systems')
    code = ('import resource\n'
            'from sar_imaging.memory import available_bytes\n'
            'resource.setrlimit(resource.RLIMIT_AS, (10**11, 10**11))\n'
            'before = available_bytes()\n'
            'size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()\n'
            'resource.setrlimit(resource.RLIMIT_AS, (size + 10**8, size + 10**8))\n'
            'after = available_bytes()\n'
            'assert 0 < after <= 10**8 <= before, (before, after)\n')
    subprocess.run([sys.executable, '-c', code], cwd=pytestconfig.rootpath, check=True)


def test_a_limit_counts_only_where_the_system_tells_the_size_of_the_process(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, '_STATM', tmp_path / 'none')
    monkeypatch.setattr(memory.resource, 'getrlimit', lambda which: (10**9, 10**9))
    assert memory._process_bytes() == MOST


def test_what_is_refused_says_the_sizes():
    check_memory(1, 'a byte', 'nothing')
    with pytest.raises(MemoryError, match=r'the moon needs 1000000000000 MB, \d+ MB are '
                                          r'available; choose a smaller one'):
        check_memory(10**18, 'the moon', 'choose a smaller one')
    assert available_bytes() < 10**18


def test_plans_are_made_for_the_memory_that_is_granted():
    before = available_bytes()
    with granting(1e6):
        assert available_bytes() == 10**6
        with pytest.raises(MemoryError, match='needs 2 MB, 1 MB are available; buy more'):
            check_memory(2 * 10**6, 'it', 'buy more')
        with granting(1e18):  # of another machine
            check_memory(10**17, 'it', 'buy more')
        assert available_bytes() == 10**6
    assert available_bytes() > 10**6 and before > 10**6
