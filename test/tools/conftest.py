import numpy as np
import pytest

from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

RADAR = RadarParameters(carrier_hz=10e9, bandwidth_hz=1e8, sample_rate_hz=2e8,
                        first_sample_delay_s=1e-6)
START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope='session')
def make_block():
    """Blocks of range profiles: pulses 10 ms apart on a track along y at 100 m/s."""
    def make(first, n, *, n_samples=3, positions=True):
        counter = np.arange(first, first + n)
        track = np.stack([np.zeros(n), counter * 1.0, np.full(n, 500.0)], axis=-1)[:, None]
        return PulseBlock(RADAR, True, START_NS + counter * 10_000_000, counter,
                          np.ones((n, 1, n_samples), np.complex64),
                          track if positions else None, track if positions else None)

    return make
