# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings replayed through the three real processes over real DDS, against exact images."""

import numpy as np

from msg_conversions.images import (
    amplitude_from_message,
    complex_from_message,
    map_metadata_from_message,
    quicklook_from_message,
)

# What the nodes plan for by default; positions and samples travel without any loss that counts.
LARGEST_ERROR_DB = -80.0


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def aperture_counters(truth, aperture):
    length = truth['pulses_per_aperture']
    return np.arange(aperture * length, (aperture + 1) * length)


def peak_m(image, grid, position_m, search_m):
    """Position of the largest pixel near a place, refined by a parabola per axis."""
    row, column = (int(v) for v in np.rint(grid.to_pixels(*position_m[:2])))
    n = round(search_m / grid.spacing_m)
    power = np.abs(image) ** 2
    window = power[row - n:row + n + 1, column - n:column + n + 1]
    i, j = np.unravel_index(np.argmax(window), window.shape)
    i, j = i + row - n, j + column - n

    def offset(before, at, after):
        return 0.5 * (before - after) / (before - 2 * at + after)

    return (grid.x_m[j] + offset(*power[i, j - 1:j + 2]) * grid.spacing_m,
            grid.y_m[i] - offset(*power[i - 1:i + 2, j]) * grid.spacing_m)


def test_a_recording_becomes_the_exact_images(make_chain, spotlight):
    """Those of the point spread function are looked at in the tests of evaluate."""
    truth = spotlight.truth
    n_images = truth['n_pulses'] // truth['pulses_per_aperture']
    chain = make_chain(truth)
    observer = chain.observer
    observer.send(spotlight.raw)
    images = observer.wait_for('image_complex', n_images)
    grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
    assert (list(grid.shape), grid.spacing_m) == (
        [truth['grid']['n_y'], truth['grid']['n_x']], truth['grid']['spacing_m'])
    np.testing.assert_allclose(grid.centre_m, truth['grid']['centre_m'], atol=1e-9)

    stamps = spotlight.pulses.stamp_ns
    for aperture, message in enumerate(images):
        image = complex_from_message(message)
        counters = aperture_counters(truth, aperture)
        assert spotlight.error_db(image, grid, counters) < LARGEST_ERROR_DB
        # The line through the first and last pulse's times, which are rounded to 1 ns.
        first = int(stamps[counters[0]])
        assert abs(stamp_ns(message) - first - (stamps[counters] - first).mean()) <= 2
        assert message.header.frame_id == 'map'
        for scatterer in truth['scatterers']:
            x, y = peak_m(image, grid, scatterer['position_m'], search_m=1.0)
            # The limits for the point spread function; x is range, y azimuth.
            assert abs(x - scatterer['position_m'][0]) < 0.05, scatterer['name']
            assert abs(y - scatterer['position_m'][1]) < 0.25, scatterer['name']

    amplitudes = observer.wait_for('image', n_images)
    quicklooks = observer.wait_for('image_quicklook', n_images)
    for message, amplitude, quicklook in zip(images, amplitudes, quicklooks, strict=True):
        assert message.header == amplitude.header == quicklook.header
        np.testing.assert_array_equal(amplitude_from_message(amplitude),
                                      np.abs(complex_from_message(message)))
        assert quicklook_from_message(quicklook).max() == 255

    last = truth['n_pulses'] - 1
    for node in ('pulse_buffer', 'range_compression', 'backprojection'):
        observer.wait_for_progress(node, last)
    observer.wait_for_counters('pulse_buffer', pulses_received=truth['n_pulses'],
                               pulses_missing=0, pulses_duplicate=0, pulses_late=0,
                               blocks_received=len(spotlight.raw), blocks_rejected=0,
                               blocks_dropped=0, apertures_started=n_images)
    observer.wait_for_counters('range_compression', blocks_rejected=0, blocks_dropped=0,
                               plans_made=1)
    observer.wait_for_counters('backprojection', images_published=n_images,
                               pulses_imaged=truth['n_pulses'],
                               pulses_missing_in_last_aperture=0)


def test_a_recording_in_a_loop_gives_the_same_images(make_chain, spotlight, tmp_path):
    # In a namespace and with a configuration file, as two radars on one robot would run.
    config = tmp_path / 'radar.yaml'
    config.write_text('/**:\n  ros__parameters:\n    min_pulse_fraction: 1\n'
                      '/**/backprojection:\n  ros__parameters:\n    frame_id: odom\n')
    chain = make_chain(spotlight.truth, namespace='radar1',
                       arguments=['--params-file', str(config)])
    for loop in range(3):
        chain.observer.send(spotlight.raw)
        images = chain.observer.wait_for('image_complex', 2 * (loop + 1))
    assert {m.header.frame_id for m in images} == {'odom'}
    for message in images[2:]:
        first = images[stamp_ns(message) != stamp_ns(images[0])]
        assert message.header == first.header
        np.testing.assert_array_equal(complex_from_message(message), complex_from_message(first))
    chain.observer.wait_for_counters('radar1/pulse_buffer', restarts=2, pulses_missing=0)
    chain.observer.wait_for_counters('radar1/backprojection', restarts=2, apertures_dropped=0)
    for name in ('pulse_buffer', 'backprojection'):
        assert chain.log(name).count('pulse counter jumped back to 0') == 2
