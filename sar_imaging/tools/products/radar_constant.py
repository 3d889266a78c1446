# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measure the radar constant at a reflector of known cross section and save it as YAML.

Run: sar-imaging radar-constant bags/countryside --reflector -21 17 0 --trihedral 0.3 \
     --output radar.yaml
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from sar_imaging.configuration.scene_grid import GridChoice, choose_grid
from sar_imaging.files import replacing
from sar_imaging.quality import measure_scatterer
from sar_imaging.radiometry import RadarConstant, noise_power, trihedral_cross_section_m2

from ...recordings.pulse_source import PulseSource, SourceError, open_pulses
from ..arguments import add_aperture, add_memory, add_pulses, memory_bytes
from ..program import command_parser, main_of
from . import forming
from .brightness import respond

_CELLS = 32.0  # resolution cells along a side of the image of the reflector
_CUT_CELLS = 6.0
_NOISE_BYTES = 1e8

_EPILOG = """\
The file goes to `sar-imaging image --brightness sigma0 --radar-constant FILE`. It is good for all
recordings of the same radar with the same gain. Nothing else as bright may stand within ten
resolution cells of the reflector. The pattern of the antenna is taken out where the file describes
it; where not, the antenna is taken to light the reflector as brightly as the rest of the scene.
Exit status: 0 when the file was written, 1 with a reason when not.
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('sar-imaging radar-constant', 'Measure the radar constant at a reflector '
                       'of known cross section.', _EPILOG)
    add_pulses(p)
    p.add_argument('--reflector', type=float, nargs=3, required=True, metavar=('X', 'Y', 'Z'),
                   help='its place in the frame of the phase centres, metres')
    size = p.add_mutually_exclusive_group(required=True)
    size.add_argument('--cross-section', type=float, metavar='M2',
                      help='of the reflector, square metres')
    size.add_argument('--trihedral', type=float, metavar='EDGE',
                      help='length of the edge where two plates of a triangular trihedral meet, '
                           'metres')
    add_aperture(p)
    add_memory(p)
    p.add_argument('--output', type=Path, required=True, metavar='FILE', help='YAML file')
    return p


def run(arguments: argparse.Namespace) -> str:
    """Measure and write the constant; returns a summary for people."""
    source = forming.weighted(open_pulses(arguments.file, aperture=arguments.aperture))
    wavelength = source.radar.propagation_speed_m_per_s / source.radar.carrier_hz
    size = (arguments.cross_section if arguments.trihedral is None
            else trihedral_cross_section_m2(arguments.trihedral, wavelength))
    if not (math.isfinite(size) and size > 0):
        raise SourceError(f'a cross section of {size:g} m^2; expected a positive number')
    n_bytes = memory_bytes(arguments)
    constant = measure_constant(source, arguments.reflector, size, n_bytes)
    write_constant(arguments.output, constant, source, arguments.reflector, size)
    return (f'gain {constant.gain:.6g} from a reflector of {size:.4g} m^2 '
            f'({10 * math.log10(size):.1f} dB), noise power at most {constant.noise_power:.3g} in '
            f'a sample of the range profiles\nwritten to {arguments.output}')


def write_constant(path: Path, constant: RadarConstant, source: PulseSource,
                   reflector_m: Sequence[float], cross_section_m2: float) -> None:
    """Write a radar constant with where it comes from; folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as part:
        part.write_text(yaml.safe_dump({
            'gain_m': constant.gain, 'noise_power': constant.noise_power,
            'measured_in': str(source.path), 'reflector_m': [float(v) for v in reflector_m],
            'cross_section_m2': float(cross_section_m2),
            'carrier_hz': float(source.radar.carrier_hz)}, sort_keys=False))


def measure_constant(source: PulseSource, reflector_m: Sequence[float], cross_section_m2: float,
                     n_bytes: float) -> RadarConstant:
    """Radar constant from a small image around a reflector.

    Raises
    ------
    SourceError
        No peak stands at that place.
    """
    choice = _around(source, reflector_m, n_bytes)
    image, _ = forming.form(source, choice, -60.0, n_bytes, label='imaging the reflector')
    cells = choice.range_resolution_m, choice.azimuth_resolution_m
    peak = measure_scatterer(
        image.samples, choice.grid, reflector_m, aperture_centre_m=source.track_m.mean(axis=0),
        wavenumber_rad_per_m=source.radar.wavenumber_rad_per_m,
        cut_half_width_range_m=_CUT_CELLS * cells[0],
        cut_half_width_azimuth_m=_CUT_CELLS * cells[1])
    if not math.isfinite(peak.peak_amplitude):
        raise SourceError(f'no reflector is seen at {reflector_m}: {peak.reason}; is its place '
                          'right?')
    block = next(iter(source.profiles(_NOISE_BYTES)))
    return RadarConstant.from_reflector(
        peak.peak_amplitude, choice.grid.to_pixels(*reflector_m[:2]), respond(source, choice),
        cross_section_m2, noise_power(block.samples))


def _around(source: PulseSource, place: Sequence[float], n_bytes: float) -> GridChoice:
    """Fine pixels around a place."""
    first = choose_grid(source.coverage(), np.asarray(place, float), size_m=(1.0, 1.0),
                        memory_bytes=n_bytes)
    side = _CELLS * max(first.range_resolution_m, first.azimuth_resolution_m)
    return choose_grid(source.coverage(), np.asarray(place, float), size_m=(side, side),
                       memory_bytes=n_bytes)


main = main_of(parser, run, quiet=True)
