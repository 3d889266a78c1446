"""Load any measured data from a description in YAML: arrays, times, poses, radar parameters.

`load` reads a description and the files that it names; docs/loading.md lists all keys.
"""

from ..geometry.poses import PoseTable
from .description import DescriptionError, find_description, read_description, shipped_names
from .load import Loaded, load

__all__ = ['DescriptionError', 'Loaded', 'PoseTable', 'find_description', 'load',
           'read_description', 'shipped_names']
