"""RViz configuration, Foxglove layout and Fast DDS profile fit the nodes and the middleware."""

import ast
import json
import pathlib
import xml.etree.ElementTree as ElementTree

import pytest
import yaml

ROOT = pathlib.Path(__file__).parents[2]
PACKAGE = ROOT / 'sar_imaging'
RVIZ = PACKAGE / 'resource' / 'sar_imaging.rviz'
FOXGLOVE = PACKAGE / 'resource' / 'sar_imaging.foxglove.json'
LATCHED = 'LATCHED', 'MAP_QOS'  # names of what is transient local
# What a display of RViz or a panel of Foxglove shows.
DISPLAYS = {'rviz_default_plugins/Image': 'Image', 'rviz_default_plugins/Map': 'OccupancyGrid',
            'rviz_default_plugins/PointCloud2': 'PointCloud2'}


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
