# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile and damaged files of every kind that the package reads, made of small valid ones.

`READERS` lists the valid files with the commands that read them; `kinds_of` the ways in which one
is damaged. What a file could execute or read writes or tells a canary, which must stay silent.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import io
import json
import os
import pathlib
import re
import socket
import sqlite3
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator

import numpy as np
import yaml

CANARY, SECRET = 'executed', 'a-secret-of-the-machine'  # a file that appears; a text that is told
DATUM, AREA = (47.0, 8.0, 450.0), (0.0, 0.0, 0.0)
N_PULSES, N_SAMPLES = 24, 128
GIGA = 10**9

#: A way to damage a file: what is told of it, and what puts it in the place of the valid one.
Damage = tuple[str, Callable[[pathlib.Path], None]]


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


# What is valid ---------------------------------------------------------------------------------


def pulses(compressed: bool = False):
    """A short flight past three reflectors, as one block."""
    from sar_imaging.signal.magnitudes import SPEED_OF_LIGHT
    from sar_imaging.signal.pulses import PulseBlock
    from sar_imaging.signal.radar import RadarParameters, Waveform
    from sar_imaging.simulation.echoes import EchoSimulator

    along = np.linspace(-6.0, 6.0, N_PULSES)
    track = np.stack([along, np.full(N_PULSES, -300.0), np.full(N_PULSES, 200.0)], -1)[:, None]
    away = np.linalg.norm(track, axis=-1).mean()
    if compressed:
        radar = RadarParameters(9.6e9, 150e6, 300e6,
                                2 * away / SPEED_OF_LIGHT - N_SAMPLES / 2 / 300e6)
    else:
        radar = RadarParameters(9.6e9, 300e6, 300e6, 2 * away / SPEED_OF_LIGHT,
                                waveform=Waveform.STEPPED_FREQUENCY)
    samples = EchoSimulator(radar, N_SAMPLES, compressed=compressed, points_m=[
        [0.0, 0.0, 0.0], [4.0, -3.0, 0.0], [-5.0, 4.0, 0.0]], amplitudes=[1.0, 0.7, 0.5j])(
            track, track)
    stamp_ns = 1_700_000_000_000_000_000 + np.arange(N_PULSES) * 10_000_000
    return PulseBlock(radar, compressed, stamp_ns, np.arange(N_PULSES), samples, track, track,
                      'map')


def _area():
    from sar_imaging.geometry.grids import MapGrid

    return MapGrid.from_size(AREA, 16.0, 16.0, 0.25)


def _datum():
    from sar_imaging.geometry.earth import Datum

    return Datum(*DATUM)


def _image():
    from sar_imaging.imaging.imager import plan_image

    block = pulses()
    return plan_image(_area(), block.radar, block.n_samples, compressed=False)(block)


def _cphd(compressed=False, **options):
    def make(folder):
        from sar_imaging.formats.cphd import write_cphd

        write_cphd(folder / 'scene.cphd', [pulses(compressed)], _datum(), _area(), **options)
    return make


def _sicd(folder):
    from sar_imaging.formats import Acquisition, write_sicd

    write_sicd(folder / 'image.nitf', _image(), _datum(), Acquisition.of(pulses()))


def _geotiff(folder):
    from sar_imaging.formats import write_geotiff

    write_geotiff(folder / 'map.tif', _image(), _datum(), content='complex')


def _bag(folder, with_poses=False):
    from sar_imaging.recordings.bag_io import write_bag
    from sar_imaging.recordings.truth import make_truth

    block = pulses()
    truth = make_truth(
        scenario='hostile', description='three reflectors', scatterers=[
            {'name': 'middle', 'position_m': [0.0, 0.0, 0.0], 'amplitude_db': 0.0}],
        grid=_area(), pulses_per_aperture=N_PULSES, n_pulses=N_PULSES, n_channels=1,
        cut_half_width_m=(3.0, 3.0), radar=block.radar, compressed=False, datum=_datum())
    write_bag(folder / 'bag', [block.select(slice(i, i + 6)) for i in range(0, N_PULSES, 6)],
              truth)


def _sqlite_bag(folder, packed=False):
    """The recording of `_bag` as the older plugin of rosbag2 stores it."""
    from rosbags import rosbag2
    from rosbags.typesys import Stores, get_typestore

    _bag(folder)
    old, new = folder / 'bag', folder / 'new'
    writer = rosbag2.Writer(new, version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3)
    if packed:
        writer.set_compression(rosbag2.CompressionMode.MESSAGE, rosbag2.CompressionFormat.ZSTD)
    with rosbag2.Reader(old) as reader, writer:
        for key, text in reader.storage.metadata.custom.items():
            writer.set_custom_data(key, text)
        store = get_typestore(Stores.ROS2_JAZZY)
        topics = {c.id: writer.add_connection(c.topic, c.msgtype, typestore=store)
                  for c in reader.connections}
        for connection, time_ns, cdr in reader.messages():
            writer.write(topics[connection.id], time_ns, cdr)
    for file in old.iterdir():
        file.unlink()
    for file in new.iterdir():
        file.rename(old / file.name.replace('new', 'bag'))
    new.rmdir()
    text = (old / 'metadata.yaml').read_text()
    (old / 'metadata.yaml').write_text(text.replace('new.db3', 'bag.db3'))


def _described(write, **changes):
    """Files of samples by `write`, and a description that reads them from there."""
    def make(folder):
        block = pulses()
        tree = {'name': 'rail', 'samples': {'variable': 'echoes', 'axes': ['pulse', 'sample']},
                'radar': {'waveform': 'stepped_frequency', 'carrier_hz': 9.6e9,
                          'bandwidth_hz': 300e6},
                'times': {'first_s': 0.0, 'interval_s': 0.01},
                'positions': {'line': {'first_m': [-6.0, -300.0, 200.0],
                                       'last_m': [6.0, -300.0, 200.0]}},
                'scene': {'centre_m': [0.0, 0.0, 0.0], 'size_m': [16.0, 16.0],
                          'spacing_m': 0.25}}
        file = write(folder, block.samples[:, 0])
        tree['samples']['file'] = file
        for key, value in changes.items():
            if isinstance(value, dict) and not value.pop('alone', False):
                value = {**tree.get(key, {}), **value}
            tree[key] = value
        if 'poses' in tree:
            del tree['positions']
        (folder / 'rail.yaml').write_text(yaml.safe_dump(tree))
    return make


def _npy(folder, samples):
    np.save(folder / 'samples.npy', samples)
    return 'samples.npy'


def _npz(folder, samples):
    np.savez(folder / 'samples.npz', echoes=samples, t=0.01 * np.arange(N_PULSES))
    return 'samples.npz'


def _mat(folder, samples):
    from scipy.io import savemat

    savemat(folder / 'samples.mat', {'echoes': samples}, do_compression=True)
    return 'samples.mat'


def _hdf5(name):
    def write(folder, samples):
        import h5py

        with h5py.File(folder / name, 'w', userblock_size=512) as file:
            file['echoes'] = samples.T if name.endswith('.mat') else samples
        if name.endswith('.mat'):
            with open(folder / name, 'r+b') as file:
                file.write(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\0\2IM')
        return name
    return write


def _csv(folder, samples):
    _npy(folder, samples)
    rows = '\n'.join(f'{0.01 * i},{0.5 * i - 6},-300,200' for i in range(N_PULSES))
    (folder / 'track.csv').write_text('time,x,y,z\n' + rows + '\n')
    return 'samples.npy'


def _log(folder, samples):
    lines = [f'{1.7e9 + 0.04 * i:.3f}, MrmFullScanInfo, {i}, 100, {5000 + 40 * i}, 0, 0, 0, 0, '
             f'10000, 35564, 32, 1, 0, 0, {len(scan)}, '
             + ', '.join(str(int(v)) for v in 1e4 * scan.real)
             for i, scan in enumerate(samples)]
    (folder / 'rail.log').write_text('\n'.join(lines) + '\n')
    return 'rail.log'


def _bare(folder, samples):
    samples.astype('<c8').tofile(folder / 'samples.bin')
    return 'samples.bin'


def _poses(name):
    def write(folder, samples):
        _npy(folder, samples)
        t = 0.01 * np.arange(-50, N_PULSES + 50)
        rows = np.column_stack([t, 50 * t - 6, np.full(t.shape, -300.0), np.full(t.shape, 200.0),
                                np.zeros((len(t), 3)), np.ones(len(t))])
        if name == 'poses.tum':
            np.savetxt(folder / name, rows, fmt='%.9f')
        elif name == 'poses.bag' or name == 'poses':
            _pose_bag(folder / name, rows)
        else:
            heads = [['Format Version', '1.23', 'Rotation Type', 'Quaternion', 'Length Units',
                      'Meters'],
                     ['', 'Type', *['Rigid Body'] * 7], ['', 'Name', *['radar'] * 7],
                     ['', '', *['Rotation'] * 4, *['Position'] * 3],
                     ['Frame', 'Time (Seconds)', *'XYZWXYZ']]
            lines = [','.join(head) for head in heads] + [
                ','.join(map(str, [i, row[0], *row[4:], *row[1:4]]))
                for i, row in enumerate(rows)]
            (folder / name).write_text('\n'.join(lines) + '\n')
        return 'samples.npy'
    return write


def _pose_bag(path, rows):
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    one = path.suffix == '.bag'
    store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_JAZZY)
    types, kind = store.types, 'geometry_msgs/msg/PoseStamped'
    writer = rosbag1.Writer(path) if one else rosbag2.Writer(
        path, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
    with writer:
        connection = writer.add_connection('/pose', kind, typestore=store)
        for t, x, y, z, *q in rows:
            ns = int(round((t + 10) * 1e9))
            stamp = types['builtin_interfaces/msg/Time'](sec=ns // GIGA, nanosec=ns % GIGA)
            head = dict(stamp=stamp, frame_id='map')
            message = types[kind](
                header=types['std_msgs/msg/Header'](**({'seq': 0} if one else {}), **head),
                pose=types['geometry_msgs/msg/Pose'](
                    position=types['geometry_msgs/msg/Point'](x=x, y=y, z=z),
                    orientation=types['geometry_msgs/msg/Quaternion'](*q)))
            raw = (store.serialize_ros1 if one else store.serialize_cdr)(message, kind)
            writer.write(connection, ns, bytes(raw))


def _calibration(folder, samples):
    _npy(folder, samples)
    (folder / 'channels.yaml').write_text('amplitude: [1.0]\nphase_deg: [0.0]\ndelay_s: [0.0]\n')
    return 'samples.npy'


def _constant(folder):
    _bag(folder)
    (folder / 'constant.yaml').write_text('gain_m: 1.0e+6\nnoise_power: 3.0\n')


def _configuration(folder):
    import sar_imaging

    shipped = pathlib.Path(sar_imaging.__file__).parent / 'config' / 'drone_uwb.yaml'
    (folder / 'radar.yaml').write_bytes(shipped.read_bytes())


def _job(folder):
    _bag(folder)
    (folder / 'survey.yaml').write_text(
        'recordings: [bag]\noutput: survey\nspacing_m: 0.5\nmemory_gb: 1\n'
        'products: {images: [geotiff], mosaic: true}\n')


def _catalogue(folder):
    _cphd()(folder)
    (folder / 'item.json').write_text(json.dumps({
        'type': 'Feature', 'stac_version': '1.0.0', 'id': 'flight', 'geometry': None,
        'properties': {'datetime': '2026-01-01T00:00:00Z'}, 'links': [],
        'assets': {'pulses': {'href': './scene.cphd', 'roles': ['data']}}}))


def _costs(folder):
    from sar_imaging.planning.costs import DEFAULT

    DEFAULT.write(folder / 'costs.json')


def _antenna(folder):
    (folder / 'antenna.yaml').write_text(
        'azimuth_deg: [-10, 0, 10]\nazimuth_gain_db: [-20, 0, -20]\n')


def _terrain(folder):
    np.savez(folder / 'terrain.npz', height_m=np.zeros((5, 4)), x_m=np.arange(4.0),
             y_m=np.arange(5.0))


# Ways to damage any file -----------------------------------------------------------------------


def _set(content: bytes | Callable[[], bytes]) -> Callable[[pathlib.Path], None]:
    """Put a content, or one that is made when it is wanted, in place of the valid one."""
    def put(path):
        path.write_bytes(content if isinstance(content, bytes) else content())
    return put


def _link(target: str) -> Callable[[pathlib.Path], None]:
    def put(path):
        path.unlink()
        path.symlink_to(target)
    return put


def _sparse(content: bytes, n_bytes: int) -> Callable[[pathlib.Path], None]:
    def put(path):
        with open(path, 'wb') as file:
            file.write(content)
            file.truncate(n_bytes)
    return put


def _pipe(path):
    path.unlink()
    os.mkfifo(path)


def _folder(path):
    path.unlink()
    path.mkdir()


def _socket(path):
    path.unlink()
    with socket.socket(socket.AF_UNIX) as made:
        here = os.getcwd()
        os.chdir(path.parent)  # names of sockets are short
        made.bind(path.name)
        os.chdir(here)


def _loop(path):
    path.unlink()
    path.symlink_to(path.name)


def common(content: bytes, seeds: range) -> Iterator[Damage]:
    """Ways to damage any file."""
    n = len(content)
    yield 'empty', _set(b'')
    yield 'one byte', _set(content[:1])
    for share in (0.1, 0.5, 0.9):
        yield f'cut off after {share:.0%}', _set(content[:int(n * share)])
    yield 'the last byte is missing', _set(content[:-1])
    yield 'the first byte is missing', _set(content[1:])
    yield 'zeros', _set(bytes(n))
    for place in (0.02, 0.3, 0.6):
        start, size = int(n * place), max(min(n // 3, 50_000), 1)
        yield f'zeros at {place:.0%}', _set(content[:start] + bytes(size) + content[start + size:])
    yield 'twice', _set(content + content)
    yield 'ones', _set(b'\xff' * n)
    yield 'text', _set(b'this is something else\n')
    yield 'UTF-16', _set(content.decode('latin-1').encode('utf-16'))
    yield 'line ends of Windows', _set(content.replace(b'\n', b'\r\n'))
    yield 'one line of 64 MB', _set(lambda: b'1,' * 2**25)
    yield 'a terabyte of nothing', _sparse(b'', 2**40)
    yield 'a terabyte behind it', _sparse(content, 2**40)
    yield 'a pipe', _pipe
    yield 'a folder', _folder
    yield 'a socket', _socket
    yield 'a device without end', _link('/dev/zero')
    yield 'a link to itself', _loop
    yield 'a link to nothing', _link('nothing')
    yield 'a link to memory', _link('/proc/self/mem')
    yield 'nothing', lambda path: path.unlink()
    starts = {'CPHD': b'CPHD/1.1.0\n\f\n', 'NITF': b'NITF02.10', 'TIFF': b'II*\0',
              'NumPy': b'\x93NUMPY\x01\0', 'HDF5': b'\x89HDF\r\n\x1a\n', 'zip': b'PK\3\4',
              'MCAP': b'\x89MCAP0\r\n', 'ROS 1': b'#ROSBAG V2.0\n',
              'SQLite': b'SQLite format 3\0', 'pickle': _pickle()}
    for name, start in starts.items():
        yield f'begins as {name}', _set(start + content[len(start):])
    for seed in seeds:
        yield f'random {seed}', _set(_random(content, np.random.default_rng(seed)))


def _random(content: bytes, rng) -> bytes:
    """Bytes overwritten, removed, repeated; digits that became nines."""
    out = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        at, size = int(len(out) * rng.random() ** 2), int(rng.integers(1, 64))
        kind = rng.integers(5)
        if kind == 0:
            out[at:at + size] = rng.bytes(size)
        elif kind == 1:
            del out[at:at + size]
        elif kind == 2:
            out[at:at] = out[at:at + size]
        elif kind == 3:
            out[at:at + size] = re.sub(rb'\d', b'9', bytes(out[at:at + size]))
        else:
            out[at:at + 8] = rng.choice([0, 255, 127, 128]).astype(np.uint8).tobytes() * 8
    return bytes(out)


def _pickle() -> bytes:
    import pickle

    class Executed:
        def __reduce__(self):
            return os.system, (f'touch {CANARY}',)

    return pickle.dumps(Executed())


# Ways to damage files of one kind --------------------------------------------------------------

ABSURD = [None, True, '', 'x', -1, 0, 1, 1e-300, 1e300, -1e300, 10**30, float('nan'),
          float('inf'), [], [[]], {}, [float('nan')] * 3, [1e200, 0, 0], 'nan', '1e999',
          '../../../../etc/passwd', '/dev/zero', 'pipe', 'a\0b', 'x' * 100_000, [0] * 10_000]


def _leaves(tree, path=()):
    yield path
    items = tree.items() if isinstance(tree, dict) else (
        enumerate(tree) if isinstance(tree, list) else ())
    for key, value in items:
        yield from _leaves(value, (*path, key))


def _with(tree, path, value):
    if not path:
        return value
    copy = dict(tree) if isinstance(tree, dict) else list(tree)
    copy[path[0]] = _with(copy[path[0]], path[1:], value)
    return copy


def values_of(tree) -> Iterator[tuple[str, object]]:
    """The tree with each of its values replaced by each absurd one."""
    for path in _leaves(tree):
        for value in ABSURD:
            told = repr(value)
            yield (f'{".".join(map(str, path)) or "all"} is '
                   f'{told if len(told) < 30 else told[:27] + "..."}', _with(tree, path, value))


def _dumped(tree) -> Callable[[], bytes]:
    """As YAML, made when it is wanted: it takes 10 ms, and there are a thousand."""
    return lambda: yaml.safe_dump(tree).encode()


def bombs() -> Iterator[tuple[str, bytes]]:
    """Hostile YAML."""
    yield 'YAML nested 100,000 deep', b'a: ' + b'[' * 100_000
    yield 'YAML of 100,000 flow mappings', b'{a: ' * 100_000
    yield 'YAML of 100,000 dashes', b'- ' * 100_000
    aliases = ['a0: &a0 [x, x, x, x, x, x, x, x, x]'] + [
        f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * 9)}]' for i in range(1, 12)]
    yield 'YAML bomb of aliases', '\n'.join(aliases).encode()
    merges = ['a0: &a0 {k: v}'] + [
        f'a{i}: &a{i} {{<<: [{", ".join([f"*a{i - 1}"] * 9)}]}}' for i in range(1, 12)]
    yield 'YAML bomb of merges', '\n'.join(merges).encode()
    yield 'YAML that is its own value', b'a: &a [*a]'
    yield 'YAML that merges itself', b'a: &a {<<: *a}'
    for tag in ('python/object/apply:os.system', 'python/object/new:os.system'):
        yield f'YAML of {tag}', f'name: !!{tag} ["touch {CANARY}"]'.encode()
    yield 'YAML of a module', b'name: !!python/module:os'
    yield 'number of base 60', b'name: ' + b'1:' * 50_000 + b'1'
    yield 'number of 100,000 digits', b'name: ' + b'9' * 100_000
    yield 'key twice', b'name: a\nname: b\n'
    yield 'two documents', b'name: a\n---\nname: b\n'
    yield 'tabs', b'name:\n\t- a\n'
    yield 'key that is a list', b'? [a, b]\n: c\n'
    yield 'binary', b'name: !!binary aGVsbG8\n'
    yield 'set', b'name: !!set {a, b}\n'
    yield 'date', b'name: 2001-99-99\n'
    yield 'a line of 900 kB', b'name: "' + b'x' * 900_000 + b'"'
    yield 'NUL', b'name: a\0b'
    yield 'directive', b'%YAML 9.9\n---\nname: a\n'
    yield 'tag without end', b'name: !<' + b'a' * 100_000


def _yaml_file(content: bytes) -> Iterator[Damage]:
    for told, text in bombs():
        yield told, _set(text)
    for told, tree in values_of(yaml.safe_load(content)):
        yield told, _set(_dumped(tree))


def _json_file(content: bytes) -> Iterator[Damage]:
    yield 'JSON nested 100,000 deep', _set(b'[' * 100_000)
    yield 'number of 100,000 digits', _set(b'{"a": ' + b'9' * 100_000 + b'}')
    for told, tree in values_of(json.loads(content)):
        yield told, _set(json.dumps(tree).encode())


def _header(shape='(24, 128)', descr="'<c8'", order='False', version=1) -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n".encode()
    size = struct.pack('<H' if version == 1 else '<I', len(text))
    return b'\x93NUMPY' + bytes([version, 0]) + size + text


def _arrays() -> Iterator[tuple[str, bytes]]:
    rest = bytes(8 * 24 * 128)
    for shape in ('(1000000, 1000000)', '(-5, 3)', '(' * 4000, '(2**62, 4)',
                  '(4611686018427387904, 4)', '()', '(0,)', '(24, 128,' + '1,' * 100 + ')',
                  '(True, 24)', '(24.0, 128)',
                  '[24, 128]', "('a',)", '24', 'None', '(0, 9223372036854775807)'):
        yield f'shape {shape[:30]}', _header(shape) + rest
    for descr in ("'|O'", "'<c99999999'", "'<U3'", "'|V8'", "[('a', '<f8')]", "'<M8[s]'", "'x'",
                  "''", 'None', "'<f2'", "'>c8'", "'<c32'", "'|S8'", "('<c8', (2,))",
                  f"__import__('os').system('touch {CANARY}')", "'b1'"):
        yield f'type {descr[:30]}', _header(descr=descr) + rest
    yield 'order of neither', _header(order='7') + rest
    for version in (2, 3, 9):
        yield f'version {version}', _header(version=version) + rest
    yield 'header of 4 GB', b'\x93NUMPY\x02\0' + b'\xff' * 4 + rest
    yield 'Python objects', _header('(1,)', "'|O'") + _pickle()
    for value in (np.nan, np.inf, 3e38):
        yield f'samples are {value}', _header() + np.full((24, 128), value, '<c8').tobytes()


def _npy_file(content: bytes) -> Iterator[Damage]:
    for told, array in _arrays():
        yield told, _set(array)


def _npz_file(content: bytes) -> Iterator[Damage]:
    def packed(members, **options):
        file = io.BytesIO()
        with zipfile.ZipFile(file, 'w', **options) as archive:
            for name, text in members:
                archive.writestr(name, text)
        return file.getvalue()

    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        times = ('t.npy', archive.read('t.npy'))
        own = ('echoes.npy', archive.read('echoes.npy'))
    for told, array in _arrays():
        yield f'member: {told}', _set(packed([('echoes.npy', array), times]))
    for name, method in (('deflate', zipfile.ZIP_DEFLATED), ('bzip2', zipfile.ZIP_BZIP2)):
        yield f'bomb of {name}', _set(lambda method=method: packed(
            [('echoes.npy', _header('(8000, 8000)') + bytes(8 * 8000**2))], compression=method,
            compresslevel=1))
    yield 'no members', _set(packed([]))
    yield 'other names', _set(packed([('../../../etc/passwd', own[1]), ('/x.npy', own[1])]))
    yield 'names without end', _set(packed([('echoes', own[1]), times]))
    yield 'members twice', _set(packed([own, ('echoes.npy', b'x'), times]))
    whole = packed([own, times])
    place = whole.index(b'PK\1\2')
    for field, at in (('compressed size', 20), ('size', 24), ('method', 10), ('encryption', 8),
                      ('offset', 42), ('checksum', 16)):
        wrong = bytearray(whole)
        wrong[place + at:place + at + 2] = b'\xfe\xff' if field != 'encryption' else b'\1\0'
        yield f'wrong {field}', _set(bytes(wrong))
    wrong = bytearray(whole)
    wrong[place + 20:place + 28] = b'\xff' * 8
    yield 'sizes of 4 GB', _set(bytes(wrong))


def _mat_file(content: bytes) -> Iterator[Damage]:
    from scipy.io import savemat

    def element(kind, body):
        return struct.pack('<II', kind, len(body)) + body.ljust(-len(body) % 8 + len(body), b'\0')

    head = content[:128]

    def matrix(cls=6, dims=(24, 128), name=b'echoes', data=None, flags=0x08):
        body = element(6, struct.pack('<II', flags << 8 | cls, 0)) + element(
            5, struct.pack(f'<{len(dims)}i', *dims)) + element(1, name)
        return element(14, body + (element(9, bytes(8 * 24 * 128)) * 2 if data is None else data))

    for dims in ((GIGA, GIGA), (-5, 3), (2**31 - 1, 2), (24,), (), (1,) * 200, (0, 0)):
        yield f'dimensions {str(dims)[:30]}', _set(head + matrix(dims=dims))
    for cls in (0, 1, 2, 3, 4, 5, 16, 17, 18, 99):
        yield f'class {cls}', _set(head + matrix(cls))
    yield 'name of a megabyte', _set(head + matrix(name=b'e' * 10**6))
    cell = matrix(9, (1, 1), b'', element(9, bytes(8)), 0)
    for _ in range(2000):
        cell = matrix(1, (1, 1), b'', cell, 0)
    yield 'cells in cells, 2,000 deep', _set(head + matrix(1, (1, 1), data=cell, flags=0))
    yield 'cells that claim a billion', _set(head + matrix(1, (GIGA, 1), data=cell, flags=0))
    yield 'structure of wrong fields', _set(head + matrix(
        2, (1, 1), data=element(5, struct.pack('<i', -1)) + element(1, b'a' * 32)))
    file = io.BytesIO()
    from scipy.sparse import csc_matrix
    savemat(file, {'echoes': csc_matrix(np.eye(24))})
    sparse = file.getvalue()
    yield 'sparse', _set(sparse)
    yield 'sparse of wild indices', _set(sparse.replace(struct.pack('<i', 5), b'\xff\xff\xff\x7f'))
    yield 'matrix that claims 4 GB', _set(head + struct.pack('<II', 14, 2**32 - 8) + matrix()[8:])
    yield 'data that claim 4 GB', _set(head + matrix(data=struct.pack('<II', 9, 2**32 - 8)))

    def bomb():
        packed = zlib.compress(matrix(dims=(8000, 8000), data=element(9, bytes(2**29))), 1)
        return head + struct.pack('<II', 15, len(packed)) + packed

    yield 'bomb', _set(bomb)
    yield 'compressed rubbish', _set(head + struct.pack('<II', 15, 64) + os.urandom(64))
    yield 'compressed in compressed', _set(head + element(15, zlib.compress(
        element(15, zlib.compress(matrix())))))
    yield 'big endian', _set(head[:124] + b'\1\0MI' + matrix())
    yield 'version 4', _set(struct.pack('<5i', 0, GIGA, GIGA, 0, 7) + b'echoes\0' + bytes(64))
    yield 'version 4, negative', _set(struct.pack('<5i', 0, -1, 5, 0, 7) + b'echoes\0' + bytes(64))
    yield 'samples are NaN', _set(head + matrix(data=element(
        9, np.full(24 * 128, np.nan).tobytes()) * 2))


def _hdf5_file(content: bytes) -> Iterator[Damage]:
    def made(fill):
        def put(path):
            import h5py

            path.unlink()
            with h5py.File(path, 'w', userblock_size=512) as file:
                fill(file, h5py)
            if path.suffix == '.mat':
                with open(path, 'r+b') as file:
                    file.write(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\0\2IM')
        return put

    def data(**options):
        return made(lambda file, h5py: file.create_dataset('echoes', **options))

    yield 'claims 8 TB', data(shape=(10**6, 10**6), dtype='c8', chunks=(1000, 1000))
    yield 'bomb', data(data=np.zeros((10_000, 5_000), np.complex64), compression='gzip',
                       compression_opts=1)
    yield 'without a shape', made(lambda f, h: f.create_dataset('echoes', data=h.Empty('f8')))
    yield 'texts', data(data=np.array([b'a', b'b']))
    yield 'texts of any length', made(lambda f, h: f.create_dataset(
        'echoes', (3,), h.string_dtype()))
    yield 'references', made(lambda f, h: f.create_dataset('echoes', (3,), h.ref_dtype))
    yield 'structure of three', data(data=np.zeros(5, [('a', 'f8'), ('b', 'f8'), ('c', 'f8')]))
    yield 'structure of texts', data(data=np.zeros(5, [('real', 'S3'), ('imag', 'S3')]))
    yield 'group', made(lambda f, h: f.create_group('echoes'))
    yield 'group in itself', made(lambda f, h: f.__setitem__('echoes', f['/']))
    yield 'link to nothing', made(lambda f, h: f.__setitem__('echoes', h.SoftLink('/none')))
    yield 'link to itself', made(lambda f, h: f.__setitem__('echoes', h.SoftLink('/echoes')))
    yield 'link to another file', made(lambda f, h: f.__setitem__(
        'echoes', h.ExternalLink('secret.h5', 'echoes')))
    yield 'link to a pipe', made(lambda f, h: f.__setitem__(
        'echoes', h.ExternalLink('pipe', 'echoes')))
    for name in ('secret', 'pipe', '/dev/zero'):
        yield f'samples of {name}', data(shape=(24, 128), dtype='c8', external=[
            (name, 0, 8 * 24 * 128)])

    def virtual(file, h5py):
        layout = h5py.VirtualLayout((24, 128), 'c8')
        layout[:] = h5py.VirtualSource('pipe', 'echoes', (24, 128))
        file.create_virtual_dataset('echoes', layout)

    yield 'virtual', made(virtual)
    yield 'one-sided', data(data=np.zeros((24, 128, 2, 2)))
    yield 'samples are NaN', data(data=np.full((24, 128), np.nan, np.complex64))
    yield 'long doubles', data(data=np.zeros((24, 128), np.longdouble))
    yield 'deep groups', made(lambda f, h: f.create_dataset('a/' * 3000 + 'b', data=[1.0]))


def _text_file(content: bytes) -> Iterator[Damage]:
    lines = content.decode().splitlines()
    middle = len(lines) // 2
    fields = re.split(r'[,\s]+', lines[middle].strip())
    for place in range(len(fields)):
        for value in ('', 'nan', 'inf', '-1', '1e999', '1e30', 'x', '9' * 5000, '1,5', '"', '1_0',
                      '\0', '٣', '0x1F', '99999999999999999999', '-inf'):
            if place > 20:
                break
            parts = lines[middle].split(',' if ',' in lines[middle] else None)
            parts[place] = value
            changed = [*lines[:middle], (',' if ',' in lines[middle] else ' ').join(parts),
                       *lines[middle + 1:]]
            yield f'field {place} is {value[:20]!r}', _set('\n'.join(changed).encode())
    yield 'lines reversed', _set('\n'.join(lines[:1] + lines[:0:-1]).encode())
    yield 'one line', _set((lines[0] + '\n').encode())
    yield 'heads twice', _set('\n'.join([lines[0]] + lines).encode())
    yield 'no heads', _set('\n'.join(lines[1:]).encode())
    yield 'quote without end', _set(('"' + '\n'.join(lines)).encode())
    yield 'a field of 10 MB', _set(
        lambda: '\n'.join([*lines[:2], '1' * 10**7, *lines[2:]]).encode())
    yield 'a million columns', _set(lambda: (
        ','.join(['a'] * 10**6) + '\n' + ','.join(['1'] * 10**6)).encode())
    yield 'ten million empty lines', _set(lambda: b'\n' * 10**7 + content)
    yield 'old line ends', _set(content.replace(b'\n', b'\r'))
    yield 'semicolons', _set(content.replace(b',', b';'))
    yield 'mark of bytes', _set(b'\xef\xbb\xbf' + content)
    yield 'latin', _set(b'\xe9' + content)


def _xml_file(start: bytes):
    """Ways to damage the XML within a file, and the texts of its headers."""
    def special(content: bytes) -> Iterator[Damage]:
        place, end = content.index(start), content.rindex(b'>') + 1
        text = content[place:end]
        found = list(re.finditer(rb'>([^<>]+)</', text))
        values = [b'', b'-1', b'0', b'1e300', b'nan', b'inf', b'18446744073709551615', b'x',
                  b'999999999', b'2147483647', b'0001-01-01T00:00:00Z', b'\xff']
        for i, match in enumerate(found):
            for new in values[i % 3::3]:
                room = match.end(1) - match.start(1)
                name = re.findall(rb'<([A-Za-z0-9]+)[^<>]*$', text[:match.start(1) + 0][:-1])
                told = f'{(name or [b"?"])[-1].decode()} {i} is {new.decode("latin-1")[:20]!r}'
                if len(new) > room:
                    spare = text[:match.start(1)] + new + text[match.end(1):]
                    yield told + ', all moved', _set(content[:place] + spare + content[end:])
                else:
                    new = new.ljust(room)
                    yield told, _set(content[:place + match.start(1)] + new
                                     + content[place + match.end(1):])
        size = len(text)
        bomb = b''.join([b'<!DOCTYPE x [<!ENTITY a "', b'a' * 40, b'">', *(
            b'<!ENTITY %c "%s">' % (c, b'&%c;' % (c - 1) * 9) for c in range(98, 108)), b']>'])
        for told, inside in {
                'bomb of entities': bomb + b'<x>&k;</x>',
                'entity of a file': b'<!DOCTYPE x [<!ENTITY f SYSTEM "secret">]><x>&f;</x>',
                'entity of a pipe': b'<!DOCTYPE x [<!ENTITY f SYSTEM "pipe">]><x>&f;</x>',
                'entity of the net': b'<!DOCTYPE x SYSTEM "http://127.0.0.1:9/x"><x/>',
                'nested deep': b'<x>' * (size // 4), 'no XML': b'x' * size,
                'attributes': b'<x ' + b' '.join(b'a%d=""' % i for i in range(size // 9)) + b'/>',
                'other root': b'<SICD/>', 'empty root': text[:text.index(b'>')] + b'/>',
        }.items():
            yield f'XML: {told}', _set(content[:place] + inside[:size].ljust(size) + content[end:])
            inside = inside.replace(b'<x>', text[:text.index(b'>') + 1]).replace(b'</x>', b'')
            yield f'XML of its kind: {told}', _set(
                content[:place] + inside[:size].ljust(size) + content[end:])
        header = content[:place]
        digits = [m for m in re.finditer(rb'\d{2,}', header)][:60]
        for i, match in enumerate(digits):
            n = match.end() - match.start()
            new = [b'9' * n, b'0' * n, b'-' + b'1' * (n - 1)][i % 3]
            yield f'number {i} of the header is {new.decode()}', _set(
                content[:match.start()] + new + content[match.end():])
    return special


def _cphd_file(content: bytes) -> Iterator[Damage]:
    yield from _xml_file(b'<CPHD')(content)
    first = int(re.search(rb'PVP_BLOCK_BYTE_OFFSET := (\d+)', content)[1])
    words = int(re.search(rb'PVP_BLOCK_SIZE := (\d+)', content)[1]) // 8
    per = words // N_PULSES
    for word in range(per):
        for value in (np.nan, np.inf, 0.0, -1.0, 1e300, 1e-300, 1e10)[word % 2::2]:
            for rows, told in (([N_PULSES // 2], 'one vector'), (range(N_PULSES), 'every vector')):
                out = bytearray(content)
                for row in rows:
                    at = first + 8 * (row * per + word)
                    out[at:at + 8] = struct.pack('>d', value)
                yield f'word {word} of {told} is {value}', _set(bytes(out))


def _tiff_file(content: bytes) -> Iterator[Damage]:
    (start,) = struct.unpack('<I', content[4:8])
    (count,) = struct.unpack('<H', content[start:start + 2])
    for i in range(count):
        at = start + 2 + 12 * i
        tag, kind, n, value = struct.unpack('<HHII', content[at:at + 12])
        for told, new in (('value 0', (tag, kind, n, 0)),
                          ('value of 4 GB', (tag, kind, n, 2**32 - 1)),
                          ('count of 4 GB', (tag, kind, 2**32 - 1, value)),
                          ('type 99', (tag, 99, n, value))):
            out = bytearray(content)
            out[at:at + 12] = struct.pack('<HHII', *new)
            yield f'tag {tag}: {told}', _set(bytes(out))
    out = bytearray(content)
    out[start + 2 + 12 * count:start + 6 + 12 * count] = struct.pack('<I', start)
    yield 'directory that follows itself', _set(bytes(out))

    def written(count=1, dtype='complex64', shape=(8, 8), tags=None, **options):
        def put(path):
            import rasterio

            path.unlink()
            with rasterio.open(path, 'w', driver='GTiff', count=count, dtype=dtype,
                               height=shape[0], width=shape[1], **options) as file:
                file.update_tags(**(tags or {}))
        return put

    yield 'no place', written()
    yield 'three bands', written(3, 'uint8')
    yield 'bomb', written(shape=(40_000, 40_000), compress='deflate', tiled=True, SPARSE_OK=True,
                          tags={'CONTENT': 'complex'})
    import rasterio

    with rasterio.MemoryFile(content) as memory, memory.open() as file:
        (tag, text), = ((k, v) for k, v in file.tags().items() if v.startswith('{'))
    for told, other in values_of(json.loads(text)):
        yield f'tag: {told}', written(shape=(64, 64), tags={tag: json.dumps(other)})

    def beside(name, text):
        def put(path):
            path.with_name(path.name + name).write_text(text)
        return put

    yield 'another file beside it', beside('.aux.xml', '<PAMDataset>' + '<x>' * 10_000)
    yield 'overviews beside it', beside('.ovr', 'II*\0rubbish')
    yield 'mask beside it', beside('.msk', 'II*\0rubbish')
    yield 'VRT', _set(b'<VRTDataset rasterXSize="9" rasterYSize="9"><VRTRasterBand dataType="Byte"'
                      b' band="1"><SimpleSource><SourceFilename>secret</SourceFilename>'
                      b'</SimpleSource></VRTRasterBand></VRTDataset>')


def _mcap_file(content: bytes) -> Iterator[Damage]:
    place, first = 8, {}
    while place < len(content) - 8:  # where each kind of record begins
        kind, size = struct.unpack('<BQ', content[place:place + 9])
        first.setdefault(kind, place)
        place += 9 + size
    for kind, at in first.items():
        for told, size in (('2**62 bytes', 2**62), ('2**64 - 1 bytes', 2**64 - 1), ('no bytes', 0),
                           ('2 GB', 2**31)):
            out = bytearray(content)
            out[at + 1:at + 9] = struct.pack('<Q', size)
            yield f'record {kind} claims {told}', _set(bytes(out))
        out = bytearray(content)
        out[at] = 0
        yield f'record {kind} is of kind 0', _set(bytes(out))
        body = range(at + 9, min(at + 9 + 64, len(content) - 4), 4)
        for j in body:
            out = bytearray(content)
            out[j:j + 4] = b'\xff' * 4
            yield f'record {kind}, bytes {j - at} of it', _set(bytes(out))
    chunk = first.get(6)
    if chunk is not None:
        inside = chunk + 9 + 32
        for name in (b'zstd', b'lz4', b'rot13'):
            yield f'compression {name.decode()}', _set(_rechunked(content, chunk, name, None))
        import lz4.frame

        for claimed in (1000, 2**29):
            yield f'bomb of lz4 that claims {claimed} bytes', _set(lambda n=claimed: _rechunked(
                content, chunk, b'lz4', lz4.frame.compress(bytes(2**29)), n))
        if sys.version_info < (3, 14):
            from backports import zstd
            for claimed in (1000, 2**29):
                yield f'bomb of zstd that claims {claimed} bytes', _set(lambda n=claimed: (
                    _rechunked(content, chunk, b'zstd', zstd.compress(bytes(2**29)), n)))
        cdr = content.index(b'\0\1\0\0', inside)
        for j in range(cdr, cdr + 160, 4):
            for value in (2**32 - 1, 2**31, 0):
                out = bytearray(content)
                out[j:j + 4] = struct.pack('<I', value)
                yield f'message, bytes {j - cdr} are {value}', _set(bytes(out))


def _rechunked(content, chunk, name, data, unpacked=None):
    """A file whose first chunk has another compression, and what follows it as it was."""
    (size,) = struct.unpack('<Q', content[chunk + 1:chunk + 9])
    head = content[chunk + 9:chunk + 9 + 28]
    data = content[chunk + 9 + 40:chunk + 9 + size] if data is None else data
    if unpacked is not None:
        head = head[:16] + struct.pack('<Q', unpacked) + head[24:]
    body = head + struct.pack('<I', len(name)) + name + struct.pack('<Q', len(data)) + data
    return (content[:chunk] + struct.pack('<BQ', 6, len(body)) + body
            + content[chunk + 9 + size:])


def _ros1_file(content: bytes) -> Iterator[Damage]:
    import bz2

    import lz4.frame

    def size_at(place):
        return int.from_bytes(content[place:place + 4], 'little')

    place, records = 13, []
    while place < len(content):  # first byte of header and data of each record
        data = place + 4 + size_at(place)
        records.append((place, data))
        place = data + 4 + size_at(data)
    for i, (header, data) in enumerate(records[:8]):
        for told, at in (('header', header), ('data', data)):
            for size in (0, 2**31, 2**32 - 1):
                yield f'{told} of record {i} claim {size} bytes', _set(
                    content[:at] + size.to_bytes(4, 'little') + content[at + 4:])
        for j in range(header + 4, min(header + 84, data), 4):
            yield f'header of record {i}, bytes {j - header}', _set(
                content[:j] + b'\xff' * 4 + content[j + 4:])
    chunk = next((h, d) for h, d in records if b'compression=none' in content[h:d])

    def packed(name, stored, claimed):
        field = b'compression=' + name
        head = (struct.pack('<I', 4) + b'op=\5' + struct.pack('<I', len(field)) + field
                + struct.pack('<I', 9) + b'size=' + struct.pack('<I', claimed))
        stop = chunk[1] + 4 + size_at(chunk[1])
        return (content[:chunk[0]] + struct.pack('<I', len(head)) + head
                + struct.pack('<I', len(stored)) + stored + content[stop:])

    for name, pack in ((b'bz2', bz2.compress), (b'lz4', lz4.frame.compress)):
        for claimed in (0, 1000, 2**28, 2**32 - 1):
            yield f'bomb of {name.decode()} that claims {claimed} bytes', _set(
                lambda name=name, pack=pack, n=claimed: packed(name, pack(bytes(2**28)), n))
        yield f'{name.decode()} that is none', _set(packed(name, b'rubbish', 1000))
        yield f'{name.decode()} twice', _set(packed(name, pack(b'a' * 1000) + pack(
            b'b' * 1000), 2000))
    yield 'compression of nobody', _set(packed(b'rot13', b'rubbish', 7))


def _packed_file(content: bytes) -> Iterator[Damage]:
    """Messages that were compressed one by one."""
    if sys.version_info < (3, 14):
        from backports import zstd
    else:
        from compression import zstd

    def messages(make):
        def put(path):
            with contextlib.closing(sqlite3.connect(path)) as db:
                db.execute('UPDATE messages SET data = ?', (make(),))
                db.commit()
        return put

    yield 'bombs', messages(lambda: zstd.compress(bytes(2**29)))
    yield 'two frames', messages(lambda: zstd.compress(b'a') + zstd.compress(bytes(2**29)))
    yield 'no frames', messages(lambda: b'rubbish')
    yield 'half a frame', messages(lambda: zstd.compress(os.urandom(1000))[:500])
    yield 'nothing', messages(lambda: b'')
    yield from _sqlite_file(content)


def _sqlite_file(content: bytes) -> Iterator[Damage]:
    def changed(*statements):
        def put(path):
            with sqlite3.connect(path) as db:
                db.execute('PRAGMA writable_schema=1')
                for statement in statements:
                    with contextlib.suppress(sqlite3.Error):  # what the schema forbids
                        db.execute(statement)
            db.close()
        return put

    forever = 'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) '
    for table in ('messages', 'topics', 'metadata', 'schema', 'message_definitions'):
        yield f'no table {table}', changed(f'DROP TABLE IF EXISTS {table}')
        yield f'{table} that never ends', changed(
            f'DROP TABLE IF EXISTS {table}', f'CREATE VIEW {table} AS {forever}SELECT i AS id, '
            'i AS topic_id, i AS timestamp, i AS data, i AS name, i AS type, i AS '
            'serialization_format, i AS offered_qos_profiles, i AS schema_version, i AS '
            'ros_distro, i AS metadata_version, i AS metadata, i AS topic_type, i AS encoding, '
            'i AS encoded_message_definition, i AS type_description_hash FROM n')
        yield f'{table} without rows', changed(f'DELETE FROM {table}')
    for column, value in (('data', "'x'"), ('data', 'NULL'), ('data', '7'), ('timestamp', "'x'"),
                          ('timestamp', 'NULL'), ('timestamp', '9223372036854775807'),
                          ('topic_id', '99'), ('data', 'zeroblob(1000000)'),
                          ('timestamp', '1e300')):
        yield f'{column} is {value}', changed(f'UPDATE messages SET {column} = {value}')
    for column in ('name', 'type', 'serialization_format', 'offered_qos_profiles'):
        for value in ("'x'", 'NULL', '7', "x'ff'", "'[[[['"):
            yield f'topic: {column} is {value}', changed(f'UPDATE topics SET {column} = {value}')
    yield 'a trigger', changed('CREATE TRIGGER t AFTER INSERT ON messages BEGIN DELETE FROM '
                               'messages; END')
    for at in (16, 18, 20, 28, 32, 44, 52, 56, 100, 105):
        out = bytearray(content)
        out[at:at + 2] = b'\xff\xff'
        yield f'header byte {at}', _set(bytes(out))

    def beside(name, text):
        def put(path):
            path.with_name(path.name + name).write_bytes(text)
        return put

    yield 'log beside it', beside('-wal', b'7\x7f\x06\x82' + bytes(4096))
    yield 'journal beside it', beside('-journal', b'\xd9\xd5\x05\xf9 \xa1c\xd7' + bytes(4096))


def _truth_file(content: bytes) -> Iterator[Damage]:
    """The truth within the metadata of a bag."""
    from sar_imaging.recordings.bag_io import TRUTH_KEY

    tree = yaml.safe_load(content)
    custom = tree['rosbag2_bagfile_information']['custom_data']
    truth = json.loads(custom[TRUTH_KEY])

    def put(text):
        custom = {TRUTH_KEY: text}
        return _set(_dumped({'rosbag2_bagfile_information': {
            **tree['rosbag2_bagfile_information'], 'custom_data': custom}}))

    for told, text in (('no JSON', 'x'), ('nothing', ''), ('nested deep', '[' * 100_000),
                       ('nested objects', '{"a":' * 100_000), ('digits', '9' * 100_000),
                       ('version 99', json.dumps({**truth, 'version': 99})),
                       ('a list', '[]'), ('NaN', 'NaN'), ('a key twice', '{"a": 1, "a": 2}')):
        yield told, put(text)
    for told, other in values_of(truth):
        if not told.startswith(('scenario', 'description', 'notes')):
            yield told, put(json.dumps(other))
    for name, fields in {'alignment': {'time_offset_s': 0.0, 'range_bias_m': 0.0,
                                       'lever_arm_m': [0.0, 0.0, 0.0]},
                         'antenna': {'pattern': 'sinc', 'azimuth_width_deg': 3.0},
                         'mount': {'kind': 'track', 'side': 'left'},
                         'collection': {'collector_name': 'a', 'channels': ['1']}}.items():
        for told, other in values_of({name: fields}):
            yield told, put(json.dumps({**truth, **(other if isinstance(other, dict) else {})}))


def _metadata_file(content: bytes) -> Iterator[Damage]:
    for told, text in bombs():
        yield told, _set(text)
        yield f'within: {told}', _set(b'rosbag2_bagfile_information:\n  ' + text)
    for told, tree in values_of(yaml.safe_load(content)):
        if 'custom_data' not in told:
            yield told, _set(_dumped(tree))


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
    Reader('CPHD, FX', 'scene.cphd', _cphd(), (_INFO, ('read', 'cphd', '{file}')), _cphd_file),
    Reader('CPHD, TOA in CI4', 'scene.cphd', _cphd(True, sample_type='CI4'),
           (('convert', '{file}', '{out}/bag'),), _cphd_file),
    Reader('SICD', 'image.nitf', _sicd, (_INFO, ('convert', '{file}', '{out}/map.tif')),
           _xml_file(b'<SICD')),
    Reader('GeoTIFF', 'map.tif', _geotiff, (_INFO, ('read', 'geotiff', '{file}')), _tiff_file),
    Reader('NumPy .npy', 'samples.npy', _described(_npy), _LOAD, _npy_file),
    Reader('NumPy .npz', 'samples.npz', _described(_npz, times={'variable': 't', 'alone': True}),
           _LOAD, _npz_file),
    Reader('MATLAB 5', 'samples.mat', _described(_mat), _LOAD, _mat_file),
    Reader('MATLAB 7.3', 'samples.mat', _described(_hdf5('samples.mat')), _LOAD, _hdf5_file),
    Reader('HDF5', 'samples.h5', _described(_hdf5('samples.h5')), _LOAD, _hdf5_file),
    Reader('CSV', 'track.csv', _described(_csv, positions={
        'file': 'track.csv', 'variables': ['x', 'y', 'z'], 'alone': True}), _LOAD, _text_file),
    Reader('P440 log', 'rail.log', _described(
        _log, samples={'variable': 'scan', 'iq': 'real'},
        radar={'waveform': 'passband', 'carrier_hz': 3.95e9, 'bandwidth_hz': 1.5e9,
               'sample_spacing_m': 'range_bin_m', 'range_start_m': 'range_start_m'},
        times={'variable': 'time_s', 'alone': True}), _LOAD, _text_file),
    Reader('bare samples', 'samples.bin', _described(_bare, samples={
        'dtype': 'complex64', 'sizes': {'sample': N_SAMPLES}}), _LOAD),
    Reader('poses, CSV', 'track.csv', _described(_csv, poses={'file': 'track.csv', 'level': True},
                                                 times={'first_s': 0.05, 'interval_s': 0.005}),
           _LOAD, _text_file),
    Reader('poses, TUM', 'poses.tum', _described(_poses('poses.tum'), **_POSES), _LOAD,
           _text_file),
    Reader('poses, OptiTrack', 'poses.csv', _described(_poses('poses.csv'), poses={
        'file': 'poses.csv'}), _LOAD, _text_file),
    Reader('poses, ROS 1 bag', 'poses.bag', _described(_poses('poses.bag'), times={
        'first_s': 10.0}, poses={'file': 'poses.bag'}), _LOAD, _ros1_file),
    Reader('poses, ROS 2 bag', 'poses/poses.mcap', _described(_poses('poses'), times={
        'first_s': 10.0}, poses={'file': 'poses'}), _LOAD, _mcap_file),
    Reader('description', 'rail.yaml', _described(_npy), _LOAD, _yaml_file),
    Reader('calibration', 'channels.yaml', _described(_calibration, calibration='channels.yaml'),
           _LOAD, _yaml_file),
    Reader('bag, MCAP', 'bag/bag.mcap', _bag, _OF_BAG, _mcap_file),
    Reader('bag, SQLite', 'bag/bag.db3', _sqlite_bag, _OF_BAG, _sqlite_file),
    Reader('bag, packed messages', 'bag/bag.db3', lambda f: _sqlite_bag(f, packed=True), _OF_BAG,
           _packed_file),
    Reader('bag, metadata', 'bag/metadata.yaml', _bag, _OF_BAG, _metadata_file),
    Reader('bag, truth', 'bag/metadata.yaml', _bag,
           (*_OF_BAG, ('convert', '{folder}/bag', '{out}/scene.cphd')), _truth_file),
    Reader('radar constant', 'constant.yaml', _constant, ((
        'image', '{folder}/bag', '--output', '{out}', '--brightness', 'rcs', '--radar-constant',
        '{file}'),), _yaml_file),
    Reader('configuration', 'radar.yaml', _configuration,
           (('check-config', '{file}'), ('layouts', '{file}', '--output', '{out}')), _yaml_file),
    Reader('job of an archive', 'survey.yaml', _job, (('read', 'job', '{file}'),), _yaml_file),
    Reader('catalogue', 'item.json', _catalogue, (('read', 'catalogue', '{file}'),), _json_file),
    Reader('antenna', 'antenna.yaml', _antenna, (('read', 'antenna', '{file}'),), _yaml_file),
    Reader('terrain', 'terrain.npz', _terrain, (('read', 'terrain', '{file}'),)),
    Reader('costs', 'costs.json', _costs, (('read', 'costs', '{file}'),), _json_file),
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
            found[name] = (hashlib.sha256(path.read_bytes()).hexdigest() if size < GIGA
                           else f'{size} bytes')
        else:
            found[name] = 'folder' if path.is_dir() else 'special'
    return found
