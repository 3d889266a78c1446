# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Which backend computes a plan: the processor's, that of a device, or one after the other."""

import logging
import subprocess
import sys
import types

import numpy as np
import pytest

from sar_imaging import backends
from sar_imaging.backends import DeviceError, automatic, backend, device
from sar_imaging.backends.cpu.backprojection import Backprojection
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.afbp.plan import plan_afbp
from sar_imaging.planning.exact.backprojection import plan_backprojection


@pytest.fixture
def planned(make_scene):
    scene = make_scene(1000.0, n=16, pulses=8)
    return scene, plan_backprojection(scene.grid, scene.block.radar, scene.block.n_samples,
                                      *scene.echoes[1:], -60.0)


@pytest.fixture
def forget():
    """Whether there is a device is found out again."""
    device.device_backend.cache_clear()
    yield
    device.device_backend.cache_clear()


class Fake(Backprojection):
    """A device that computes as the processor does, unless it fails."""

    failure = None

    def add(self, samples, tx_m, rx_m, image):
        if self.failure:
            raise self.failure
        super().add(samples, tx_m, rx_m, image)


def with_device(monkeypatch, seconds, **attributes):
    kind = type('Fake', (Fake,), attributes)
    fake = types.SimpleNamespace(Backprojection=kind, seconds=lambda plan: seconds)
    monkeypatch.setattr(backends, 'device_backend', lambda: fake)
    monkeypatch.setattr(device, 'device_backend', lambda: fake)


def test_the_processor_where_there_is_no_device(monkeypatch, tmp_path, forget):
    monkeypatch.setattr(device, '_NODES', (tmp_path / 'nvidiactl',))
    assert backend('auto') is backend('cpu')


def test_nothing_of_cuda_is_imported_without_a_device():
    program = """
import sys
import numpy as np
from sar_imaging.backends import device
device._NODES = ()
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal import PulseBlock, RadarParameters
tx = np.zeros((4, 1, 3)); tx[:, 0, 1] = np.arange(4)
radar = RadarParameters(10e9, 300e6, 400e6, 6.2e-6)
block = PulseBlock(radar, True, np.arange(4), np.arange(4), np.ones((4, 1, 400), complex), tx, tx)
image = plan_image(MapGrid((1000.0, 0.0, 0.0), 8, 8, 0.25), radar, 400, backend='auto')(block)
assert np.abs(image.samples).min() > 0
print(*(n for n in sys.modules if 'cupy' in n or 'cuda' in n.lower()))
"""
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True,
                         check=True)
    before = subprocess.run([sys.executable, '-c', 'import sys, numba\nprint(*(n for n in '
                             'sys.modules if "cupy" in n or "cuda" in n.lower()))'],
                            capture_output=True, text=True, check=True)
    # what Numba loads by itself, and nothing else
    assert set(run.stdout.split()) <= set(before.stdout.split())
    assert not [n for n in run.stdout.split() if n.startswith(('sar_imaging', 'cupy'))]


def test_a_device_that_is_asked_for_must_be_there(monkeypatch):
    monkeypatch.setitem(sys.modules, 'cupy', None)  # cannot be imported
    for name in [n for n in sys.modules if n.startswith('sar_imaging.backends.cuda')]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(DeviceError, match=r"^backend='cuda' needs CuPy and numba-cuda: pip .*"):
        backend('cuda')


def test_a_driver_without_a_device_is_one_line(monkeypatch, tmp_path, caplog, forget):
    node = tmp_path / 'nvidiactl'
    node.touch()
    monkeypatch.setattr(device, '_NODES', (node,))
    monkeypatch.setattr(device.importlib.util, 'find_spec', lambda name: name)

    def fail():
        raise DeviceError('the CUDA device cannot be used (no driver)')

    monkeypatch.setattr(device, 'require_device', fail)
    with caplog.at_level(logging.WARNING):
        assert backend('auto') is backend('auto') is backend('cpu')
    assert caplog.messages == ['the CUDA device cannot be used (no driver); the processor '
                               'computes']


@pytest.mark.parametrize(('share', 'name'), [(0.01, 'cuda'), (1e3, 'cpu')])
def test_the_quicker_one_computes(monkeypatch, planned, share, name):
    scene, plan = planned
    with_device(monkeypatch, plan.seconds * share)
    assert backend('auto') is automatic
    chosen = backend('auto').Backprojection(plan)
    assert chosen.name == name and chosen.memory is None
    image, wanted = np.zeros((2, *scene.grid.shape), np.complex64)
    chosen.add(*scene.echoes, image)
    Backprojection(plan).add(*scene.echoes, wanted)
    np.testing.assert_array_equal(image, wanted)


def test_the_processor_goes_on_where_the_device_fails(monkeypatch, planned, caplog):
    scene, plan = planned
    with_device(monkeypatch, 0.0, failure=DeviceError('the CUDA device failed: gone'))
    image, wanted = np.zeros((2, *scene.grid.shape), np.complex64)
    chosen = backend('auto').Backprojection(plan)
    with caplog.at_level(logging.WARNING):
        chosen.add(*scene.echoes, image)
        chosen.add(*scene.echoes, image)
    assert caplog.messages == ['the CUDA device failed: gone; the processor computes']
    for _ in range(2):
        Backprojection(plan).add(*scene.echoes, wanted)
    np.testing.assert_array_equal(image, wanted)
    assert chosen.name == 'cpu' and chosen.memory is not None


def test_the_log_says_why(monkeypatch, planned, caplog):
    _, plan = planned
    with_device(monkeypatch, 0.0)
    with caplog.at_level(logging.INFO):
        backend('auto').Backprojection(plan)
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith('the image takes 0 s on the CUDA device, transfers ')
    assert caplog.messages[0].endswith(' s on the processor: the device computes it')


@pytest.mark.parametrize(('error', 'level'), [
    (DeviceError('an image needs 9 MB'), 'WARNING'), (ValueError('no beams yet'), 'INFO')])
def test_what_the_device_refuses_the_processor_does(monkeypatch, planned, caplog, error, level):
    _, plan = planned

    def refuse(*_):
        raise error

    with_device(monkeypatch, 0.0, __init__=refuse)
    with caplog.at_level(logging.INFO):
        assert backend('auto').Backprojection(plan).name == 'cpu'
    assert [(r.levelname, r.message) for r in caplog.records[1:]] == [
        (level, f'{error}; the processor computes')]


def test_other_entries_are_the_processors(monkeypatch):
    with_device(monkeypatch, 0.0)
    assert backend('auto').correlate_profiles is backend('cpu').correlate_profiles


@pytest.mark.parametrize(('seconds', 'messages'), [
    (0.0, ['the CUDA device failed: gone; the processor computes']), (1e3, [])])
def test_afbp_goes_on_where_the_device_fails(monkeypatch, make_scene, caplog, seconds, messages):
    scene = make_scene(1000.0, n=16, pulses=16)
    block, cpu = scene.block, backend('cpu')

    class Failing(cpu.SubapertureImager):
        def image(self, number, *arguments):
            if number == 1:
                raise DeviceError('the CUDA device failed: gone')
            return super().image(number, *arguments)

    fake = types.SimpleNamespace(SubapertureImager=Failing, SpectrumFusion=cpu.SpectrumFusion,
                                 form_map=cpu.form_map, seconds=lambda plan: seconds)
    monkeypatch.setattr(backends, 'device_backend', lambda: fake)
    monkeypatch.setattr(device, 'device_backend', lambda: fake)
    options = {'method': 'afbp', 'target_db': -50.0, 'pulses_per_subaperture': 8}
    with caplog.at_level(logging.WARNING):
        image, wanted = (plan_image(scene.grid, block.radar, block.n_samples, backend=name,
                                    **options)(block) for name in ('auto', 'cpu'))
    assert [text for text in caplog.messages if 'device' in text] == messages
    np.testing.assert_array_equal(image.samples, wanted.samples)


@pytest.mark.parametrize('failing', [None, 'image', 'add', 'polar_image', 'form_map'])
@pytest.mark.parametrize('keep', [False, True])
def test_live_afbp_goes_on_where_the_device_fails(monkeypatch, make_scene, caplog, failing, keep):
    """Wherever it fails, nothing of the aperture is lost."""
    scene, cpu = make_scene(1000.0, n=16, pulses=16), backend('cpu')
    block, grid = scene.block, scene.grid
    plan = plan_afbp(grid, block.radar, block.n_samples, block.tx_m, block.rx_m, target_db=-50.0,
                     pulses_per_subaperture=8).subapertures

    def fails(entry, work, after=0):
        calls = iter(range(100))

        def call(*arguments, **options):
            if entry == failing and next(calls) >= after:
                raise DeviceError('the CUDA device failed: gone')
            return work(*arguments, **options)

        return call

    class Imager(cpu.SubapertureImager):
        image = fails('image', cpu.SubapertureImager.image, after=1)

    class Fusion(cpu.SpectrumFusion):
        add = fails('add', cpu.SpectrumFusion.add, after=1)
        polar_image = fails('polar_image', cpu.SpectrumFusion.polar_image)

    free = types.SimpleNamespace(seconds=lambda counts: 0.0)
    fake = types.SimpleNamespace(SubapertureImager=Imager, SpectrumFusion=Fusion,
                                 form_map=fails('form_map', cpu.form_map),
                                 device_costs=lambda: free)
    monkeypatch.setattr(backends, 'device_backend', lambda: fake)
    monkeypatch.setattr(device, 'device_backend', lambda: fake)
    images = []
    for made in (backend('auto'), cpu):
        imager = made.SubapertureImager(plan)
        fusion = made.SpectrumFusion(plan.fusion_grid, keep=keep)
        for number, some in enumerate(plan.sampling.pulses):
            fusion.add(number, imager.image(number, block.select(some)),
                       plan.sampling.centre[number])
        if keep:
            fusion.remove(0)
        assert fusion.included == ({1} if keep else {0, 1})
        images.append(made.form_map(fusion.polar_image(), plan.fusion_grid, grid))
        fusion.clear()
        assert not fusion.included
    np.testing.assert_array_equal(*images)
    assert [text for text in caplog.messages if 'gone' in text] == (
        ['the CUDA device failed: gone; the processor computes'] if failing else [])


@pytest.mark.parametrize(('seconds', 'failing'), [(0.0, None), (0.0, 'made'), (0.0, 'image'),
                                                  (1e9, None)])
def test_a_search_goes_on_where_the_device_fails(monkeypatch, make_scene, caplog, seconds,
                                                 failing):
    scene, cpu, calls = make_scene(1000.0, n=16, pulses=8), backend('cpu'), []
    block = scene.block

    class Trials(cpu.TrialImages):
        def __init__(self, *arguments):
            calls.append('made')
            if failing == 'made':
                raise DeviceError('the CUDA device failed: gone')
            super().__init__(*arguments)

        def image(self, *arguments):
            calls.append('image')
            if failing == 'image':
                raise DeviceError('the CUDA device failed: gone')
            return super().image(*arguments)

    free = types.SimpleNamespace(seconds=lambda counts: seconds)
    fake = types.SimpleNamespace(TrialImages=Trials, device_costs=lambda: free)
    monkeypatch.setattr(backends, 'device_backend', lambda: fake)
    monkeypatch.setattr(device, 'device_backend', lambda: fake)
    where = block.tx_m, block.rx_m, np.array([[998.0, 0.0, 0.0]]), np.array([0.25, 0.0, 0.0])
    made = [backends.optional_entry(name, 'TrialImages')(block.radar, block.samples)
            for name in ('auto', 'cpu')]
    for _ in range(2):
        np.testing.assert_array_equal(*(trials.image(*where) for trials in made))
    assert made[0].length == made[1].length
    assert calls == {None: ['made', 'image', 'image'] if seconds == 0.0 else [],
                     'made': ['made'], 'image': ['made', 'image']}[failing]
    assert [text for text in caplog.messages if 'gone' in text] == (
        ['the CUDA device failed: gone; the processor computes'] if failing else [])
