"""Parameters of written vectors: times, places and windows of pulses, in the standard's terms."""

from __future__ import annotations

import dataclasses

import numpy as np

from ...geometry.earth import Datum
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters
from .antennas.writing import PARAMETERS, WrittenAntenna
from .container import CphdError
from .vectors import NORMAL

OVERSAMPLING = 1.2  # samples per that of the saved window or band, as the standard advises
_ONE_PLATFORM = 0.01  # distance of transmitter and receiver, of that to the scene
_XYZ = 'X=F8;Y=F8;Z=F8;'
#: Parameters in the order of the standard; AmpSF only where samples are integers.
LAYOUT = {'TxTime': 'F8', 'TxPos': _XYZ, 'TxVel': _XYZ, 'RcvTime': 'F8', 'RcvPos': _XYZ,
          'RcvVel': _XYZ, 'SRPPos': _XYZ, 'AmpSF': 'F8', 'aFDOP': 'F8', 'aFRR1': 'F8',
          'aFRR2': 'F8', 'FX1': 'F8', 'FX2': 'F8', 'TOA1': 'F8', 'TOA2': 'F8', 'TDTropoSRP': 'F8',
          'SC0': 'F8', 'SCSS': 'F8', 'SIGNAL': 'I8'}


def words(kind: str) -> int:
    """Words of 8 bytes that a parameter takes."""
    return kind.count(';') or 1


def vector_type(layout: dict[str, str]) -> np.dtype:
    """Type of a vector's parameters."""
    kinds = {'F8': np.dtype('f8'), 'I8': np.dtype('i8')}
    return np.dtype([(name, kinds.get(kind, np.dtype(('f8', (words(kind),)))))
                     for name, kind in layout.items()])


@dataclasses.dataclass(frozen=True)
class Pulses:
    """What was written: everything of the pulses but their samples.

    Parameters
    ----------
    radar : RadarParameters
        Of the written samples.
    n_samples : int
        Of each vector.
    domain : {'FX', 'TOA'}
        What the samples are over.
    datum : Datum
        Where the frame of the phase centres stands.
    reference_m : (3,) float64
        Reference point, in the frame, metres.
    stamp_ns : (P,) int64
        Times of the pulses.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres in the frame, metres.
    amplitude : (P, C) float64 or None
        Factors of the samples, where they are integers.
    has_signal : (P, C) bool
        False where all samples of a vector are zero.
    antenna : WrittenAntenna or None
        Where it is known.
    """

    radar: RadarParameters
    n_samples: int
    domain: str
    datum: Datum
    reference_m: np.ndarray
    stamp_ns: np.ndarray
    tx_m: np.ndarray
    rx_m: np.ndarray
    amplitude: np.ndarray | None
    has_signal: np.ndarray
    antenna: WrittenAntenna | None = None

    @property
    def start_ns(self) -> int:
        """Whole second before the first pulse."""
        return int(self.stamp_ns[0]) // 10**9 * 10**9

    @property
    def layout(self) -> dict[str, str]:
        """Parameters of the vectors and their formats."""
        antenna = {} if self.antenna is None else {
            name: kind for own in PARAMETERS.values() for name, kind in own.items()}
        return {n: k for n, k in LAYOUT.items()
                if n != 'AmpSF' or self.amplitude is not None} | antenna

    @property
    def collect_type(self) -> str:
        """Whether transmitter and receiver are on one platform, by their distance."""
        apart = np.linalg.norm(self.tx_m - self.rx_m, axis=-1).max()
        away = np.linalg.norm(self.rx_m - self.reference_m, axis=-1).min()
        return 'MONOSTATIC' if apart < _ONE_PLATFORM * away else 'BISTATIC'


def reference_delays(tx_m: np.ndarray, rx_m: np.ndarray, reference_m: np.ndarray) -> np.ndarray:
    """(P, C) float64 two-way delay of the reference point, seconds."""
    return (np.linalg.norm(tx_m - reference_m, axis=-1)
            + np.linalg.norm(rx_m - reference_m, axis=-1)) / SPEED_OF_LIGHT


def vector_parameters(pulses: Pulses) -> np.ndarray:
    """(C, P) structured array of the parameters of all vectors.

    Velocities are those between neighbouring pulses. aFRR1 and aFRR2 are zero: pulses of this
    package are as if the platform stood still while they travel.

    Raises
    ------
    CphdError
        Times do not increase, or there are too few pulses for velocities.
    """
    if len(pulses.stamp_ns) < 2:
        raise CphdError('one pulse has no velocity, which CPHD needs; write two or more')
    if (np.diff(pulses.stamp_ns) <= 0).any():
        worst = int((np.diff(pulses.stamp_ns) <= 0).argmax())
        raise CphdError(f'pulse {worst + 1} was transmitted at {pulses.stamp_ns[worst + 1]} ns, '
                        f'not after {pulses.stamp_ns[worst]} ns; put pulses in the order of time')
    tx_s = (pulses.stamp_ns - pulses.start_ns) * 1e-9
    delay_s = reference_delays(pulses.tx_m, pulses.rx_m, pulses.reference_m)
    tx_v, rx_v = (_velocity(m, tx_s) for m in (pulses.tx_m, pulses.rx_m))
    out = np.zeros(pulses.tx_m.shape[1::-1], vector_type(pulses.layout))
    out['TxTime'] = tx_s
    out['RcvTime'] = (tx_s[:, None] + delay_s).T
    out['SRPPos'] = pulses.datum.to_ecef(pulses.reference_m)
    for name, position_m, velocity in (('Tx', pulses.tx_m, tx_v), ('Rcv', pulses.rx_m, rx_v)):
        out[f'{name}Pos'] = pulses.datum.to_ecef(position_m).swapaxes(0, 1)
        out[f'{name}Vel'] = pulses.datum.vectors_to_ecef(velocity).swapaxes(0, 1)
    out['aFDOP'] = -(_range_rate(pulses.tx_m - pulses.reference_m, tx_v)
                     + _range_rate(pulses.rx_m - pulses.reference_m, rx_v)).T / SPEED_OF_LIGHT
    if pulses.amplitude is not None:
        out['AmpSF'] = pulses.amplitude.T
    if pulses.antenna is not None:  # the same at both ends of a pulse's way
        for side in ('Tx', 'Rcv'):
            out[f'{side}ACX'], out[f'{side}ACY'] = pulses.antenna.x_axis, pulses.antenna.y_axis
    out['SIGNAL'] = np.where(pulses.has_signal, NORMAL, 0).T
    (_phase_history_window if pulses.domain == 'FX' else _profile_window)(pulses, delay_s, out)
    return out


def _phase_history_window(pulses: Pulses, delay_s: np.ndarray, out: np.ndarray) -> None:
    """Band and window of phase histories: frequencies are samples, delays one period."""
    radar, n = pulses.radar, pulses.n_samples
    step = radar.bandwidth_hz / n
    out['SC0'] = out['FX1'] = radar.carrier_hz - (n - 1) / 2 * step
    out['FX2'] = radar.carrier_hz + (n - 1) / 2 * step
    out['SCSS'] = step
    half = 0.5 / (OVERSAMPLING * step) * (1 - 1e-6)  # for rounding
    middle = radar.first_sample_delay_s - delay_s
    # Around the reference point where the period around the radar's own reference holds that.
    if np.abs(middle).max() <= 0.5 / step - half:
        middle = np.zeros_like(delay_s)
    out['TOA1'], out['TOA2'] = (middle - half).T, (middle + half).T


def _profile_window(pulses: Pulses, delay_s: np.ndarray, out: np.ndarray) -> None:
    """Band and window of profiles: delays are samples, the band is the radar's."""
    radar = pulses.radar
    if radar.sample_rate_hz < 1.1 * radar.bandwidth_hz:
        raise CphdError(f'profiles have {radar.sample_rate_hz / radar.bandwidth_hz:.3g} samples '
                        'per 1 / bandwidth; CPHD asks for 1.1 or more: compress with '
                        f'oversampling={OVERSAMPLING} or more')
    out['FX1'] = radar.carrier_hz - radar.bandwidth_hz / 2
    out['FX2'] = radar.carrier_hz + radar.bandwidth_hz / 2
    out['SCSS'] = 1 / radar.sample_rate_hz
    out['SC0'] = out['TOA1'] = (radar.first_sample_delay_s - delay_s).T
    out['TOA2'] = out['TOA1'] + (pulses.n_samples - 1) / radar.sample_rate_hz


def _velocity(position_m: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """(P, C, 3) float64 velocities, metres per second."""
    return np.gradient(position_m, time_s, axis=0, edge_order=min(2, len(time_s) - 1))


def _range_rate(line_m: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(P, C) float64 rate of the length of some lines, metres per second."""
    return np.einsum('pcx,pcx->pc', line_m, velocity) / np.linalg.norm(line_m, axis=-1)
