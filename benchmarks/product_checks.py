# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every product of the shipped bags and the examples before the checkers of its standard.

Run from the repository root: ``python -m benchmarks.product_checks``. sarkit's checkers (those of
``sicdcheck`` and ``cphdcheck``), sarpy's and ``rio cogeo validate`` look at all that `sar-imaging
image`, `sar-imaging convert` and the examples of the pages write. What docs/formats.md names of
them is counted, all else is a fault.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import io
import json
import logging
import os
import pathlib
import re
import runpy
import sys
import tempfile
from collections.abc import Iterator, Sequence

from sar_imaging.tools import command

from .support.hostile import valid

ROOT = pathlib.Path(__file__).parent.parent
RESULTS = ROOT / 'benchmarks' / 'results' / 'product_checks.json'
DATUM = ('--datum', '47.0', '8.0', '450.0')
BAGS = ('psf', 'spotlight', 'countryside')
EXAMPLES = ('06_sicd.py', '07_from_cphd_to_a_map.py')
#: What docs/formats.md names, by the beginning or a part of what the checkers tell.
NAMED = {
    'more than 2.2 pixels to a cell': r'check_iprbw_to_ss_osr_(row|col): Warning: (Row|Col) OSR',
    'the algorithm is OTHER': r'WARNING: SICDType: Image formation algorithm populated as "OTHER"',
    'no radiometric data': r'WARNING: SICDType: No Radiometric data provided',
    'a radar below the horizon': r'ERROR: SCPCOAType: attribute (Graze|Incidence|Layover)Ang is '
                                 r'expected to have value (-0\.0|90\.0)',
    'aFRR1 and aFRR2 are zero': r'check_channel_afrr1_afrr2_relative_.*: Warning: aFRR1 == '
                                r'\(FX1 \+ FX2\) \* aFRR2 / 2'}


def products(folder: pathlib.Path) -> Iterator[pathlib.Path]:
    """Files that commands and examples write."""
    for bag in BAGS:  # psf and countryside are range profiles
        source = ROOT / 'bags' / bag
        for plane in ('ground', 'slant'):
            formats = 'png,geotiff,sicd,kml,stac' if plane == 'ground' else 'sicd'
            out = folder / f'{bag} {plane}'
            yield from _written(out, 'image', source, '--output', out, '--format', formats,
                                '--plane', plane, *DATUM)
        for sample_type in ('CF8', 'CI4', 'CI2'):
            target = folder / f'{bag} TOA {sample_type}.cphd'
            yield from _written(target, 'convert', source, target, '--domain', 'TOA',
                                '--sample-type', sample_type, *DATUM)
        again, out = folder / f'{bag} again.cphd', folder / f'{bag} of CPHD'
        first = folder / f'{bag} TOA CF8.cphd'
        yield from _written(again, 'convert', first, again)
        yield from _written(out, 'image', first, '--output', out, '--format', 'geotiff,sicd')
        target = folder / f'{bag} levels.tif'
        yield from _written(target, 'convert', folder / f'{bag} ground' / 'image.nitf', target)
    valid.bag(folder)  # of stepped frequency
    for sample_type in ('CF8', 'CI4', 'CI2'):
        target = folder / f'steps FX {sample_type}.cphd'
        yield from _written(target, 'convert', folder / 'bag', target, '--domain', 'FX',
                            '--sample-type', sample_type)
    for name in EXAMPLES:
        within = folder / name / 'run'  # examples look for the bags above
        within.mkdir(parents=True)
        (folder / name / 'bags').symlink_to(ROOT / 'bags')
        before, tempfile.tempdir = tempfile.tempdir, str(within)
        try:
            with contextlib.chdir(within), contextlib.redirect_stdout(io.StringIO()):
                runpy.run_path(str(ROOT / 'docs' / 'examples' / name), run_name='__main__')
        finally:
            tempfile.tempdir = before
        yield from _files(within)


def _written(target: pathlib.Path, *words) -> Iterator[pathlib.Path]:
    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
        status = command.main([str(w) for w in words])
    if status != 0:
        print(f'{" ".join(map(str, words[:1]))} {target.name}: '
              f'{told.getvalue().strip().splitlines()[-1]}')
    elif target.is_dir():
        yield from _files(target)
    else:
        yield target


def _files(folder: pathlib.Path) -> list[pathlib.Path]:
    return sorted(p for p in folder.rglob('*') if p.is_file() and not p.is_symlink()
                  and 'bags' not in p.parts)


def told_by_sarkit(path: pathlib.Path) -> list[str]:
    """Errors and warnings of sarkit's checkers."""
    from sarkit import verification

    kind = {'.nitf': verification.SicdConsistency, '.cphd': verification.CphdConsistency}
    with open(path, 'rb') as file:
        checker = kind[path.suffix].from_file(file, **(
            {'thorough': True} if path.suffix == '.cphd' else {}))
        checker.check()
    return [f'{name}: {detail["severity"]}: {detail["details"]}'
            for name, told in checker.failures(omit_passed_sub=True).items()
            for detail in told['details'] if not detail['passed']]


def told_by_sarpy(path: pathlib.Path) -> list[str]:
    """Errors and warnings of sarpy's checkers."""
    if path.suffix == '.nitf':
        from sarpy.consistency.sicd_consistency import check_file

        lines: list[str] = []
        handler = logging.Handler()
        handler.emit = lambda record: lines.append(f'{record.levelname}: {record.getMessage()}')
        logger = logging.getLogger('validation')
        logger.addHandler(handler)
        level, logger.level = logger.level, logging.INFO
        try:
            valid = check_file(str(path))
        finally:
            logger.removeHandler(handler)
            logger.level = level
        told = [' '.join(line.split()) for line in lines if not line.startswith('INFO')]
        return told if valid or told else ['it is not valid']
    from sarpy.consistency.cphd_consistency import CphdConsistency

    checker = CphdConsistency.from_file(str(path), check_signal_data=True)
    checker.check()
    return [f'{name}: {detail["severity"]}: {detail["details"]}'
            for name, told in checker.failures().items() for detail in told['details']
            if not detail['passed']]


def told_by_rio(path: pathlib.Path) -> list[str]:
    """Errors and warnings of ``rio cogeo validate --strict``."""
    from rio_cogeo.cogeo import cog_validate

    valid, errors, warnings = cog_validate(str(path), strict=True)
    return [*errors, *warnings] if errors or warnings or not valid else []


CHECKS = {'.nitf': (told_by_sarkit, told_by_sarpy), '.cphd': (told_by_sarkit, told_by_sarpy),
          '.tif': (told_by_rio,)}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns 1 where a checker told something."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument('--output', type=pathlib.Path, help='file for the results')
    arguments = p.parse_args(argv)
    checked: collections.Counter[str] = collections.Counter()
    named: collections.Counter[str] = collections.Counter()
    told: dict[str, dict[str, list[str]]] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = pathlib.Path(place)
        for path in products(folder):
            for check in CHECKS.get(path.suffix, ()):
                name = str(path.relative_to(folder))
                try:
                    found = check(path)
                except Exception as error:
                    found = [f'{check.__name__} failed: {type(error).__name__}: {error}']
                checked[f'{path.suffix[1:]}, {check.__name__[8:]}'] += 1
                other = []
                for text in found:
                    known = [key for key, start in NAMED.items() if re.match(start, text)]
                    named.update(known)
                    other += [] if known else [text]
                if other:
                    told.setdefault(name, {})[check.__name__] = other
                    print(name, check.__name__, *other, sep='\n    ', flush=True)
    print(*(f'{name}: {n} files' for name, n in sorted(checked.items())),
          *(f'named: {name}: {n} times' for name, n in named.items()), sep='\n')
    if arguments.output:
        arguments.output.write_text(json.dumps({
            'checked': checked, 'named': named, 'told': told}, indent=1)
                                    + os.linesep)
    return int(bool(told))


if __name__ == '__main__':
    sys.exit(main())
