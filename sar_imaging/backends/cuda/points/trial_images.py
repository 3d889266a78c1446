"""Quick images of few pixels on the device, for the many trial geometries of a search."""

from __future__ import annotations

import math

import numpy as np

from ....signal.radar import RadarParameters
from ..arrays import (
    complex_samples,
    cuda,
    given,
    kernel,
    launch,
    load_pair,
    pairs,
    reports_failures,
    require_device,
    xp,
)
from ..phasors import fraction, phasor
from ..transfers import to_host

LENGTH = 16  # pixels of a piece of a line
_LANES = 8  # of echoes: those of a lane are added by one thread of each pixel
_THREADS = LENGTH * _LANES


class TrialImages:
    """See `backends.protocol.TrialImages`; profiles go to the device once, images come back.

    Paths are exact and profiles linear between samples.

    Raises
    ------
    DeviceError
        There is no device, it fails, or it lacks memory.
    """

    length = LENGTH

    @reports_failures
    def __init__(self, radar: RadarParameters, samples):
        require_device()
        self._radar, self._n_samples = radar, samples.shape[-1]
        self._profiles = complex_samples(samples)

    @reports_failures
    def image(self, tx_m: np.ndarray, rx_m: np.ndarray, starts_m: np.ndarray,
              step_m: np.ndarray, range_bias_m: float = 0.0) -> np.ndarray:
        """See `backends.protocol.TrialImages.image`."""
        radar = self._radar
        centres = np.concatenate([np.reshape(c, (-1, 3)) for c in (tx_m, rx_m)], axis=1)
        profile = np.array([radar.range_start_m - range_bias_m, radar.sample_spacing_m,
                            2 / radar.wavelength_m])
        image = xp.empty((2, len(starts_m), LENGTH), np.float32)
        launch(add_pieces, len(starts_m), _THREADS, pairs(self._profiles), self._n_samples,
               *(xp.asarray(np.ascontiguousarray(v, np.float64)) for v in (
                   centres, starts_m, step_m, profile)), image)
        return to_host(given(image))


@kernel()
def add_pieces(profiles, n_samples, centres, starts, step, profile, image):
    """Backproject profiles onto pieces of lines; a grid of pieces.

    Parameters
    ----------
    profiles, n_samples : pairs, int
        Profiles echo by echo, so many samples each; zero beyond their ends.
    centres : (R, 6) float64
        Transmitter and receiver of each echo, metres.
    starts, step : (K, 3), (3,) float64
        First pixel of each piece, and from pixel to pixel, metres.
    profile : (3,) float64
        Half path of sample 0, and from sample to sample, metres; cycles of the carrier per metre.
    image : (2, K, LENGTH) float32
        Real and imaginary part.
    """
    real_sums = cuda.shared.array(_THREADS, np.float32)
    imag_sums = cuda.shared.array(_THREADS, np.float32)
    thread, piece = cuda.threadIdx.x, cuda.blockIdx.x
    pixel, lane = thread % LENGTH, thread // LENGTH
    x = starts[piece, 0] + pixel * step[0]
    y = starts[piece, 1] + pixel * step[1]
    z = starts[piece, 2] + pixel * step[2]
    real, imag = np.float32(0.0), np.float32(0.0)
    for echo in range(lane, centres.shape[0], _LANES):
        path = 0.5 * (
            math.sqrt((x - centres[echo, 0]) ** 2 + (y - centres[echo, 1]) ** 2
                      + (z - centres[echo, 2]) ** 2)
            + math.sqrt((x - centres[echo, 3]) ** 2 + (y - centres[echo, 4]) ** 2
                        + (z - centres[echo, 5]) ** 2))
        place = min(max((path - profile[0]) / profile[1], -2.0), n_samples + 1.0)
        cell = math.floor(place)
        t, first = np.float32(place - cell), int(cell)
        re, im = np.float32(0.0), np.float32(0.0)
        if 0 <= first < n_samples:
            a, b = load_pair(profiles, np.uint64(echo * n_samples + first))
            re += (np.float32(1.0) - t) * a
            im += (np.float32(1.0) - t) * b
        if -1 <= first < n_samples - 1:
            a, b = load_pair(profiles, np.uint64(echo * n_samples + first + 1))
            re += t * a
            im += t * b
        cosine, sine = phasor(np.float32(fraction(path * profile[2])))
        real += re * cosine - im * sine
        imag += re * sine + im * cosine
    real_sums[thread], imag_sums[thread] = real, imag
    cuda.syncthreads()
    if lane == 0:
        for k in range(1, _LANES):
            real += real_sums[pixel + k * LENGTH]
            imag += imag_sums[pixel + k * LENGTH]
        image[0, piece, pixel] = real
        image[1, piece, pixel] = imag
