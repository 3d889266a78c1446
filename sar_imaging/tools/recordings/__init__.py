"""Recordings: rosbag2 files of pulse blocks with their truth and the platform's poses."""

from .bag_io import BagError, read_blocks, read_poses, read_truth, write_bag
from .recording import Recording, read_recording
from .truth import make_truth

__all__ = ['BagError', 'Recording', 'make_truth', 'read_blocks', 'read_poses',
           'read_recording', 'read_truth', 'write_bag']
