# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Names of before go on working for one release, and a warning says where they are now."""

import importlib

import pytest

RECORDINGS, ARCHIVE = 'sar_imaging.recordings', 'sar_imaging.archive'
SIMULATION = 'sar_imaging.simulation'
FORMER = {'sar_imaging.loading': (RECORDINGS, 'load', 'DescriptionError', 'PoseTable'),
          'sar_imaging.geometry.illumination': ('sar_imaging.geometry.antenna', 'Antenna',
                                                'Mount'),
          'sar_imaging.tools.recordings': (RECORDINGS, 'read_blocks', 'make_truth', 'BagError'),
          'sar_imaging.tools.recordings.bag_io': (RECORDINGS, 'read_blocks', 'write_bag'),
          'sar_imaging.tools.products.sources': (RECORDINGS, 'open_source'),
          'sar_imaging.simulation.trials': (SIMULATION, 'flawed_aperture', 'FlawedAperture'),
          'sar_imaging.simulation.trials.track_errors': (SIMULATION, 'flawed_aperture'),
          'sar_imaging.tools.archive.jobs': (ARCHIVE, 'read_job'),
          'sar_imaging.tools.archive.products': (ARCHIVE, 'check_mosaic'),
          'sar_imaging.tools.archive.workflow': (ARCHIVE, 'run_archive')}
PRESENT = {'open_source': 'open_pulses'}


@pytest.mark.parametrize('module', FORMER)
def test_former_names_are_the_present_ones_with_a_warning(module):
    former, (home, *names) = importlib.import_module(module), FORMER[module]
    for name in names:
        present = PRESENT.get(name, name)
        with pytest.warns(DeprecationWarning, match=f'is now {home}.{present};'):
            assert getattr(former, name) is getattr(importlib.import_module(home), present)
    with pytest.raises(AttributeError, match='no_such_name'):
        former.no_such_name  # noqa: B018


def test_a_former_name_may_have_gone_to_the_repository():
    trials = importlib.import_module('sar_imaging.simulation.trials')
    cases = importlib.import_module('benchmarks.support.random_cases')
    with pytest.warns(DeprecationWarning, match='now benchmarks.support.random_cases.random_case'):
        assert trials.random_case is cases.random_case
