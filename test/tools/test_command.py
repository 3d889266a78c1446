# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The one program: its commands are the tools."""

import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import llvmlite.binding as llvm
import numba
import pytest

from sar_imaging.tools import command
from sar_imaging.tools.program import run_command


@pytest.mark.parametrize('words', command.COMMANDS, ids=' '.join)
def test_every_command_explains_itself(words, capsys):
    with pytest.raises(SystemExit) as end:
        command.main([*words, '--help'])
    assert end.value.code == 0
    assert 'usage:' in capsys.readouterr().out


def test_the_overview_has_every_command_and_its_purpose(capsys):
    assert command.main(['--help']) == 0
    text = capsys.readouterr().out
    for words in command.COMMANDS:
        [line] = [line for line in text.splitlines()
                  if re.match(f'  {" ".join(words)} +[*A-Z]', line)]
        assert line.endswith('.')
        assert (' *' in line) == (words in command.PROVISIONAL)


def test_the_page_of_what_stays_names_the_provisional_commands():
    text = (Path(__file__).parents[2] / 'docs' / 'stability.md').read_text()
    table = text.split('**Provisional**')[1].split('\n## ')[0]
    named = re.findall('`(?:sar-imaging )?([a-z -]+)`', table)
    assert {' '.join(words) for words in command.PROVISIONAL} <= set(named)


def test_what_does_not_exist_is_named(capsys):
    assert command.main(['imagine', 'psf']) == 2
    text = capsys.readouterr().err
    assert "there is no command 'imagine'" in text and 'simulate archive' in text


def test_arguments_reach_the_command(capsys):
    assert command.main(['check-config', 'nowhere.yaml']) == 1
    captured = capsys.readouterr()
    assert 'nowhere.yaml cannot be read' in captured.out + captured.err


def test_no_command_loads_what_it_does_not_need():
    code = ("import sys; from sar_imaging.tools.command import main; main(['--help']);"
            "sys.exit('numpy' in sys.modules)")
    subprocess.run([sys.executable, '-c', code], check=True, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize('arguments', [['info', 'bags/psf'], ['info', '--help'], ['--help']],
                         ids=' '.join)
def test_commands_end_quietly_when_nobody_reads_them(arguments):
    process = subprocess.Popen([sys.executable, '-m', 'sar_imaging.tools.command', *arguments],
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()  # as head does when it has seen enough
    _, errors = process.communicate(timeout=60)
    assert errors == b''
    assert process.returncode == 128 + signal.SIGPIPE


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_waits_until_llvm_has_returned(capsys, number):
    entered = []

    def enter():  # called by LLVM's lock; what is raised here would leave the lock taken
        if not entered:
            entered.append(True)
            signal.raise_signal(number)
            entered.append('after the signal')

    def leave():
        pass

    def compile_one():
        numba.njit(lambda x: x + 1)(1)
        return 'compiled'

    llvm.ffi.register_lock_callback(enter, leave)
    try:
        assert run_command(compile_one) == 130
    finally:
        llvm.ffi.unregister_lock_callback(enter, leave)
    assert capsys.readouterr().err == 'interrupted; nothing was written\n'
    assert entered == [True, 'after the signal']
    later = threading.Thread(target=compile_one, daemon=True)
    later.start()
    later.join(60)
    assert not later.is_alive()


def test_an_interrupt_within_a_destructor_is_not_lost(capsys):
    class Dropped:
        def __del__(self):  # what it raises, Python cannot hand on
            signal.raise_signal(signal.SIGINT)

    reached = []

    def work():
        kept = Dropped()
        del kept
        reached.append('after the interrupt')

    assert run_command(work) == 130
    assert capsys.readouterr().err == 'interrupted; nothing was written\n'
    assert not reached
