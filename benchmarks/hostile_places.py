# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every output into hostile places: inputs and other files stay, nothing is half written.

Run from the repository root: ``python -m benchmarks.hostile_places [--outputs NAME ...]``. Each
command writes where links, pipes, folders, inputs, full or read-only disks are in the place of its
files, and is interrupted and killed. See `benchmarks.hostile_files` for the limits.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import pathlib
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence

from .hostile_files import LONGEST_LINE, MEMORY_BYTES, _forked, prepare, run
from .support.hostile import valid
from .support.hostile.readers import digests
from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'hostile_places.json'
LIMIT_S = 60.0  # images of loaded machines; what is refused takes a second
OLD = b'of an earlier run'
NOBODY = 65534


@dataclasses.dataclass(frozen=True)
class Output:
    """A command that writes.

    Parameters
    ----------
    name : str
        Of the output.
    make : callable
        Writes the inputs into a folder.
    words : tuple of str
        ``{in}`` and ``{out}`` are replaced.
    files : tuple of str
        What it writes into ``{out}``; a name that ends with ``/`` is a folder.
    patient, reads : bool
        False where it may refuse what others write over; where it has no inputs.
    before : callable
        Called in the process before the command.
    memory_bytes : int
        Largest address space.
    """

    name: str
    make: Callable[[pathlib.Path], None]
    words: tuple[str, ...]
    files: tuple[str, ...]
    patient: bool = True
    reads: bool = True
    before: Callable[[], None] = lambda: None
    memory_bytes: int = MEMORY_BYTES


def _channels(folder):
    shutil.copytree(pathlib.Path(__file__).parent.parent / 'bags' / 'psf', folder / 'bag')


_SMALL = ('--size', '4', '--spacing', '0.1')
_PICTURE = ('image.npy', 'image.png', 'quality.json', 'report.html')


def _two_bags(folder):
    valid.bag(folder)
    shutil.copytree(folder / 'bag', folder / 'second')


def _without_measuring():
    import numpy as np

    from sar_imaging.planning.costs import DEFAULT
    from sar_imaging.tools import costs

    costs.measure = lambda *_, **__: None
    costs.solve = lambda *_: (DEFAULT, np.ones(2))


OUTPUTS = (
    Output('convert to CPHD', valid.bag, ('convert', '{in}/bag', '{out}/scene.cphd', '--force'),
           ('scene.cphd',)),
    Output('convert CPHD to CPHD', valid.cphd(), ('convert', '{in}/scene.cphd', '{out}/new.cphd',
                                                  '--force', '--sample-type', 'CI2'),
           ('new.cphd',)),
    Output('convert to a recording', valid.cphd(), ('convert', '{in}/scene.cphd', '{out}/new',
                                                    '--force'), ('new/',)),
    Output('convert to GeoTIFF', valid.sicd, ('convert', '{in}/image.nitf', '{out}/map.tif',
                                              '--force'), ('map.tif',)),
    Output('load', valid.described(valid.npy), ('load', '{in}/rail.yaml', '--output', '{out}/new',
                                                '--force'), ('new/',)),
    Output('simulate', valid.costs, ('simulate', 'psf', '--output', '{out}/new', '--force'),
           ('new/',)),
    Output('simulate archive', valid.costs, (
        'simulate', 'archive', '--output', '{out}/survey', '--force', '--recordings', '1',
        '--lines', '1', '--pixels', '64'), ('survey/',)),
    Output('measure-costs', valid.bag, ('measure-costs', '--output', '{out}/costs.json'),
           ('costs.json',), reads=False, before=_without_measuring),
    Output('image', valid.bag, ('image', '{in}/bag', '--output', '{out}', *_SMALL), _PICTURE),
    Output('image, all formats', valid.bag, (
        'image', '{in}/bag', '--output', '{out}', *_SMALL, '--format',
        'png,geotiff,sicd,kml,stac'),
        (*_PICTURE, 'image.tif', 'image.nitf', 'image.json', 'overlay.png', 'overlay.kml',
         'overlay.pgw', 'overlay.prj')),
    Output('image of a volume', valid.bag, (
        'image', '{in}/bag', '--output', '{out}', '--size', '4', '--spacing', '0.5', '--height',
        '1'), ('volume.npy', 'cloud.ply', 'volume.png', 'quality.json')),
    Output('archive', valid.job, (
        'archive', '{in}/survey.yaml', '--output', '{out}', '--workers', '1'),
        ('job.json', 'job.lock', 'plan.txt', 'summary.json', 'mosaic.tif', 'report.html',
         'catalog.json'), patient=False, memory_bytes=10**11),  # workers map much
    Output('change', _two_bags, (
        'change', '{in}/bag', '{in}/second', '--output', '{out}', *_SMALL),
           ('comparison.json', 'comparison.npz', 'report.html', 'comparison.tif')),
    Output('doctor', valid.bag, ('doctor', '{in}/bag', '--output', '{out}'),
           ('signals.png', 'doctor.json')),
    Output('calibrate', _channels, ('calibrate', '{in}/bag', '--output', '{out}/channels.yaml'),
           ('channels.yaml',)),
    Output('radar-constant', valid.bag, (
        'radar-constant', '{in}/bag', '--reflector', '0', '0', '0', '--cross-section', '10',
        '--output', '{out}/radar.yaml'), ('radar.yaml',)),
    Output('layouts', valid.configuration, ('layouts', '{in}/radar.yaml', '--output', '{out}'),
           ('radar.rviz', 'radar.foxglove.json')),
)


@dataclasses.dataclass(frozen=True)
class Sandbox:
    """Folders of a run: inputs, outputs, files of other people."""

    inputs: pathlib.Path
    out: pathlib.Path
    others: pathlib.Path
    output: Output

    def targets(self) -> list[pathlib.Path]:
        """Where the files are written."""
        return [self.out / name for name in self.output.files]

    def source(self) -> pathlib.Path:
        """An input."""
        return next(p for p in sorted(self.inputs.rglob('*')) if p.is_file())

    def precious(self) -> pathlib.Path:
        """A file of somebody else."""
        return self.others / 'precious'

    def at_each(self, put: Callable[[pathlib.Path], object]) -> None:
        """Put something in the place of each file that is not a folder."""
        for target in self.targets():
            put(target)


# What may stand in the place of outputs; True where the command has to refuse.
PLACES: dict[str, tuple[Callable[[Sandbox], object], bool | None]] = {
    'nothing': (lambda s: None, False),
    'old files': (lambda s: s.at_each(lambda t: _old(t)), False),
    'old files that may not be written': (
        lambda s: s.at_each(lambda t: (_old(t), t.chmod(0o444 if t.is_file() else 0o555))), False),
    'links to an input': (lambda s: s.at_each(lambda t: t.symlink_to(s.source())), True),
    'links to an input by another path': (lambda s: s.at_each(lambda t: t.symlink_to(
        s.out / '..' / 'out' / '..' / s.source().relative_to(s.out.parent))), True),
    'hard links of an input': (lambda s: s.at_each(lambda t: t.hardlink_to(s.source())), True),
    'links to links to an input': (lambda s: s.at_each(lambda t: (
        (s.others / 'between').unlink(missing_ok=True),
        (s.others / 'between').symlink_to(s.source()), t.symlink_to(s.others / 'between'))), True),
    'links to other files': (lambda s: s.at_each(lambda t: t.symlink_to(s.precious())), None),
    'hard links of other files': (lambda s: s.at_each(lambda t: t.hardlink_to(s.precious())),
                                  None),
    'links to other folders': (lambda s: s.at_each(lambda t: t.symlink_to(s.others)), None),
    'links to nothing': (lambda s: s.at_each(lambda t: t.symlink_to('nothing')), None),
    'links to themselves': (lambda s: s.at_each(lambda t: t.symlink_to(t.name)), None),
    'links to a device': (lambda s: s.at_each(lambda t: t.symlink_to('/dev/full')), None),
    'folders with files': (lambda s: s.at_each(lambda t: (
        t.mkdir(), (t / 'kept').write_bytes(OLD))), True),
    'files where folders go': (lambda s: s.at_each(lambda t: t.write_bytes(OLD)), None),
    'pipes': (lambda s: s.at_each(os.mkfifo), True),
    'a link to the folder': (lambda s: (s.out.rmdir(), (s.others / 'there').mkdir(),
                                        s.out.symlink_to(s.others / 'there')), False),
    'a link to the inputs': (lambda s: (s.out.rmdir(), s.out.symlink_to(s.inputs)), False),
    'a file where the folder goes': (lambda s: (s.out.rmdir(), s.out.write_bytes(OLD)), True),
    'no folder': (lambda s: s.out.rmdir(), None),
    'a link to no folder': (lambda s: (s.out.rmdir(), s.out.symlink_to('nothing')), None),
    'what an interrupted run left': (lambda s: (
        (s.out / '.sar_imaging.abcd').mkdir(), (s.out / '.sar_imaging.abcd' / 'x').touch()),
        False),
}


def _old(target: pathlib.Path) -> None:
    """What an earlier run left: a file, or the folder of a recording."""
    if (name := {'new': 'metadata.yaml', 'survey': 'archive.json'}.get(target.name)):
        target.mkdir()
        (target / name).write_bytes(OLD)
    else:
        target.write_bytes(OLD)


def _as_nobody() -> None:
    os.setgid(NOBODY)
    os.setuid(NOBODY)


def _small_files(n_bytes: int) -> Callable[[], None]:
    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, n_bytes))
    return limit


#: What happens to the process: called in it before the command, signal and moment.
EVENTS: dict[str, dict] = {
    **{f'files of at most {n} bytes': {'before': _small_files(n)} for n in (0, 100, 5000)},
    **{f'{name} after {seconds:g} s': {'stop': (seconds, number)}
       for name, number in (('Ctrl-C', signal.SIGINT), ('SIGTERM', signal.SIGTERM),
                            ('SIGKILL', signal.SIGKILL))
       for seconds in (0.05, 0.15, 0.4)},
}


def check(sandbox: Sandbox, status: int | str, text: str, before: dict, fresh: dict[str, int],
          refused: bool | None, killed: bool) -> list[str]:
    """What is wrong after a run."""
    found = []
    lines = [line for line in text.splitlines() if line.startswith('error: ')]
    if status == 1 and len(lines) != 1:
        found.append(f'{len(lines)} lines of errors')
    if any(len(line) > LONGEST_LINE for line in lines) or 'Traceback' in text:
        found.append('no one line')
    if status == 1 and '.sar_imaging.' in text:
        found.append('names a folder that is gone')
    if status not in (0, 1, 3, 130, 'signal SIGTERM') and not killed:
        found.append(f'ended with {status}')
    if refused is not None and not killed and (status == 1) != refused:
        found.append('was not refused' if refused else 'was refused')
    for name, digest in before.items():
        if digests(sandbox.inputs if name == 'inputs' else sandbox.others) != digest:
            found.append(f'changed {name}')
    if sandbox.out.is_dir() and not killed:
        left = [p.name for p in sandbox.out.iterdir() if p.name.startswith('.sar_imaging.')
                and p.name != '.sar_imaging.abcd']
        if left:
            found.append('left a folder behind')
    for target in sandbox.targets():
        if target.is_file() and not target.is_symlink():
            size = target.stat().st_size
            known = fresh.get(target.name)
            if known and size != len(OLD) and abs(size - known) > max(200, 0.2 * known) and (
                    status != 0) and target.stat().st_nlink == 1:
                found.append(f'half of {target.name}: {size} of {known} bytes')
    return found


def campaign(output: Output, names: Sequence[str] = ()) -> dict:
    """Figures and faults of one output."""
    found: dict = {'runs': 0, 'written': 0, 'refused': 0, 'stopped': 0, 'faults': []}
    fresh: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = pathlib.Path(place)
        folder.chmod(0o755)
        (folder / 'valid').mkdir()
        _forked(lambda: output.make(folder / 'valid'))
        for name, options in [*((n, {'put': p, 'refused': r}) for n, (p, r) in PLACES.items()),
                              *EVENTS.items(), ('a full disk', {'disk': True}),
                              ('a folder of somebody else', {'before': _as_nobody,
                                                             'refused': True})]:
            if names and name not in names:
                continue
            if 'somebody else' in name and os.geteuid():
                continue  # needs the rights to become somebody else
            sandbox = _sandbox(folder, output)
            disk = options.get('disk') and _mounted(sandbox.out)
            if options.get('disk') and not disk:
                continue  # needs the rights to mount one
            options.get('put', lambda s: None)(sandbox)
            refused = options.get('refused')
            if refused is False and not output.patient or 'input' in name and not output.reads:
                refused = None
            before_it = [output.before, options.get('before', lambda: None)]
            if 'at most' in name or 'after' in name:  # old files stay, or new ones are whole
                sandbox.at_each(_old)
            before = {'inputs': digests(sandbox.inputs), 'others': digests(sandbox.others)}
            words = [w.format(**{'in': sandbox.inputs, 'out': sandbox.out})
                     for w in output.words]
            killed = 'SIGKILL' in name
            try:
                status, text, _ = run(words, sandbox.others, LIMIT_S,
                                      before=lambda calls=before_it: [c() for c in calls],
                                      stop=options.get('stop'), memory_bytes=output.memory_bytes)
                if name in ('a link to the inputs', 'a link to the folder'):
                    before = {}  # new files are beside the old ones: see below
                wrong = check(sandbox, status, text, before, fresh, refused, killed)
                if name == 'a link to the inputs' and any(
                        digests(folder / 'valid').get(k) != v
                        for k, v in digests(sandbox.inputs).items()
                        if k in digests(folder / 'valid')):
                    wrong.append('changed inputs')
            finally:
                if disk:
                    subprocess.run(['umount', str(sandbox.out)], check=True)
            if name == 'nothing':
                fresh = {t.name: t.stat().st_size for t in sandbox.targets() if t.is_file()}
                missing = [t.name for t in sandbox.targets() if not t.exists()]
                wrong += [f'no {n}' for n in missing]
            found['runs'] += 1
            found['written' if status in (0, 3) else 'refused' if status == 1 else
                  'stopped'] += 1
            if wrong:
                found['faults'].append([name, '; '.join(wrong), text[-600:]])
    return found


def _sandbox(folder: pathlib.Path, output: Output) -> Sandbox:
    """New folders of a run."""
    for name in ('inputs', 'out', 'others'):
        path = folder / name
        if path.is_symlink() or path.is_file():
            path.unlink()
        shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(folder / 'valid', folder / 'inputs')
    (folder / 'out').mkdir()
    (folder / 'others').mkdir()
    sandbox = Sandbox(folder / 'inputs', folder / 'out', folder / 'others', output)
    sandbox.precious().write_bytes(b'precious')
    return sandbox


def _mounted(path: pathlib.Path) -> bool:
    """Whether a disk of 4 kB could be mounted there."""
    return shutil.which('mount') is not None and subprocess.run(
        ['mount', '-t', 'tmpfs', '-o', 'size=4k', 'tmpfs', str(path)],
        capture_output=True).returncode == 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns 1 where a fault was found."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument('--outputs', nargs='+', help='parts of their names (default: all)')
    p.add_argument('--places', nargs='+', default=(), help='names of places and events')
    p.add_argument('--output', type=pathlib.Path, help='file for the results')
    arguments = p.parse_args(argv)
    prepare()
    results: dict = {'machine': machine(), 'memory_bytes': MEMORY_BYTES, 'outputs': {}}
    for output in OUTPUTS:
        if arguments.outputs and not any(n in output.name for n in arguments.outputs):
            continue
        found = campaign(output, arguments.places)
        results['outputs'][output.name] = found
        print(f'{output.name:22} {found["runs"]:3} runs: {found["written"]:3} written, '
              f'{found["refused"]:3} refused, {found["stopped"]:3} stopped, '
              f'{len(found["faults"])} faults', flush=True)
        for told, wrong, text in found['faults']:
            print(f'    {told} | {wrong} | {text.strip()[-260:]!r}', flush=True)
        if arguments.output:
            arguments.output.write_text(json.dumps(results, indent=1) + '\n')
    return int(any(found['faults'] for found in results['outputs'].values()))


if __name__ == '__main__':
    sys.exit(main())
