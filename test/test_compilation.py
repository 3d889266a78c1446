# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What is told when kernels are compiled, and where their machine code is kept."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding
from numba.core import codegen

from sar_imaging import compilation
from sar_imaging.compilation import counted, numba
from sar_imaging.tools.compile_kernels import main


def test_the_first_compilation_is_announced_once():
    """And none where the machine code is there already."""
    compiled = [numba.njit(f) for f in (lambda x: x + 1, lambda x: x + 2)]
    told = []
    with counted(lambda: told.append('now')):
        assert [f(np.float32(1.0)) for f in compiled] == [2.0, 3.0]
    assert told == ['now']
    with counted(lambda: told.append('again')):
        compiled[0](np.float32(2.0))
    assert told == ['now']
    compiled[0](1)  # outside nobody is told
    assert told == ['now']


def test_who_waits_for_kernels_is_told_why_and_how_far(caplog, monkeypatch):
    """As a warning at a terminal and in a notebook, as a fact elsewhere."""
    caplog.set_level('INFO', 'sar_imaging.compilation')
    monkeypatch.setattr(compilation, '_TELL_EVERY_S', 0.0)
    for level in ('INFO', 'WARNING'):
        compiled = [compilation.njit(f, cache=False) for f in (lambda x: x + 1, lambda x: x + 2)]
        with compilation.announced():
            assert [f(1) for f in compiled] == [2, 3]
        first, second, last = caplog.messages
        assert 'once on each machine' in first and 'compile_kernels' in first
        assert 'kept in this process alone' in first
        assert '2 functions in' in second and second.endswith('s so far')
        assert last.startswith('2 functions were compiled in')
        assert {record.levelname for record in caplog.records} == {level}
        caplog.clear()
        with compilation.announced():
            compiled[0](1)  # it is there
        assert not caplog.records
        monkeypatch.setattr(compilation.sys, 'ps1', '>>> ', raising=False)


def test_parts_of_kernels_are_for_kernels_alone(tmp_path):
    """No machine code of their own is kept, and Python, which has none to call, is refused."""
    (tmp_path / 'kernels.py').write_text(
        'from sar_imaging.compilation import kernel_part, njit, numba\n'
        '@kernel_part\n'
        'def twice(x, i):\n'
        '    return 2 * x[i]\n'
        '@njit(parallel=True)\n'
        'def f(x, out):\n'
        '    for i in numba.prange(len(x)):\n'
        '        out[i] = twice(x, i)\n'
        'import gc, numpy\n'
        'def refused():\n'
        '    try:\n'
        '        twice(numpy.arange(3), 1)\n'
        '    except TypeError as error:\n'
        '        return "twice is called by compiled functions alone" in str(error)\n'
        'assert refused()\n'
        'out = numpy.zeros(3, int)\n'
        'f(numpy.arange(3), out)\n'
        'assert out.tolist() == [0, 2, 4]\n'
        'assert refused() and gc.isenabled()\n')
    environment = os.environ | {'NUMBA_CACHE_DIR': str(tmp_path / 'cache'),
                                'PYTHONPATH': str(Path(compilation.__file__).parents[1])}
    for _ in range(2):  # compiled, and from the cache
        result = _run(tmp_path, 'import kernels', environment)
        assert result.returncode == 0, result.stderr
    assert [path.name[:9] for path in tmp_path.rglob('*.nbc')] == ['kernels.f']


def _without_places(tmp_path):
    """The module where Numba can write neither beside it nor below the home folder."""
    shutil.copy(compilation.__file__, tmp_path / 'compilation.py')
    for name in ('__pycache__', 'home'):
        (tmp_path / name).write_text('no folder')  # root may write to any folder, not to this
    kept = tmp_path / 'temporary'
    kept.mkdir(exist_ok=True)
    (tmp_path / 'kernels.py').write_text(
        'import compilation\n'
        'given = compilation.config.CACHE_DIR\n'
        '@compilation.njit\n'
        'def f(x):\n'
        '    return x + 1\n'
        'g = compilation.njit(inline="always")(lambda x: f(x))\n'
        'assert g(1) == 2\n'
        'assert compilation.config.CACHE_DIR == given\n')
    environment = {k: v for k, v in os.environ.items() if not k.startswith('NUMBA')}
    return environment | {'HOME': str(tmp_path / 'home'), 'PYTHONDONTWRITEBYTECODE': '1',
                          'XDG_CACHE_HOME': str(tmp_path / 'home'), 'TMPDIR': str(kept)}


def _run(tmp_path, code, environment):
    return subprocess.run([sys.executable, '-c', code], cwd=tmp_path, env=environment,
                          capture_output=True, text=True)


def test_machine_code_goes_to_a_temporary_folder_where_there_is_no_other(tmp_path):
    environment = _without_places(tmp_path)
    folder = tmp_path / 'temporary' / f'sar_imaging-numba-{os.getuid()}'
    for _ in range(2):  # a second process finds the folder there
        result = _run(tmp_path, 'import kernels', environment)
        assert result.returncode == 0, result.stderr
        assert result.stderr.count('machine code is kept in') == 1
        assert str(folder) in result.stderr and 'set NUMBA_CACHE_DIR' in result.stderr
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert list(folder.rglob('kernels.f-*.nbc'))


def test_what_was_compiled_into_an_installation_is_read_by_users_who_may_not_write_there(tmp_path):
    """What they compile themselves is kept in a folder of theirs."""
    environment = _without_places(tmp_path) | {'HOME': str(tmp_path / 'user'),
                                               'XDG_CACHE_HOME': str(tmp_path / 'user')}
    (tmp_path / 'home').unlink()
    (tmp_path / '__pycache__').unlink()
    (tmp_path / 'kernels.py').write_text(
        'import compilation\n'
        '@compilation.njit\n'
        'def f(x):\n'
        '    return x + 1\n'
        'def first():\n'
        '    with compilation.counted() as kernels:\n'
        '        f(1)\n'
        '    return kernels.n\n')
    read_only = ('from pathlib import Path\n'
                 'from numba.core import caching\n'
                 'def ensure(self, may=caching._CacheLocator.ensure_cache_path):\n'
                 '    if Path(self.get_cache_path()) == Path("__pycache__").absolute():\n'
                 '        raise PermissionError\n'
                 '    may(self)\n'
                 'caching._CacheLocator.ensure_cache_path = ensure\n'  # root may write anywhere
                 'import kernels\n'
                 'assert kernels.f._cache.cache_path.startswith(str(Path("user").absolute()))\n')
    for code, n in (('import kernels\n', 1), (read_only, 0)):
        result = _run(tmp_path, code + f'assert kernels.first() == {n}, kernels.first()',
                      environment)
        assert result.returncode == 0, result.stderr
    assert not list((tmp_path / 'user').rglob('*.nbc'))
    result = _run(tmp_path, read_only + 'kernels.f(1.0)', environment)  # of another type
    assert result.returncode == 0, result.stderr
    assert list((tmp_path / 'user').rglob('*.nbc'))


def test_a_temporary_folder_that_others_may_write_to_is_not_used(tmp_path):
    environment = _without_places(tmp_path)
    folder = tmp_path / 'temporary' / f'sar_imaging-numba-{os.getuid()}'
    folder.mkdir()
    folder.chmod(0o777)  # somebody else may have put machine code there
    result = _run(tmp_path, 'import kernels', environment)
    assert 'machine code is kept in' in result.stderr
    assert f'{folder}:' not in result.stderr


def test_a_folder_that_the_user_names_is_used(tmp_path):
    environment = _without_places(tmp_path) | {'NUMBA_CACHE_DIR': str(tmp_path / 'mine')}
    result = _run(tmp_path, 'import kernels', environment)
    assert result.returncode == 0 and not result.stderr
    assert list((tmp_path / 'mine').rglob('kernels.f-*.nbc'))


def test_functions_and_settings_of_the_user_stay_as_they_are(tmp_path):
    """Compiled before the package is imported, and after."""
    (tmp_path / 'user.py').write_text(
        'import numba, numpy\n'
        'from numba.core import config\n'
        'def settings():\n'
        '    return {k: v for k, v in vars(config).items() if k.isupper()}\n'
        'def code():\n'
        '    compiled = numba.njit(lambda x: x * x)\n'
        '    compiled(numpy.ones(3, numpy.float32))\n'
        '    return compiled.inspect_asm()[compiled.signatures[0]]\n'
        'def count(code):\n'
        '    return [code.count(kind) for kind in ("xmm", "ymm", "zmm", "v0.4s")]\n'
        'before, first = settings(), count(code())\n'
        'import sar_imaging.imaging.exact\n'
        'assert settings() == before\n'
        'assert count(code()) == first, (count(code()), first)\n')
    environment = os.environ | {'PYTHONPATH': str(Path(compilation.__file__).parents[1])}
    result = subprocess.run([sys.executable, tmp_path / 'user.py'], env=environment,
                            capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def _add_squares(x, y):
    for line in numba.prange(y.shape[0]):
        for i in range(y.shape[1]):
            y[line, i] += x[i] * x[i]


@pytest.mark.skipif(not binding.get_host_cpu_features().get('avx512f')
                    or 'NUMBA_CPU_NAME' in os.environ, reason='no vectors of 512 bits here')
@pytest.mark.parametrize('parallel', [False, True])
def test_kernels_use_vectors_of_512_bits(parallel):
    x, y = np.arange(1000, dtype=np.float32), np.zeros((2, 1000), np.float32)
    compiled = compilation.njit(_add_squares, parallel=parallel, cache=False)
    compiled(x, y)
    np.testing.assert_array_equal(y, [x * x] * 2)
    assert 'zmm' in ''.join(compiled.inspect_asm().values())


def test_a_parallel_function_becomes_machine_code_once(monkeypatch):
    """Numba makes it of the loop and of two wrappers as well, and runs none of these."""
    made, finalize = [], codegen.JITCodeLibrary._finalize_specific
    monkeypatch.setattr(codegen.JITCodeLibrary, '_finalize_specific',
                        lambda self: (made.append(self.name), finalize(self)))
    x, y = np.ones(10, np.float32), np.zeros((2, 10), np.float32)
    compilation.njit(_add_squares, parallel=True, cache=False)(x, y)
    assert made == ['_add_squares'] and (y == 1.0).all()


@pytest.mark.parametrize('version', ['0.57.1', '0.9', '0.57.0rc1'])
def test_old_numba_is_refused(version):
    with pytest.raises(ImportError, match=f'Numba {version} is installed; 0.58 or later'):
        compilation.check_version(version)


@pytest.mark.parametrize('version', ['0.58.1', '0.58.0rc1', '0.60.1', '0.62.0dev0+12.g12', '1.0'])
def test_newer_numba_is_accepted(version):
    compilation.check_version(version)


def test_kernels_are_compiled_by_a_command(capsys):
    assert main([]) == 0
    first = capsys.readouterr().out
    assert 'kernels compiled in' in first or 'were there already' in first
    assert main([]) == 0  # this process has them by now
    assert 'nothing to compile' in capsys.readouterr().out
