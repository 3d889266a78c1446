# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated pulses, and CPHD files whose samples follow from the standard's own formulas."""

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.earth import Datum
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters
from sar_imaging.signal.radar import Waveform
from sar_imaging.simulation.echoes import EchoSimulator

POINTS_M = np.array([[0.0, 0.0, 0.0], [10.0, -7.0, 0.0], [-13.0, 11.0, 0.0]])
AMPLITUDES = np.array([1.0, 0.7, 0.5j])
DATUM = Datum(47.0, 8.0, 450.0)
GRID = MapGrid.from_size((0.0, 0.0, 0.0), 40.0, 40.0, 0.8)


@pytest.fixture(autouse=True)
def _with_sarkit():
    pytest.importorskip('sarkit', reason='sarkit needs Python 3.11 and the extra "formats"')


def pulses(compressed=False, n_channels=1, n_pulses=40, side=1, heading_deg=0.0, apart_m=0.4):
    """Pulses of a straight flight past three reflectors, 3 km away; side -1 looks to the left."""
    time = np.arange(n_pulses) * 0.01
    track = np.stack([(time - time.mean()) * 100, np.full(n_pulses, -3000.0 * side),
                      np.full(n_pulses, 2000.0)], -1)
    turn = np.radians(heading_deg)
    turn = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    track = track @ turn
    tx = np.repeat(track[:, None], n_channels, 1)
    rx = tx + np.arange(n_channels)[:, None] * (np.array([apart_m, 0, 0]) @ turn)
    away = np.linalg.norm(track, axis=-1).mean()
    if compressed:
        n, rate = 512, 300e6
        radar = RadarParameters(9.6e9, 150e6, rate, 2 * away / SPEED_OF_LIGHT - n / 2 / rate)
    else:
        n, band = 256, 300e6
        radar = RadarParameters(9.6e9, band, band, 2 * (away + 1.0) / SPEED_OF_LIGHT,
                                waveform=Waveform.STEPPED_FREQUENCY)
    samples = EchoSimulator(radar, n, compressed=compressed, points_m=POINTS_M,
                            amplitudes=AMPLITUDES)(tx, rx)
    stamp_ns = 1_700_000_000_123_456_789 + np.arange(n_pulses) * 10_000_000
    return PulseBlock(radar, compressed, stamp_ns, np.arange(n_pulses), samples, tx, rx, 'map')


def by_formula(template, target, edit=lambda tree, pvps: None, sample_type=None):
    """A copy of a file, edited, whose samples are the standard's signal model of its vectors.

    Domain FX: ``exp(SGN j 2 pi fx dTOA)``; domain TOA: peaks with the phase of fx_C at the delays
    dTOA. Positions are Earth-centred throughout; nothing of the package is used.
    """
    import sarkit.cphd as skcphd

    with open(template, 'rb') as file, skcphd.Reader(file) as reader:
        tree = reader.metadata.xmltree
        names = [n.text for n in tree.findall('{*}Data/{*}Channel/{*}Identifier')]
        pvps = {name: reader.read_pvps(name).astype(
            skcphd.get_pvp_dtype(tree)) for name in names}
    replaced = edit(tree, pvps)
    pvps = replaced or pvps
    sign, domain = (int(tree.findtext('{*}Global/{*}SGN')),
                    tree.findtext('{*}Global/{*}DomainType'))
    points = DATUM.to_ecef(POINTS_M)
    with open(target, 'wb') as file, skcphd.Writer(file, skcphd.Metadata(xmltree=tree)) as writer:
        for node in tree.findall('{*}Data/{*}Channel'):
            name, n = node.findtext('{*}Identifier'), int(node.findtext('{*}NumSamples'))
            own = pvps[name]
            kind = tree.findtext('{*}Data/{*}SignalArrayFormat')
            writer.write_signal(name, _typed(_model(own, n, points, sign, domain), own, kind))
            writer.write_pvp(name, own)
    return target


def _model(own, n, points, sign, domain):
    def travel(point):
        return (np.linalg.norm(own['TxPos'] - point, axis=-1)
                + np.linalg.norm(own['RcvPos'] - point, axis=-1)) / SPEED_OF_LIGHT

    to_reference = travel(own['SRPPos'])
    axis = own['SC0'][:, None] + own['SCSS'][:, None] * np.arange(n)
    samples = np.zeros(axis.shape, complex)
    for point, amplitude in zip(points, AMPLITUDES, strict=True):
        later = (travel(point) - to_reference)[:, None]
        amplitude = amplitude if sign < 0 else np.conj(amplitude)
        if domain == 'FX':
            samples += amplitude * np.exp(sign * 2j * np.pi * axis * later)
        else:
            middle = (own['FX1'] + own['FX2'])[:, None] / 2
            band = (own['FX2'] - own['FX1'])[:, None]
            samples += (amplitude * np.sinc(band * (axis - later))
                        * np.exp(sign * 2j * np.pi * middle * later))
    if domain == 'FX':
        samples[(axis < own['FX1'][:, None]) | (axis > own['FX2'][:, None])] = 99.0  # no signal
    if 'SIGNAL' in own.dtype.names:
        samples[own['SIGNAL'] == 0] = 0
    return samples


def _typed(samples, own, kind):
    import sarkit.cphd as skcphd

    kind = skcphd.binary_format_string_to_dtype(kind)
    if 'AmpSF' in own.dtype.names:
        samples = samples / own['AmpSF'][:, None]
    if kind == np.complex64:
        return samples.astype(kind)
    out = np.empty(samples.shape, kind)
    out['real'], out['imag'] = np.rint(samples.real), np.rint(samples.imag)
    return out


def expected_phase_history(block):
    """Samples that a stepped-frequency block has of the reflectors, in closed form."""
    radar, n = block.radar, block.n_samples
    frequency = radar.carrier_hz + (np.arange(n) - (n - 1) / 2) * radar.bandwidth_hz / n
    delay = np.stack([(np.linalg.norm(block.tx_m - p, axis=-1)
                       + np.linalg.norm(block.rx_m - p, axis=-1)) for p in POINTS_M])
    delay = delay / SPEED_OF_LIGHT - radar.first_sample_delay_s
    return np.einsum('s,spcn->pcn', AMPLITUDES,
                     np.exp(-2j * np.pi * delay[..., None] * frequency))


def level_db(difference, reference):
    """Largest difference, dB below the largest reference."""
    return 20 * np.log10(np.abs(difference).max() / np.abs(reference).max() + 1e-30)
