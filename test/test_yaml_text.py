# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Keys that are given twice, wherever the package reads YAML."""

import pathlib
import re

import pytest
import yaml
from hypothesis import given, strategies as st

from sar_imaging.archive.job import JobError, read_job
from sar_imaging.configuration.parameters import (
    ConfigurationFileError,
    load_tree,
    read_configuration,
)
from sar_imaging.geometry.antenna import Antenna
from sar_imaging.radiometry import RadarConstant
from sar_imaging.recordings import DescriptionError, read_description
from sar_imaging.signal.calibration import CalibrationError, ChannelCalibration
from sar_imaging.yaml_text import RepeatedKeyError, line_of, load_yaml, trouble

PACKAGE = pathlib.Path(__file__).parents[1] / 'sar_imaging'

READERS = {
    'description': (read_description, DescriptionError, 'radar: {}\nradar: {}'),
    'job': (read_job, JobError, 'products:\n  mosaic: true\n  mosaic: false'),
    'parameters': (load_tree, ConfigurationFileError, '/**:\n  a: {}\n  a: {}'),
    'antenna': (Antenna.load, ValueError, 'azimuth_deg: [0]\nazimuth_deg: [1]'),
    'constant': (RadarConstant.load, ValueError, 'gain_m: 1.0\ngain_m: 2.0'),
    'calibration': (ChannelCalibration.load, CalibrationError, 'delay_s: []\ndelay_s: []')}


@pytest.mark.parametrize('name', READERS)
def test_every_reader_refuses_a_key_that_is_given_twice(tmp_path, name):
    read, error, text = READERS[name]
    path = tmp_path / 'file.yaml'
    path.write_text(text)
    with pytest.raises(error, match=f'twice.*|line {len(text.splitlines())}') as caught:
        read(path)
    said = str(caught.value)
    assert 'twice' in said and f'line {len(text.splitlines())}' in said and '\n' not in said


@pytest.mark.parametrize('text', [
    'a: 1\nb:\n  - c: 2\n  - c: 3', 'base: &base {a: 1, b: 2}\nof: {<<: *base, a: 3}',
    '1: a\n"1": b', 'a: &a [1]\nb: [*a, *a]'])
def test_what_is_given_once_is_read_as_pyyaml_reads_it(text):
    assert repr(load_yaml(text)) == repr(yaml.safe_load(text))


@pytest.mark.parametrize(('text', 'message'), [
    ('a: 1\nb: 2\na: 3', 'line 3: the key a is given twice, first in line 1; keep one of them'),
    ('a:\n- {b: 1,\n   b: 2}', 'line 3: the key b is given twice, first in line 2'),
    ('{a: {x: 1}, "a": {}}', 'line 1: the key a is given twice, first in line 1')])
def test_line_and_key_are_named(text, message):
    with pytest.raises(RepeatedKeyError) as caught:
        load_yaml(text)
    assert message in trouble(caught.value)


BOUNDLESS = {
    'merges': '\n'.join(['a0: &a0 {k: 1}', *(
        f'a{i}: &a{i} {{<<: [{", ".join([f"*a{i - 1}"] * 9)}]}}' for i in range(1, 12))]),
    'aliases': '\n'.join(['a0: &a0 [1]', *(
        f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * 9)}]' for i in range(1, 12))]),
    'itself': 'a: &a [*a]', 'deep': 'a: ' + '[' * 100_000, 'deep block': '- ' * 100_000,
    'mapping': '{a: ' * 100_000, 'base 60': 'a: 1' + ':59' * 300_000, 'long': 'a: ' + '9' * 10**6}


@pytest.mark.parametrize('name', BOUNDLESS)
def test_boundless_texts_are_refused_in_one_line(name):
    with pytest.raises(yaml.YAMLError) as caught:
        load_yaml(BOUNDLESS[name])
    assert trouble(caught.value).startswith('line ')


@given(st.dictionaries(st.text(max_size=5), st.integers() | st.lists(st.text(max_size=3))),
       st.data())
def test_any_repeated_key_is_found(content, data):
    text = yaml.safe_dump(content)
    assert load_yaml(text) == content
    if content:
        key = data.draw(st.sampled_from(sorted(content)))
        with pytest.raises(RepeatedKeyError):
            load_yaml(text + yaml.safe_dump({key: 0}))


def test_lines_of_keys_and_items_are_known():
    content = load_yaml('a: 1\nb:\n  c: [x,\n    y]\n  <<: {d: 2}\n')
    assert (line_of(content, 'a'), line_of(content, 'b'), line_of(content, 'e')) == (1, 2, None)
    assert (line_of(content['b'], ('c', 1)), line_of(content['b'], 'd')) == (4, 5)
    assert line_of({'a': 1}, 'a') is None  # of a program


@pytest.mark.parametrize(('name', 'text'), [
    ('description', 'name: rail\nradar: {carier_hz: 1.0}'),
    ('job', 'recordings: flights\ntille: 1'),
    ('parameters', '/**/backprojection:\n  ros__parameters: {taget_db: 1.0}')])
def test_a_misspelt_key_is_named_with_its_line(tmp_path, name, text):
    path = tmp_path / 'file.yaml'
    path.write_text(text)
    if name == 'parameters':
        said = f'{path}, {read_configuration(path).findings[0].text}'
    else:
        with pytest.raises(ValueError) as caught:
            READERS[name][0](path) if name == 'job' else read_description(path).section(
                'radar', ['carrier_hz'])
        said = str(caught.value)
    assert 'file.yaml, line 2: ' in said and 'did you mean' in said


def test_a_text_that_looks_like_a_number_is_one_unless_in_quotes():
    assert load_yaml('[9.6e9, "9.6e9", 1e-3]') == [9.6e9, '9.6e9', 1e-3]
    assert load_yaml(yaml.safe_dump(['9.6e9'])) == ['9.6e9']


def test_all_yaml_is_read_in_one_place():
    """With `safe_load` a key that is given twice would pass."""
    alone = re.compile(r'yaml\.(safe_load|load|full_load|SafeLoader)\b')
    users = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob('*.py')
             if alone.search(re.sub(r'`[^`]*`', '', path.read_text()))}
    assert users == {'yaml_text.py'}
