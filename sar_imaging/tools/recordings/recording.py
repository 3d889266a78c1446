"""Pulses, apertures and phase centres of a recording, as evaluation needs them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.poses import PoseStatus, PoseTrack
from sar_imaging.geometry.track_frame import mean_centres
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

from .bag_io import BagError, deserialise, raw_messages, read_poses, read_truth


@dataclasses.dataclass(frozen=True)
class Aperture:
    """Pulses of a recording that make one image.

    Parameters
    ----------
    number : int
        ``counter // pulses_per_aperture``.
    n_pulses : int
        Different pulses of it in the recording.
    first_ns, last_ns : int
        Times of its first and last pulse, nanoseconds.
    last_message : int
        Index of the message with its last pulse.
    """

    number: int
    n_pulses: int
    first_ns: int
    last_ns: int
    last_message: int


@dataclasses.dataclass(frozen=True)
class Recording:
    """Index of a recording.

    Parameters
    ----------
    path : Path
        Bag folder.
    truth : dict or None
        What `bag_io.make_truth` stored with it.
    radar : RadarParameters
        Of its first readable message.
    n_messages : int
        Messages on `/pulses`.
    n_unreadable : int
        Of these, messages that hold no pulse block.
    counter : (P,) int64
        Pulse counters, in the order recorded.
    stamp_ns : (P,) int64
        Pulse times, nanoseconds.
    message : (P,) int64
        Index of the message of each pulse.
    phase_centre_m : (P, 3) float64 or None
        Mean phase centres, metres, of the pulses or by the poses recorded with them; None when
        the recording has neither.
    """

    path: Path
    truth: dict | None
    radar: RadarParameters
    n_messages: int
    n_unreadable: int
    counter: np.ndarray
    stamp_ns: np.ndarray
    message: np.ndarray
    phase_centre_m: np.ndarray | None

    @property
    def grid(self) -> MapGrid | None:
        """Grid that the truth proposes."""
        if self.truth is None:
            return None
        grid = self.truth['grid']
        return MapGrid(grid['centre_m'], grid['n_x'], grid['n_y'], grid['spacing_m'])

    @property
    def datum(self) -> Datum | None:
        """Where the imaging frame stands on the Earth, where the recording tells.

        Raises
        ------
        BagError
            What it tells is no datum.
        """
        fields = (self.truth or {}).get('datum')
        try:
            return None if fields is None else Datum(**fields)
        except (TypeError, ValueError) as error:
            raise BagError(f'{self.path}: the datum of the recording: {error}') from error

    def apertures(self, pulses_per_aperture: int) -> list[Aperture]:
        """Apertures in the order of their numbers."""
        numbers = self.counter // pulses_per_aperture
        out = []
        for number in np.unique(numbers):
            index = np.flatnonzero(numbers == number)
            stamps = self.stamp_ns[index]
            out.append(Aperture(int(number), np.unique(self.counter[index]).size,
                                int(stamps.min()), int(stamps.max()),
                                int(self.message[index[self.counter[index].argmax()]])))
        return out

    def phase_centre_at(self, stamp_ns: int) -> np.ndarray:
        """(3,) float64 phase centre at a time, interpolated between pulses, metres."""
        order = np.argsort(self.stamp_ns, kind='stable')
        # nanoseconds since 1970 do not fit a float64, those since the first pulse do
        seconds = (self.stamp_ns[order] - self.stamp_ns[order[0]]) * 1e-9
        at = (stamp_ns - int(self.stamp_ns[order[0]])) * 1e-9
        return np.array([np.interp(at, seconds, axis) for axis in self.phase_centre_m[order].T])


def read_recording(path: Path | str) -> Recording:
    """Read through a recording once.

    Parameters
    ----------
    path : path
        Bag folder.

    Returns
    -------
    Recording
        Its index.

    Raises
    ------
    BagError
        The folder is no bag with `/pulses`, or no message holds a pulse block.
    """
    truth = read_truth(path)
    poses = read_poses(path)
    track = None if poses is None else poses.track()
    counter, stamp_ns, message, centre = [], [], [], []
    radar, n_messages, problem = None, 0, None
    for index, (_, cdr) in enumerate(raw_messages(path)):
        n_messages += 1
        try:
            block = deserialise(cdr)
        except Exception as error:  # damaged bytes fail in many ways; nodes have to live with them
            problem = error
            continue
        radar = radar or block.radar
        counter.append(block.counter.astype(np.int64))
        stamp_ns.append(block.stamp_ns)
        message.append(np.full(block.n_pulses, index))
        if block.has_positions:
            centre.append(block.phase_centre_m)
        elif track is not None and truth is not None and 'alignment' in truth:
            centre.append(_phase_centre(block, track, Alignment(**truth['alignment'])))
    if radar is None:
        raise BagError(f'{path}: none of {n_messages} messages holds a pulse block'
                       + (f'; the last one: {problem}' if problem else ''))
    return Recording(
        Path(path), truth, radar, n_messages, n_messages - len(counter),
        np.concatenate(counter), np.concatenate(stamp_ns), np.concatenate(message),
        np.concatenate(centre) if len(centre) == len(counter) else None)


def _phase_centre(block: PulseBlock, track: PoseTrack, alignment: Alignment) -> np.ndarray:
    """(P, 3) mean phase centres of pulses by the poses recorded with them."""
    poses = track.sample(block.stamp_ns + alignment.time_offset_ns, final=True)
    if (poses.status != PoseStatus.READY).any():
        raise BagError('the recording has pulses without poses around them')
    tx_m, rx_m = alignment.phase_centres(poses.position_m, poses.attitude, block.n_channels)
    return mean_centres(tx_m, rx_m)
