"""Names of before go on working for one release, and a warning says where they are now."""

import importlib

import pytest

from sar_imaging import recordings

FORMER = {'sar_imaging.loading': ('load', 'DescriptionError', 'PoseTable'),
          'sar_imaging.tools.recordings': ('read_blocks', 'make_truth', 'BagError'),
          'sar_imaging.tools.recordings.bag_io': ('read_blocks', 'write_bag'),
          'sar_imaging.tools.products.sources': ('open_source',)}


@pytest.mark.parametrize('module', FORMER)
def test_former_names_are_the_present_ones_with_a_warning(module):
    former = importlib.import_module(module)
    for name in FORMER[module]:
        with pytest.warns(DeprecationWarning, match=f'is now sar_imaging.recordings.{name}'):
            assert getattr(former, name) is getattr(recordings, name)
    with pytest.raises(AttributeError, match='no_such_name'):
        former.no_such_name  # noqa: B018
