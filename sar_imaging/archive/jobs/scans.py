"""What a scan of a recording tells: its apertures with their antennas, or why it is lost."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...geometry.earth import Datum
from ...geometry.illumination import AntennaPattern, PatternCut, Pointing
from ...imaging.radiometry import Radiometry
from ...radiometry import BrightnessScale
from ...signal.radar import RadarParameters
from .windows import Window

_CUTS = ('azimuth', 'elevation')


def turned(looks: Pointing | None, own: Datum | None, wanted: Datum | None) -> Pointing | None:
    """Pointing in another frame; the same where either frame stands nowhere."""
    if looks is None or own is None or wanted is None or own == wanted:
        return looks
    return Pointing(*(wanted.vectors_from_ecef(own.vectors_to_ecef(axes))
                      for axes in (looks.boresight, looks.up)))


def antenna_arrays(pattern: AntennaPattern | None, looks: Pointing | None
                   ) -> dict[str, np.ndarray]:
    """An antenna as arrays of a file, to the bit; none where there is no antenna."""
    if pattern is None:
        return {}
    arrays = {'boresight': looks.boresight, 'up': looks.up}
    for name in _CUTS:
        cut = getattr(pattern, name)
        arrays[name] = np.array([cut.start, cut.step, *cut.amplitude])
    return arrays


def antenna_of_arrays(arrays: Mapping[str, np.ndarray]
                      ) -> tuple[AntennaPattern | None, Pointing | None]:
    """What `antenna_arrays` wrote: the pattern, and where it looked at each pulse."""
    if _CUTS[0] not in arrays:
        return None, None
    cuts = (PatternCut(float(v[0]), float(v[1]), v[2:]) for v in map(arrays.__getitem__, _CUTS))
    return (AntennaPattern(*cuts),
            Pointing.of_unit_vectors(arrays['boresight'], arrays['up']))


_SCALE = 'scale_root', 'scale_rows', 'scale_columns'


def scale_arrays(scale: BrightnessScale | None) -> dict[str, np.ndarray]:
    """A scale as arrays of a file, to the bit; none where there is none."""
    return {} if scale is None else dict(zip(_SCALE, (scale.root, *scale.knots), strict=True))


@dataclasses.dataclass(frozen=True)
class Loss:
    """Something of an archive that no image is made of.

    Attributes
    ----------
    name : str
        Recording, aperture or piece.
    path : Path or None
        Of the recording, where there is one.
    reason : str
        One line.
    """

    name: str
    path: Path | None
    reason: str


@dataclasses.dataclass(frozen=True)
class RecordingScan:
    """What the scan of a recording told.

    Attributes
    ----------
    name : str
        Of the recording.
    apertures : tuple of ApertureScan
        Those that can be imaged.
    losses : tuple of Loss
        Those that cannot, or the recording itself.
    """

    name: str
    apertures: tuple[ApertureScan, ...] = ()
    losses: tuple[Loss, ...] = ()


@dataclasses.dataclass(frozen=True)
class Division:
    """How the image of an aperture is divided into pieces.

    Attributes
    ----------
    windows : tuple of Window
        Parts of its window, each of which reads the pulses; they touch and do not overlap.
    pulses : tuple of (int, int)
        Parts of its pulses, ascending: first index and the one after the last. With several,
        their images are summed in a fixed binary tree, window by window.
    seconds : float
        Predicted, of the longest piece, on one core.
    total_seconds : float
        Predicted, of all its pieces, on one core.
    memory_bytes : int
        Predicted, of the largest piece: image, what forms it, and blocks of pulses.
    method : str
        By which the pieces are imaged.
    """

    windows: tuple[Window, ...]
    pulses: tuple[tuple[int, int], ...]
    seconds: float
    total_seconds: float
    memory_bytes: int
    method: str = ''


@dataclasses.dataclass(frozen=True)
class ApertureScan:
    """One aperture of a recording, as everything after the scan needs it.

    Attributes
    ----------
    name : str
        Unique within the archive, fit for file names: ``'flight-012_aperture-003'``.
    path : Path
        Recording.
    recording : str
        Its name in the archive: ``'flight-012'``, the name of its strip.
    aperture : int or None
        Number that `open_source` takes; None for a file with one.
    fingerprint : str
        Of the recording: sizes of its files and a checksum of their first and last bytes.
    kind : str
        ``'recording'`` or ``'CPHD'``.
    radar : RadarParameters
        Of its samples.
    n_pulses, n_channels, n_samples : int
        Sizes.
    compressed : bool
        Whether these are range profiles.
    first_ns, last_ns : int
        Times of the first and the last pulse, nanoseconds.
    datum : Datum or None
        Of the recording; its phase centres in `centres` are in the map's frame already.
    footprint_m : ((x, y), ...) floats
        Corners of what it tells something about, in the map's frame, metres.
    window : Window
        Pixels of its image, on the map's lattice.
    centre_m : (3,) floats
        Mean phase centre in the map's frame, metres.
    range_m : float
        Median distance of the window's middle from the phase centres, metres.
    reads_bytes : int
        Of its samples on disk.
    division : Division
        How its image is made.
    centres : str
        File of its phase centres below the output folder: ``'scans/NAME.npz'``.
    warnings : tuple of str
        What a person should know.
    radiometry : Radiometry or None
        What the squared magnitude of its image is, where the job wants calibrated brightness.
    """

    name: str
    path: Path
    recording: str
    aperture: int | None
    fingerprint: str
    kind: str
    radar: RadarParameters
    n_pulses: int
    n_channels: int
    n_samples: int
    compressed: bool
    first_ns: int
    last_ns: int
    datum: Datum | None
    footprint_m: tuple[tuple[float, float], ...]
    window: Window
    centre_m: tuple[float, float, float]
    range_m: float
    reads_bytes: int
    division: Division
    centres: str
    warnings: tuple[str, ...] = ()
    radiometry: Radiometry | None = None

    def message_times(self, output: Path) -> np.ndarray:
        """(P,) int64 times at which messages with the pulses were recorded; none of CPHD."""
        with np.load(output / self.centres) as file:
            return file['message_ns']

    def antenna(self, output: Path) -> tuple[AntennaPattern | None, Pointing | None]:
        """Pattern and pointing of the antenna in the map's frame; None where nobody tells."""
        with np.load(output / self.centres) as file:
            return antenna_of_arrays(file)

    def brightness_scale(self, output: Path) -> BrightnessScale | None:
        """What samples of its image are multiplied by; None where they stay as they are."""
        if self.radiometry is None:
            return None
        with np.load(output / self.centres) as file:
            root, *knots = (file[name] for name in _SCALE)
        return BrightnessScale(root, tuple(knots), self.radiometry)

    def phase_centres(self, output: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Counters (P,), times (P,) ns, and phase centres tx and rx (P, C, 3) in the map's frame.

        Ascending counters; float64 metres; from the file that the scan wrote.
        """
        with np.load(output / self.centres) as file:
            return file['counter'], file['stamp_ns'], file['tx_m'], file['rx_m']
