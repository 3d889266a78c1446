# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions: what is wrong is said in one line that names the key."""

from __future__ import annotations

import pytest

from sar_imaging.recordings import (
    DescriptionError,
    find_description,
    read_description,
    shipped_names,
)


def described(tmp_path, text, **changes):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    return read_description(path, changes)


@pytest.mark.parametrize(('text', 'message'), [
    ('sample: {}', 'unknown key sample; did you mean samples?'),
    ('quux: 1', 'unknown key quux; expected one of name, description'),
    ('- a', 'the file: expected keys with values'),
    ('a: [', 'line 1: it is no YAML: '),
    ('name: a\nsamples: {}\nname: b', 'line 3: the key name is given twice, first in line 1'),
    ('radar: {k: 1, k: 2}', 'line 1: the key k is given twice, first in line 1; keep one'),
    ('', 'the file: expected keys with values')])
def test_what_is_no_description_is_told(tmp_path, text, message):
    with pytest.raises(DescriptionError, match='mine.yaml') as error:
        described(tmp_path, text)
    assert message in str(error.value) and '\n' not in str(error.value)


@pytest.mark.parametrize(('key', 'value', 'message'), [
    ('number', '[1, 2]', 'radar.k: expected one number, got [1, 2]; it holds 2'),
    ('number', 'fast', "radar.k: expected numbers, got 'fast'"),
    ('number', '60 MHz/us', "got '60 MHz/us'; write the number alone, in the unit that the key"),
    ('number', '.nan', 'radar.k: expected finite numbers, got nan'),
    ('integer', '1.5', 'radar.k: expected a whole number of at least 1, got 1.5'),
    ('flag', '1', 'radar.k: expected true or false, got 1'),
    ('text', '1', 'radar.k: expected a text, got 1; put it in quotes'),
    ('vector', '[1, 2]', 'radar.k: expected [x, y, z] or a list of these, got [1, 2]'),
    ('vector', '[[1, 2, 3], [1, 2, 3]]', 'radar.k: expected one vector of 3 numbers')])
def test_a_wrong_value_is_named_with_what_was_expected(tmp_path, key, value, message):
    section = described(tmp_path, f'radar: {{k: {value}}}').section('radar', ('k',))
    with pytest.raises(DescriptionError) as error:
        getattr(section, key)('k')
    assert message in str(error.value)


def test_a_missing_key_and_a_mistaken_word_are_named(tmp_path):
    section = described(tmp_path, 'radar: {waveform: fmwc}').section('radar', ('waveform', 'k'))
    with pytest.raises(DescriptionError, match=r'radar\.k is missing; add it'):
        section.number('k')
    with pytest.raises(DescriptionError, match='expected one of lfm, fmcw.*did you mean fmcw'):
        section.choice('waveform', ('lfm', 'fmcw'))
    with pytest.raises(DescriptionError, match="got 'FMCW'; did you mean fmcw"):
        described(tmp_path, 'name: FMCW').choice('name', ('lfm', 'fmcw'))
    with pytest.raises(DescriptionError, match='k is missing; add it: one of lfm, fmcw'):
        section.choice('k', ('lfm', 'fmcw'))


def test_numbers_of_yaml_1_1_without_a_point_are_numbers(tmp_path):
    section = described(tmp_path, 'radar: {k: 1e-9}').section('radar', ('k',))
    assert section.number('k') == 1e-9


def test_values_can_be_changed_by_their_path(tmp_path):
    top = described(tmp_path, 'radar: {k: 1}', **{'radar.k': 2, 'scene.window': 'hamming'})
    assert top.section('radar', ('k',)).number('k') == 2
    assert top.section('scene', ('window',)).text('window') == 'hamming'
    with pytest.raises(DescriptionError, match=r'radar\.k\.m=1 cannot be set'):
        described(tmp_path, 'radar: {k: 1}', **{'radar.k.m': 1})


def test_files_that_are_none_are_told(tmp_path):
    with pytest.raises(DescriptionError, match='no.yaml does not exist; expected a YAML file or '
                       'one of arcsar'):
        find_description('no.yaml')
    with pytest.raises(DescriptionError, match='is a folder; expected the YAML file'):
        find_description(tmp_path)
    with pytest.raises(DescriptionError, match='cannot be read'):
        read_description(tmp_path / 'no.yaml')
    (tmp_path / 'b.yaml').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(DescriptionError, match='is no text'):
        read_description(tmp_path / 'b.yaml')


@pytest.mark.parametrize('name', shipped_names())
def test_shipped_descriptions_are_short(name):
    lines = find_description(name).read_text().splitlines()
    assert len(lines) <= 15
    assert max(map(len, lines)) <= 100
