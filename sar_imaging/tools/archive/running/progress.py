"""The bar in the terminal: pieces, predicted time that is left, losses."""

from __future__ import annotations

from tqdm import tqdm

from .summary import duration


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
