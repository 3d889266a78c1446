# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of all tests; recordings of bags/ with exact images; profiles of random scatterers."""

import dataclasses
import gc
import os
import signal
from pathlib import Path

# Read where NumPy is loaded. Threads of BLAS turn in a loop while they wait for the next product,
# and products here are small: files of the doctor and of groups took twice the processor time.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
import pytest
import scipy.fft
from hypothesis import settings

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.earth import Datum
from sar_imaging.imaging.correlation import correlate
from sar_imaging.recordings import bag_io, open_pulses
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.signal.waveforms import lfm_spectrum, n_pulse_samples

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent

# The first call of a test may compile a kernel or import half of rclpy: tests are not timed.
settings.register_profile('untimed', deadline=None)
settings.load_profile('untimed')

# A shell starts background jobs with SIGINT ignored, which children inherit; the tests of Ctrl-C
# need what a terminal gives.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Threads of OpenMP that wait for each other would keep processors busy which other processes need:
# twice the processor time for files of small images. Read where Numba starts its first threads.
os.environ.setdefault('OMP_WAIT_POLICY', 'passive')

# Of what is collected nothing becomes garbage: Python need not look through it, now or later.
gc.disable()

# The files that compile the largest kernels, and between them some that need none: of processes
# that begin side by side with files that need the same kernels one compiles and the others wait.
# Then those of a minute or so: one that begins last would be waited for alone.
FIRST = ('backends/test_lit_kernels.py', 'backends/test_beams.py', 'archive/test_processes.py',
         'backends/test_correlation.py', 'backends/test_project_lines.py',
         'archive/test_runner.py', 'archive/test_cluster.py', 'diagnosis/test_doctor_rules.py',
         'docs/test_site.py', 'backends/test_processors.py', 'archive/test_command.py',
         'tools/evaluation/test_evaluate.py', 'tools/evaluation/test_evaluate_nodes.py')


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session):
    """Let each process of xdist begin with another part of the files.

    Pytest rewrites their asserts, for half of the time of a collection, and keeps what it wrote:
    side by side each would rewrite all of them.
    """
    config, number = session.config, os.environ.get('PYTEST_XDIST_WORKER', 'gw0')
    if config.args_source is pytest.Config.ArgsSource.TESTPATHS:
        parts = sorted({TESTS / path.relative_to(TESTS).parts[0]
                        for path in TESTS.rglob('test_*.py')})
        files = np.cumsum([len(list(part.rglob('test_*.py'))) for part in parts])
        share = int(number[2:]) / int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
        first = int(np.searchsorted(files, share * files[-1]))
        config.args = list(map(str, parts[first:] + parts[:first]))


def pytest_collection_modifyitems(items):
    places = {TESTS / name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: (places.get(item.path, len(FIRST)), item.path))


def pytest_collection_finish():
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)  # a tenth of the time of tests that compile was spent on it
    gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes():
    gc.enable()  # this process collects nothing


def chirp_band_spectrum(raw):
    """Frequencies and spectra of raw LFM pulses divided by the pulse's own spectrum.

    From the whole record, since the edges of cut range profiles leak over the band: correlating
    those instead differs by -67 dB in the noise of the spotlight recording.
    """
    radar = raw.radar
    n = scipy.fft.next_fast_len(raw.n_samples + n_pulse_samples(radar))
    baseband = scipy.fft.fftfreq(n, 1.0 / radar.sample_rate_hz)
    inside = np.flatnonzero(np.abs(baseband) <= radar.bandwidth_hz / 2)
    inside = inside[np.argsort(baseband[inside])]
    baseband = baseband[inside]
    spectra = scipy.fft.fft(raw.samples.astype(np.complex128), n, axis=-1)[..., inside]
    spectra /= lfm_spectrum(baseband, radar) * radar.sample_rate_hz * len(baseband)
    spectra *= np.exp(-2j * np.pi * baseband * radar.first_sample_delay_s)
    return radar.carrier_hz + baseband, spectra


class Recording:
    """A recording of bags/ with its truth and the exact image of any of its pulses."""

    def __init__(self, name):
        path = ROOT / 'bags' / name
        self.truth = bag_io.read_truth(path)
        self.raw = [cdr for _, cdr in bag_io.raw_messages(path)]
        self.pulses = concatenate(list(bag_io.read_blocks(path)))

    def blocks(self, n_pulses):
        """The recorded pulses in blocks of this length."""
        return [self.pulses.select(slice(i, i + n_pulses))
                for i in range(0, self.pulses.n_pulses, n_pulses)]

    def later(self, blocks, apertures):
        """Blocks as if they were sent some apertures later, a second each."""
        shift = np.uint32(apertures * self.truth['pulses_per_aperture'])
        return [dataclasses.replace(b, counter=b.counter + shift,
                                    stamp_ns=b.stamp_ns + apertures * 10**9) for b in blocks]

    def correlation(self, counters, points):
        """(n,) complex128 exact image of recorded pulses at points (n, 3), in float64."""
        pulses = self.pulses.select(np.isin(self.pulses.counter, counters))
        spectrum = band_spectrum if pulses.compressed else chirp_band_spectrum
        return correlate(*spectrum(pulses), pulses.tx_m, pulses.rx_m, points)

    def error_db(self, image, grid, counters):
        """Error of an image against the exact one of `counters`, over a subset of pixels.

        Half of the pixels are the brightest ones, the others are spread over the image.
        """
        flat = image.ravel()
        chosen = np.union1d(np.argsort(np.abs(flat))[-100:],
                            np.random.default_rng(7).integers(0, flat.size, 100))
        exact = self.correlation(counters, grid.points().reshape(-1, 3)[chosen])
        return 20 * np.log10(np.linalg.norm(flat[chosen] - exact) / np.linalg.norm(exact))


@pytest.fixture(scope='session', autouse=True)
def kept_bytecode():
    """Node processes keep bytecode beside the compiled kernels, even if the shell wants none.

    Hundreds are started, and each would compile the package again.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv('PYTHONDONTWRITEBYTECODE', raising=False)
        yield


@pytest.fixture(scope='session', autouse=True)
def small_segments(tmp_path_factory):
    """Processes of DDS make segments of shared memory of 16 MiB, which hold the largest messages.

    They write all of a segment when they start: the 64 MiB of the package's profile took half of
    the time of the system in a fork. `shipped_profile` is for what needs these.
    """
    profile = (ROOT / 'sar_imaging' / 'config' / 'fastdds_large_segment.xml').read_text()
    size = f'<segment_size>{2**26}<'
    assert size in profile
    path = tmp_path_factory.mktemp('dds') / 'profile.xml'
    path.write_text(profile.replace(size, f'<segment_size>{2**24}<'))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', str(path))
        yield


@pytest.fixture
def shipped_profile(monkeypatch):
    """Processes that are started with this environment have the profile that users have."""
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE')


@pytest.fixture(scope='session')
def fork_server(tmp_path_factory):
    """Starts nodes and `evaluate` from a process that has loaded their libraries."""
    pytest.importorskip('rclpy', reason='rclpy comes as wheels for Linux on x86-64 only')
    from .fork_server import running

    with running(tmp_path_factory.mktemp('forks')) as forks:
        yield forks


@pytest.fixture(scope='module')
def forked_nodes(fork_server):
    """The nodes of `NodeProcesses` are started so."""
    with pytest.MonkeyPatch.context() as patch:
        fork_server.take_over(patch.setattr)
        yield


@pytest.fixture(scope='session', params=['psf', 'spotlight'])
def any_recording(request):
    return Recording(request.param)


@pytest.fixture(scope='session')
def spotlight():
    return Recording('spotlight')


@pytest.fixture(scope='session')
def psf():
    return Recording('psf')


@pytest.fixture(scope='session')
def make_block():
    """Blocks of range profiles: pulses 10 ms apart on a track along y at 100 m/s."""
    radar = RadarParameters(carrier_hz=10e9, bandwidth_hz=1e8, sample_rate_hz=2e8,
                            first_sample_delay_s=1e-6)

    def make(first, n, *, n_samples=3, positions=True):
        counter = np.arange(first, first + n)
        track = np.stack([np.zeros(n), counter * 1.0, np.full(n, 500.0)], axis=-1)[:, None]
        return PulseBlock(radar, True, 1_700_000_000_000_000_000 + counter * 10_000_000, counter,
                          np.ones((n, 1, n_samples), np.complex64),
                          track if positions else None, track if positions else None)

    return make


@pytest.fixture(scope='session')
def spotlight_bag():
    """Folder of a recording of ten scatterers, two apertures."""
    return ROOT / 'bags' / 'spotlight'


@pytest.fixture(scope='session')
def spotlight_cphd(spotlight_bag, tmp_path_factory):
    """Its second aperture as CPHD, at 47.3 degrees north."""
    pytest.importorskip('sarkit', reason='the extra formats is not installed')
    from sar_imaging.formats.cphd import write_cphd

    source = open_pulses(spotlight_bag)
    path = tmp_path_factory.mktemp('cphd') / 'spotlight.cphd'
    write_cphd(path, source.blocks(1e7), Datum(47.3, 8.5, 430.0, 20.0), source.grid)
    return path


@dataclasses.dataclass(frozen=True)
class Case:
    """A grid, the profiles of scatterers on it, and the scatterers."""

    grid: MapGrid
    block: PulseBlock
    points: np.ndarray


def make_case(range_m, *, channels=1, height_m=0.0, heading_rad=0.0, n=96, spacing_m=0.25,
              pulses=48, aperture_m=None, n_points=12, seed=1, bend_m=0.0, track_m=None,
              extent=0.95, carrier_hz=10e9):
    """Profiles (10 GHz unless told, 300 MHz, sampled at 400 MHz) of random scatterers.

    The radar flies along y and looks along +x, all turned by `heading_rad`; receivers stand half
    a wavelength apart; `bend_m` bows the track outwards in the middle, `track_m` (pulses, 3)
    replaces it. Scatterers fill `extent` times the grid in both directions.
    """
    rng = np.random.default_rng(seed)
    carrier, bandwidth, rate = carrier_hz, 300e6, 400e6
    aperture = range_m * 0.03 if aperture_m is None else aperture_m
    u = np.linspace(-0.5, 0.5, pulses)
    tx = np.zeros((pulses, channels, 3))
    tx[..., 0] = (bend_m * (4 * u ** 2 - 1))[:, None]
    tx[..., 1] = (aperture * u)[:, None]
    tx[..., 2] = height_m
    if track_m is not None:
        tx[:] = track_m[:, None]
    rx = tx.copy()
    rx[..., 1] += (np.arange(channels) - channels // 2) * SPEED_OF_LIGHT / carrier / 2
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    tx, rx = tx @ turn, rx @ turn
    ground = np.sqrt(range_m ** 2 - height_m ** 2)
    grid = MapGrid((ground * cos, ground * sin, 0.0), n, n, spacing_m)
    points = np.array(grid.centre_m) + np.c_[
        (rng.random((n_points, 2)) - 0.5) * extent * n * spacing_m, np.zeros(n_points)]

    def distance(a):
        return np.linalg.norm(a[:, :, None] - points, axis=-1)

    tau = (distance(tx) + distance(rx)) / SPEED_OF_LIGHT
    spacing = SPEED_OF_LIGHT / 2 / rate
    n_samples = 2 * int(0.75 * n * spacing_m / spacing) + 64
    start = 2 * (range_m - n_samples / 2 * spacing) / SPEED_OF_LIGHT
    step_hz = rate / n_samples
    spectrum = np.zeros((pulses, channels, n_samples), complex)
    highest = int(bandwidth / 2 / step_hz)

    def turns(cycles):
        return np.exp(-2j * np.pi * np.mod(cycles, 1.0))

    # Phases grow evenly with frequency: hundreds of products, whose rounding errors stay below
    # -250 dB, take a tenth of the time of as many exponentials.
    echo = turns(carrier * tau - highest * step_hz * (tau - start))
    onwards = turns(step_hz * (tau - start))
    for k in range(-highest, highest + 1):
        spectrum[..., k] = echo.sum(axis=-1)
        echo *= onwards
    samples = np.fft.ifft(spectrum, axis=-1, norm='forward')
    radar = RadarParameters(carrier, bandwidth, rate, start)
    return Case(grid, PulseBlock(radar, True, np.arange(pulses), np.arange(pulses), samples,
                                 tx, rx), points)


@pytest.fixture(name='make_case', scope='session')
def make_case_fixture():
    return make_case
