"""Convert a recording of a 60 GHz MIMO radar on a slider to a rosbag2 recording.

Run: python -m sar_imaging.tools.measured.load_mimo_60ghz FILE --output out/bags/mimo_60ghz

Two transmitters take turns and four receivers record both: eight channels, each with phase centres
of its own. A slider moves the board up in 64 steps at three horizontal stops; together that is a
planar aperture, which images in three dimensions.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock

from ..recordings.bag_io import BagError, make_truth
from ..recordings.writing import convert

N_RECEIVERS, N_TRANSMITTERS = 4, 2
TX_PITCH_M = 0.010  # between the two transmitters in use
NOMINAL_PRF_HZ = 10.0  # the file holds no times
START_NS = 1_700_000_000_000_000_000
_SCALARS = ('f_start_hz', 'slope_hz_per_s', 'fs_hz', 'pitch_m', 'stop_pitch_m')

_DESCRIPTION = """\
Convert mimo_chair.npz (TI IWR6843, 2 transmitters x 4 receivers on a slider) to a rosbag2
recording of raw FMCW pulse blocks with eight channels. The file holds no times: pulses are stamped
at a nominal 10 Hz. The channels are not calibrated; see the tool calibrate.
"""


def read_file(path: Path | str) -> PulseBlock:
    """Read the recording.

    Parameters
    ----------
    path : path
        The .npz file.

    Returns
    -------
    PulseBlock
        Raw FMCW samples ``(192, 8, 256)``, the stops one after the other, each from its lowest
        step up, and nominal positions: x to the right, y in front of the board, z up, metres;
        the origin is the middle of the whole aperture.

    Raises
    ------
    BagError
        The file is missing or is not of this form.
    """
    try:
        with np.load(path) as data:
            adc = np.asarray(data['adc'], np.complex64)
            start_hz, slope, rate_hz, pitch_m, stop_m = (float(data[k]) for k in _SCALARS)
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        raise BagError(f'{path} is not the MIMO recording: {error}') from error
    if adc.ndim != 4 or adc.shape[2] != N_TRANSMITTERS * N_RECEIVERS:
        raise BagError(f'{path}: adc.shape={adc.shape}; expected (stops, steps, '
                       f'{N_TRANSMITTERS * N_RECEIVERS} channels, samples)')
    n_stops, n_steps, n_channels, n_samples = adc.shape
    radar = fmcw_parameters(start_frequency_hz=start_hz, slope_hz_per_s=slope,
                            sample_rate_hz=rate_hz, n_samples=n_samples)
    tx_m, rx_m = _phase_centres(n_stops, n_steps, pitch_m, stop_m)
    count = np.arange(n_stops * n_steps)
    stamp_ns = START_NS + np.rint(count * (1e9 / NOMINAL_PRF_HZ)).astype(np.int64)
    # The radar mixes with the other sideband: conjugated, a longer delay turns backwards.
    samples = adc.reshape(count.size, n_channels, n_samples).conj()
    return PulseBlock(radar, False, stamp_ns, count, samples, tx_m, rx_m)


def _phase_centres(n_stops: int, n_steps: int, pitch_m: float,
                   stop_m: float) -> tuple[np.ndarray, np.ndarray]:
    """(P, 8, 3) transmit and receive phase centres; channels and stops run towards -x."""
    def centred(n):
        return np.arange(n) - (n - 1) / 2

    transmitter, receiver = np.divmod(np.arange(N_TRANSMITTERS * N_RECEIVERS), N_RECEIVERS)
    stop_x = np.repeat(-stop_m * centred(n_stops), n_steps)[:, None]
    up = np.tile(pitch_m * centred(n_steps), n_stops)[:, None]
    out = []
    for x in (-TX_PITCH_M * (transmitter - 0.5), -pitch_m * (receiver - 1.5)):
        x = stop_x + x
        out.append(np.stack([x, 0 * x, up + 0 * x], axis=-1))
    return out[0], out[1]


def mimo_truth(block: PulseBlock) -> dict:
    """Truth of the recording: grid and aperture; no scatterer is known as a point."""
    return make_truth(
        scenario='mimo_60ghz', description='60 GHz MIMO radar on a slider: a chair 1.8 m in front '
        'of it, a cabinet to its left',
        scatterers=[], grid=MapGrid.from_size((0.0, 2.0, -0.2), 3.2, 2.8, 0.01),
        pulses_per_aperture=block.n_pulses, n_pulses=block.n_pulses,
        n_channels=block.n_channels, cut_half_width_m=(0.3, 0.3), radar=block.radar,
        compressed=False, window='hamming',
        notes='Measured, not simulated; Apache-2.0. Nominal geometry, channels not calibrated. '
              'The map lies 0.2 m below the middle of the aperture, where the chair is brightest. '
              f'The times are nominal, {NOMINAL_PRF_HZ:g} pulses per second.')


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(prog='load_mimo_60ghz', description=_DESCRIPTION,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('file', type=Path, help='mimo_chair.npz')
    p.add_argument('--output', type=Path, default=Path('out/bags/mimo_60ghz'), metavar='FOLDER',
                   help='bag folder to make (default: %(default)s)')
    p.add_argument('--force', action='store_true', help='replace an existing bag')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return convert(lambda: read_file(arguments.file), mimo_truth,
                   arguments.output, overwrite=arguments.force)


if __name__ == '__main__':
    sys.exit(main())
