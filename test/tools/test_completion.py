# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the shells complete."""

import shlex
import shutil
import subprocess

import pytest

from sar_imaging.tools import command, completion


@pytest.fixture(scope='module')
def code():
    """What is printed for each shell."""
    return {shell: completion.run(completion.parser().parse_args([shell]))
            for shell in ('bash', 'zsh')}


def _completed(code, line: str) -> list[str]:
    """What bash offers for the last word of a line."""
    words = line.split(' ')
    ask = [code['bash'], f'COMP_WORDS=({" ".join(map(shlex.quote, words))})',
           f'COMP_CWORD={len(words) - 1}', '_sar_imaging', r'printf "%s\n" "${COMPREPLY[@]}"']
    return subprocess.run(['bash', '-c', '\n'.join(ask)], check=True, capture_output=True,
                          text=True).stdout.split()


@pytest.mark.parametrize(('line', 'expected'), [
    ('sar-imaging ch', ['change', 'check-config']),
    ('sar-imaging simulate a', ['archive']),
    ('sar-imaging simulate --for', ['--force']),
    ('sar-imaging simulate archive --fo', ['--force', '--format']),
    ('sar-imaging simulate archive --format ', ['bag', 'cphd']),
    ('sar-imaging image bags/psf --brightness s', ['sigma0']),
    ('sar-imaging image bags/p', []),  # a file: bash does that itself, by `-o default`
    ('sar-imaging completion z', ['zsh']),
    ('sar-imaging nothing --', [])])
@pytest.mark.skipif(shutil.which('bash') is None, reason='needs bash')
def test_words_are_completed(code, line, expected):
    assert sorted(_completed(code, line)) == expected


@pytest.mark.skipif(shutil.which('bash') is None, reason='needs bash')
def test_every_command_is_completed(code):
    assert set(_completed(code, 'sar-imaging ')) == {words[0] for words in command.COMMANDS}


@pytest.mark.skipif(shutil.which('zsh') is None, reason='needs zsh')
def test_zsh_takes_it(code):
    ask = ['autoload -U compinit && compinit -u -D', code['zsh'], 'emulate sh', 'setopt ksharrays',
           'COMP_WORDS=(sar-imaging simulate archive --format b)', 'COMP_CWORD=4', '_sar_imaging',
           'print -l "${COMPREPLY[@]}"']  # the options that bashcompinit calls functions with
    run = subprocess.run(['zsh', '-f', '-c', '\n'.join(ask)], capture_output=True, text=True)
    assert (run.stdout.split(), run.stderr) == (['bag', 'cphd'], '')  # zsh drops the second
