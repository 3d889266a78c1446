# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Load measured data by their description: pulses, poses, and what is known of the scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..files import told
from ..geometry.alignment import Alignment
from ..geometry.antenna import Antenna, Mount
from ..geometry.poses import PoseTable
from ..numpy_files import check_memory
from ..signal.background import subtract_background
from ..signal.positioning import without_range_bias
from ..signal.pulses import PulseBlock, concatenate
from ..signal.tdm import TdmSchedule, locate_channels, move_channels
from . import (
    antenna as antenna_section,
    poses as pose_files,
    positions as position_section,
    radar as radar_section,
    samples,
    scene as scene_section,
    times,
    virtual_array,
)
from .data_files import DataFiles, find_files
from .description import (
    SECTIONS,
    DescriptionError,
    Section,
    find_description,
    of_part,
    read_description,
)
from .driver_bags import read_bag_frames
from .frames import ALIGNMENT_KEYS, FrameConverter, FrameError, convert_all
from .poses import poses_around, read_poses, told_of_poses
from .scene import Scene, read_scene
from .truth import antenna_truth, make_truth
from .virtual_array import VirtualArray, calibration_weights, read_array

_OF_MESSAGES = 4  # bytes of samples for each byte of messages: complex64 of int16 and a copy
_LOCATED = 1024  # pulses whose phase centres are computed at once


@dataclasses.dataclass(frozen=True)
class Loaded:
    """Measured data: pulses, poses and the scene.

    Attributes
    ----------
    name, description, notes : str
        Name, description and notes of the recording.
    block : PulseBlock
        All pulses. They have no positions where `poses` tell these.
    poses : PoseTable or None
        Poses on a clock of their own, nanoseconds.
    alignment : Alignment or None
        Between pulses and poses, where there are poses.
    scene : Scene
        Where and what to image.
    warnings : tuple of str
        What a person should know.
    antenna : Antenna or None
        Pattern of the antenna, where it is told. Pulses with positions have their pointing.
    mount : Mount or None
        What tells the pointing, where there are poses.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.recordings import load
    >>> along = np.linspace(-0.5, 0.5, 32)
    >>> np.savez('rail.npz', echoes=np.ones((32, 64), np.complex64),
    ...          place=np.stack([0 * along, along, 0 * along], axis=-1))
    >>> with open('rail.yaml', 'w') as file:
    ...     _ = file.write('''
    ... name: rail
    ... samples: {file: rail.npz, variable: echoes, axes: [pulse, sample]}
    ... radar: {waveform: stepped_frequency, carrier_hz: 10e9, bandwidth_hz: 1e9}
    ... times: {first_s: 0.0, interval_s: 0.01}
    ... positions: {variable: place}
    ... scene: {centre_m: [5, 0, 0], size_m: [4, 4], spacing_m: 0.1}
    ... ''')
    >>> loaded = load('rail.yaml')
    >>> loaded.name, loaded.block.samples.shape, loaded.scene.grid.shape, loaded.poses
    ('rail', (32, 1, 64), (41, 41), None)
    """

    name: str
    description: str
    notes: str
    block: PulseBlock
    poses: PoseTable | None
    alignment: Alignment | None
    scene: Scene
    warnings: tuple[str, ...] = ()
    antenna: Antenna | None = None
    mount: Mount | None = None


def truth_of(loaded: Loaded, alignment: Alignment | None) -> dict[str, Any]:
    """Truth of a recording of these data, with the alignment to image them with."""
    scene, block = loaded.scene, loaded.block
    return make_truth(
        scenario=loaded.name, description=loaded.description, notes=loaded.notes,
        scatterers=scene.scatterers, grid=scene.grid,
        pulses_per_aperture=scene.pulses_per_aperture or int(block.counter[-1]) + 1,
        n_pulses=block.n_pulses, n_channels=block.n_channels, cut_half_width_m=scene.cut_m,
        radar=block.radar, compressed=block.compressed, window=scene.window,
        alignment=alignment, frame=scene.frame, datum=scene.datum) | antenna_truth(
            loaded.antenna, loaded.mount)


def load(description: Path | str, data: Path | str | None = None, *,
         changes: Mapping[str, object] | None = None) -> Loaded:
    """Load measured data by a YAML description, as they are: pulses and poses on their clocks.

    `open_pulses` opens the same description as pulses with positions.

    Parameters
    ----------
    description : path
        YAML file, see docs/loading.md, or the name of a shipped one such as ``'gotcha'``.
    data : path, optional
        Folder with the files that it names, or the file of the samples; by default they lie
        beside the description.
    changes : mapping, optional
        Values in place of those of the file, by path such as ``'alignment.time_offset_s'``.

    Returns
    -------
    Loaded
        Pulses, poses where they have a clock of their own, and the scene.

    Raises
    ------
    DescriptionError
        The description or the data cannot be used; the text says where and why.
    MissingExtraError
        A file needs a library that is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.recordings import load
    >>> np.savez('rail.npz', echoes=np.ones((32, 64), np.complex64))
    >>> with open('rail.yaml', 'w') as file:
    ...     _ = file.write('''
    ... name: rail
    ... samples: {file: rail.npz, variable: echoes, axes: [pulse, sample]}
    ... radar: {waveform: stepped_frequency, carrier_hz: 10e9, bandwidth_hz: 1e9}
    ... times: {first_s: 0.0, interval_s: 0.01}
    ... positions: {line: {first_m: [0, -0.5, 1], last_m: [0, 0.5, 1]}}
    ... scene: {centre_m: [5, 0, 0], size_m: [4, 4], spacing_m: 0.1}
    ... ''')
    >>> block = load('rail.yaml').block
    >>> block.phase_centre_m[[0, -1]].tolist()
    [[0.0, -0.5, 1.0], [0.0, 0.5, 1.0]]
    """
    description = find_description(description)
    try:
        return _load(description, data, changes or {})
    except (FrameError, ImportError):
        raise
    except Exception as error:  # numbers that contradict each other fail anywhere
        text = told(error)
        if isinstance(error, DescriptionError) and (description.name in text or (
                Path(text.partition(' ')[0]).suffix and not text.startswith(SECTIONS))):
            raise  # it names its file
        raise DescriptionError(f'{description.name}: {text}') from error


def _load(description: Path, data: Path | str | None, changes: Mapping[str, object]) -> Loaded:
    top = read_description(description, changes)
    section, folder, files = _find(top, description, data)
    warnings: tuple[str, ...] = ()
    shape: tuple[int, ...]
    if 'topic' in section:
        every = DataFiles([])
        pulses, array, warnings = _read_messages(top, section, folder, files)
        shape = (pulses.n_pulses,)
    else:
        every = DataFiles(files)
        top = top.with_variables(every.same)
        pulses, array, shape = _read_pulses(top, section, folder, every)
    warnings += array.doubts(pulses.radar.wavelength_m)
    poses, position_m = None, np.zeros((0, 3))
    if ('poses' in top) == ('positions' in top):
        raise top.error('positions', 'either positions or poses, to say where the radar was')
    if 'poses' in top:
        poses = read_poses(top.section('poses', pose_files.KEYS), folder, every)
    else:
        position_m, pulses = _read_positions(top, folder, every, shape, pulses)
    used, pulses, lost = _choose(top, _corrected(top, folder, pulses))
    warnings += lost
    if section.flag('remove_background'):
        pulses = subtract_background(pulses)
    scene = read_scene(top.section('scene', scene_section.KEYS))
    alignment = _alignment(top.section('alignment', ALIGNMENT_KEYS), array, poses is not None)
    told = (top.text('name', '') or description.stem, top.text('description', ''),
            top.text('notes', ''))
    if poses is not None:
        return _with_poses(top, told, pulses, poses, alignment, array, scene, warnings)
    block, antenna = _pointed(top, _dated(_at_positions(pulses, position_m[used], alignment,
                                                        array)))
    return Loaded(*told, block, None, None, scene, warnings, antenna)


def _corrected(top: Section, folder: Path, pulses: PulseBlock) -> PulseBlock:
    """Pulses with the weights of a calibration of the channels, where there is one."""
    if 'calibration' not in top:
        return pulses
    weights = calibration_weights(folder / top.text('calibration'), pulses.n_channels,
                                  real_samples=pulses.radar.waveform.is_real)
    return dataclasses.replace(pulses, samples=pulses.samples * weights)


def _with_poses(top: Section, told: tuple[str, str, str], pulses: PulseBlock, poses: PoseTable,
                alignment: Alignment, array: VirtualArray, scene: Scene,
                warnings: tuple[str, ...]) -> Loaded:
    """Pulses beside their poses; with positions where the channels have times of their own."""
    try:
        poses = dataclasses.replace(poses_around(poses, pulses, alignment), frame_id=scene.frame)
    except DescriptionError as error:  # which a warning may explain
        raise DescriptionError('; '.join([str(error), *warnings])) from error
    warnings += told_of_poses(pulses, poses, alignment)
    if times.is_relative(pulses.stamp_ns, poses.stamp_ns):
        pulses = _dated(pulses)
        poses = dataclasses.replace(poses, stamp_ns=poses.stamp_ns + times.EPOCH_NS)
    if array.schedule is None:
        antenna, mount = _antenna(top)
        return Loaded(*told, pulses, poses, alignment, scene, warnings, antenna, mount)
    block, antenna = _pointed(top, _at_own_times(pulses, poses, alignment, array.schedule))
    return Loaded(*told, block, None, None, scene, warnings, antenna)


def _antenna(top: Section) -> tuple[Antenna | None, Mount | None]:
    """Antenna, and what tells its pointing by the poses."""
    if 'antenna' not in top:
        return None, None
    section = top.section('antenna', antenna_section.KEYS)
    antenna, mount = antenna_section.read_antenna(section)
    if not isinstance(mount, Mount):
        raise section.error('pointing', 'a kind with poses', 'outward is for positions on an arc')
    return antenna, mount


def _pointed(top: Section, block: PulseBlock) -> tuple[PulseBlock, Antenna | None]:
    """Pulses at known positions with their pointing, and the antenna."""
    if 'antenna' not in top:
        return block, None
    section = top.section('antenna', antenna_section.KEYS)
    antenna, mount = antenna_section.read_antenna(section)
    positions = top.section('positions', position_section.KEYS) if 'positions' in top else None
    centre = (None if positions is None or 'arc' not in positions
              else lambda: positions.vector('centre_m', np.zeros(3)))
    return antenna_section.with_pointing(block, mount, section, centre), antenna


def _find(top: Section, description: Path, data: Path | str | None
          ) -> tuple[Section, Path, list[Path]]:
    """Part ``samples``, folder of the data, and files of the samples."""
    section = top.section('samples', samples.KEYS)
    place = description.parent if data is None else Path(data)
    if place.is_file() or (place / 'metadata.yaml').is_file():
        return section, place.parent, [place]
    if 'topic' in section and (place / section.text('file')).is_dir():
        return section, place, [place / section.text('file')]
    if not place.is_dir():
        raise DescriptionError(f'{place} does not exist; expected the folder with the data')
    return section, place, find_files(place, section.text('file'), 'samples.file')


def _own_file(section: Section, name: str, folder: Path, data: DataFiles) -> DataFiles:
    """Files of a part that names its own, otherwise those of the samples."""
    if 'file' not in section:
        return data
    return DataFiles(find_files(folder, section.text('file'), f'{name}.file'))


def _read_pulses(top: Section, section: Section, folder: Path, data: DataFiles
                 ) -> tuple[PulseBlock, VirtualArray, tuple[int, ...]]:
    """All pulses with the radar's own times, their array, and axes that count them."""
    values, shape, n_receivers = samples.read_samples(section, data)
    radar, compressed = radar_section.read_radar(top.section('radar', radar_section.KEYS),
                                                 values.shape[-1])
    is_real = section.raw('iq', 'complex') == 'real'
    if is_real != radar.waveform.is_real:
        raise section.error('iq', f'{"not real" if is_real else "real"} samples of the waveform '
                            f'{radar.waveform.name.lower()}', 'real samples are of fmcw_real and '
                            'passband')
    array = read_array(top.section('array', virtual_array.KEYS), values.shape[1], n_receivers)
    clock = top.section('times', times.KEYS)
    stored = _own_file(clock, 'times', folder, data)
    time_ns, counter = times.read_times(clock, len(values), stored.real)
    return PulseBlock(radar, compressed, time_ns, counter, values), array, shape


def _read_messages(top: Section, section: Section, folder: Path, files: list[Path]
                   ) -> tuple[PulseBlock, VirtualArray, tuple[str, ...]]:
    """Pulses of raw messages in a bag, and what a person should know."""
    parts = files[0].rglob('*') if files[0].is_dir() else files
    check_memory(files[0].name, _OF_MESSAGES * sum(p.stat().st_size for p in parts))
    for name, keys, known in (('samples', samples.OF_FILES, samples.KEYS),
                              ('times', times.OF_FILES, times.KEYS)):
        part = top.section(name, known)
        for key in keys:
            if key in part:
                raise part.error(key, 'none besides samples.topic', 'messages tell it themselves; '
                                 'leave it out')
    converter = FrameConverter(top, folder)
    sizes = section.section('sizes', samples.AXES)
    pulses, warnings = convert_all(converter, read_bag_frames(
        files[0], section.text('topic'),
        {key: sizes.integer(key) for key in ('channel', 'sample') if key in sizes},
        section.raw('axes', None)))
    assert converter.array is not None  # of the frames
    return pulses, converter.array, warnings


def _read_positions(top: Section, folder: Path, data: DataFiles, shape: tuple[int, ...],
                    pulses: PulseBlock) -> tuple[np.ndarray, PulseBlock]:
    """(P, 3) positions, and the pulses referenced to one range."""
    section = top.section('positions', position_section.KEYS)
    position_m = position_section.read_positions(
        section, shape, _own_file(section, 'positions', folder, data))
    keys = top.section('radar', radar_section.KEYS)
    values, radar = radar_section.reference_to_one_range(
        keys, data.real, pulses.radar, pulses.samples, position_m)
    return position_m, dataclasses.replace(pulses, radar=radar, samples=values)


def _choose(top: Section, pulses: PulseBlock
            ) -> tuple[np.ndarray, PulseBlock, tuple[str, ...]]:
    """Which pulses are used, (P,) bool; these, counted where they had no numbers; warnings."""
    section = top.section('times', times.KEYS)
    wanted = times.used_pulses(section, pulses.stamp_ns)
    used = wanted & [bool(np.isfinite(samples).all()) for samples in pulses.samples]
    warnings: tuple[str, ...] = ()
    if n_lost := int(wanted.sum() - used.sum()):
        text = f'{n_lost} of {wanted.sum()} pulses hold NaN or infinity'
        if used.sum() < 2:
            raise DescriptionError(f'samples: {text}; expected finite numbers: check '
                                   'samples.dtype and samples.scale')
        warnings = (f'{text} and are left out, the first is number '
                    f'{np.flatnonzero(wanted & ~used)[0]}',)
    if not used.all():
        pulses = pulses.select(used)
    counter = np.flatnonzero(used)
    if 'counter' in section or 'topic' in top.section('samples', samples.KEYS):
        counter = pulses.counter
    counter = counter - counter[0]  # gaps show lost pulses
    return used, dataclasses.replace(pulses, counter=counter), warnings


def _alignment(section: Section, array: VirtualArray, has_poses: bool) -> Alignment:
    if 'time_offset_s' in section and not has_poses:
        raise section.error('time_offset_s', 'no offset for positions that need no clock',
                            'leave it out')
    lever_m = section.vector('lever_arm_m', np.zeros(3))
    arms = [lever_m + centres for centres in (array.tx_m, array.rx_m)]
    one = all((a == a[0]).all() for a in arms)
    tx_m, rx_m = (a[:1] if one else a for a in arms)
    return Alignment(tx_m, rx_m, section.number('time_offset_s', 0.0),
                     section.number('range_bias_m', 0.0))


def _dated(block: PulseBlock) -> PulseBlock:
    """Block whose clock begins in 2023 where it began at zero."""
    if not times.is_relative(block.stamp_ns):
        return block
    return dataclasses.replace(block, stamp_ns=block.stamp_ns + times.EPOCH_NS)


def _at_positions(pulses: PulseBlock, position_m: np.ndarray, alignment: Alignment,
                  array: VirtualArray) -> PulseBlock:
    """Pulses with the phase centres of a radar that does not turn."""
    shape = (pulses.n_pulses, pulses.n_channels, 3)
    tx_m, rx_m = (np.broadcast_to(position_m[:, None] + arms, shape)
                  for arms in (alignment.tx_m, alignment.rx_m))
    block = dataclasses.replace(pulses, tx_m=tx_m, rx_m=rx_m)
    if alignment.range_bias_m:
        block = dataclasses.replace(block, radar=without_range_bias(block.radar, alignment))
    if array.schedule is None:
        return block
    time_s = (pulses.stamp_ns - pulses.stamp_ns[0]) * 1e-9
    return move_channels(block, np.gradient(position_m, time_s, axis=0), array.schedule)


def _at_own_times(pulses: PulseBlock, poses: PoseTable, alignment: Alignment,
                  schedule: TdmSchedule) -> PulseBlock:
    """Phase centres of every channel where the platform is at the channel's own time."""
    parts = []
    for first in range(0, pulses.n_pulses, _LOCATED):
        part = pulses.select(slice(first, first + _LOCATED))
        near = poses_around(poses, part, alignment)
        with of_part('poses'):
            parts.append(locate_channels(part, near, alignment, schedule))
    return concatenate(parts)
