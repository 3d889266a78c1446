# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""CPHD files of every variant, written with sarkit and NumPy alone, imaged by this package.

Run from the repository root: ``python -m benchmarks.cphd_variants``. Vectors, XML and samples are
made here from the standard's own formulas (NGA.STND.0068-1, section 6): nothing of the package
takes part before it reads the file. Each target's place is compared with the point that the
samples were made of, and its widths with those of the sum over all vectors and frequencies.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import pathlib
import sys
import tempfile
from collections.abc import Sequence

import numpy as np
import sarkit.cphd as skcphd
from sarkit import wgs84

from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'cphd_variants.json'
C = 299792458.0
NAMESPACE = 'http://api.nsgreg.nga.mil/schema/cphd/1.1.0'
IARP_DEG = (47.3, 8.5, 430.0)
TARGETS_M = np.array([[0.0, 0.0], [14.0, -9.0], [-17.0, 12.0]])  # east, north of the IARP
AMPLITUDES = np.array([1.0, 0.8, 0.9j])
HALF_M = 30.0
MIDDLE_HZ, BAND_HZ = 9.6e9, 200e6
N_VECTORS, N_SAMPLES = 96, 256
CUT_M, STEP_M = 3.0, 0.01  # about a target
ORDER = ('TxTime', 'TxPos', 'TxVel', 'RcvTime', 'RcvPos', 'RcvVel', 'SRPPos', 'AmpSF', 'aFDOP',
         'aFRR1', 'aFRR2', 'FX1', 'FX2', 'TOA1', 'TOA2', 'TDTropoSRP', 'SC0', 'SCSS', 'SIGNAL')


@dataclasses.dataclass(frozen=True)
class Variant:
    """What of a file differs from the others."""

    domain: str = 'FX'
    sign: int = -1
    kind: str = 'CF8'
    bistatic: bool = False
    moving: bool = False  # reference point of the vectors
    flagged: int = 0  # vectors without signal
    reordered: bool = False  # other order of parameters, gaps and added ones between them
    oversampling: float = 1.4  # of domain TOA
    fractional: bool = False  # profiles that begin at parts of a sample


VARIANTS = {
    **{f'{domain}, SGN {sign:+d}, {kind}': Variant(domain, sign, kind)
       for domain in ('FX', 'TOA') for sign in (-1, 1) for kind in ('CF8', 'CI4', 'CI2')},
    **{f'{domain}, {name}': Variant(domain, **options) for domain in ('FX', 'TOA')
       for name, options in {
           'bistatic': {'bistatic': True}, 'moving reference': {'moving': True},
           'bistatic with moving reference': {'bistatic': True, 'moving': True, 'sign': 1},
           '9 flagged vectors': {'flagged': 9}, 'other order of parameters': {'reordered': True},
           'all at once, CI4': {'sign': 1, 'kind': 'CI4', 'bistatic': True, 'moving': True,
                                'flagged': 5, 'reordered': True}}.items()},
    **{f'TOA, {rate:g} times oversampled': Variant('TOA', oversampling=rate)
       for rate in (1.1, 1.15, 1.2, 1.25, 2.0)},
    'TOA, fractional starts': Variant('TOA', fractional=True),
    'TOA, fractional starts, CI2': Variant('TOA', kind='CI2', fractional=True),
    'TOA, 1.1 times, CI2, fractional starts, SGN +1': Variant(
        'TOA', 1, 'CI2', oversampling=1.1, fractional=True),
}


def _frame() -> tuple[np.ndarray, np.ndarray]:
    """IARP and (3, 3) axes east, north, up, Earth-centred."""
    iarp = wgs84.geodetic_to_cartesian(np.array(IARP_DEG))
    return iarp, np.stack([wgs84.east(np.array(IARP_DEG)), wgs84.north(np.array(IARP_DEG)),
                           wgs84.up(np.array(IARP_DEG))])


def _targets() -> np.ndarray:
    iarp, axes = _frame()
    return iarp + TARGETS_M @ axes[:2]


def vectors(variant: Variant) -> np.ndarray:
    """(N_VECTORS,) structured array of the parameters, in the standard's order."""
    iarp, axes = _frame()
    kind = np.dtype([(n, 'f8', (3,)) if n.endswith(('Pos', 'Vel')) else
                     (n, 'i8' if n == 'SIGNAL' else 'f8') for n in ORDER])
    out = np.zeros(N_VECTORS, kind)
    time = 0.5 + np.arange(N_VECTORS) * 0.02
    along = time - time.mean()
    tx = iarp + np.stack([120 * along, np.full(N_VECTORS, -5000.0) + 2 * along**2,
                          3000 + 3 * along], -1) @ axes
    rx = tx
    if variant.bistatic:
        rx = iarp + np.stack([2500 + 90 * along, np.full(N_VECTORS, -4200.0),
                              np.full(N_VECTORS, 2600.0)], -1) @ axes
    reference = np.repeat(iarp[None], N_VECTORS, 0)
    if variant.moving:
        reference = reference + np.stack([6 * np.sin(along), 5 * along, 0 * along], -1) @ axes
    out['TxTime'], out['TxPos'], out['RcvPos'], out['SRPPos'] = time, tx, rx, reference
    out['RcvTime'] = time + _travel(tx, rx, reference)
    for name, position in (('TxVel', tx), ('RcvVel', rx)):
        out[name] = np.gradient(position, time, axis=0)
    out['AmpSF'] = 1.0
    out['FX1'], out['FX2'] = MIDDLE_HZ - BAND_HZ / 2, MIDDLE_HZ + BAND_HZ / 2
    if variant.domain == 'FX':
        out['SCSS'] = BAND_HZ / (N_SAMPLES - 1)
        out['SC0'] = out['FX1']
        out['TOA1'], out['TOA2'] = -0.4 / out['SCSS'], 0.4 / out['SCSS']
    else:
        out['SCSS'] = 1 / (variant.oversampling * BAND_HZ)
        out['SC0'] = -N_SAMPLES / 2 * out['SCSS']
        if variant.fractional:
            out['SC0'] += np.random.default_rng(1).random(N_VECTORS) * out['SCSS']
        out['TOA1'], out['TOA2'] = out['SC0'], out['SC0'] + (N_SAMPLES - 1) * out['SCSS']
    out['SIGNAL'] = 1
    if variant.flagged:
        out['SIGNAL'][np.random.default_rng(2).choice(N_VECTORS, variant.flagged, False)] = 0
    return out


def _travel(tx, rx, point) -> np.ndarray:
    return (np.linalg.norm(tx - point, axis=-1) + np.linalg.norm(rx - point, axis=-1)) / C


def samples(variant: Variant, own: np.ndarray) -> np.ndarray:
    """(N_VECTORS, N_SAMPLES) signal by the standard's formulas; AmpSF of `own` is set."""
    axis = own['SC0'][:, None] + own['SCSS'][:, None] * np.arange(N_SAMPLES)
    out = np.zeros(axis.shape, complex)
    for point, amplitude in zip(_targets(), AMPLITUDES, strict=True):
        later = (_travel(own['TxPos'], own['RcvPos'], point)
                 - _travel(own['TxPos'], own['RcvPos'], own['SRPPos']))[:, None]
        if variant.domain == 'FX':
            out += amplitude * np.exp(variant.sign * 2j * np.pi * axis * later)
        else:
            out += (amplitude * np.sinc(BAND_HZ * (axis - later))
                    * np.exp(variant.sign * 2j * np.pi * MIDDLE_HZ * later))
    bad = own['SIGNAL'] != 1
    out[bad] = 1e3 * np.exp(1j * np.arange(N_SAMPLES))  # what a reader must not use
    kind = skcphd.binary_format_string_to_dtype(variant.kind)
    if variant.kind == 'CF8':
        return out.astype(kind)
    largest = {'CI4': 32000, 'CI2': 120}[variant.kind]
    own['AmpSF'] = np.abs(np.stack([out.real, out.imag])).max(axis=(0, 2)) / largest
    whole = np.empty(out.shape, kind)
    scaled = out / own['AmpSF'][:, None]
    whole['real'], whole['imag'] = np.rint(scaled.real), np.rint(scaled.imag)
    return whole


def metadata(variant: Variant, own: np.ndarray):
    """XML of a file, by sarkit's wrapper of elements."""
    import datetime

    import lxml.etree as etree

    iarp, axes = _frame()
    root = etree.Element(f'{{{NAMESPACE}}}CPHD', nsmap={None: NAMESPACE})
    corners = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * HALF_M
    corner_points = wgs84.cartesian_to_geodetic(iarp + corners @ axes[:2])[:, :2]
    layout, n_words = _layout(variant)
    has_amplitude = variant.kind != 'CF8'
    skcphd.ElementWrapper(root).from_dict({
        'CollectionID': {
            'CollectorName': 'NumPy', 'CoreName': 'variant', 'CollectType':
            'BISTATIC' if variant.bistatic else 'MONOSTATIC',
            'RadarMode': {'ModeType': 'SPOTLIGHT'}, 'Classification': 'UNCLASSIFIED',
            'ReleaseInfo': 'UNRESTRICTED'},
        'Global': {
            'DomainType': variant.domain, 'SGN': variant.sign,
            'Timeline': {'CollectionStart': datetime.datetime(
                2025, 3, 1, 12, tzinfo=datetime.timezone.utc),
                'TxTime1': own['TxTime'][0], 'TxTime2': own['TxTime'][-1]},
            'FxBand': {'FxMin': own['FX1'].min(), 'FxMax': own['FX2'].max()},
            'TOASwath': {'TOAMin': own['TOA1'].min(), 'TOAMax': own['TOA2'].max()}},
        'SceneCoordinates': {
            'EarthModel': 'WGS_84', 'IARP': {'ECF': iarp, 'LLH': np.array(IARP_DEG)},
            'ReferenceSurface': {'Planar': {'uIAX': axes[0], 'uIAY': axes[1]}},
            'ImageArea': {'X1Y1': np.full(2, -HALF_M), 'X2Y2': np.full(2, HALF_M)},
            'ImageAreaCornerPoints': corner_points},
        'Data': {
            'SignalArrayFormat': variant.kind, 'NumBytesPVP': 8 * n_words, 'NumCPHDChannels': 1,
            'Channel': [{'Identifier': 'one', 'NumVectors': N_VECTORS, 'NumSamples': N_SAMPLES,
                         'SignalArrayByteOffset': 0, 'PVPArrayByteOffset': 0}],
            'NumSupportArrays': 0},
        'Channel': {
            'RefChId': 'one', 'FXFixedCPHD': True, 'TOAFixedCPHD': not variant.fractional,
            'SRPFixedCPHD': not variant.moving,
            'Parameters': [{
                'Identifier': 'one', 'RefVectorIndex': N_VECTORS // 2, 'FXFixed': True,
                'TOAFixed': not variant.fractional, 'SRPFixed': not variant.moving,
                'SignalNormal': not variant.flagged,
                'Polarization': {'TxPol': 'V', 'RcvPol': 'V'}, 'FxC': MIDDLE_HZ,
                'FxBW': BAND_HZ, 'TOASaved': np.ptp([own['TOA1'].min(), own['TOA2'].max()]),
                'DwellTimes': {'CODId': 'all', 'DwellId': 'all'}}]},
        'PVP': {name: value for name, value in layout.items()
                if name != 'AmpSF' or has_amplitude},
        'Dwell': {'NumCODTimes': 1, 'CODTime': [{
            'Identifier': 'all', 'CODTimePoly': [[float(own['TxTime'].mean())]]}],
            'NumDwellTimes': 1, 'DwellTime': [{
                'Identifier': 'all', 'DwellTimePoly': [[float(np.ptp(own['TxTime']))]]}]}})
    return root.getroottree()


def _layout(variant: Variant) -> tuple[dict, int]:
    """Elements of the PVP layout, and words of a vector."""
    names = [n for n in ORDER if n != 'AmpSF' or variant.kind != 'CF8']
    if variant.reordered:
        names = list(np.random.default_rng(3).permutation(names))
    places, word = {}, 0
    for name in names:
        word += 2 * variant.reordered  # words that nobody explains
        places[name] = word
        word += 3 if name.endswith(('Pos', 'Vel')) else 1
    kinds = {n: 'I8' if n == 'SIGNAL' else 'F8' if not n.endswith(('Pos', 'Vel')) else
             'X=F8;Y=F8;Z=F8;' for n in names}
    layout = {n: {'Offset': places[n], 'Size': 3 if 'X' in kinds[n] else 1,
                  'dtype': skcphd.binary_format_string_to_dtype(kinds[n])}
              for n in ORDER if n in places}
    if variant.reordered:
        layout['AddedPVP'] = [{'Name': 'temperature', 'Offset': word, 'Size': 1,
                               'dtype': np.dtype('f8')}]
    return layout, word + 1


def write(path: pathlib.Path, variant: Variant) -> np.ndarray:
    """Write a file; returns its vectors."""
    own = vectors(variant)
    signal = samples(variant, own)
    tree = metadata(variant, own)
    with open(path, 'wb') as file, skcphd.Writer(file, skcphd.Metadata(xmltree=tree)) as writer:
        writer.write_signal('one', signal)
        kind = skcphd.get_pvp_dtype(tree)
        pvps = np.zeros(N_VECTORS, kind)
        for name in set(kind.names) & set(ORDER):
            pvps[name] = own[name]
        writer.write_pvp('one', pvps)
    return own


def measure(path: pathlib.Path, own: np.ndarray) -> dict:
    """Image a file about its targets: places and widths beside those of the formulas."""
    from sar_imaging.formats.cphd import CphdReader
    from sar_imaging.geometry.grids import MapGrid
    from sar_imaging.imaging.imager import plan_image

    kept = own[own['SIGNAL'] == 1]
    found: dict = {'place_cm': [], 'width_percent': [], 'level_db': []}
    with CphdReader(path) as reader:
        blocks = list(reader.blocks())
        found['warnings'] = reader.warnings
        for target, amplitude, (x, y) in zip(_targets(), AMPLITUDES, TARGETS_M, strict=True):
            grid = MapGrid.from_size((x, y, 0.0), 2 * CUT_M, 2 * CUT_M, 0.05)
            imager = plan_image(grid, reader.radar, reader.n_samples,
                                compressed=reader.compressed, method='exact')
            image = imager.new_image()
            for block in blocks:
                imager.accumulate(block, image)
            peak, widths = _peak_and_widths(np.asarray(image.samples), np.asarray(grid.x_m),
                                            np.asarray(grid.y_m))
            datum = reader.datum
            there = datum.to_ecef(np.array([*peak, 0.0]))
            found['place_cm'].append(round(100 * float(np.linalg.norm(there - target)), 3))
            told = _widths_by_formula(kept, target, reader.domain)
            found['width_percent'].append([round(100 * (a / b - 1), 2) for a, b in zip(
                widths, told, strict=True)])
            found['level_db'].append(round(float(20 * np.log10(
                np.abs(image.samples).max() / np.abs(amplitude))), 3))
    level = np.array(found['level_db'])
    found['level_db'] = (level - level[0]).round(3).tolist()  # between the targets
    return found


def _peak_and_widths(samples, x_m, y_m) -> tuple[np.ndarray, tuple[float, float]]:
    """Place of the peak, and -3 dB widths along x and y, by interpolated magnitudes."""
    from scipy.interpolate import RectBivariateSpline

    order_y, order_x = np.argsort(y_m), np.argsort(x_m)
    power = np.abs(samples[np.ix_(order_y, order_x)])**2
    spline = RectBivariateSpline(y_m[order_y], x_m[order_x], power)
    row, column = np.unravel_index(power.argmax(), power.shape)
    place = np.array([x_m[order_x][column], y_m[order_y][row]])
    for step in (0.025, 0.005, 0.0005):
        around = np.arange(-6, 7) * step
        values = spline(place[1] + around, place[0] + around)
        row, column = np.unravel_index(values.argmax(), values.shape)
        place = place + [around[column], around[row]]
    fine = np.arange(-CUT_M, CUT_M, STEP_M)
    cuts = (spline(place[1], place[0] + fine, grid=False),
            spline(place[1] + fine, place[0], grid=False))
    return place, tuple(_width(fine, cut) for cut in cuts)


def _width(axis: np.ndarray, power: np.ndarray) -> float:
    """Between the half-power points about the middle, between samples by straight lines."""
    middle = len(axis) // 2
    level = power / power[middle - 5:middle + 6].max()
    ends = []
    for cut, places in ((level[middle:], axis[middle:]), (level[middle::-1], axis[middle::-1])):
        i = int(np.argmax(cut < 0.5))
        share = (cut[i - 1] - 0.5) / (cut[i - 1] - cut[i])
        ends.append(places[i - 1] + share * (places[i] - places[i - 1]))
    return float(ends[0] - ends[1])


def _widths_by_formula(own: np.ndarray, target: np.ndarray, domain: str) -> tuple[float, float]:
    """-3 dB widths of the sum over vectors and frequencies about a target, along x and y.

    N samples of a spectrum with both its ends stand for a band of N steps.
    """
    _, axes = _frame()
    fine = np.arange(-CUT_M, CUT_M, STEP_M)
    at = _travel(own['TxPos'], own['RcvPos'], target)
    band = BAND_HZ * (N_SAMPLES / (N_SAMPLES - 1) if domain == 'FX' else 1.0)
    frequency = MIDDLE_HZ + ((np.arange(64) + 0.5) / 64 - 0.5) * band
    found = []
    for axis in axes[:2]:
        points = target + fine[:, None] * axis
        later = np.stack([_travel(own['TxPos'], own['RcvPos'], p) for p in points]) - at
        power = np.abs(sum(np.exp(2j * np.pi * f * later).sum(axis=1) for f in frequency))**2
        found.append(_width(fine, power))
    return tuple(found)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument('--output', type=pathlib.Path, help='file for the results')
    p.add_argument('--variants', nargs='+', help='parts of their names (default: all)')
    arguments = p.parse_args(argv)
    results: dict = {'machine': machine(), 'variants': {}}
    with tempfile.TemporaryDirectory() as folder:
        for name, variant in VARIANTS.items():
            if arguments.variants and not any(n in name for n in arguments.variants):
                continue
            path = pathlib.Path(folder) / 'variant.cphd'
            found = measure(path, write(path, variant))
            results['variants'][name] = found
            widths = np.abs(found['width_percent']).max()
            print(f'{name:48} {max(found["place_cm"]):6.3f} cm, widths within {widths:.2f} %, '
                  f'levels within {np.abs(found["level_db"]).max():.2f} dB', flush=True)
            if arguments.output:
                arguments.output.write_text(json.dumps(results, indent=1) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
