"""Find the recordings of a job: folders, globs, lists and STAC catalogues."""

from __future__ import annotations

import dataclasses
import glob
import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from sar_imaging.files import read_text, told
from sar_imaging.formats import MissingExtraError, require
from sar_imaging.formats.cphd import CphdError, CphdReader
from sar_imaging.geometry.earth import Datum

from ...recordings.bag_io import BagError, read_truth
from ...recordings.kinds import CPHD, RECORDING, UnknownKindError, kind_of
from .job import Job, JobError

_MOST_CATALOGUE_BYTES = 2**26
_BAG_FILES = ('.mcap', '.db3')


def find_recordings(job: Job) -> dict[str, Path]:
    """Recordings of a job by their names in the archive, sorted by path, each once.

    Of a folder, all recordings and files ``*.cphd`` below it are taken, and folders with nothing
    in them or with the samples of a recording that was never completed: they are lost, and shall
    be told. A glob and a list take whatever they name.

    Raises
    ------
    JobError
        Something named does not exist, is no catalogue, or nothing is found.
    """
    found: dict[str, Path] = {}
    for pattern in job.recordings:
        some = list(_named(pattern, job.output))
        if not some:
            raise JobError(f'recordings: {pattern} holds no recording; expected folders of '
                           'rosbag2 or files *.cphd; name another folder, glob or catalogue')
        for path in some:
            found.setdefault(os.path.realpath(path), path)
    return _with_names(sorted(found.values(), key=str))


def with_datum(job: Job, recordings: dict[str, Path]) -> Job:
    """The job with the datum of the first recording that tells one, where it has none itself."""
    if job.datum is not None:
        return job
    for name, path in recordings.items():
        try:
            datum = _datum(path)
        except (BagError, CphdError, UnknownKindError, OSError, ValueError):
            continue  # lost, as its scan will tell
        if datum is not None:
            return dataclasses.replace(job, datum=datum, datum_from=name)
    return job


def _datum(path: Path) -> Datum | None:
    kind = kind_of(path)
    if kind == RECORDING:
        fields = (read_truth(path) or {}).get('datum')
        return None if fields is None else Datum(**fields)
    if kind == CPHD:
        with CphdReader(path) as reader:
            return reader.datum
    return None


def _named(pattern: str, output: Path) -> Iterator[Path]:
    """What a pattern names."""
    path = Path(pattern)
    if path.is_dir():
        yield from [path] if _is_recording(path) else _below(path, {output.resolve()})
    elif path.suffix.lower() == '.json' and path.is_file():
        yield from _of_catalogue(path)
    elif path.exists():
        yield path
    elif glob.has_magic(pattern):
        yield from map(Path, glob.glob(pattern, recursive=True))
    else:
        raise JobError(f'recordings: {pattern} does not exist; expected a folder, a file, a glob '
                       'or a STAC catalogue; correct the path')


def _is_recording(path: Path) -> bool:
    return (path / 'metadata.yaml').is_file()


def _below(folder: Path, seen: set[Path]) -> Iterator[Path]:
    """Recordings below a folder but folders `seen`, such as the job's output or by links."""
    for path in folder.iterdir():
        if path.name.startswith('.'):
            continue
        if path.is_dir():
            if (real := path.resolve()) in seen:
                continue
            seen.add(real)
            inside = list(path.iterdir())
            if (not inside or _is_recording(path)
                    or any(p.suffix.lower() in _BAG_FILES for p in inside)):
                yield path
            else:
                yield from _below(path, seen)
        elif path.suffix.lower() == '.cphd':
            yield path


def _of_catalogue(path: Path) -> Iterator[Path]:
    """Files of pulses that the items of a STAC catalogue have as assets."""
    try:
        pystac = require('pystac', 'reading a STAC catalogue', 'archive')
    except MissingExtraError as error:
        raise JobError(str(error)) from error

    class Local(pystac.stac_io.DefaultStacIO):
        def read_text_from_href(self, href: str) -> str:
            if '://' in href:
                raise ValueError(f'it leads to {href}; expected files on a disk')
            return read_text(href, _MOST_CATALOGUE_BYTES)

    try:
        entry = pystac.read_file(str(path), stac_io=Local())
        items = [entry] if isinstance(entry, pystac.Item) else list(
            entry.get_items(recursive=True))
        assets = [(item.id, href) for item in items for asset in item.assets.values()
                  if _is_of_pulses(href := asset.get_absolute_href(), asset)]
    except Exception as error:  # pystac has several, and those of JSON and of files besides
        raise JobError(f'recordings: {path} is no STAC catalogue that can be read '
                       f'({told(error)}); expected a catalogue, collection or item whose links '
                       'lead to files; correct it, or name folders') from error
    for item, href in assets:
        if '://' in href:
            raise JobError(f'recordings: item {item} of {path} lies at {href}; expected files on '
                           'a disk; download them, or mount where they lie')
        yield Path(href)


def _is_of_pulses(href: str, asset) -> bool:
    """Whether an asset is a recording or CPHD, and no image made of it."""
    return (href.lower().endswith('.cphd') or 'cphd' in (asset.media_type or '')
            or 'recording' in (asset.roles or ()) or _is_recording(Path(href)))


def _with_names(paths: list[Path]) -> dict[str, Path]:
    """Names that are unique and fit for files: of the path, with as many folders as that takes."""
    def name(path: Path, depth: int) -> str:
        own = path.stem if path.suffix.lower() == '.cphd' else path.name
        text = '_'.join([*path.absolute().parts[-depth:-1], own])
        return re.sub(r'[^\w.-]+', '_', text).strip('.') or 'recording'

    depths = dict.fromkeys(paths, 1)
    while True:
        names = {path: name(path, depth) for path, depth in depths.items()}
        count = Counter(text.lower() for text in names.values())
        same = [path for path, text in names.items() if count[text.lower()] > 1]
        longer = [path for path in same if depths[path] < len(path.absolute().parts)]
        if not longer:  # what is still the same differs in characters that names cannot have
            for number, path in enumerate(same):
                names[path] = f'{names[path]}_{number}'
            return {text: path for path, text in names.items()}
        depths.update({path: depths[path] + 1 for path in longer})
