# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""RViz configuration, Foxglove layout and Fast DDS profile fit the nodes and the middleware."""

import ast
import json
import pathlib
import xml.etree.ElementTree as ElementTree

import pytest
import yaml

from sar_imaging.geometry import MapGrid
from sar_imaging.tools import layouts

ROOT = pathlib.Path(__file__).parents[2]
PACKAGE = ROOT / 'sar_imaging'
RVIZ = PACKAGE / 'resource' / 'sar_imaging.rviz'
FOXGLOVE = PACKAGE / 'resource' / 'sar_imaging.foxglove.json'
LATCHED = 'LATCHED', 'MAP_QOS'  # names of what is transient local
# What a display of RViz or a panel of Foxglove shows.
DISPLAYS = {'rviz_default_plugins/Image': 'Image', 'rviz_default_plugins/Map': 'OccupancyGrid',
            'rviz_default_plugins/PointCloud2': 'PointCloud2'}
# Names of properties and of their choices as RViz of ROS 2 Jazzy and Foxglove know them: both skip
# silently what they do not know.
ANY = object()
GRID = MapGrid.from_size((1.0, 2.0, 3.0), 10.0, 10.0, 0.5)
QOS = {'Value': ANY, 'Depth': ANY, 'History Policy': {'Keep Last', 'Keep All'},
       'Reliability Policy': {'Reliable', 'Best Effort'},
       'Durability Policy': {'Volatile', 'Transient Local'}}
DISPLAY = {'Class': ANY, 'Name': ANY, 'Enabled': {True, False}}
RVIZ_KEYS = {
    'Grid': DISPLAY | {'Cell Size': ANY, 'Plane': {'XY', 'XZ', 'YZ'}, 'Plane Cell Count': ANY,
                       'Reference Frame': ANY, 'Offset': dict.fromkeys('XYZ', ANY)},
    'TF': DISPLAY | {'Show Names': {True, False}, 'Marker Scale': ANY, 'Frame Timeout': ANY},
    'Map': DISPLAY | {'Alpha': ANY, 'Color Scheme': {'map', 'costmap', 'raw'},
                      'Draw Behind': {True, False}, 'Topic': QOS | {'Filter size': ANY},
                      'Update Topic': QOS, 'Use Timestamp': {True, False}},
    'Image': DISPLAY | {'Normalize Range': {True, False}, 'Min Value': ANY, 'Max Value': ANY,
                        'Median window': ANY, 'Topic': QOS},
    'PointCloud2': DISPLAY | {
        'Style': {'Points', 'Squares', 'Flat Squares', 'Spheres', 'Boxes', 'Tiles'},
        'Size (m)': ANY, 'Color Transformer': {'Intensity', 'RGB8', 'AxisColor', 'FlatColor'},
        'Channel Name': ANY, 'Autocompute Intensity Bounds': {True, False},
        'Use rainbow': {True, False}, 'Topic': QOS | {'Filter size': ANY}},
    'TopDownOrtho': {'Class': ANY, 'Name': ANY, 'Scale': ANY, 'X': ANY, 'Y': ANY, 'Angle': ANY,
                     'Target Frame': ANY, 'Near Clip Distance': ANY}}
CLASSES = {f'rviz_default_plugins/{name}' for name in (*RVIZ_KEYS, 'MoveCamera', 'Measure')} | {
    f'rviz_common/{name}' for name in ('Displays', 'Views', 'Time')}
SCENE = {'foxglovePanelTitle': ANY, 'followTf': ANY, 'layers': ANY, 'topics': ANY,
         'followMode': {'follow-none', 'follow-position', 'follow-pose'},
         'scene': {'backgroundColor': ANY}, 'imageMode': {'imageTopic': ANY},
         'cameraState': {'perspective': {True, False}, 'distance': ANY, 'phi': ANY,
                         'thetaOffset': ANY, 'targetOffset': ANY}}
FOXGLOVE_KEYS = {
    'Image': SCENE, '3D': SCENE,
    'DiagnosticSummary': {'foxglovePanelTitle': ANY, 'minLevel': {0, 1, 2, 3}, 'pinnedIds': ANY,
                          'hardwareIdFilter': ANY, 'topicToRender': ANY,
                          'sortByLevel': {True, False}},
    'RosOut': {'foxglovePanelTitle': ANY, 'minLogLevel': {1, 2, 3, 4, 5}, 'searchTerms': ANY,
               'topicToRender': ANY}}
GRID_LAYER = {'layerId': {'foxglove.Grid'}, 'label': ANY, 'visible': {True, False}, 'size': ANY,
              'divisions': ANY, 'frameId': ANY, 'position': ANY}
FOXGLOVE_TOPICS = {
    'OccupancyGrid': {'visible': {True, False}, 'colorMode': {'custom', 'costmap', 'map', 'raw'}},
    'PointCloud2': {'visible': {True, False}, 'pointSize': ANY, 'colorField': ANY,
                    'colorMode': {'flat', 'gradient', 'colormap'},
                    'colorMap': {'turbo', 'rainbow'}}}


def check_keys(given, known, where):
    """Each key is known, and its value one of the choices."""
    for key, value in given.items():
        assert key in known, f'{where}: no reader knows {key!r}'
        if isinstance(known[key], dict):
            check_keys(value, known[key], f'{where}, {key}')
        elif known[key] is not ANY:
            assert value in known[key], f'{where}, {key}: {value!r}'


def published_topics():
    """Type and latching of every topic that a node makes with create_output, from its source."""
    topics = {}
    for path in (PACKAGE / 'nodes').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, 'attr', '') == 'create_output':
                kind, topic, qos = node.args[:3]
                # Of f'{prefix}image' what stands without a prefix.
                parts = topic.values if isinstance(topic, ast.JoinedStr) else [topic]
                name = ''.join(p.value for p in parts if isinstance(p, ast.Constant))
                topics[f'/{name}'] = (kind.id, getattr(qos, 'id', '') in LATCHED)
    return topics


@pytest.fixture(scope='module')
def rviz():
    return yaml.safe_load(RVIZ.read_text())


@pytest.fixture(scope='module')
def foxglove():
    return json.loads(FOXGLOVE.read_text())


def test_the_source_tells_the_topics():
    topics = published_topics()
    assert topics['/image_quicklook'] == ('Image', False)
    assert topics['/obstacle_map'] == ('OccupancyGrid', True)


def test_rviz_shows_topics_of_the_nodes_with_their_quality_of_service(rviz):
    topics = published_topics()
    displays = rviz['Visualization Manager']['Displays']
    shown = {d['Topic']['Value']: d for d in displays if 'Topic' in d}
    assert {'/image_quicklook', '/obstacle_map'} <= set(shown) <= set(topics)
    for topic, display in shown.items():
        kind, latched = topics[topic]
        assert DISPLAYS[display['Class']] == kind
        # Volatile readers never get what was published before they came.
        durability = 'Transient Local' if latched else 'Volatile'
        assert display['Topic']['Durability Policy'] == durability
        assert display['Topic']['Reliability Policy'] == 'Reliable'
        assert display['Topic']['History Policy'] == 'Keep Last'
    assert 'rviz_default_plugins/TF' in {d['Class'] for d in displays}
    assert all(d['Enabled'] for d in displays)


def test_rviz_knows_all_classes_and_properties(rviz):
    manager = rviz['Visualization Manager']
    moved = layouts.rviz_layout(GRID, 'odom')['Visualization Manager']
    for part in (*manager['Displays'], manager['Views']['Current'], *moved['Displays']):
        check_keys(part, RVIZ_KEYS[part['Class'].rpartition('/')[2]], part['Name'])
    used = [*rviz['Panels'], *manager['Displays'], *manager['Tools'],
            manager['Transformation']['Current'], manager['Views']['Current']]
    assert {part['Class'] for part in used} <= CLASSES
    assert manager['Global Options'].keys() == {'Background Color', 'Fixed Frame', 'Frame Rate'}


def test_foxglove_knows_all_settings(foxglove):
    topics = published_topics()
    moved = layouts.foxglove_layout(GRID, 'odom')['configById']
    for name, panel in (*foxglove['configById'].items(), *moved.items()):
        check_keys(panel, FOXGLOVE_KEYS[name.partition('!')[0]], name)
        for topic, settings in panel.get('topics', {}).items():
            check_keys(settings, FOXGLOVE_TOPICS[topics[topic][0]], topic)
        for layer in panel.get('layers', {}).values():
            check_keys(layer, GRID_LAYER, f'{name}, grid')
    assert foxglove.keys() == {'configById', 'layout', 'globalVariables', 'userNodes',
                               'playbackConfig'}


def test_rviz_looks_at_the_frame_of_the_images(rviz):
    defaults = (PACKAGE / 'config' / 'sar_imaging.yaml').read_text()
    frame = rviz['Visualization Manager']['Global Options']['Fixed Frame']
    assert f'frame_id: {frame}\n' in defaults
    assert rviz['Visualization Manager']['Views']['Current']['Class'].endswith('TopDownOrtho')


def test_foxglove_shows_topics_of_the_nodes(foxglove):
    panels = foxglove['configById']
    topics = published_topics()
    assert topics[panels['Image!quicklook']['imageMode']['imageTopic']][0] == 'Image'
    assert {topics[t][0] for t in panels['3D!map']['topics']} <= {'OccupancyGrid', 'PointCloud2'}
    assert '/obstacle_map' in panels['3D!map']['topics']
    health = (PACKAGE / 'nodes' / 'runtime' / 'health.py').read_text()
    assert f"'{panels['DiagnosticSummary!nodes']['topicToRender']}'" in health


def test_foxglove_lays_out_every_panel_once(foxglove):
    def panels(part):
        if isinstance(part, str):
            return [part]
        assert part['direction'] in ('row', 'column')
        assert 0 < part['splitPercentage'] < 100
        return panels(part['first']) + panels(part['second'])

    assert sorted(panels(foxglove['layout'])) == sorted(foxglove['configById'])


def test_the_fast_dds_profile_carries_megabytes():
    profile = ElementTree.parse(PACKAGE / 'config' / 'fastdds_large_segment.xml')
    name = {'dds': profile.getroot().tag.split('}')[0].strip('{')}
    [shared] = [t for t in profile.findall('.//dds:transport_descriptor', name)
                if t.findtext('dds:type', namespaces=name) == 'SHM']
    # Twice the largest message that is recommended, 16 MB, and more.
    assert int(shared.findtext('dds:segment_size', namespaces=name)) == 64 * 2**20
    [participant] = profile.findall('.//dds:participant', name)
    assert participant.get('is_default_profile') == 'true'
    used = {t.text for t in participant.findall('.//dds:userTransports/dds:transport_id', name)}
    described = {t.findtext('dds:transport_id', namespaces=name)
                 for t in profile.findall('.//dds:transport_descriptor', name)}
    assert used == described
    assert participant.findtext('.//dds:useBuiltinTransports', namespaces=name) == 'false'
