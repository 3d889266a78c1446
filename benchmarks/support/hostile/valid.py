# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Small valid files of every kind that the package reads."""

from __future__ import annotations

import json
import pathlib

import numpy as np
import yaml

DATUM, AREA = (47.0, 8.0, 450.0), (0.0, 0.0, 0.0)
N_PULSES, N_SAMPLES = 24, 128
GIGA = 10**9


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


def cphd(compressed=False, **options):
    def make(folder):
        from sar_imaging.formats.cphd import write_cphd

        write_cphd(folder / 'scene.cphd', [pulses(compressed)], _datum(), _area(), **options)
    return make


def sicd(folder):
    from sar_imaging.formats import Acquisition, write_sicd

    write_sicd(folder / 'image.nitf', _image(), _datum(), Acquisition.of(pulses()))


def geotiff(folder):
    from sar_imaging.formats import write_geotiff

    write_geotiff(folder / 'map.tif', _image(), _datum(), content='complex')


def bag(folder, with_poses=False):
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


def sqlite_bag(folder, packed=False):
    """The recording of `bag` as the older plugin of rosbag2 stores it."""
    from rosbags import rosbag2
    from rosbags.typesys import Stores, get_typestore

    bag(folder)
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


def described(write, **changes):
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


def npy(folder, samples):
    np.save(folder / 'samples.npy', samples)
    return 'samples.npy'


def npz(folder, samples):
    np.savez(folder / 'samples.npz', echoes=samples, t=0.01 * np.arange(N_PULSES))
    return 'samples.npz'


def mat(folder, samples):
    from scipy.io import savemat

    savemat(folder / 'samples.mat', {'echoes': samples}, do_compression=True)
    return 'samples.mat'


def hdf5(name):
    def write(folder, samples):
        import h5py

        with h5py.File(folder / name, 'w', userblock_size=512) as file:
            file['echoes'] = samples.T if name.endswith('.mat') else samples
        if name.endswith('.mat'):
            with open(folder / name, 'r+b') as file:
                file.write(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\0\2IM')
        return name
    return write


def csv(folder, samples):
    npy(folder, samples)
    rows = '\n'.join(f'{0.01 * i},{0.5 * i - 6},-300,200' for i in range(N_PULSES))
    (folder / 'track.csv').write_text('time,x,y,z\n' + rows + '\n')
    return 'samples.npy'


def log(folder, samples):
    lines = [f'{1.7e9 + 0.04 * i:.3f}, MrmFullScanInfo, {i}, 100, {5000 + 40 * i}, 0, 0, 0, 0, '
             f'10000, 35564, 32, 1, 0, 0, {len(scan)}, '
             + ', '.join(str(int(v)) for v in 1e4 * scan.real)
             for i, scan in enumerate(samples)]
    (folder / 'rail.log').write_text('\n'.join(lines) + '\n')
    return 'rail.log'


def bare(folder, samples):
    samples.astype('<c8').tofile(folder / 'samples.bin')
    return 'samples.bin'


def poses(name):
    def write(folder, samples):
        npy(folder, samples)
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


def calibration(folder, samples):
    npy(folder, samples)
    (folder / 'channels.yaml').write_text('amplitude: [1.0]\nphase_deg: [0.0]\ndelay_s: [0.0]\n')
    return 'samples.npy'


def constant(folder):
    bag(folder)
    (folder / 'constant.yaml').write_text('gain_m: 1.0e+6\nnoise_power: 3.0\n')


def configuration(folder):
    import sar_imaging

    shipped = pathlib.Path(sar_imaging.__file__).parent / 'config' / 'drone_uwb.yaml'
    (folder / 'radar.yaml').write_bytes(shipped.read_bytes())


def job(folder):
    bag(folder)
    (folder / 'survey.yaml').write_text(
        'recordings: [bag]\noutput: survey\nspacing_m: 0.5\nmemory_gb: 1\n'
        'products: {images: [geotiff], mosaic: true}\n')


def catalogue(folder):
    cphd()(folder)
    (folder / 'item.json').write_text(json.dumps({
        'type': 'Feature', 'stac_version': '1.0.0', 'id': 'flight', 'geometry': None,
        'properties': {'datetime': '2026-01-01T00:00:00Z'}, 'links': [],
        'assets': {'pulses': {'href': './scene.cphd', 'roles': ['data']}}}))


def costs(folder):
    from sar_imaging.planning.costs import DEFAULT

    DEFAULT.write(folder / 'costs.json')


def antenna(folder):
    (folder / 'antenna.yaml').write_text(
        'azimuth_deg: [-10, 0, 10]\nazimuth_gain_db: [-20, 0, -20]\n')


def terrain(folder):
    np.savez(folder / 'terrain.npz', height_m=np.zeros((5, 4)), x_m=np.arange(4.0),
             y_m=np.arange(5.0))
