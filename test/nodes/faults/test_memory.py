# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A scene larger than memory is refused with its sizes, and the next sensible one is imaged."""

import dataclasses
import pathlib
import resource

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_conversions import subaperture_image
from msg_conversions.images import complex_from_message, map_metadata_from_message
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.streaming.subapertures import LiveSubapertures
from sar_imaging.tools.node_processes import parameters_from_truth, pipeline_parameters

LARGEST_ERROR_DB = {'image': -80.0, 'subapertures': -60.0}  # what is planned for by default
ROOM_BYTES = 2_000_000_000  # beside what a node has at its start, threads and kernels included
FINE_M = 0.001


def limit_memory(pid):
    """Let a process have only so much more memory, as a container or `ulimit -v` does."""
    pages = int(pathlib.Path(f'/proc/{pid}/statm').read_text().split()[0])
    limit = pages * resource.getpagesize() + ROOM_BYTES
    resource.prlimit(pid, resource.RLIMIT_AS, (limit, limit))


def test_a_grid_larger_than_memory_refuses_the_configuration(start_node, make_observer, psf):
    modes = {'backprojection': 'image', 'sar_pipeline': 'subapertures'}
    parameters = parameters_from_truth(psf.truth, modes['backprojection'])
    parameters |= pipeline_parameters(parameters_from_truth(psf.truth, modes['sar_pipeline']))
    nodes = {name: start_node(name, parameters[name] | {
        'autostart': False, 'max_image_pixels': 2**31 - 1, 'grid.spacing': FINE_M})
        for name in modes}
    for (name, node), pulses in zip(nodes.items(), ('range_profiles', 'pulses'), strict=True):
        observer = make_observer(pulses)
        observer.wait(lambda o=observer, n=name: o.status(n), 'diagnostics')
        limit_memory(node.pid(name))
        assert not observer.change_state(name, 'configure')
        node.wait_for_log(name, r'configuration refused: an image of \d+ x \d+ pixels and its '
                          r'message need \d+ MB, \d+ MB are available; raise '
                          rf'grid\.spacing={FINE_M} or choose a smaller grid')
        assert observer.state(name) == 'unconfigured'

        spacing = psf.truth['grid']['spacing_m']
        assert observer.set_parameter(name, 'grid.spacing', spacing) == (True, '')
        assert observer.change_state(name, 'configure')
        assert observer.change_state(name, 'activate')
        node.wait_for_log(name, 'subscriber on .*image_complex joined')
        observer.wait(lambda o=observer: o.joined, 'a subscriber of the pulses')
        observer.send(psf.raw)
        [image] = observer.wait_for('image_complex', 1)
        grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
        error_db = psf.error_db(complex_from_message(image), grid, np.arange(200))
        assert error_db < LARGEST_ERROR_DB[modes[name]]
        assert observer.counters(name)['errors'] == 0
        assert node.stop(name) == 0


def test_subapertures_of_a_map_larger_than_memory_are_refused(start_node, make_observer, psf):
    truth = psf.truth['grid']
    grid = MapGrid(tuple(truth['centre_m']), truth['n_x'], truth['n_y'], truth['spacing_m'])
    fine = MapGrid.from_size(grid.centre_m, (grid.n_x - 1) * grid.spacing_m,
                             (grid.n_y - 1) * grid.spacing_m, FINE_M)
    profiles = RangeCompressor.for_block(psf.pulses)(psf.pulses)
    vast, sensible = (
        LiveSubapertures(g, pulses_per_aperture=200, pulses_per_subaperture=50).add(profiles)
        for g in (fine, grid))
    node = start_node('afbp_fusion', {'max_image_pixels': 2**31 - 1})
    observer = make_observer('subaperture_images')
    node.wait_for_log('afbp_fusion', 'subscriber on .*image_complex joined')
    observer.wait(lambda: observer.joined, 'the subscription')
    limit_memory(node.pid('afbp_fusion'))
    observer.send_messages(subaperture_image.to_message(i) for i in vast)
    observer.wait_for_counters('afbp_fusion', blocks_rejected=4, errors=0)
    assert observer.status('afbp_fusion').level > DiagnosticStatus.OK
    node.wait_for_log('afbp_fusion', r'rejected sub-aperture 0 of aperture 0 of \S+: fusing an '
                      r'aperture needs \d+ MB, \d+ MB are available; choose a smaller map')
    observer.send_messages(subaperture_image.to_message(dataclasses.replace(i, aperture=1))
                           for i in sensible)
    [image] = observer.wait_for('image_complex', 1)
    error_db = psf.error_db(complex_from_message(image), grid, np.arange(200))
    assert error_db < LARGEST_ERROR_DB['subapertures']
