"""Settings of all tests; the recordings of bags/ with their exact images."""

import dataclasses
import signal
from pathlib import Path

import numpy as np
import pytest
import scipy.fft
from hypothesis import settings

from sar_imaging.imaging.correlation import correlate
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.signal.waveforms import lfm_spectrum, n_pulse_samples
from sar_imaging.tools import bag_io

ROOT = Path(__file__).resolve().parents[1]

# The first call of a test may compile a kernel or import half of rclpy: tests are not timed.
settings.register_profile('untimed', deadline=None)
settings.load_profile('untimed')

# A shell starts background jobs with SIGINT ignored, which children inherit; the tests of Ctrl-C
# need what a terminal gives.
signal.signal(signal.SIGINT, signal.default_int_handler)


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


@pytest.fixture(scope='session', params=['psf', 'spotlight'])
def any_recording(request):
    return Recording(request.param)


@pytest.fixture(scope='session')
def spotlight():
    return Recording('spotlight')


@pytest.fixture(scope='session')
def psf():
    return Recording('psf')
