# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways to damage files of YAML and JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

import yaml

from .any_file import CANARY, Damage, puts

ABSURD = [None, True, '', 'x', -1, 0, 1, 1e-300, 1e300, -1e300, 10**30, float('nan'),
          float('inf'), [], [[]], {}, [float('nan')] * 3, [1e200, 0, 0], 'nan', '1e999',
          '../../../../etc/passwd', '/dev/zero', 'pipe', 'a\0b', 'x' * 100_000, [0] * 10_000]


def _leaves(tree, path=()):
    yield path
    items = tree.items() if isinstance(tree, dict) else (
        enumerate(tree) if isinstance(tree, list) else ())
    for key, value in items:
        yield from _leaves(value, (*path, key))


def _with(tree, path, value):
    if not path:
        return value
    copy = dict(tree) if isinstance(tree, dict) else list(tree)
    copy[path[0]] = _with(copy[path[0]], path[1:], value)
    return copy


def values_of(tree) -> Iterator[tuple[str, object]]:
    """The tree with each of its values replaced by each absurd one."""
    for path in _leaves(tree):
        for value in ABSURD:
            told = repr(value)
            yield (f'{".".join(map(str, path)) or "all"} is '
                   f'{told if len(told) < 30 else told[:27] + "..."}', _with(tree, path, value))


def dumped(tree) -> Callable[[], bytes]:
    """As YAML, made when it is wanted: it takes 10 ms, and there are a thousand."""
    return lambda: yaml.safe_dump(tree).encode()


def bombs() -> Iterator[tuple[str, bytes]]:
    """Hostile YAML."""
    yield 'YAML nested 100,000 deep', b'a: ' + b'[' * 100_000
    yield 'YAML of 100,000 flow mappings', b'{a: ' * 100_000
    yield 'YAML of 100,000 dashes', b'- ' * 100_000
    aliases = ['a0: &a0 [x, x, x, x, x, x, x, x, x]'] + [
        f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * 9)}]' for i in range(1, 12)]
    yield 'YAML bomb of aliases', '\n'.join(aliases).encode()
    merges = ['a0: &a0 {k: v}'] + [
        f'a{i}: &a{i} {{<<: [{", ".join([f"*a{i - 1}"] * 9)}]}}' for i in range(1, 12)]
    yield 'YAML bomb of merges', '\n'.join(merges).encode()
    yield 'YAML that is its own value', b'a: &a [*a]'
    yield 'YAML that merges itself', b'a: &a {<<: *a}'
    for tag in ('python/object/apply:os.system', 'python/object/new:os.system'):
        yield f'YAML of {tag}', f'name: !!{tag} ["touch {CANARY}"]'.encode()
    yield 'YAML of a module', b'name: !!python/module:os'
    yield 'number of base 60', b'name: ' + b'1:' * 50_000 + b'1'
    yield 'number of 100,000 digits', b'name: ' + b'9' * 100_000
    yield 'key twice', b'name: a\nname: b\n'
    yield 'two documents', b'name: a\n---\nname: b\n'
    yield 'tabs', b'name:\n\t- a\n'
    yield 'key that is a list', b'? [a, b]\n: c\n'
    yield 'binary', b'name: !!binary aGVsbG8\n'
    yield 'set', b'name: !!set {a, b}\n'
    yield 'date', b'name: 2001-99-99\n'
    yield 'a line of 900 kB', b'name: "' + b'x' * 900_000 + b'"'
    yield 'NUL', b'name: a\0b'
    yield 'directive', b'%YAML 9.9\n---\nname: a\n'
    yield 'tag without end', b'name: !<' + b'a' * 100_000


def yaml_file(content: bytes) -> Iterator[Damage]:
    for told, text in bombs():
        yield told, puts(text)
    for told, tree in values_of(yaml.safe_load(content)):
        yield told, puts(dumped(tree))


def json_file(content: bytes) -> Iterator[Damage]:
    yield 'JSON nested 100,000 deep', puts(b'[' * 100_000)
    yield 'number of 100,000 digits', puts(b'{"a": ' + b'9' * 100_000 + b'}')
    for told, tree in values_of(json.loads(content)):
        yield told, puts(json.dumps(tree).encode())
