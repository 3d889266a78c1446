"""Tables of parameters by themselves: defaults are allowed, ends of ranges are, beyond is not."""

import importlib
import pkgutil

import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from sar_imaging import nodes
from sar_imaging.nodes.parameters import ConfigurationError, Parameter


def _tables():
    for info in pkgutil.iter_modules(nodes.__path__):
        module = importlib.import_module(f'{nodes.__name__}.{info.name}')
        for value in vars(module).values():
            for one in value if isinstance(value, tuple) else (value,):
                if isinstance(one, Parameter):
                    yield one
                elif isinstance(one, type):
                    yield from getattr(one, 'PARAMETERS', ())


PARAMETERS = {(p.name, str(p.default)): p for p in _tables()}


def test_tables_are_found():
    assert {'grid.centre_x', 'reorder_window_pulses', 'oversampling', 'images_every'} <= {
        p.name for p in PARAMETERS.values()}


@pytest.mark.parametrize('parameter', PARAMETERS.values(), ids=lambda p: p.name)
def test_defaults_and_ends_of_ranges_are_allowed_and_no_more(parameter):
    assert parameter.coerce(parameter.default) == parameter.default
    if parameter.minimum is None:
        return
    kind, low, high = type(parameter.default), parameter.minimum, parameter.maximum
    assert low < high
    step = 1 if kind is int else 1e-6 * (high - low)
    for value in (low - step, high + step):
        with pytest.raises(ConfigurationError, match=f'{parameter.name}=.*expected .* from'):
            parameter.coerce(kind(value))
    if parameter.check is None:
        assert [parameter.coerce(kind(v)) for v in (low, high)] == [low, high]


@pytest.mark.parametrize(('name', 'least'), [
    ('grid.spacing', 1e-4), ('max_image_pixels', 1), ('queue_depth', 1), ('worker_queue_size', 1),
    ('pulses_per_aperture', 2), ('oversampling', 1.0)])
def test_what_is_counted_may_be_few_but_not_nothing(name, least):
    for parameter in (p for p in PARAMETERS.values() if p.name == name):
        assert parameter.coerce(least) == least
        with pytest.raises(ConfigurationError, match=f'{name}=0.*expected'):
            parameter.coerce(0 * least)
