"""What is finished: a small file for each piece, written after the piece's own files."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..jobs.stored import bring_to_disk, write_text


def fingerprint(piece: Any, needs: Mapping[str, str | None]) -> str:
    """Digest of all that decides what a piece computes.

    Parameters
    ----------
    piece : Piece
        Its `fingerprint` tells all of it but the predictions.
    needs : mapping of str to str
        Fingerprints of the pieces that it needs by their keys; None for one that is lost.

    Returns
    -------
    str
        Changes when the piece does, when one of its needs is computed anew, and when one that
        was lost is there now.
    """
    text = json.dumps([piece.fingerprint(), sorted(needs.items())])
    return hashlib.sha256(text.encode()).hexdigest()


def write_whole(path: Path, text: str) -> None:
    """Write a file that is there whole or not at all, even if the power fails.

    Parameters
    ----------
    path : path
        Its folder exists.
    text : str
        What it says.
    """
    write_text(path, text)
    bring_to_disk(path.parent)


def sync_files(paths: Iterable[Path]) -> None:
    """Bring files to the disk, and their names; folders and what is missing are passed over."""
    folders = set()
    for path in paths:
        if path.is_file():
            bring_to_disk(path)
            folders.add(path.parent)
    for folder in sorted(folders):
        bring_to_disk(folder)


@dataclasses.dataclass(frozen=True)
class Records:
    """Records of finished pieces in an output folder.

    Attributes
    ----------
    output : path
        Output folder of the job.
    """

    output: Path

    def path(self, key: str, suffix: str = '.json') -> Path:
        """File of a piece, in one of 256 folders, for a million in one are slow to look up."""
        name = hashlib.sha256(key.encode()).hexdigest()[:32]
        return self.output / 'records' / name[:2] / (name + suffix)

    def prepare(self) -> None:
        """Make the folders, and remove notes that a killed job left."""
        for number in range(256):
            folder = self.output / 'records' / f'{number:02x}'
            folder.mkdir(parents=True, exist_ok=True)
            for path in folder.iterdir():
                if path.suffix == '.starts':
                    path.unlink(missing_ok=True)

    def ready(self) -> bool:
        """Whether this machine sees the folders that the job's own machine made."""
        return (self.output / 'records' / 'ff').is_dir()

    def read(self, key: str, mark: str) -> dict | None:
        """Record of a finished piece.

        Parameters
        ----------
        key : str
            Of the piece.
        mark : str
            Its fingerprint.

        Returns
        -------
        dict or None
            What `write` wrote; None where the piece must be computed: there is no record, or one
            of something else, or a file of the piece has gone.
        """
        try:
            record = json.loads(self.path(key).read_text())
        except (FileNotFoundError, ValueError):
            return None
        if not isinstance(record, dict) or record.get('fingerprint') != mark:
            return None
        files = (record.get('result') or {}).get('files') or ()
        return record if all((self.output / name).exists() for name in files) else None

    def write(self, key: str, mark: str, *, result: dict, **told) -> dict:
        """Record that a piece is finished, after its own files are on the disk; returns it.

        Parameters
        ----------
        key, mark : str
            Key and fingerprint of the piece.
        result : dict
            What it returned, for JSON; `files`, where given, are names relative to the output.
        **told
            More for the record: seconds, memory, worker.
        """
        sync_files(self.output / name for name in result.get('files') or ())
        record = {'key': key, 'fingerprint': mark, 'result': result, **told}
        write_whole(self.path(key), json.dumps(record))
        return record

    def forget(self, key: str) -> None:
        """Remove the record of a piece."""
        self.path(key).unlink(missing_ok=True)

    def start(self, key: str, run: str) -> int:
        """Note that a worker starts a piece; returns how often workers did in this run.

        A worker that dies leaves its note, which tells the piece that killed it from those that
        only waited on the same worker.
        """
        with self.path(key, '.starts').open('a') as file:
            file.write(run + '\n')
        return self.starts(key, run)

    def starts(self, key: str, run: str) -> int:
        """How often workers started this piece in this run without finishing it."""
        try:
            return self.path(key, '.starts').read_text().splitlines().count(run)
        except FileNotFoundError:
            return 0

    def finish(self, key: str) -> None:
        """Remove the notes of starts."""
        self.path(key, '.starts').unlink(missing_ok=True)
