# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A shipped configuration file, as it is, through the real nodes."""

import re

import pytest

from msg_conversions.images import complex_from_message, map_metadata_from_message
from sar_imaging.configuration import Machine, derive
from sar_imaging.configuration.parameters import default_file, read_configuration
from sar_imaging.quality import measure_scatterer
from sar_imaging.simulation.scenarios.catalogue import configured_scenario
from sar_imaging.tools.simulate import scenario_truth

CAR = default_file().with_name('automotive_77ghz.yaml')


def test_the_car_images_what_its_configuration_promises(make_chain):
    configuration = read_configuration(CAR)
    acquisition, imaging = configuration.acquisition(), configuration.imaging()
    derived = derive(acquisition, imaging, Machine.this_one())
    scenario = configured_scenario('car', acquisition, imaging)
    # The later file wins: every parameter comes from the shipped one.
    chain = make_chain(scenario_truth(scenario, window=imaging.window),
                       arguments=['--params-file', str(CAR)])
    chain.observer.send(scenario.blocks(32))
    [message] = chain.observer.wait_for('image_complex', 1)
    assert message.header.frame_id == 'odom'
    grid = map_metadata_from_message(chain.observer.wait_for('map_metadata', 1)[0])
    assert grid.shape == imaging.grid.shape
    image = complex_from_message(message)
    qualities = [measure_scatterer(
        image, grid, scatterer.position_m, aperture_centre_m=acquisition.centre_m,
        wavenumber_rad_per_m=acquisition.radar.wavenumber_rad_per_m,
        cut_half_width_range_m=scenario.cut_half_width_m[0],
        cut_half_width_azimuth_m=scenario.cut_half_width_m[1])
        for scatterer in scenario.scatterers]
    # Measured: 2e-4 of the widths of the first, which stands in the middle of the grid, to which
    # the derived widths belong; the sidelobes of the others may move a peak by 1 %.
    assert qualities[0].irw_range_m == pytest.approx(derived.range_width_m, rel=2e-3)
    assert qualities[0].irw_azimuth_m == pytest.approx(derived.azimuth_width_m, rel=2e-3)
    for quality in qualities:
        assert abs(quality.position_error_range_m) < 0.02 * derived.range_width_m
        assert abs(quality.position_error_azimuth_m) < 0.02 * derived.azimuth_width_m
    # What the node found out from the first block alone is what the checker derives.
    log = chain.log('backprojection')
    assert log.count('derived quantities:') == 1
    assert re.search(rf'azimuth resolution +{derived.azimuth_width_m:.3g} m', log)
    warnings = [line for line in log.splitlines() if 'WARN' in line]
    # A busy machine is told, and is no fault of the configuration.
    assert all(re.search('input stalled|falling behind', line) for line in warnings)
    for node in derived.memory:
        used = chain.observer.wait(
            lambda name=node.node: chain.observer.counters(name).get('memory_megabytes'),
            f'diagnostics of {node.node}')
        assert used < node.n_bytes / 1e6, node
