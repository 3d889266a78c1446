# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Values of parameters: types, ranges up to their ends, and what may change when."""

import math

import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

import rclpy
from rclpy.parameter import Parameter as RosParameter

from sar_imaging.nodes import backprojection, pulse_buffer, range_compression
from sar_imaging.nodes.runtime import stage
from sar_imaging.nodes.runtime.parameters import (
    ANY_TIME,
    START,
    ConfigurationError,
    Parameter,
    ParameterValues,
    one_of,
)

NUMBER = Parameter('number', 2.5, 'A number.', 'm', -1.0, 4.0)
COUNT = Parameter('count', 3, 'A count.', '', 0, 7, changes=ANY_TIME)
LIST = Parameter('list', [0.0], 'Numbers.')
WORD = Parameter('word', 'red', 'A word.', check=one_of('red', 'blue'))
FLAG = Parameter('flag', False, 'A switch.', changes=START)
TABLES = (*stage.COMMON_PARAMETERS, *pulse_buffer.PARAMETERS, *range_compression.PARAMETERS,
          *backprojection.PARAMETERS)


@pytest.mark.parametrize(('parameter', 'given', 'taken'), [
    (NUMBER, -1.0, -1.0), (NUMBER, 4.0, 4.0), (NUMBER, 3, 3.0), (COUNT, 0, 0), (COUNT, 7, 7),
    (LIST, [1.0, 2.0], [1.0, 2.0]), (LIST, (1, 2.5), [1.0, 2.5]), (WORD, 'blue', 'blue'),
    (FLAG, True, True)])
def test_values_up_to_the_ends_of_their_range_are_taken(parameter, given, taken):
    value = parameter.coerce(given)
    assert value == taken and type(value) is type(taken)


@pytest.mark.parametrize(('parameter', 'value', 'text'), [
    (NUMBER, math.nextafter(-1.0, -2.0), r'a number from -1.0 to 4.0 \(m\)'),
    (NUMBER, math.nextafter(4.0, 5.0), 'a number from'), (NUMBER, math.nan, 'a number from'),
    (NUMBER, True, 'a number from'), (NUMBER, '1', "number='1'; expected"),
    (COUNT, -1, 'a whole number from 0 to 7'), (COUNT, 8, 'a whole number'),
    (COUNT, 3.0, 'a whole number'), (COUNT, True, 'a whole number'),
    (LIST, [], 'a list of numbers'), (LIST, [1.0, math.inf], 'a list of numbers'),
    (LIST, ['a'], 'a list of numbers'), (LIST, 'ab', 'a list of numbers'),
    (WORD, 'green', "word: 'green' is unknown; use one of red, blue"),
    (FLAG, 1, 'true or false')])
def test_other_values_are_refused_with_what_is_expected(parameter, value, text):
    with pytest.raises(ConfigurationError, match=text):
        parameter.coerce(value)


def test_every_default_lies_in_its_range():
    for parameter in TABLES:
        assert parameter.coerce(parameter.default) == parameter.default
        for end in {parameter.minimum, parameter.maximum} - {None}:
            # A check beside the range may want more, such as one of a few words.
            assert parameter.check or parameter.coerce(type(parameter.default)(end)) == end


@pytest.mark.parametrize(('name', 'least'), [
    ('grid.spacing', 1e-4), ('max_image_pixels', 1), ('queue_depth', 1), ('worker_queue_size', 1),
    ('pulses_per_aperture', 2), ('oversampling', 1.0)])
def test_what_is_counted_may_be_few_but_not_nothing(name, least):
    found = [p for p in TABLES if p.name == name]
    assert found
    for parameter in found:
        assert parameter.coerce(least) == least
        with pytest.raises(ConfigurationError, match=f'{name}=0.*expected'):
            parameter.coerce(0 * least)


@pytest.fixture
def node(ros_environment):
    rclpy.init()
    made = []

    def make(**values):
        made.append(rclpy.create_node('p', parameter_overrides=[
            RosParameter(name, value=value) for name, value in values.items()]))
        return made[-1], ParameterValues(made[-1], (NUMBER, COUNT, WORD, FLAG))

    yield make
    for one in made:
        one.destroy_node()
    rclpy.try_shutdown()


def changed(node, name, value):
    [result] = node.set_parameters([RosParameter(name, value=value)])
    return result.successful, result.reason


def test_what_counts_at_the_configuration_changes_only_without_one(node):
    ros, values = node(number=1)
    assert values['number'] == 1.0 and type(values['number']) is float
    assert changed(ros, 'number', 2.0)[0] and values['number'] == 2.0
    values.load()
    successful, reason = changed(ros, 'number', 3.0)
    assert not successful and 'is read when the node is configured' in reason
    assert values['number'] == 2.0
    assert changed(ros, 'number', 2.0)[0]  # as it is
    assert changed(ros, 'count', 5)[0] and values['count'] == 5
    values.release()
    assert changed(ros, 'number', 3.0)[0] and values['number'] == 3.0
    assert not changed(ros, 'flag', True)[0] and values['flag'] is False


def test_an_impossible_value_of_the_start_refuses_until_it_is_corrected(node):
    ros, values = node(number=9.0, count=2)
    with pytest.raises(ConfigurationError, match=r'number=9.0; expected a number from -1.0 to'):
        values.load()
    assert values['count'] == 2
    assert not changed(ros, 'number', 4.5)[0]
    assert changed(ros, 'number', 4.0)[0]
    values.load()
    assert values['number'] == 4.0
    assert not changed(ros, 'number', 'text')[0]
