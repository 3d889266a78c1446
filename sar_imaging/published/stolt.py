"""Stolt interpolation, inverse transform, and pixels read from the slant-plane image.

The change of variables of Rosenberg & Gray, equations 10 and 11, for spectra whose k_y are
uniform and whose k_x are not.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.fft

from ..compilation import njit, numba
from ..geometry import MapGrid
from ..geometry.straight_track import StraightTrack

_TAPS = 6  # of the kernel that reads the image between the samples of the FFT
_SHAPE = 2.3 * _TAPS
_NODES, _BY_NODE = np.polynomial.legendre.leggauss(64)  # of the integral over the kernel


@dataclasses.dataclass(frozen=True)
class SlantImage:
    """Image over position along the track and distance from it, one period, at baseband.

    Parameters
    ----------
    samples : (M_y, M_x) complex64
        Convolved such that the kernel of `read` restores the image; the centre stands at index
        (0, 0), what lies before it at the end.
    spacing_m : (2,) floats
        Of the samples, along the track and across, metres.
    centre_m : (2,) floats
        Position along the track and distance from it at index (0, 0), metres.
    carrier : (2,) floats
        k_y and k_x of zero frequency, radians per metre.
    """

    samples: np.ndarray
    spacing_m: tuple[float, float]
    centre_m: tuple[float, float]
    carrier: tuple[float, float]

    @classmethod
    def from_spectrum(cls, spectrum, first, steps, centre_m) -> SlantImage:
        """Image ``sum_yx F_yx exp(j k_y (y - Y_c) + j k_x (x - X_c))``.

        Parameters
        ----------
        spectrum : (I, J) complex64
            F at ``k_y = first[0] + i steps[0]``, ``k_x = first[1] + j steps[1]``.
        first, steps : (2,) floats
            Radians per metre.
        centre_m : (2,) floats
            ``(Y_c, X_c)``, metres.
        """
        shape = [scipy.fft.next_fast_len(2 * n) for n in spectrum.shape]
        padded = np.zeros(shape, np.complex64)
        gains = [1 / _kernel_response((np.arange(n) - n // 2) / m)
                 for n, m in zip(spectrum.shape, shape, strict=True)]
        padded[:spectrum.shape[0], :spectrum.shape[1]] = spectrum * (
            gains[0][:, None] * gains[1]).astype(np.float32)
        padded = np.roll(padded, [-(n // 2) for n in spectrum.shape], axis=(0, 1))
        samples = scipy.fft.ifft2(padded, norm='forward', overwrite_x=True,
                                  workers=numba.get_num_threads())
        carrier = tuple(float(f + s * (n // 2))
                        for f, s, n in zip(first, steps, spectrum.shape, strict=True))
        spacing = tuple(2 * np.pi / (s * m) for s, m in zip(steps, shape, strict=True))
        return cls(samples, spacing, tuple(centre_m), carrier)

    def read(self, grid: MapGrid, track: StraightTrack, scale: complex) -> np.ndarray:
        """Pixels of a map grid, each at its own distance and position.

        Parameters
        ----------
        grid : MapGrid
            Where the pixels are.
        track : StraightTrack
            Whose coordinates the image has.
        scale : complex
            Factor; pixels are also multiplied by the square root of their distance in metres.

        Returns
        -------
        (n_y, n_x) complex64
        """
        out = np.empty(grid.shape, np.complex64)
        _read_pixels(self.samples, self.spacing_m, self.centre_m, self.carrier, complex(scale),
                     track.origin_m, track.direction, grid.x_m, grid.y_m, grid.z_m, out)
        return out


def _kernel_response(frequency) -> np.ndarray:
    """Fourier transform of the kernel of `SlantImage.read` at cycles per sample."""
    kernel = _BY_NODE * _TAPS / 2 * np.exp(_SHAPE * (np.sqrt(1 - _NODES ** 2) - 1))
    return np.cos(np.pi * _TAPS * np.multiply.outer(frequency, _NODES)) @ kernel


@njit(parallel=True)
def spread(values, position, taps, out):
    """Stolt interpolation: spread each value over `taps` uniform k_x by a windowed sinc.

    Parameters
    ----------
    values : (R, K) complex128
        Values at measured wavenumbers.
    position : (R, K) float64
        Their k_x in samples of `out`.
    taps : int
        Length of the Hamming window, even.
    out : (R, J) complex64
        Changed in place.
    """
    cos_step, sin_step = np.cos(2 * np.pi / taps), np.sin(2 * np.pi / taps)
    for row in numba.prange(values.shape[0]):
        for i in range(values.shape[1]):
            value = values[row, i]
            if value == 0:
                continue
            first = int(np.floor(position[row, i])) - taps // 2 + 1
            t = position[row, i] - first
            sine = np.sin(np.pi * t) / np.pi
            c, s = np.cos(2 * np.pi * t / taps), np.sin(2 * np.pi * t / taps)
            for j in range(taps):
                sinc = sine / t if abs(t) > 1e-9 else 1.0
                out[row, first + j] += np.complex64(value * (sinc * (0.54 + 0.46 * c)))
                t -= 1.0
                sine = -sine
                c, s = c * cos_step + s * sin_step, s * cos_step - c * sin_step


@njit(parallel=True)
def _read_pixels(samples, spacing, centre, carrier, scale, origin, direction, x, y, z, out):
    """Read a `SlantImage` at the slant-plane coordinates of every pixel of a map grid.

    The kernel ``exp(b (sqrt(1 - (2 d / taps)^2) - 1))`` of non-uniform Fourier transforms leaves
    an error of about 1e-5.
    """
    taps, shape = _TAPS, _SHAPE
    n_rows, n_columns = samples.shape
    for i in numba.prange(len(y)):
        weight = np.empty(taps)
        column = np.empty(taps, np.int64)
        for j in range(len(x)):
            dx, dy, dz = x[j] - origin[0], y[i] - origin[1], z - origin[2]
            along = dx * direction[0] + dy * direction[1] + dz * direction[2]
            dx -= along * direction[0]
            dy -= along * direction[1]
            dz -= along * direction[2]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            u, v = along - centre[0], distance - centre[1]
            first = np.floor(v / spacing[1]) - (taps // 2 - 1)
            for b in range(taps):
                d = (v / spacing[1] - first - b) * (2 / taps)
                weight[b] = np.exp(shape * (np.sqrt(max(1 - d * d, 0.0)) - 1))
                column[b] = int(first + b) % n_columns
            first = np.floor(u / spacing[0]) - (taps // 2 - 1)
            total = 0j
            for a in range(taps):
                d = (u / spacing[0] - first - a) * (2 / taps)
                row = int(first + a) % n_rows
                line = 0j
                for b in range(taps):
                    line += weight[b] * samples[row, column[b]]
                total += line * np.exp(shape * (np.sqrt(max(1 - d * d, 0.0)) - 1))
            phase = carrier[0] * u + carrier[1] * v
            out[i, j] = (scale * np.sqrt(distance)) * total * complex(np.cos(phase), np.sin(phase))
