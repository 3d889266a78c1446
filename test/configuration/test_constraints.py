# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every violation is found, and following its advice removes it."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given, settings

from sar_imaging.configuration import Machine, check, derive
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.correlation import correlate
from sar_imaging.signal.radar import SPEED_OF_LIGHT, Waveform

from .conftest import MACHINE, make_acquisition, make_imaging, profile_setups


def findings(acquisition, imaging, machine=MACHINE):
    return check(acquisition, imaging, machine, derive(acquisition, imaging, machine))


def grid(size_x, size_y, spacing, x=0.0, y=0.0):
    return MapGrid.from_size((x, y, 0.0), size_x, size_y, spacing)


def test_nothing_is_wrong_with_the_example(acquisition, imaging):
    assert findings(acquisition, imaging) == []


# Severity, text, and the changes that bring it about.
CASES = {
    'oversampling': ('error', r'range profiles are sampled at 1 times their bandwidth; '
                     'backprojection needs 1.25: raise oversampling',
                     {}, {'oversampling': 1.0}),
    'autofocus': ('error', 'autofocus.track_error=0.1 and autofocus.time_offset=0 are of no use '
                  'in mode: subapertures',
                  {}, {'mode': 'subapertures', 'autofocus_track_error': 0.1}),
    'pixels': ('error', 'the grid has 501 x 501 pixels, more than max_image_pixels=1000; raise '
               'grid.spacing', {}, {'max_image_pixels': 1000}),
    'scene too far': ('error', r'the scene lies .* nothing of it was recorded; move the range '
                      'window', {'first_sample_delay_s': 2 * 2000.0 / SPEED_OF_LIGHT}, {}),
    'scene cut': ('warning', r'the scene lies .*, \d+ % of its depth; the rest of the image '
                  'stays dark', {'first_sample_delay_s': 2 * 990.0 / SPEED_OF_LIGHT}, {}),
    'range folds': ('error', 'the scene is .* m deep, the frequency step repeats ranges every '
                    '9.993 m; use more frequencies',
                    {'waveform': Waveform.STEPPED_FREQUENCY, 'sample_rate_hz': 300e6,
                     'n_samples': 20, 'first_sample_delay_s': 2 * 1000.0 / SPEED_OF_LIGHT}, {}),
    'recording too long': ('error', 'prf_hz=400000: a recording of 1200 samples takes longer than '
                           'the 2.5 us between pulses; at most 3.333e.05 Hz',
                           {'prf_hz': 400e3}, {}),
    'pulses in the air': ('warning', 'the scene at .* is beyond the unambiguous range of 599.6 m: '
                          '1 later pulses are in flight', {'prf_hz': 250e3}, {}),
    'receiver deaf': ('warning', 'at prf_hz=130000 a pulse is sent while echoes are recorded',
                      {'prf_hz': 130e3}, {}),
    'ambiguous beam': ('error', 'pulses every 0.25 m repeat scatterers every 0.059.* the '
                       'illuminated scene is 0.0.* wide: raise prf_hz=200 to 2',
                       {'beamwidth_rad': 1.0}, {'grid': grid(20.0, 80.0, 0.1)}),
    'ambiguous scene': ('warning', 'repeat scatterers every .* the scene is 0.0.* wide: raise '
                        'prf_hz', {}, {'grid': grid(20.0, 80.0, 0.1)}),
    'both sides': ('warning', 'the grid extends across the track: only the antenna pattern',
                   {'centre_m': (-10.0, 0.0, 900.0)}, {}),
    'along the track': ('error', 'the aperture of 63.8 m resolves inf m in azimuth',
                        {'velocity_m_per_s': (50.0 * 0.8, 0.0, -50.0 * 0.6)}, {}),
    'below': ('error', 'directly below the radar, .* m away: ranges on the ground are not',
              {'centre_m': (0.0, 0.0, 1000.0)}, {}),
    'pixels far apart': ('error', 'grid.spacing=2 m: scatterers between pixels vanish, the '
                         r'null spacing in azimuth is 0.234 m; use at most half of it, 0.11 m',
                         {}, {'grid': grid(50.0, 50.0, 2.0)}),
    'pixels apart': ('warning', 'grid.spacing=0.2 m is more than half of the null spacing in '
                     'azimuth, 0.234 m: a scatterer between pixels loses up to 2.8 dB; 0.11 m',
                     {}, {'grid': grid(50.0, 50.0, 0.2)}),
    # 0.25 m from pulse to pulse, 256 of them.
    'strip with gaps': ('warning', 'the image follows the antenna, 64 m along y from aperture to '
                        r'aperture, and is 50.1 m long there: 13.9 m in between are never imaged; '
                        'raise grid.size_y to 64 m',
                        {}, {'mode': 'subapertures', 'subaperture_follow': True}),
    'block too large': ('error', 'a block of 32 pulses has 153728 floats, more than '
                        'max_message_elements=1000; lower pulses_per_block',
                        {}, {'max_message_elements': 1000}),
    'block large': ('warning', 'blocks of 39.4 MB take long to transfer; lower '
                    'pulses_per_block=2048',
                    {}, {'pulses_per_block': 2048}),
    'blocks small': ('warning', 'blocks of 38.4 kB are small, so there are many; raise '
                     'pulses_per_block=2',
                     {}, {'pulses_per_block': 2}),
}


@pytest.mark.parametrize('case', CASES)
def test_a_violation_is_found(case):
    severity, text, radar, settings = CASES[case]
    found = findings(make_acquisition(**radar), make_imaging(**settings))
    matching = [f for f in found if re.search(text, f.text)]
    assert [f.severity for f in matching] == [severity], [f.text for f in found]
    assert [f.severity for f in found] == sorted(f.severity for f in found)  # errors first


# Just inside and just outside of every limit: what changes, and the words of its finding.
LIMITS = {
    'pixels': ('more than max_image_pixels', [{}, {'max_image_pixels': 501 * 501}],
               [{}, {'max_image_pixels': 501 * 501 - 1}]),
    'elements': ('more than max_message_elements', [{}, {'max_message_elements': 153_728}],
                 [{}, {'max_message_elements': 153_727}]),
    # 19 216 bytes a pulse: 32 bit complex numbers, 2 channels, 1201 samples of a profile.
    'large blocks': ('take long to transfer', [{}, {'pulses_per_block': 832}],
                     [{}, {'pulses_per_block': 833}]),
    # 16 bytes a sample as it comes: 100 kB.
    'small blocks': ('so there are many', [{'n_samples': 1250}, {'pulses_per_block': 5}],
                     [{'n_samples': 1249}, {'pulses_per_block': 5}]),
    # Half a second of pulses is enough, however small the blocks are.
    'long blocks': ('so there are many', [{'prf_hz': 10.0}, {'pulses_per_block': 5}],
                    [{'prf_hz': 10.5}, {'pulses_per_block': 5}]),
    'strip': ('are never imaged',
              [{}, {'mode': 'subapertures', 'subaperture_follow': True,
                    'grid': MapGrid((0.0, 0.0, 0.0), 500, 640, 0.1)}],
              [{}, {'mode': 'subapertures', 'subaperture_follow': True,
                    'grid': MapGrid((0.0, 0.0, 0.0), 500, 639, 0.1)}]),
    'no strip': ('are never imaged', [{}, {'mode': 'subapertures', 'subaperture_sliding': True}],
                 [{}, {'mode': 'subapertures', 'subaperture_sliding': True,
                       'subaperture_follow': True}]),
    'long recording': ('takes longer than', [{'prf_hz': 400e6 / 1200}, {}],
                       [{'prf_hz': 400e6 / 1199.9}, {}]),
}


@pytest.mark.parametrize('case', LIMITS)
def test_a_finding_begins_at_its_limit(case):
    text, inside, outside = LIMITS[case]
    for expected, (radar, changes) in ((False, inside), (True, outside)):
        found = findings(make_acquisition(**radar), make_imaging(**changes))
        assert any(text in f.text for f in found) is expected, [f.text for f in found]


@pytest.mark.parametrize(('samples_per_cell', 'expected'), [(1.2501, False), (1.2499, True)])
def test_profiles_need_five_samples_for_four_cells(acquisition, imaging, samples_per_cell,
                                                   expected):
    """What is planned has a length whose transform is quick, and mostly more than is asked for."""
    derived = derive(acquisition, imaging, MACHINE)
    radar = dataclasses.replace(derived.profile_radar, sample_rate_hz=samples_per_cell * 300e6)
    found = check(acquisition, imaging, MACHINE, dataclasses.replace(derived, profile_radar=radar))
    assert any('times their bandwidth' in f.text for f in found) is expected


def test_pixels_are_judged_by_half_of_the_null_spacing_and_by_twice():
    null = derive(make_acquisition(), make_imaging(), MACHINE).azimuth_null_m

    def severities(share):
        finer = make_imaging(grid=MapGrid((0.0, 0.0, 0.0), 20, 20, share * null))
        return [f.severity for f in findings(make_acquisition(), finer) if 'azimuth' in f.text]

    assert [severities(share) for share in (0.499, 0.501, 1.99, 2.01)] == [
        [], ['warning'], ['warning'], ['error']]


@pytest.mark.parametrize(('share', 'expected'), [(0.999, True), (1.001, False)])
def test_memory_and_time_are_enough_from_what_is_needed_on(acquisition, imaging, share, expected):
    derived = derive(acquisition, imaging, MACHINE)
    memory = round(share * sum(m.n_bytes for m in derived.memory))
    rate = share * derived.imaging_s / derived.aperture_s * MACHINE.rate_per_s
    texts = [f.text for f in findings(acquisition, imaging, Machine(rate, 'given', memory))]
    assert any('the nodes may need' in t for t in texts) is expected
    assert any('blocks will be dropped' in t for t in texts) is expected
    one_image = round(share * 24 * 501 * 501)  # image, message, message serialised
    texts = [f.text for f in findings(acquisition, imaging, Machine(1e9, 'given', one_image))]
    assert any('and its message need' in t for t in texts) is expected


@pytest.mark.parametrize(('memory', 'severity', 'text'), [
    (1_000_000, 'error', 'an image of 501 x 501 pixels and its message need 6 MB, 1 MB are '
     'available'),
    (300_000_000, 'warning', 'the nodes may need .* MB, 300 MB are available; lower queue_depth'),
])
def test_memory(acquisition, imaging, memory, severity, text):
    found = findings(acquisition, imaging, Machine(1e9, 'given', memory))
    assert [f.severity for f in found if re.search(text, f.text)] == [severity]


def test_a_machine_that_is_too_slow(acquisition, imaging):
    [found] = findings(acquisition, imaging, Machine(50e6, 'given', 8_000_000_000))
    assert found.severity == 'warning'
    assert 'an image takes about 2.57 s of work, the next aperture comes after 1.28 s' \
        in found.text


@given(setup=profile_setups())
@settings(max_examples=60)
def test_any_setup_is_judged_and_the_advice_helps(setup):
    acquisition, imaging = setup
    derived = derive(acquisition, imaging, MACHINE)
    found = check(acquisition, imaging, MACHINE, derived)
    assert all(f.text and f.severity in ('error', 'warning') for f in found)
    if any('in direction cosine' in f.text for f in found):
        faster = dataclasses.replace(acquisition, prf_hz=derived.least_prf_hz)
        assert not any('in direction cosine' in f.text for f in findings(faster, imaging))
    null = min(derived.range_null_m, derived.azimuth_null_m)
    if any(f.text.startswith('grid.spacing') for f in found):
        assert imaging.grid.spacing_m > 0.5 * null
        finer = dataclasses.replace(imaging, grid=dataclasses.replace(
            imaging.grid, n_x=1, n_y=1, spacing_m=0.49 * null))
        assert not any(f.text.startswith('grid.spacing')
                       for f in findings(acquisition, finer))
    else:
        assert imaging.grid.spacing_m <= 0.5 * null * (1 + 1e-6)


def test_an_ambiguous_scatterer_appears_where_the_checker_says():
    """The ghost of an undersampled track stands `ambiguity_m` away along the circle of range."""
    # One frequency is enough for azimuth; 250 m at 1 km are 14 degrees.
    acquisition = make_acquisition(centre_m=(-1000.0, 0.0, 0.0), n_channels=1, prf_hz=40.0,
                                   velocity_m_per_s=(0.0, 2.4, 0.0))
    derived = derive(acquisition, make_imaging(pulses_per_aperture=64), MACHINE)
    track = acquisition.track(64)[:, None]
    frequency = np.array([acquisition.radar.carrier_hz])
    path = np.linalg.norm(track, axis=-1)  # the scatterer stands at the origin
    spectra = np.exp(-4j * np.pi * path / SPEED_OF_LIGHT * frequency)[..., None]
    sines = derived.ambiguity_m / 1000.0 + np.linspace(-0.02, 0.02, 2001)
    points = 1000.0 * np.stack([np.sqrt(1 - sines**2) - 1, sines, 0 * sines], axis=1)
    image = np.abs(correlate(frequency, spectra, track, track, points))
    assert image.max() > 0.99 * 64  # as bright as the scatterer itself
    # A pixel is 0.02 m; the response, 3.3 m wide, has its maximum there.
    assert points[image.argmax(), 1] == pytest.approx(derived.ambiguity_m, abs=0.1)
