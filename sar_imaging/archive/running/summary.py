"""What a job did: its bar in the terminal, what was made, what is lost and why, and the status."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from tqdm import tqdm

ALL_DONE, REFUSED, WITH_LOSSES, INTERRUPTED = 0, 1, 3, 130


@dataclasses.dataclass(frozen=True)
class Loss:
    """A piece that is not there.

    Attributes
    ----------
    key : str
        The piece.
    reason : str
        One line.
    where : str
        Last lines of the traceback, where there was one.
    """

    key: str
    reason: str
    where: str = ''


@dataclasses.dataclass(frozen=True)
class Summary:
    """What `run_pieces` did.

    Attributes
    ----------
    n_pieces : int
        Of the job.
    n_computed : int
        Computed in this run.
    n_found : int
        Finished by an earlier run.
    losses : tuple of Loss
        In the order of the pieces.
    stopped : str
        Why the job stopped before its end, one line; '' when it did not.
    interrupted : bool
        Ctrl-C.
    seconds : float
        Of this run, on the clock.
    computing_seconds : float
        Of all pieces of this run, on their workers.
    peak_bytes : int
        Largest resident memory of a worker.
    peak_key : str
        The piece that took it.
    """

    n_pieces: int
    n_computed: int
    n_found: int
    losses: tuple[Loss, ...]
    stopped: str = ''
    interrupted: bool = False
    seconds: float = 0.0
    computing_seconds: float = 0.0
    peak_bytes: int = 0
    peak_key: str = ''

    @property
    def exit_status(self) -> int:
        """0 all is done, 3 with losses, 1 stopped, 130 interrupted by Ctrl-C."""
        if self.interrupted:
            return INTERRUPTED
        if self.stopped:
            return REFUSED
        return WITH_LOSSES if self.losses else ALL_DONE

    def as_json(self) -> dict:
        """For summary.json."""
        return {**dataclasses.asdict(self), 'exit_status': self.exit_status}

    def __add__(self, other: Summary) -> Summary:
        """Two stages of a job as one."""
        larger = max(self, other, key=lambda summary: summary.peak_bytes)
        return Summary(
            self.n_pieces + other.n_pieces, self.n_computed + other.n_computed,
            self.n_found + other.n_found, self.losses + other.losses,
            self.stopped or other.stopped, self.interrupted or other.interrupted,
            self.seconds + other.seconds, self.computing_seconds + other.computing_seconds,
            larger.peak_bytes, larger.peak_key)

    def told(self, output: Path) -> str:
        """For people: every loss with its reason, and how to go on."""
        done = self.n_computed + self.n_found
        before = f', {self.n_found} of them by an earlier run' if self.n_found else ''
        lines = [f'{done} of {self.n_pieces} pieces done{before}, {len(self.losses)} lost, in '
                 f'{duration(self.seconds)}; results in {output}']
        if self.peak_bytes:
            lines.append(f'largest memory of a worker: {self.peak_bytes / 1e9:.2f} GB '
                         f'({self.peak_key})')
        return '\n'.join([*lines, *self.troubles()])

    def troubles(self) -> list[str]:
        """Every loss with its reason, and what stopped the job, a line each."""
        lines = [f'lost: {loss.key}: {loss.reason}' for loss in self.losses]
        if self.interrupted:
            lines.append('interrupted; the same command goes on where it stopped')
        elif self.stopped:
            lines.append(f'stopped: {self.stopped}')
        return lines


def duration(seconds: float) -> str:
    """A time as people say it: '40 s', '12 min', '3.5 h', '2.1 days'."""
    for unit, name, most in ((1, 's', 120), (60, 'min', 7200), (3600, 'h', 172800)):
        if seconds < most:
            return f'{seconds / unit:.3g} {name}'
    return f'{seconds / 86400:.3g} days'


class Progress:
    """A bar for a job's pieces; silent where the output is no terminal.

    Parameters
    ----------
    n_pieces : int
        Of the job.
    predicted_seconds : float
        Of all pieces together, on one worker.
    """

    def __init__(self, n_pieces: int, predicted_seconds: float):
        self._left = predicted_seconds
        self._predicted = self._measured = 0.0
        self._losses = 0
        self._bar = tqdm(total=n_pieces, unit='piece', disable=None, dynamic_ncols=True,
                         bar_format='{l_bar}{bar}| {n_fmt}/{total_fmt} pieces, {elapsed}'
                                    '{postfix}')

    def done(self, predicted_seconds: float, seconds: float | None = None) -> None:
        """A piece is finished; `seconds` None: by an earlier run."""
        self._left -= predicted_seconds
        if seconds is not None:
            self._predicted += predicted_seconds
            self._measured += seconds
        self._bar.update()

    def lost(self, predicted_seconds: float) -> None:
        """A piece is lost."""
        self._left -= predicted_seconds
        self._losses += 1
        self._bar.update()

    def show(self, n_threads: int) -> None:
        """Tell how long it takes with so many threads of workers."""
        if not n_threads:
            told = 'waiting for workers'
        else:
            told = f'{duration(max(self.seconds_left(n_threads), 0))} left'
        self._bar.set_postfix_str(f'{told}, {self._losses} lost', refresh=False)
        self._bar.refresh()

    def seconds_left(self, n_threads: int) -> float:
        """Predicted from the pieces to come, corrected by what those until now took."""
        pace = self._measured / self._predicted if self._predicted else 1.0
        return self._left * pace / n_threads

    def close(self) -> None:
        """Leave the bar as it is."""
        self._bar.close()
