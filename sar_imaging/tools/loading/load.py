"""Turn measured data and their description in YAML into a recording.

Run: sar-imaging load DESCRIPTION [DATA] --output out/bags/mine
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import yaml

from sar_imaging.files import naming
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.loading import DescriptionError, Loaded, load, shipped_names
from sar_imaging.yaml_text import load_yaml

from ..ending import run_command
from ..recordings.bag_io import check_target, write_bag
from ..recordings.truth import antenna_truth, make_truth
from ..recordings.writing import split, with_progress
from .bag_frames import read_bag_frames
from .bag_poses import read_bag_poses
from .estimate import describe, estimate_alignment
from .scene_check import told_of_scene

_DESCRIPTION = """\
Turn measured data into a recording (rosbag2). A description in YAML says where samples, times and
poses are and what the radar sends; docs/loading.md lists its keys. Each number in it may be the
name of a variable of the data file. `sar-imaging evaluate` and `sar-imaging image` image the
recording.
"""


def truth_of(loaded: Loaded, alignment: Alignment | None) -> dict:
    """Truth of the recording: scene, aperture, and the alignment to image with."""
    scene, block = loaded.scene, loaded.block
    return make_truth(
        scenario=loaded.name, description=loaded.description, notes=loaded.notes,
        scatterers=scene.scatterers, grid=scene.grid,
        pulses_per_aperture=scene.pulses_per_aperture or int(block.counter[-1]) + 1,
        n_pulses=block.n_pulses, n_channels=block.n_channels, cut_half_width_m=scene.cut_m,
        radar=block.radar, compressed=block.compressed, window=scene.window,
        alignment=alignment, frame=scene.frame, datum=scene.datum) | antenna_truth(
            loaded.antenna, loaded.mount)


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(prog='load', description=_DESCRIPTION,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('description', help='YAML file, or the name of a shipped one: '
                   f'{", ".join(shipped_names())}')
    p.add_argument('data', type=Path, nargs='?',
                   help='folder with the files that the description names, or the file of the '
                        'samples (default: the folder of the description)')
    p.add_argument('--output', type=Path, metavar='FOLDER',
                   help='bag folder to make (default: out/bags/ and the name of the recording)')
    p.add_argument('--set', action='append', default=[], metavar='KEY=VALUE', dest='changes',
                   help='another value for a key, such as alignment.time_offset_s=9.28; may be '
                        'given several times')
    p.add_argument('--estimate-alignment', action='store_true',
                   help='estimate time offset and range bias from the image, beginning with those '
                        'of the description')
    p.add_argument('--force', action='store_true', help='replace an existing bag')
    return p


def _changes(pairs: Sequence[str]) -> dict[str, object]:
    out = {}
    for pair in pairs:
        key, separator, value = pair.partition('=')
        try:
            out[key] = load_yaml(value)
        except yaml.YAMLError:
            separator = ''
        if not separator:
            raise DescriptionError(f'--set {pair}: expected KEY=VALUE, such as times.first_s=0.5')
    return out


def _write(arguments: argparse.Namespace) -> str:
    if arguments.output is not None:
        check_target(arguments.output, overwrite=arguments.force)
    loaded = load(arguments.description, arguments.data, changes=_changes(arguments.changes),
                  read_bag=read_bag_poses, read_frames=read_bag_frames)
    output = arguments.output or Path('out/bags') / _folder(loaded.name)
    check_target(output, overwrite=arguments.force)
    with naming(arguments.description, 'makes no recording', DescriptionError):
        return _write_loaded(loaded, output, arguments)


def _folder(name: str) -> str:
    """A name of a folder, nothing else that a description of somebody else may tell."""
    if Path(name).name != name or not name.isprintable():
        raise DescriptionError(f'name: {name!r} is no name of a folder; give one by --output')
    return name


def _write_loaded(loaded: Loaded, output: Path, arguments: argparse.Namespace) -> str:
    for text in (*loaded.warnings, *told_of_scene(loaded)):
        print(f'warning: {text}', file=sys.stderr)
    alignment, poses = loaded.alignment, loaded.poses
    if arguments.estimate_alignment:
        if poses is None:
            raise DescriptionError('--estimate-alignment: expected poses on a clock of their own; '
                                   'this recording has the phase centres of its pulses')
        alignment, report = estimate_alignment(loaded.block, poses, alignment, loaded.scene.grid)
        print(describe(report))
    block = loaded.block
    count = write_bag(output, with_progress(split(block), block.n_pulses),
                      truth_of(loaded, alignment), overwrite=arguments.force, poses=poses)
    told = '' if poses is None else f', {len(poses.stamp_ns)} poses'
    return f'{output}: {block.n_pulses} pulses in {count} messages{told}'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return run_command(lambda: _write(arguments))


if __name__ == '__main__':
    sys.exit(main())
