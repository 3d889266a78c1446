"""Convert the AFRL Gotcha volumetric SAR data (MATLAB files) to a rosbag2 recording.

Run: python -m sar_imaging.tools.measured.load_gotcha FOLDER --output out/bags/gotcha

Each file holds one degree of azimuth as motion-compensated phase history,
``fp(f, p) = sum_i a_i exp(-j 4 pi f (|pos_p - x_i| - r0_p) / c)``. A radar has one delay reference
for all its pulses, so the samples are referenced anew from ``r0_p`` to one range for all.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform

from ..recordings.bag_io import BagError, make_truth
from ..recordings.writing import convert

NOMINAL_PRF_HZ = 100.0  # the files hold no times; one pulse per 1.06 m then means 106 m/s
START_NS = 1_700_000_000_000_000_000
FLOAT32_ROUNDING_M = 0.002  # positions and r0 are float32 numbers around 10 km

_DESCRIPTION = """\
Convert AFRL Gotcha volumetric SAR files (data_3dsar_pass*_az*_*.mat) to a rosbag2 recording of
stepped-frequency pulse blocks. The files are public but not part of this project. They hold no
times: pulses are stamped at a nominal 100 Hz. The autofocus terms stored in the files are not
applied: on pass 1 HH they shift the image and do not sharpen it.
"""


def read_folder(folder: Path) -> PulseBlock:
    """Read all Gotcha files of a folder as one block of monostatic pulses.

    Parameters
    ----------
    folder : Path
        With the .mat files of one pass and polarisation.

    Returns
    -------
    PulseBlock
        Samples ``(P, 1, 424)``, positions in the data's frame: origin in the scene's middle, z
        up, metres. Files in the order of their names.

    Raises
    ------
    BagError
        No file is there, a file is not of this kind, or files do not belong together.
    """
    files = sorted(Path(folder).glob('*.mat'))
    if not files:
        raise BagError(f'{folder} holds no .mat file; pass the folder with the '
                       'data_3dsar_pass*_az*_*.mat files')
    parts = [_read_file(file) for file in files]
    for file, part in zip(files, parts, strict=True):
        if not np.array_equal(part[0], parts[0][0]):
            raise BagError(f'{file} has other frequencies than {files[0].name}; convert one pass '
                           'and polarisation at a time')
    phase_history, position_m = (np.concatenate([part[i] for part in parts]) for i in (1, 2))
    return _as_block(parts[0][0], phase_history, position_m)


def _read_file(file: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies (K,), phase history (P, K) and positions (P, 3), float64 and complex128."""
    try:
        data = loadmat(file, squeeze_me=True, struct_as_record=False)['data']
        frequency_hz = np.asarray(data.freq, float)
        phase_history = np.asarray(data.fp, complex).T
        # float64 before any difference is taken: a range is 10 km and a phase millimetres.
        position_m = np.stack([data.x, data.y, data.z], axis=-1).astype(float)
        r0_m = np.asarray(data.r0, float)
    except (LookupError, AttributeError, TypeError, ValueError, NotImplementedError,
            MatReadError) as error:
        raise BagError(f'{file} is not a Gotcha file: {error}') from error
    if phase_history.shape != (len(position_m), len(frequency_hz)):
        raise BagError(f'{file}: fp.shape={phase_history.T.shape} does not match '
                       f'{len(frequency_hz)} frequencies and {len(position_m)} positions')
    difference = np.abs(r0_m - np.linalg.norm(position_m, axis=1)).max()
    if difference > FLOAT32_ROUNDING_M:
        raise BagError(f'{file}: r0 differs from the distance of the antenna to the origin by '
                       f'{difference:.4f} m; expected motion compensation to the origin')
    return frequency_hz, phase_history, position_m


def _as_block(frequency_hz: np.ndarray, phase_history: np.ndarray,
              position_m: np.ndarray) -> PulseBlock:
    carrier_hz, step_hz = _uniform_grid(frequency_hz)
    n_pulses, n = phase_history.shape
    # r0 itself is rounded to 1 mm, 12 degrees of phase; it is the length of the position, whose
    # own rounding cancels in the difference to the range of a pixel.
    r0_m = np.linalg.norm(position_m, axis=1)
    reference_m = round(float(r0_m.mean()), 3)
    frequency_hz = carrier_hz + (np.arange(n) - (n - 1) / 2) * step_hz
    cycles = 2.0 / SPEED_OF_LIGHT * np.outer(r0_m - reference_m, frequency_hz)
    radar = RadarParameters(
        carrier_hz=carrier_hz, bandwidth_hz=n * step_hz, sample_rate_hz=n * step_hz,
        first_sample_delay_s=2 * reference_m / SPEED_OF_LIGHT,
        waveform=Waveform.STEPPED_FREQUENCY)
    counter = np.arange(n_pulses)
    stamp_ns = START_NS + np.rint(counter * (1e9 / NOMINAL_PRF_HZ)).astype(np.int64)
    samples = phase_history * np.exp(-2j * np.pi * np.remainder(cycles, 1.0))
    return PulseBlock(radar, False, stamp_ns, counter, samples[:, None], position_m[:, None],
                      position_m[:, None])


def _uniform_grid(frequency_hz: np.ndarray) -> tuple[float, float]:
    """Centre and step of equally spaced ascending frequencies that are rounded to float32."""
    index = np.arange(frequency_hz.size) - (frequency_hz.size - 1) / 2
    step_hz = float(index @ frequency_hz / (index @ index))
    centre_hz = float(frequency_hz.mean())
    worst = np.abs(centre_hz + index * step_hz - frequency_hz).max()
    if worst > 1e-3 * step_hz:
        raise BagError(f'frequencies deviate by {worst:.0f} Hz from equal steps of '
                       f'{step_hz:.0f} Hz; expected a uniform grid')
    return centre_hz, step_hz


def gotcha_truth(block: PulseBlock) -> dict:
    """Truth of the recording: the two calibration reflectors in the grass of the scene."""
    return make_truth(
        scenario='gotcha', description='AFRL Gotcha volumetric SAR, X band, airborne spotlight: '
        'a car park, a road and two calibration reflectors',
        scatterers=[
            {'name': 'reflector', 'position_m': [-15.60, 21.60, 0.0], 'amplitude_db': 0.0},
            {'name': 'reflector_2', 'position_m': [-27.80, 38.82, 0.0], 'amplitude_db': -5.8}],
        grid=MapGrid.from_size((0.0, 0.0, 0.0), 100.0, 100.0, 0.1),
        pulses_per_aperture=block.n_pulses, n_pulses=block.n_pulses, n_channels=1,
        cut_half_width_m=(2.0, 2.0), radar=block.radar, compressed=False,
        notes='Measured, not simulated. US Air Force public release. The reflectors stand where '
              'they peak in float64 backprojections made without this project (reflector) and '
              'with it (reflector_2); no survey came with the files, and no times either: '
              f'{NOMINAL_PRF_HZ:g} pulses per second are nominal.')


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(prog='load_gotcha', description=_DESCRIPTION,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('folder', type=Path, help='folder with the .mat files of one pass')
    p.add_argument('--output', type=Path, default=Path('out/bags/gotcha'), metavar='FOLDER',
                   help='bag folder to make (default: %(default)s)')
    p.add_argument('--force', action='store_true', help='replace an existing bag')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return convert(lambda: read_folder(arguments.folder), gotcha_truth, arguments.output,
                   overwrite=arguments.force)


if __name__ == '__main__':
    sys.exit(main())
