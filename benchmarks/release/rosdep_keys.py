# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Which keys of package.xml a copy of the rosdep database resolves, for each ROS distribution.

Run from the repository root: ``python -m benchmarks.release.rosdep_keys ROSDISTRO``; ROSDISTRO is
a checkout of github.com/ros/rosdistro. A key is a package of the distribution, or a rule for apt
on the Ubuntu that the distribution is released for. What pip would install does not count: bloom
releases nothing that depends on it.
"""

from __future__ import annotations

import argparse
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import yaml

DISTRIBUTIONS = 'jazzy', 'kilted', 'lyrical', 'rolling'
RULES = 'base.yaml', 'python.yaml'
ROOT = Path(__file__).resolve().parents[2]


def keys(manifest: Path) -> list[str]:
    """Keys that a package.xml depends on, those of its tests among them."""
    root = ElementTree.parse(manifest).getroot()
    return sorted({element.text for element in root if element.tag.endswith('depend')})


def ubuntu_of(distribution: dict) -> str:
    """Code name of the Ubuntu that a distribution is released for."""
    [name] = distribution['release_platforms']['ubuntu']
    return name


def packages_of(distribution: dict) -> set[str]:
    """Names of the ROS packages that are released into a distribution."""
    found = set()
    for name, repository in distribution['repositories'].items():
        release = repository.get('release', {})
        if 'version' in release:
            found.update(release.get('packages', [name]))
    return found


def by_apt(rule: object, ubuntu: str) -> list[str]:
    """Packages of apt that the Ubuntu part of a rule names; none where others install it."""
    if isinstance(rule, dict):
        rule = rule.get(ubuntu, rule.get('*', rule))
    if isinstance(rule, dict):
        rule = rule.get('apt', {})
        rule = rule.get('packages', []) if isinstance(rule, dict) else rule
    return rule or []


def resolve(wanted: list[str], database: Path, name: str) -> tuple[str, dict[str, str]]:
    """Ubuntu of a distribution, and what each key is there; '' where it is nothing."""
    distribution = yaml.load((database / name / 'distribution.yaml').read_text(), yaml.CSafeLoader)
    rules = {}
    for file in RULES:
        rules |= yaml.load((database / 'rosdep' / file).read_text(), yaml.CSafeLoader)
    ubuntu, packages = ubuntu_of(distribution), packages_of(distribution)
    return ubuntu, {
        key: f'ros-{name}-{key.replace("_", "-")}' if key in packages
        else ' '.join(by_apt(rules.get(key, {}).get('ubuntu'), ubuntu)) for key in wanted}


def main() -> int:
    """Print a line for each key that is missing, and one for each distribution."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('database', type=Path, help='checkout of github.com/ros/rosdistro')
    wanted, n_missing = keys(ROOT / 'package.xml'), 0
    database = parser.parse_args().database
    for name in DISTRIBUTIONS:
        ubuntu, found = resolve(wanted, database, name)
        missing = [key for key in wanted if not found[key]]
        n_missing += len(missing)
        print(f'{name} on Ubuntu {ubuntu}: {len(wanted) - len(missing)} of {len(wanted)} keys'
              + (f'; missing: {", ".join(missing)}' if missing else ''))
    return n_missing > 0


if __name__ == '__main__':
    raise SystemExit(main())
