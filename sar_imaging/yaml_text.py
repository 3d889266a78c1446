"""YAML that people write, for the whole package: a key that is given twice is refused.

PyYAML keeps the last of such keys without a word, and YAML 1.2 forbids them (section 3.2.1.1).
"""

from __future__ import annotations

import yaml


class RepeatedKeyError(yaml.MarkedYAMLError):
    """A mapping has a key twice; its `problem` and `problem_mark` say which and where."""


class Loader(yaml.SafeLoader):
    """Safe loader whose mappings have each key once."""

    def get_single_node(self) -> yaml.Node | None:
        """Node of the whole text; see `yaml.SafeLoader`."""
        node = super().get_single_node()
        _refuse_repeated_keys(node)
        return node


def _refuse_repeated_keys(node: yaml.Node | None) -> None:
    waiting, seen = [node], set()
    while waiting:
        node = waiting.pop()
        if not isinstance(node, yaml.CollectionNode) or id(node) in seen:
            continue
        seen.add(id(node))  # aliases name a node again, even within itself
        if isinstance(node, yaml.SequenceNode):
            waiting += node.value
            continue
        first: dict[tuple, int] = {}
        for key, value in node.value:
            waiting += [key, value]
            if not isinstance(key, yaml.ScalarNode):
                continue
            line = key.start_mark.line + 1
            if (name := (key.tag, key.value)) in first:
                raise RepeatedKeyError(
                    None, None, f'the key {key.value} is given twice, first in line '
                    f'{first[name]}; keep one of them', key.start_mark)
            first[name] = line


def load_yaml(text: str, loader: type[Loader] = Loader):
    """Content of a YAML text.

    Parameters
    ----------
    text : str
        One document.
    loader : subclass of Loader
        That knows more.

    Raises
    ------
    yaml.YAMLError
        It is no YAML, or a mapping has a key twice.
    """
    return yaml.load(text, loader)


def trouble(error: yaml.YAMLError) -> str:
    """Line and reason of an error, in one line, without what else the text holds."""
    mark = getattr(error, 'problem_mark', None)
    where = '' if mark is None else f'line {mark.line + 1}: '
    problem = getattr(error, 'problem', None) or 'it cannot be parsed'
    return where + ' '.join(str(problem).split())
