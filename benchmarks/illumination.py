# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Illumination: what it saves and costs, and a spaceborne stripmap.

- speed: exact backprojection along lines and point by point, and AFBP, with an antenna that lights
  everything and with one that lights a strip; process time on one thread, in pairs with the same
  image without illumination;
- forms: exact backprojection of typical scenes, as planned and with amplitudes found in simpler
  ways: on every line, and at each point; process time on one thread, in turn with the plan's;
- stripmap: 30 s from orbit with 0.64 s in the beam, block by block, against the closed form.

`illumination_campaign` measures predictions. Run from the repository root:
``python -m benchmarks.illumination speed forms stripmap``.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import itertools
import json
import math
import pathlib
import time

import numba
import numpy as np

from sar_imaging.backends import cpu
from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, PatternCut, Pointing
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.profiles import OutOfReach
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters

from .support.machine import machine
from .support.stripmap import Stripmap

RESULTS = pathlib.Path(__file__).parent / 'results' / 'illumination.json'
_ROUNDS = 9


def _clutter(n_pulses, size, spacing_m, length_m, range_m=5000.0) -> tuple[PulseBlock, MapGrid]:
    rng, n = np.random.default_rng(0), 2400
    centres = np.zeros((n_pulses, 1, 3))
    centres[:, 0, 0] = np.linspace(-length_m / 2, length_m / 2, n_pulses)
    centres[:, 0, 2] = 1000.0
    radar = RadarParameters(9.6e9, 200e6, 300e6, 2 * (range_m - 400) / SPEED_OF_LIGHT)
    spectrum = np.fft.fft(rng.normal(size=(n_pulses, 1, n)))
    spectrum[..., np.abs(np.fft.fftfreq(n)) > 1 / 3] = 0
    number = np.arange(n_pulses)
    pointing = Pointing.beside_track(centres[:, 0], 1, 0.2)
    return PulseBlock(radar, True, number, number, np.fft.ifft(spectrum), centres, centres,
                      pointing=pointing), MapGrid((0.0, range_m, 0.0), size, size, spacing_m)


def _paired(lit, bare, block) -> tuple[float, float, float]:
    """Shortest times of both, seconds, and the median of their ratios."""
    seconds = np.empty((_ROUNDS, 2))
    lit(block), bare(block)
    for row in seconds:
        for i, imager in enumerate((lit, bare)):
            begin = time.process_time()
            imager(block)
            row[i] = time.process_time() - begin
    return *seconds.min(axis=0), float(np.median(seconds[:, 0] / seconds[:, 1]))


def speed() -> list[dict]:
    """Time with illumination over that without, of the whole image and per lit pixel."""
    numba.set_num_threads(1)
    found = []
    for name, method, target_db, case, widths, more in (
            ('exact, lines', 'exact', -60.0, (256, 1024, 0.5, 80.0), (0.6, 0.02), {}),
            ('exact, points', 'exact', -60.0, (48, 768, 0.5, 40.0), (0.6, 0.02), {'height': 1}),
            ('AFBP', 'afbp', -50.0, (2048, 768, 0.4, 400.0), (0.6, 0.06), {})):
        block, grid = _clutter(*case)
        more = {'height_m': np.zeros(grid.shape)} if more else {}
        for width in widths:
            pattern = AntennaPattern(PatternCut.sinc(width), PatternCut.gaussian(0.9))
            args = dict(method=method, target_db=target_db, **more)
            lit = plan_image(grid, block.radar, block.n_samples, illumination=pattern, **args)
            bare = plan_image(grid, block.radar, block.n_samples, **args)
            seconds, without, ratio = _paired(lit, bare, block)
            plan = lit.report.plan
            route = getattr(plan, 'route', None)
            share = route.amplitudes.share if route else len(
                plan.subapertures.amplitudes.seen) / plan.subapertures.n_subapertures
            found.append({'case': name, 'width_rad': width, 'lit_share': share,
                          'seconds': seconds, 'seconds_without': without, 'ratio': ratio,
                          'predicted_ratio': lit.report.seconds / bare.report.seconds})
            print(found[-1], flush=True)
    return found


#: Carrier and bandwidth, Hz; ground range, height and track, metres; pulses; pixels of a side and
#: their spacing, metres; and a wide and a narrow antenna, radians.
_FORMS = {
    'rail, 77 GHz, 7 m': (77e9, 1e9, 7.0, 1.0, 0.6, 1024, 300, 0.02, (1.0, 0.2)),
    'rover, 24 GHz, 60 m': (24e9, 500e6, 60.0, 10.0, 10.0, 512, 512, 0.1, (0.6, 0.2)),
    'drone, 4 GHz, 10 m': (4e9, 1e9, 10.0, 8.0, 12.0, 380, 256, 0.06, (1.0, 0.4)),
    'aircraft, 9.6 GHz, 10 km': (9.6e9, 150e6, 1e4, 3e3, 150.0, 256, 1024, 0.8, (0.1, 0.02)),
    'strip, 9.6 GHz, 5 km': (9.6e9, 200e6, 5e3, 1e3, 700.0, 1024, 768, 0.5, (0.1, 0.015))}


def _scene(carrier, band, range_m, height, track, n_pulses, size, spacing) -> tuple:
    """Noise from a straight track, the antenna beside it, and the map."""
    centres = np.zeros((n_pulses, 1, 3))
    centres[:, 0, 0] = np.linspace(-track / 2, track / 2, n_pulses)
    centres[:, 0, 2] = height
    reach, rate = size * spacing, 1.5 * band
    near = max(math.hypot(range_m, height) - reach, 0.3)
    far = math.hypot(range_m + reach, reach + track) + height
    n_samples = 64 + int(2 * (far - near) * rate / SPEED_OF_LIGHT)
    spectrum = np.fft.fft(np.random.default_rng(0).normal(size=(n_pulses, 1, n_samples)))
    spectrum[..., np.abs(np.fft.fftfreq(n_samples)) > 1 / 3] = 0
    number = np.arange(n_pulses)
    radar = RadarParameters(carrier, band, rate, 2 * near / SPEED_OF_LIGHT)
    pointing = Pointing.beside_track(centres[:, 0], 1, math.atan2(height, range_m))
    return (PulseBlock(radar, True, number, number, np.fft.ifft(spectrum), centres, centres,
                       pointing=pointing), MapGrid((0.0, range_m, 0.0), size, size, spacing))


def forms() -> list[dict]:
    """Time of simpler ways to the amplitudes over that of the plan."""
    numba.set_num_threads(1)
    found = []
    for name, (*scene, widths) in _FORMS.items():
        block, grid = _scene(*scene)
        for width, terrain in itertools.product(widths, (False, True)):
            height = {'height_m': np.zeros(grid.shape)} if terrain else {}
            args = grid, block.radar, block.n_samples
            more = {'method': 'exact', 'target_db': -60.0, **height}
            pattern = AntennaPattern(PatternCut.sinc(width), PatternCut.gaussian(0.9))
            imager = plan_image(*args, illumination=pattern, **more)
            plan, bare = (i(block).report.plan for i in (imager, plan_image(*args, **more)))
            lit = plan.route.amplitudes
            name_of, change = ('each point', {'each': True}) if plan.method == 'points' else (
                'every line', {'apart': 1})
            simpler = dataclasses.replace(plan, route=dataclasses.replace(
                plan.route, amplitudes=dataclasses.replace(lit, **change)))
            plans = {'planned': plan, 'without': bare, name_of: simpler}
            found.append({'case': name, 'width_rad': width, 'route': plan.method,
                          'lit_share': lit.share, 'seconds_over_planned': _over_first(
                              plans, block)})
            print(found[-1], flush=True)
    return found


def _over_first(plans: dict, block: PulseBlock) -> dict[str, float]:
    """Median ratio of the time of plans to that of the first, measured in turn."""
    echoes = (block.samples.reshape(-1, block.n_samples).astype(np.complex64),
              block.tx_m.reshape(-1, 3), block.rx_m.reshape(-1, 3))
    backends = {name: cpu.Backprojection(plan) for name, plan in plans.items()}
    seconds = np.empty((_ROUNDS + 1, len(plans)))
    for row in seconds:
        for i, (name, backend) in enumerate(backends.items()):
            image = np.zeros(plans[name].grid.shape, np.complex64)
            begin = time.process_time()
            backend.add(*echoes, image)
            row[i] = time.process_time() - begin
    ratios = np.median(seconds[1:] / seconds[1:, :1], axis=0)  # the first compiles
    return dict(zip(plans, ratios.round(3).tolist(), strict=True))


def stripmap() -> dict:
    """A scatterer in noise on a strip of 8 km by 2 km, from 30 s of a satellite's flight."""
    numba.set_num_threads(1)
    strip = Stripmap(carrier_hz=9.6e9, bandwidth_hz=30e6, repetition_hz=4000.0, in_beam_s=0.64,
                     n_samples=1536)
    grid = MapGrid(strip.target_m, 4000, 1000, 2.0)
    offset = np.linspace(-30, 30, 601)
    line = np.array(strip.target_m) + offset[:, None] * [1.0, 0.0, 0.0]
    theory = np.abs(strip.response(offset))
    found = {'pulses': strip.n_pulses, 'seconds_of_flight': strip.seconds,
             'pixels': grid.n_x * grid.n_y, 'lit_share': strip.lit_share(grid),
             'theory_m': strip.width_m(offset, theory),
             'theory_sidelobe_db': _sidelobe_db(theory)}
    echo, _ = _summed(strip, line, strip.pattern, noise=0.0)
    measured = np.abs(echo.samples)
    found |= {'width_m': strip.width_m(offset, measured), 'sidelobe_db': _sidelobe_db(measured),
              'error_db': 20 * math.log10(np.linalg.norm(measured - theory)
                                          / np.linalg.norm(theory))}
    for name, pattern in (('with', strip.pattern), ('without', None)):
        image, seconds = _summed(strip, grid, pattern, noise=1.0)
        power = np.abs(image.samples) ** 2
        away = np.ones(power.shape, bool)
        row, column = (round(float(v)) for v in grid.to_pixels(*strip.target_m[:2]))
        peak = power[row - 2:row + 3, column - 2:column + 3].max()
        away[row - 50:row + 51, column - 50:column + 51] = False
        found[name] = {'process_s': seconds,
                       'contrast_db': 10 * math.log10(peak / power[away].mean())}
        print(name, found[name], flush=True)
    # Of noise each lit pulse adds w^2, of which the mean is 3/8; the peak adds w^2 as well.
    n_illuminated = strip.in_beam_s * strip.repetition_hz
    found['theory_contrast_db'] = 10 * math.log10(0.375 * n_illuminated)
    return found


def _summed(strip: Stripmap, grid, pattern, noise: float):
    """Image of the recording, block by block, and the time that imaging took, seconds."""
    imager = plan_image(grid, strip.radar, strip.n_samples, method='exact', target_db=-50.0,
                        illumination=pattern)
    image, seconds = imager.new_image(), 0.0
    for block in strip.blocks(4096, noise):
        begin = time.process_time()
        with contextlib.suppress(OutOfReach):  # what is further off than profiles reach
            imager.accumulate(block, image)
        seconds += time.process_time() - begin
    return image, seconds


def _sidelobe_db(amplitude) -> float:
    """Largest sidelobe of a response beside its main lobe, dB."""
    falls = np.diff(amplitude) < 0
    peak = int(np.argmax(amplitude))
    after = peak + int(np.argmin(falls[peak:]))  # first minimum
    return 20 * math.log10(amplitude[after:].max() / amplitude[peak])


def main() -> None:
    """Run parts and write what they found."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parts = {'speed': speed, 'forms': forms, 'stripmap': stripmap}
    parser.add_argument('parts', nargs='+', choices=parts)
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name in parser.parse_args().parts:
        results |= {name: parts[name](), 'machine': machine()}
        RESULTS.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
