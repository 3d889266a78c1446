# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A stripmap through the nodes: beams that pass over the scene, weighed as correlation weighs."""

import os
import signal

import pytest

from msg_conversions.images import complex_from_message, map_metadata_from_message
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.tools.node_processes import AFBP_NODES, PIPELINE
from sar_imaging.tools.simulate import scenario_truth


@pytest.fixture(name='stripmap', scope='module')
def stripmap_fixture():
    scenario = SCENARIOS['stripmap']()
    return scenario, list(scenario.blocks(160))


def test_a_stripmap_through_the_nodes(make_chains, stripmap):
    """Sub-apertures in separate processes and exact images in one, of the same pulses."""
    scenario, blocks = stripmap
    truth, wanted_db = scenario_truth(scenario), (-50.0, -80.0)
    # Each block of an exact image is planned by itself, for 0.1 s: the 1280 pulses come in eight.
    chains = make_chains(*(
        {'truth': truth, 'names': names, 'namespace': f'radar{number}', 'mode': mode,
         'pulse_buffer': {'pulses_per_block': 32 if mode == 'subapertures' else 160},
         'backprojection': {'subapertures.target_db': wanted_db[0], 'target_db': wanted_db[1]}}
        for number, (names, mode) in enumerate(((AFBP_NODES, 'subapertures'),
                                                (PIPELINE, 'image')))))
    fusion = chains[0].pid('afbp_fusion')
    os.kill(fusion, signal.SIGSTOP)  # all 80 sub-apertures wait: more than queue_depth
    for chain in chains:
        chain.observer.send(blocks)
    chains[0].observer.wait_for_progress('backprojection', scenario.n_pulses - 1)
    os.kill(fusion, signal.SIGCONT)
    compressor = RangeCompressor.for_block(blocks[0])
    profiles = concatenate([compressor(block) for block in blocks])
    pattern = scenario.antenna.amplitudes()
    for chain, target_db in zip(chains, wanted_db, strict=True):
        [message] = chain.observer.wait_for('image_complex', 1)
        grid = map_metadata_from_message(chain.observer.wait_for('map_metadata', 1)[0])
        found = measure_error(complex_from_message(message), grid, [profiles], n_pixels=150,
                              n_brightest=100, illumination=pattern)
        assert found.error_db < target_db, chain.all_logs()
        # pulses are dense enough for the beam, though not for the whole scene
        assert 'repeat scatterers' not in chain.all_logs()
