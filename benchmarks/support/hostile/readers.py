# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Kinds of files, the commands that read them, and all ways to damage each."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import pathlib
from collections.abc import Callable, Iterator

from . import valid
from .any_file import Damage, common
from .bags import mcap_file, metadata_file, packed_file, ros1_file, sqlite_file, truth_file
from .cphd_sicd import cphd_file, xml_file
from .matlab_hdf5 import hdf5_file, mat_file
from .numpy_files import npy_file, npz_file
from .text import text_file
from .tiff import tiff_file
from .yaml_json import json_file, yaml_file


@dataclasses.dataclass(frozen=True)
class Reader:
    """A kind of file and the commands that read it.

    Parameters
    ----------
    name : str
        Of the kind.
    file : str
        The one that is damaged, in the folder that `make` fills.
    make : callable
        Writes valid files into a folder.
    commands : tuple of tuple of str
        Words; ``{file}``, ``{folder}`` and ``{out}`` are replaced. The first word ``read`` calls
        a function of `CALLS` instead.
    special : callable
        Gives more ways to damage it from its valid content.
    """

    name: str
    file: str
    make: Callable[[pathlib.Path], None]
    commands: tuple[tuple[str, ...], ...]
    special: Callable[[bytes], Iterator[Damage]] = lambda content: iter(())


CALLS: dict[str, Callable[[pathlib.Path], object]] = {}


def _call(function):
    CALLS[function.__name__] = function
    return function


@_call
def cphd(path):
    from sar_imaging.formats.cphd import CphdReader
    with CphdReader(path) as reader:
        return sum(block.n_pulses for block in reader.blocks())


@_call
def geotiff(path):
    from sar_imaging.formats import read_geotiff
    return read_geotiff(path).image.shape


@_call
def bag(path):
    from sar_imaging.recordings import open_pulses
    return sum(block.n_pulses for block in open_pulses(path).blocks(1e9))


@_call
def antenna(path):
    from sar_imaging.geometry.antenna import Antenna
    return Antenna.load(path)


@_call
def costs(path):
    from sar_imaging.planning.costs import CostModel
    return CostModel.read(path)


@_call
def job(path):
    from sar_imaging.archive.job import read_job
    return read_job(path)


@_call
def terrain(path):
    from sar_imaging.geometry.terrain import Terrain
    return Terrain.load(path)


@_call
def catalogue(path):
    from sar_imaging.archive.job import Job
    from sar_imaging.archive.recordings import find_recordings
    return find_recordings(Job((str(path),), path.parent / 'out', 0.5))


_INFO = ('info', '{file}')
_OF_BAG = (('info', '{folder}/bag'), ('read', 'bag', '{folder}/bag'))
_LOAD = (('load', '{folder}/rail.yaml', '--output', '{out}/bag'),)
_POSES = {'poses': {'file': 'poses.tum'}}

READERS = (
    Reader('CPHD, FX', 'scene.cphd', valid.cphd(), (_INFO, ('read', 'cphd', '{file}')), cphd_file),
    Reader('CPHD, TOA in CI4', 'scene.cphd', valid.cphd(True, sample_type='CI4'),
           (('convert', '{file}', '{out}/bag'),), cphd_file),
    Reader('SICD', 'image.nitf', valid.sicd, (_INFO, ('convert', '{file}', '{out}/map.tif')),
           xml_file(b'<SICD')),
    Reader('GeoTIFF', 'map.tif', valid.geotiff, (_INFO, ('read', 'geotiff', '{file}')), tiff_file),
    Reader('NumPy .npy', 'samples.npy', valid.described(valid.npy), _LOAD, npy_file),
    Reader('NumPy .npz', 'samples.npz', valid.described(valid.npz, times={
        'variable': 't', 'alone': True}), _LOAD, npz_file),
    Reader('MATLAB 5', 'samples.mat', valid.described(valid.mat), _LOAD, mat_file),
    Reader('MATLAB 7.3', 'samples.mat', valid.described(valid.hdf5('samples.mat')), _LOAD,
           hdf5_file),
    Reader('HDF5', 'samples.h5', valid.described(valid.hdf5('samples.h5')), _LOAD, hdf5_file),
    Reader('CSV', 'track.csv', valid.described(valid.csv, positions={
        'file': 'track.csv', 'variables': ['x', 'y', 'z'], 'alone': True}), _LOAD, text_file),
    Reader('P440 log', 'rail.log', valid.described(
        valid.log, samples={'variable': 'scan', 'iq': 'real'},
        radar={'waveform': 'passband', 'carrier_hz': 3.95e9, 'bandwidth_hz': 1.5e9,
               'sample_spacing_m': 'range_bin_m', 'range_start_m': 'range_start_m'},
        times={'variable': 'time_s', 'alone': True}), _LOAD, text_file),
    Reader('bare samples', 'samples.bin', valid.described(valid.bare, samples={
        'dtype': 'complex64', 'sizes': {'sample': valid.N_SAMPLES}}), _LOAD),
    Reader('poses, CSV', 'track.csv', valid.described(
        valid.csv, poses={'file': 'track.csv', 'level': True},
        times={'first_s': 0.05, 'interval_s': 0.005}), _LOAD, text_file),
    Reader('poses, TUM', 'poses.tum', valid.described(valid.poses('poses.tum'), **_POSES), _LOAD,
           text_file),
    Reader('poses, OptiTrack', 'poses.csv', valid.described(valid.poses('poses.csv'), poses={
        'file': 'poses.csv'}), _LOAD, text_file),
    Reader('poses, ROS 1 bag', 'poses.bag', valid.described(valid.poses('poses.bag'), times={
        'first_s': 10.0}, poses={'file': 'poses.bag'}), _LOAD, ros1_file),
    Reader('poses, ROS 2 bag', 'poses/poses.mcap', valid.described(valid.poses('poses'), times={
        'first_s': 10.0}, poses={'file': 'poses'}), _LOAD, mcap_file),
    Reader('description', 'rail.yaml', valid.described(valid.npy), _LOAD, yaml_file),
    Reader('calibration', 'channels.yaml', valid.described(
        valid.calibration, calibration='channels.yaml'), _LOAD, yaml_file),
    Reader('bag, MCAP', 'bag/bag.mcap', valid.bag, _OF_BAG, mcap_file),
    Reader('bag, SQLite', 'bag/bag.db3', valid.sqlite_bag, _OF_BAG, sqlite_file),
    Reader('bag, packed messages', 'bag/bag.db3', lambda f: valid.sqlite_bag(f, packed=True),
           _OF_BAG, packed_file),
    Reader('bag, metadata', 'bag/metadata.yaml', valid.bag, _OF_BAG, metadata_file),
    Reader('bag, truth', 'bag/metadata.yaml', valid.bag,
           (*_OF_BAG, ('convert', '{folder}/bag', '{out}/scene.cphd')), truth_file),
    Reader('radar constant', 'constant.yaml', valid.constant, ((
        'image', '{folder}/bag', '--output', '{out}', '--brightness', 'rcs', '--radar-constant',
        '{file}'),), yaml_file),
    Reader('configuration', 'radar.yaml', valid.configuration,
           (('check-config', '{file}'), ('layouts', '{file}', '--output', '{out}')), yaml_file),
    Reader('job of an archive', 'survey.yaml', valid.job, (('read', 'job', '{file}'),), yaml_file),
    Reader('catalogue', 'item.json', valid.catalogue, (('read', 'catalogue', '{file}'),),
           json_file),
    Reader('antenna', 'antenna.yaml', valid.antenna, (('read', 'antenna', '{file}'),), yaml_file),
    Reader('terrain', 'terrain.npz', valid.terrain, (('read', 'terrain', '{file}'),)),
    Reader('costs', 'costs.json', valid.costs, (('read', 'costs', '{file}'),), json_file),
)


def kinds_of(reader: Reader, content: bytes, seeds: range = range(10)) -> list[Damage]:
    """Every way to damage the file of a reader."""
    return [*common(content, seeds), *reader.special(content)]


def digests(folder: pathlib.Path) -> dict[str, str]:
    """What stands in a folder: kind and checksum of each file by its path."""
    found = {}
    for path in sorted(folder.rglob('*')):
        name = str(path.relative_to(folder))
        if path.is_symlink():
            found[name] = f'link to {os.readlink(path)}'
        elif path.is_file():
            size = path.stat().st_size
            found[name] = (hashlib.sha256(path.read_bytes()).hexdigest() if size < valid.GIGA
                           else f'{size} bytes')
        else:
            found[name] = 'folder' if path.is_dir() else 'special'
    return found
