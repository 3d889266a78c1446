# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The Debian package that bloom would have built, made, installed into an empty root and started.

Run from the repository root: ``python -m benchmarks.release.debian [--distribution jazzy]``. The
build farm builds from the templates of `bloom-generate rosdebian`: setup.py installs below
/opt/ros/DISTRIBUTION, keys of package.xml become packages. The same is done here with dpkg-deb, so
that it can be tried on a machine without ROS: what the package depends on is not installed, and
its programs start with the Python that runs this script and what it has of ROS.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: Python of the Ubuntu that each is released for.
PYTHON = {'jazzy': '3.12', 'kilted': '3.12', 'lyrical': '3.14', 'rolling': '3.14'}
NODES = ('radar_driver', 'pulse_buffer', 'range_compression', 'backprojection', 'afbp_fusion',
         'sar_pipeline', 'moving_targets', 'localization')
_PATIENCE_S = 300.0  # kernels may have to be compiled


def control(manifest: ElementTree.Element, distribution: str) -> str:
    """What DEBIAN/control says, from package.xml."""
    def package(key):
        return key if key.startswith('python3-') else f'ros-{distribution}-{key.replace("_", "-")}'

    depends = sorted({package(e.text) for e in manifest if e.tag in ('depend', 'exec_depend')})
    maintainer = manifest.find('maintainer')
    description = ' '.join(manifest.findtext('description').split())
    summary = description.split(':')[0]
    return (f'Package: {package(manifest.findtext("name"))}\n'
            f'Version: {manifest.findtext("version")}-0\n'
            'Architecture: all\nSection: misc\nPriority: optional\n'
            f'Maintainer: {maintainer.text} <{maintainer.get("email")}>\n'
            f'Depends: {", ".join(["python3", *depends])}\n'
            f'Description: {summary}\n {description}\n')


def build(folder: Path, distribution: str) -> Path:
    """Build the package below an empty folder; returns its path."""
    prefix, source, tree = f'/opt/ros/{distribution}', folder / 'source', folder / 'tree'
    library = f'{prefix}/lib/python{PYTHON[distribution]}/site-packages'
    shutil.copytree(ROOT, source, ignore=lambda where, names: [
        n for n in names if n.startswith('.') or n in ('build', 'out', 'shared', '__pycache__')
        or Path(where) == ROOT and n in ('test', 'benchmarks', 'docs', 'bags')])
    subprocess.run(
        [sys.executable, 'setup.py', '-q', 'build', '--executable=/usr/bin/python3', 'install',
         '--single-version-externally-managed', '--record=record', '--no-compile',
         f'--root={tree}', f'--prefix={prefix}', f'--install-lib={library}',
         f'--install-scripts={prefix}/lib/sar_imaging'], cwd=source, check=True,
        env=os.environ | {'PYTHONWARNINGS': 'ignore'}, stderr=subprocess.DEVNULL)
    manifest = ElementTree.parse(source / 'package.xml').getroot()
    notice = tree / f'usr/share/doc/ros-{distribution}-sar-imaging/copyright'
    notice.parent.mkdir(parents=True)
    shutil.copy(source / 'LICENSE', notice)
    (tree / 'DEBIAN').mkdir()
    (tree / 'DEBIAN' / 'control').write_text(control(manifest, distribution))
    subprocess.run(['dpkg-deb', '--root-owner-group', '--build', tree, folder], check=True,
                   stdout=subprocess.DEVNULL)
    [built] = folder.glob('*.deb')
    return built


def install(package: Path, root: Path) -> None:
    """Install into an empty root, without what the package depends on."""
    (root / 'var/lib/dpkg/updates').mkdir(parents=True)
    (root / 'var/lib/dpkg/info').mkdir()
    (root / 'var/lib/dpkg/status').touch()
    subprocess.run(['dpkg', f'--root={root}', '--force-depends', '--force-not-root',
                    '--install', package], check=True, capture_output=True)


def start(root: Path, distribution: str) -> dict[str, str]:
    """Start every program of an installed package; what each does, in words."""
    prefix = root / 'opt/ros' / distribution
    library = prefix / f'lib/python{PYTHON[distribution]}/site-packages'
    environment = os.environ | {'PYTHONPATH': str(library), 'AMENT_PREFIX_PATH': str(prefix),
                                'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    done = {}
    for program in sorted((prefix / 'lib/sar_imaging').iterdir()):
        command = [sys.executable, program]
        assert program.read_text().startswith('#!/usr/bin/python3'), program
        if program.name in NODES:
            done[program.name] = _start_node(command, environment, root)
        else:
            run = subprocess.run([*command, '--help'], cwd=root, env=environment, text=True,
                                 capture_output=True)
            done[program.name] = 'help' if not run.returncode and 'usage:' in run.stdout else (
                f'FAILED: {run.stderr[-300:]}')
    return done


def _start_node(command: list, environment: dict, folder: Path) -> str:
    with subprocess.Popen(command, cwd=folder, env=environment, text=True,
                          stderr=subprocess.PIPE) as process:
        lines = []
        for line in process.stderr:
            lines.append(line)
            if 'ready' in line or 'waits' in line or 'refused' in line:
                process.send_signal(signal.SIGINT)
                break
        lines.append(process.stderr.read())
        status = process.wait(_PATIENCE_S)
    return f'ready, ended with status {status}' if not status else (
        f'FAILED with status {status}: {"".join(lines)[-300:]}')


def main() -> int:
    """Build, install, look for the files that ROS looks for, and start all programs."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--distribution', choices=PYTHON, default='jazzy')
    parser.add_argument('--folder', type=Path, default=ROOT / 'build' / 'debian',
                        help='where all of it lies; what is there is removed')
    arguments = parser.parse_args()
    shutil.rmtree(arguments.folder, ignore_errors=True)
    arguments.folder.mkdir(parents=True)
    package = build(arguments.folder, arguments.distribution)
    print(f'{package.name}: {package.stat().st_size / 1e6:.1f} MB')
    root = arguments.folder / 'root'
    install(package, root)
    prefix = root / 'opt/ros' / arguments.distribution
    for path in ('share/ament_index/resource_index/packages/sar_imaging',
                 'share/sar_imaging/package.xml', 'share/sar_imaging/config/sar_imaging.yaml',
                 *(f'share/sar_imaging/launch/{name}.launch.py'
                   for name in ('sar_imaging', 'sar_pipeline', 'replay'))):
        assert (prefix / path).is_file(), f'{path} is missing'
    done = start(root, arguments.distribution)
    for name, what in done.items():
        print(f'  {name}: {what}')
    return any(what.startswith('FAILED') for what in done.values())


if __name__ == '__main__':
    raise SystemExit(main())
