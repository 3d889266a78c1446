# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Print what lets bash or zsh complete the commands of `sar-imaging` and their options.

Run: sar-imaging completion bash > ~/.local/share/bash-completion/completions/sar-imaging
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterable

from .command import COMMANDS
from .program import command_parser, main_of

_DESCRIPTION = """\
Print what lets bash or zsh complete the commands of sar-imaging, their options and the values of
these. Files are completed where nothing else fits.

  sar-imaging completion bash > ~/.local/share/bash-completion/completions/sar-imaging
  echo 'source <(sar-imaging completion zsh)' >> ~/.zshrc   # after compinit
"""
_FUNCTION = """\
_sar_imaging() {
    local word="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}" words=''
    case "${COMP_WORDS[*]:1:$((COMP_CWORD - 1))} " in
%s
    esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}
complete -o default -F _sar_imaging sar-imaging"""
_ZSH = 'autoload -U +X bashcompinit && bashcompinit'


def parser() -> argparse.ArgumentParser:
    """Command line of this program."""
    parser = command_parser('sar-imaging completion', _DESCRIPTION)
    parser.add_argument('shell', choices=('bash', 'zsh'))
    return parser


def run(arguments: argparse.Namespace) -> str:
    """The shell's code."""
    first = sorted({words[0] for words in COMMANDS})
    cases = [_case("' '", first)]
    for words in sorted(COMMANDS, key=len, reverse=True):  # `simulate archive` before `simulate`
        cases.append(_command(words))
    code = _FUNCTION % '\n'.join(cases)
    return f'{_ZSH}\n{code}' if arguments.shell == 'zsh' else code


def _command(words: tuple[str, ...]) -> str:
    """What may follow a command; nothing is known of one whose libraries are not installed."""
    after = [others[-1] for others in COMMANDS if others[:-1] == words]
    values = []
    try:
        made = importlib.import_module(f'sar_imaging.tools.{COMMANDS[words]}').parser()
    except ModuleNotFoundError:
        made = command_parser(None, '')
    for action in made._actions:
        choices = [str(choice) for choice in action.choices or ()]
        after += action.option_strings or choices
        if action.option_strings and choices:
            values.append((action.option_strings, choices))
    inner = [_case('|'.join(options), choices, 12) for options, choices in values]
    pattern = f"'{' '.join(words)} '*"
    if not inner:
        return _case(pattern, after)
    return '\n'.join([f'        {pattern})', '            case "$before" in', *inner,
                      _case('*', after, 12), '            esac ;;'])


def _case(pattern: str, words: Iterable[str], indent: int = 8) -> str:
    return f"{' ' * indent}{pattern}) words='{' '.join(words)}' ;;"


main = main_of(parser, run)

if __name__ == '__main__':
    raise SystemExit(main())
