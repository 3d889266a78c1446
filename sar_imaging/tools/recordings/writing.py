"""Common parts of the programs that write recordings: cutting into messages, progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from tqdm import tqdm

from sar_imaging.signal.pulses import PulseBlock

from ..ending import run_command
from .bag_io import check_target, write_bag

PULSES_PER_MESSAGE = 32


def split(block: PulseBlock, pulses_per_message: int = PULSES_PER_MESSAGE) -> Iterator[PulseBlock]:
    """Cut a block into blocks for one message each."""
    for first in range(0, block.n_pulses, pulses_per_message):
        yield block.select(slice(first, first + pulses_per_message))


def convert(read: Callable[[], PulseBlock], truth: Callable[[PulseBlock], dict], output: Path, *,
            overwrite: bool) -> int:
    """Write what was measured as a bag; returns the exit status of the program.

    Parameters
    ----------
    read : callable
        Reads the whole measurement; called once the target was checked.
    truth : callable
        Truth of the recording, see `recordings.make_truth`.
    output : Path
        Bag folder to make.
    overwrite : bool
        Replace an existing bag.
    """
    def write() -> str:
        check_target(output, overwrite=overwrite)
        block = read()
        count = write_bag(output, with_progress(split(block), block.n_pulses), truth(block),
                          overwrite=overwrite)
        return f'{output}: {block.n_pulses} pulses in {count} messages'

    return run_command(write)


def with_progress(blocks: Iterator[PulseBlock], n_pulses: int) -> Iterator[PulseBlock]:
    """Pass blocks on and show on a terminal how many of `n_pulses` have passed."""
    with tqdm(total=n_pulses, unit='pulse', disable=None) as bar:
        for block in blocks:
            yield block
            bar.update(block.n_pulses)
