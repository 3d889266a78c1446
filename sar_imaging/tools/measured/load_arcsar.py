"""Convert a recording of a 77 GHz FMCW radar on a rotating arm to a rosbag2 recording.

Run: python -m sar_imaging.tools.measured.load_arcsar FILE --output out/bags/arcsar

The antenna goes round half a circle and faces outward, so that its track is as curved as can be:
no straight-track imager applies. A file holds the beat signals of the ramps as the radar's
converter board writes them, and nothing else; all numbers below come with the data.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock

from ..recordings.bag_io import BagError, make_truth
from ..recordings.writing import convert

RADIUS_M = 0.2105  # of the antenna's circle, found by focusing
N_SAMPLES = 256
START_HZ, SLOPE_HZ_PER_S, SAMPLE_RATE_HZ, ADC_START_S = 77e9, 39.058e12, 2.652e6, 3.94e-6
NOMINAL_PRF_HZ = 20.0  # the files hold no times
START_NS = 1_700_000_000_000_000_000
POINTS_M = ((1.32, 2.96), (-0.94, 3.58))  # where recording 7 has point scatterers
# Of Prova_Esterna_7.bin, whatever it is called: the others have their scatterers elsewhere.
RECORDING_7_SHA256 = '145bee94a998321c3dc451e540bab98d03b44138dd7bf34878da07d88c3ca534'

_DESCRIPTION = """\
Convert a recording of the arc SAR (Prova_Esterna_7.bin or _10.bin, TI AWR1642 at 77 GHz on a
rotating arm) to a rosbag2 recording of raw FMCW pulse blocks. The files hold no times: pulses are
stamped at a nominal 20 Hz.
"""


def read_file(path: Path | str, *, radius_m: float = RADIUS_M) -> PulseBlock:
    """Read one recording.

    Parameters
    ----------
    path : path
        File of little-endian 16-bit integers, in fours: the in-phase parts of two samples, then
        their quadratures.
    radius_m : float
        Of the circle of the antenna's phase centre, metres.

    Returns
    -------
    PulseBlock
        Raw FMCW samples ``(P, 1, 256)`` and positions in a frame whose origin is the axis of
        the arm: x at its start, y in front of it, z up, metres; the antenna's height is zero.

    Raises
    ------
    BagError
        The file is missing or does not hold whole ramps.
    """
    try:
        numbers = np.fromfile(path, '<i2')
    except OSError as error:
        raise BagError(f'{path} cannot be read: {error}') from error
    if numbers.size < 4 * N_SAMPLES or numbers.size % (2 * N_SAMPLES):
        raise BagError(f'{path} holds {numbers.size} 16-bit numbers; expected two for each of '
                       f'{N_SAMPLES} samples of two ramps or more')
    in_phase, quadrature = (numbers.reshape(-1, 2, 2)[:, i].reshape(-1, 1, N_SAMPLES)
                            for i in (0, 1))
    # The radar mixes with the other sideband: conjugated, a longer delay turns backwards.
    samples = (in_phase - 1j * quadrature).astype(np.complex64)
    count = np.arange(len(samples))
    centre_m = arc(len(samples), radius_m)
    radar = fmcw_parameters(
        start_frequency_hz=START_HZ, slope_hz_per_s=SLOPE_HZ_PER_S,
        sample_rate_hz=SAMPLE_RATE_HZ, n_samples=N_SAMPLES, adc_start_s=ADC_START_S)
    stamp_ns = START_NS + np.rint(count * (1e9 / NOMINAL_PRF_HZ)).astype(np.int64)
    return PulseBlock(radar, False, stamp_ns, count, samples, centre_m, centre_m)


def arm_angles(n_pulses: int) -> np.ndarray:
    """(P,) float64 angle of the arm at each pulse, equally spaced over half a turn, radians."""
    return np.linspace(0.0, np.pi, n_pulses)


def arc(n_pulses: int, radius_m: float) -> np.ndarray:
    """(P, 1, 3) float64 phase centres on the half circle, metres."""
    angle = arm_angles(n_pulses)
    return radius_m * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)[:, None]


def known_points(path: Path | str) -> dict[str, tuple[float, float]]:
    """Names and places x, y of the point scatterers of a recording, metres.

    Only those of recording 7 are known; the other recordings have none.

    Raises
    ------
    BagError
        The file cannot be read.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise BagError(f'{path} cannot be read: {error}') from error
    if hashlib.sha256(content).hexdigest() != RECORDING_7_SHA256:
        return {}
    return {f'point_{i}': place for i, place in enumerate(POINTS_M, 1)}


def arc_truth(block: PulseBlock, points: dict[str, tuple[float, float]]) -> dict:
    """Truth of a recording.

    Parameters
    ----------
    block : PulseBlock
        Its pulses.
    points : dict
        Its point scatterers, see `known_points`.
    """
    origin = ('The points stand where an independent float64 backprojection focused them'
              if points else 'No scatterer is known')
    return make_truth(
        scenario='arcsar', description='FMCW radar at 77 GHz on a rotating arm'
        + (': two point scatterers and an extended one behind them' if points else ''),
        scatterers=[{'name': name, 'position_m': [x, y, 0.0], 'amplitude_db': 0.0}
                    for name, (x, y) in points.items()],
        grid=MapGrid.from_size((0.0, 5.0, 0.0), 12.0, 9.0, 0.01),
        pulses_per_aperture=block.n_pulses, n_pulses=block.n_pulses, n_channels=1,
        cut_half_width_m=(0.3, 0.3), radar=block.radar, compressed=False, window='taylor:4:35',
        notes=f'Measured, not simulated; Apache-2.0. {origin}; nothing was surveyed, and '
              f'amplitudes and times are not known: {NOMINAL_PRF_HZ:g} pulses per second are '
              'nominal.')


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(prog='load_arcsar', description=_DESCRIPTION,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('file', type=Path, help='Prova_Esterna_7.bin or another')
    p.add_argument('--output', type=Path, default=Path('out/bags/arcsar'), metavar='FOLDER',
                   help='bag folder to make (default: %(default)s)')
    p.add_argument('--radius', type=float, default=RADIUS_M, metavar='METRES',
                   help="radius of the antenna's circle (default: %(default)s)")
    p.add_argument('--force', action='store_true', help='replace an existing bag')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return convert(lambda: read_file(arguments.file, radius_m=arguments.radius),
                   lambda block: arc_truth(block, known_points(arguments.file)),
                   arguments.output, overwrite=arguments.force)


if __name__ == '__main__':
    sys.exit(main())
