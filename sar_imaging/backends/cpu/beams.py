# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""First stage of AFBP: images of sub-apertures on their coarse polar grid, from beams or directly.

Direct backprojection reads each pulse for every line; beams are few sums over the pulses.

Seen from its own middle the echoes of a short sub-aperture differ by little more than a delay that
depends on direction alone: a beam is their sum with the delays of one direction, taken exactly,
bin by bin of the spectrum. A few beams, no more than the sub-aperture can resolve, hold the image;
the lines of the unified polar grid, whose coordinates bend away from the sub-aperture's own, are
interpolated from them.

Beam m of echo i has the phase ``2 pi c L_mi`` at c cycles per metre. Beams lie in groups. Of a
group's beams, counted in pairs from the outermost inwards, one is as far on one side of the
group's middle as the other on the other side. With the mean M of a group's paths and half the
difference B of a pair's,

``exp(j 2 pi c L) = exp(j 2 pi c M) exp(+-j 2 pi c B)``,

exact where paths are straight over the group: a pair shares the second phasor, one of them its
conjugate. Echoes on opposite sides of the sub-aperture's middle have nearly opposite B and may
share it likewise. What that neglects is `shared_errors` of the plan.

Sums of beams and of their pixels are written as instructions: left to its vectoriser, LLVM keeps
too few of them in registers. Their arrays are flat float32, places in them uint64.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from ...compilation import DETERMINISTIC, kernel_part, njit, numba
from ...geometry.polar import PolarGrid
from ...planning.afbp.beams import (
    BEAM_TAPS,
    CELL_TAPS,
    DEGREE,
    STEP_BINS,
    BeamGain,
    BeamGeometry,
    bins_per_run,
    grid_edges,
)
from ...planning.afbp.illumination import NODES_APART, AmplitudeNodes
from ...planning.afbp.subapertures import SubaperturePlan
from ...signal.pulses import PulseBlock
from .fft import transform_rows
from .illumination import Antennas, two_way_amplitudes
from .instructions import (
    FLOAT,
    INT,
    LINE_BYTES,
    Vector,
    float_lanes,
    instructions,
    job_counter,
    order,
    take_job,
)
from .lines import PolarLines, segment_middles
from .memory import WorkSpace, aligned_empty
from .phasors import cos_cycles, fraction, sin_cycles
from .profiles import Profiles, spectra

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ...planning.interpolators import Interpolator

LANES = STEP_BINS  # float32 that lie together
ECHOES = 4  # phasors multiplied at once
STORED = 16  # taps of a table of weights
TILE = 2 * LANES  # cells or pixels that are summed in whole multiples of

_WIDTH = float_lanes()  # float32 of a vector
_VECTOR = ir.VectorType(FLOAT, _WIDTH)
_VECTORS = range(0, 2 * _WIDTH, _WIDTH)  # whose sums stay in registers
_uint64 = types.uint64


@instructions(None, _uint64, _uint64, _uint64, None, _uint64, _uint64)
def sum_beams(b, beams, source, apart, size, work, weights, target):
    """Sums of the beams that begin at `source` and so much apart, for some cells in whole tiles.

    Weights of the three orders lie in `work`, which `target` is in, too: real and imaginary parts
    of the sum of each order, so many numbers apart.
    """
    with cgutils.for_range_slice(b, INT(0), size, INT(2 * _WIDTH), inc=True) as (cell, _):
        place = b.add(source, b.mul(cell, INT(2)))
        sums = [[None] * 3 for _ in range(2 * len(_VECTORS))]
        for tap in range(BEAM_TAPS):
            w = _weights(b, work, weights, tap)
            for i, orders in enumerate(sums):
                x = _load(b, beams, place, i * _WIDTH)
                orders[:] = [_plus(v, x * w[n]) for n, v in enumerate(orders)]
            place = b.add(place, apart)
        for i, at in enumerate(_VECTORS):
            parts = [Vector(b, b.shuffle_vector(x.value, y.value,
                                                order(range(part, 2 * _WIDTH, 2))))
                     for x, y in zip(sums[2 * i], sums[2 * i + 1], strict=True)
                     for part in (0, 1)]
            _store(b, work, b.add(target, b.add(cell, INT(at))), size, parts)


@instructions(None, _uint64, None, None, None, _uint64, _uint64, _uint64, _uint64)
def sum_cells(b, index, size, along, across, work, weights, source, target, apart):
    """Sums of the cells from each of some pixels on, in whole tiles.

    Source and target are in `work`: what `sum_beams` left, and real and imaginary part, so much
    apart each. `along` holds the coefficients, from that of degree 1, of the drift between cells
    as a polynomial of the index; `across` first the two of the drift between beams, then, from
    degree 0, the two of that by how much of the second order the phase of the sum is moved.
    """
    _sum_cells(b, index, size, along, across, work, weights, source, target, apart)


@instructions(None, _uint64, None, None, None, _uint64, _uint64, _uint64, _uint64, None)
def sum_weighted_cells(b, index, size, along, across, work, weights, source, target, apart,
                       parabolas):
    """As `sum_cells`, of echoes whose amplitude is a parabola of their phase from beam to beam.

    `parabolas` holds, from degree 0, the two coefficients by index of A, of B and of C: the sum is
    A times the beams', less j B times their first derivative, less C times their second one.
    """
    _sum_cells(b, index, size, along, across, work, weights, source, target, apart, parabolas)


def _sum_cells(b, index, size, along, across, work, weights, source, target, apart,
               parabolas=None):
    v1, v2, v3 = (b.spread(b.extract_value(along, i), _WIDTH) for i in range(3))
    u1, u2, bend, bend1 = (b.spread(b.extract_value(across, i), _WIDTH) for i in range(4))
    if parabolas is not None:
        whole0, whole1, once0, once1, twice0, twice1 = (
            b.spread(b.extract_value(parabolas, i), _WIDTH) for i in range(6))
    with cgutils.for_range_slice(b, INT(0), size, INT(2 * _WIDTH), inc=True) as (pixel, _):
        numbers = [_load(b, index, pixel, at) for at in _VECTORS]
        drifts = [f * (v1 + f * (v2 + f * v3)) for f in numbers]
        sums = [[None] * 6 for _ in drifts]
        places = [b.add(source, pixel)]
        for _ in range(5):
            places.append(b.add(places[-1], apart))
        for tap in range(CELL_TAPS):
            w0, w1, w2 = _weights(b, work, weights, tap)
            for i, (at, t) in enumerate(zip(_VECTORS, drifts, strict=True)):
                w = w0 + t * (w1 + t * w2)
                sums[i] = [_plus(v, _load(b, work, place, at + tap) * w)
                           for v, place in zip(sums[i], places, strict=True)]
        for at, f, (re0, im0, re1, im1, re2, im2) in zip(_VECTORS, numbers, sums, strict=True):
            t, c = f * (u1 + f * u2), bend + f * bend1
            re = re0 + t * (re1 + t * re2) + -c * im2
            im = im0 + t * (im1 + t * im2) + c * re2
            if parabolas is not None:
                # of the second derivative the weights hold half
                one, two = once0 + f * once1, (twice0 + f * twice1) * -2.0
                whole, twice = whole0 + f * whole1, t + t
                re, im = (whole * re + one * (im1 + twice * im2) + two * re2,
                          whole * im + -one * (re1 + twice * re2) + two * im2)
            _store(b, work, b.add(target, b.add(pixel, INT(at))), apart, (re, im))


@instructions(None, _uint64, None, None, _uint64, _uint64, None, _uint64)
def add_echoes(b, echoes, echo, phasor_re, phasor_im, phasor, half, sums, total):
    """Add `ECHOES` echoes, times their phasors, to each couple of beams, for one vector.

    Four vectors of each echo stay in registers: what the phasor's real part counts, real and
    imaginary part, then what its imaginary part counts. Likewise the sums of each couple.
    """
    for at in range(0, LANES, _WIDTH):
        parts = [[_load(b, echoes, echo, (4 * k + n) * LANES + at) for n in range(4)]
                 for k in range(ECHOES)]
        with cgutils.for_range(b, half) as loop:
            first = b.add(phasor, b.mul(loop.index, INT(ECHOES)))
            to = b.add(total, b.mul(loop.index, INT(4 * LANES)))
            for n, factor in zip((0, 2), (phasor_re, phasor_im), strict=True):
                values = [_load(b, sums, to, (n + i) * LANES + at) for i in range(2)]
                for k in range(ECHOES):
                    w = _load_spread(b, factor, b.add(first, INT(k)))
                    values = [v + parts[k][n + i] * w for i, v in enumerate(values)]
                _store(b, sums, b.add(to, INT(n * LANES + at)), INT(LANES), values)


@instructions(None, _uint64, _uint64)
def fetch(b, data, place, size):
    """Bring some numbers into the cache."""
    with cgutils.for_range_slice(b, INT(0), size, INT(LINE_BYTES // 4), inc=True) as (i, _):
        b.fetch_line(b.gep(data, [b.add(place, i)]))


def _load(b, data, place, shift):
    return Vector(b, b.load(b.element(data, place, _VECTOR, shift), align=4))


def _store(b, data, place, apart, parts):
    for part in parts:
        b.store(part.value, b.element(data, place, _VECTOR), align=4)
        place = b.add(place, apart)


def _load_spread(b, data, place):
    return b.spread(b.load(b.gep(data, [place]), align=4), _WIDTH)


def _weights(b, data, weights, tap):
    return [_load_spread(b, data, b.add(weights, INT(n * STORED + tap))) for n in range(3)]


def _plus(total: Vector | None, product: Vector) -> Vector:
    return product if total is None else total + product


class CompiledBeamGeometry(BeamGeometry):
    """`BeamGeometry` whose paths are found several times as fast: each sub-aperture needs them."""

    def extra_path(self, tx_m: np.ndarray, rx_m: np.ndarray, direction: ArrayLike) -> np.ndarray:
        """(S, R) by how much half paths are longer than the distance from the centre, metres."""
        centres = np.concatenate([tx_m, rx_m]).reshape(2, -1, 3) - self.centre_m
        plane = np.array([*self.polar.track, *self.polar.across,
                          self.centre_m[2] - self.polar.z_m])
        return _extra_paths(centres, plane, self.range_m, np.array(direction, float))


@njit(fastmath=DETERMINISTIC, error_model='numpy')
def _extra_paths(centres_m, plane, range_m, direction):
    """`BeamGeometry.extra_path` for (2, R, 3) phase centres counted from their middle.

    `plane` holds the horizontal unit vectors along and across the track and the height of the
    middle above the plane.
    """
    n_echoes, n_directions = centres_m.shape[1], len(direction)
    height, square = plane[4], range_m * range_m
    x, y = np.empty(n_echoes), np.empty(n_echoes)
    offset, share = np.empty(n_echoes), np.empty(n_echoes)
    path = np.zeros((n_directions, n_echoes))
    for end in range(2):
        apart = False  # transmitters and receivers
        for r in range(n_echoes):
            x[r], y[r], z = centres_m[end, r, 0], centres_m[end, r, 1], centres_m[end, r, 2]
            offset[r] = x[r] * x[r] + y[r] * y[r] + z * z + 2 * z * height
            share[r] = 1.0 - end
            if (x[r] != centres_m[1 - end, r, 0] or y[r] != centres_m[1 - end, r, 1]
                    or z != centres_m[1 - end, r, 2]):
                share[r] = 0.5
                apart = True
        if end == 1 and not apart:
            break
        for s in range(n_directions):
            along = range_m * direction[s]
            across = np.sqrt(max(square - along * along - height * height, 0.0))
            px = along * plane[0] + across * plane[2]
            py = along * plane[1] + across * plane[3]
            beyond = px * px + py * py + height * height - square
            for r in range(n_echoes):
                longer = offset[r] + beyond - 2 * (x[r] * px + y[r] * py)  # squared
                path[s, r] += share[r] * longer / (np.sqrt(square + longer) + range_m)
    return path


class EchoPhasors(NamedTuple):
    """Paths and phases of echoes, Q phasors by `ECHOES`, for G groups of H pairs of beams.

    All arrays but the first are flat.

    Parameters
    ----------
    order : (Q,) or (2 * Q,) int64
        Echo of each phasor of a block, then of their conjugates if echoes share them, then those
        of the next block; -1 for none.
    middle, carrier, slope : (G * len(order),) float64
        In that order: M, what an echo's path is longer for the middle of a group than the
        reference's, metres; its phase at the carrier, cycles; what the path grows from beam to
        beam, metres.
    beside : (G * Q * H,) float64
        B, metres: groups, blocks, pairs from the outermost inwards, phasors of the block.
    middle_step, beside_step : (2 * G * len(order),) and (2 * G * Q * H,) float32
        Phasors of `middle` and `beside` over a vector of bins, real parts first.
    """

    order: np.ndarray
    middle: np.ndarray
    carrier: np.ndarray
    slope: np.ndarray
    beside: np.ndarray
    middle_step: np.ndarray
    beside_step: np.ndarray


def echo_phasors(path_m: np.ndarray, group: int, paired: bool, cycles: np.ndarray) -> EchoPhasors:
    """Phasors of echoes; arguments as of `form_beams`, and `cycles` of `SpectrumBins`."""
    upper, lower, before, after = _pairs_of_beams(len(path_m), group)
    n_groups, half = upper.shape
    echoes = _echoes_by_phasor(path_m, paired)
    path = path_m[:, echoes.reshape(-1)]
    slope = (path[after] - path[before]) / (after - before)[:, None]
    upper, lower = path[upper], path[lower]
    middle = (upper + lower).sum(axis=1) / (2 * half)
    beside = 0.5 * (upper - lower)
    if paired:
        first, second = np.split(beside, 2, axis=2)
        beside = 0.5 * (first - second)
        alone = echoes[1] < 0  # the middle of an odd number
        beside[:, :, alone] = first[:, :, alone]

    def by_block(values: np.ndarray) -> np.ndarray:
        """Both echoes of each phasor of a block, then those of the next block."""
        return values.reshape(-1, 1 + paired, echoes.shape[1] // ECHOES, ECHOES
                              ).swapaxes(1, 2).reshape(len(values), -1)

    middle = by_block(middle)
    beside = np.ascontiguousarray(beside.reshape(n_groups, half, -1, ECHOES).swapaxes(1, 2))
    return EchoPhasors(by_block(echoes.reshape(1, -1))[0], middle.reshape(-1),
                      np.fmod(cycles[0] * middle, 1.0).reshape(-1), by_block(slope).reshape(-1),
                      beside.reshape(-1), _step_phasors(cycles[1] * middle),
                      _step_phasors(cycles[1] * beside))


@functools.lru_cache(maxsize=16)
def _pairs_of_beams(n_beams: int, group: int
                    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Beams of each group's pairs, (G, H) each, and those before and after groups, (G,) each."""
    n_groups, half = -(-n_beams // group), -(-group // 2)
    first = np.arange(n_groups)[:, None] * group
    last = np.minimum(first + group, n_beams) - 1
    upper = np.minimum(first + np.arange(half), (first + last) // 2)
    return (upper, first + last - upper, np.maximum(first[:, 0] - 1, 0),
            np.minimum(last[:, 0] + 1, n_beams - 1))


def _echoes_by_phasor(path_m: np.ndarray, paired: bool) -> np.ndarray:
    """(1, Q) echoes, or (2, Q) whose paths grow most unlike from the first beam to the last.

    -1 stands for none: in the last block of `ECHOES`, and opposite the middle of an odd number.
    """
    n_echoes = path_m.shape[1]
    n_phasors = -(-n_echoes // 2) if paired else n_echoes
    echoes = np.full((1 + paired, -(-n_phasors // ECHOES) * ECHOES), -1)
    order = np.argsort(path_m[-1] - path_m[0]) if paired else np.arange(n_echoes)
    echoes[0, :n_phasors] = order[:n_phasors]
    if paired:
        echoes[1, :n_echoes // 2] = order[::-1][:n_echoes // 2]
    return echoes


def _step_phasors(cycles: np.ndarray) -> np.ndarray:
    """Phasors over a vector of bins, real parts first, flat."""
    cycles = LANES * cycles.reshape(-1)
    angle = (2 * np.pi * (cycles - np.rint(cycles))).astype(np.float32)
    return np.concatenate([np.cos(angle), np.sin(angle)])


_SAME = 1e-9  # radians by which phases differ that are taken for the same


class AmplitudeParabolas:
    """Support points of the amplitudes along the lines of a coarse grid.

    Parameters
    ----------
    polar : PolarGrid
        Polar grid of sub-aperture images.
    segment : int
        Pixels from one support point to the next.
    """

    def __init__(self, polar: PolarGrid, segment: int):
        places = np.arange(-(-polar.n_range // segment) + 1) * segment
        positions = polar.locate(places, np.arange(polar.n_alpha)[:, None])[0]
        self._shape = positions.shape[:2]
        self._positions = np.ascontiguousarray(positions.reshape(-1, 3).T)

    def parabolas(self, nodes: AmplitudeNodes, geometry: BeamGeometry,
                  rad_per_m: float) -> np.ndarray:
        """(3, n_alpha, K) float32 coefficients A, B and C of ``A + B p + C p^2``.

        p is the phase of an echo from beam to beam at the carrier, radians: `rad_per_m` times the
        derivative of its path by direction, metres.

        Parameters
        ----------
        nodes : AmplitudeNodes
            Through whose amplitudes the parabolas go.
        geometry : BeamGeometry
            Geometry of the sub-aperture.
        rad_per_m : float
            Carrier phase per metre of half path, times the spacing of the beams.
        """
        polar = geometry.polar
        plane = (*polar.track, *polar.across, geometry.centre_m[2] - polar.z_m,
                 geometry.range_m, *geometry.known, rad_per_m)
        offsets = np.stack([nodes.tx_m, nodes.rx_m]) - geometry.centre_m
        # a plain tuple: Numba takes 20 us to tell the type of a named one
        found = _parabolas(tuple(Antennas.of(nodes.illumination)), self._positions,
                           geometry.centre_m, offsets, plane)
        return found.reshape(3, *self._shape)


@njit(fastmath=DETERMINISTIC, error_model='numpy')
def _parabolas(echoes, positions, centre, offsets, plane):
    """`AmplitudeParabolas.parabolas` at positions (3, N).

    `offsets` (2, 3, 3) are those of the nodes' phase centres.

    `plane` holds the horizontal unit vectors along and across the track, the height of the middle
    above the plane, the distance at which paths are compared, metres, the extremes of the
    directions in which they bend, and `rad_per_m`. Without branches, for the compiler's vectors.
    """
    n = positions.shape[1]
    out = np.empty((3, n), np.float32)
    x, y = np.empty((3, n)), np.empty((3, n))
    for node in range(3):
        _phases(positions, centre, offsets[:, node], plane, x[node])
        two_way_amplitudes(Antennas(*echoes), node, positions, y[node])
    for i in range(n):
        x0, x1, x2 = x[0, i], x[1, i], x[2, i]
        y0, y1, y2 = y[0, i], y[1, i], y[2, i]
        whole, first, last = x2 - x0, x1 - x0, x2 - x1
        least = NODES_APART * abs(whole)
        slope = (y1 - y0) / first
        c = ((y2 - y1) / last - slope) / whole
        bent = 1.0 if abs(first) > least else 0.0
        bent = bent if abs(last) > least else 0.0
        b = slope - c * (x0 + x1) if bent > 0.0 else (y2 - y0) / whole
        c = c if bent > 0.0 else 0.0
        a = y0 - x0 * (b + c * x0)
        moved = abs(whole) > _SAME
        out[0, i] = a if moved else y1
        out[1, i] = b if moved else 0.0
        out[2, i] = c if moved else 0.0
    return out


@njit(fastmath=DETERMINISTIC, error_model='numpy')
def _phases(positions, centre, ends, plane, out):
    """Phases of a node's echo from beam to beam, radians: `BeamGeometry.slope`, differentiated."""
    tx, ty, ax, ay, height, range_m, low, high, rad_per_m = plane
    square = range_m * range_m
    (x0, y0, z0), (x1, y1, z1) = ends[0], ends[1]
    own0, own1 = (x0 * x0 + y0 * y0 + z0 * z0 + 2.0 * z0 * height + square,
                  x1 * x1 + y1 * y1 + z1 * z1 + 2.0 * z1 * height + square)
    cx, cy, cz = centre
    factor = -0.5 * range_m * rad_per_m
    for i in range(len(out)):
        x, y, z = positions[0, i] - cx, positions[1, i] - cy, positions[2, i] - cz
        direction = (x * tx + y * ty) / np.sqrt(x * x + y * y + z * z)
        direction = direction if direction > low else low
        along = range_m * (direction if direction < high else high)
        across = np.sqrt(square - along * along - height * height)
        tangent = along / across
        ux, uy = tx - tangent * ax, ty - tangent * ay
        px, py = along * tx + across * ax, along * ty + across * ay
        out[i] = factor * (
            (x0 * ux + y0 * uy) / np.sqrt(own0 - 2.0 * (x0 * px + y0 * py))
            + (x1 * ux + y1 * uy) / np.sqrt(own1 - 2.0 * (x1 * px + y1 * py)))


BINS = 128  # whose samples stay in the cache
_GAUSS = 0.5 - 0.5 / 3 ** 0.5  # where a straight line agrees best with a parabola over 0 to 1
_E0, _E2, _E3, _E4, _E5 = (np.float32(1 / v) for v in (1, 2, 6, 24, 120))

_u = np.uint64


class SpectrumBins(NamedTuple):
    """Bins of the echoes' spectra that make beams.

    Parameters
    ----------
    runs : (J, 4) int64
        Bins of each job: the first one in the echoes' spectra and in the beams', its number
        counted from the carrier's, how many.
    common : (2 * N,) float32
        Factor of each bin of the echoes' spectra, real and imaginary parts in turn.
    cycles : (2,) float64
        Cycles per metre of half path at the carrier, and what they grow from bin to bin.
    n_cells : int
        Bins of the beams' spectra.
    """

    runs: np.ndarray
    common: np.ndarray
    cycles: np.ndarray
    n_cells: int

    @classmethod
    def of(cls, common: np.ndarray, cycles: np.ndarray, zero: int, n_cells: int, longest: int
           ) -> SpectrumBins:
        """Runs of at most so many of the bins that cells hold; `zero` is the carrier's."""
        n_bins = len(common)
        kept = min(n_bins, n_cells)
        upper, lower = (kept + 1) // 2, kept // 2
        runs = []
        for first, target, start, count in ((zero, 0, 0, upper), ((zero - lower) % n_bins,
                                                                  n_cells - lower, -lower, lower)):
            runs += [(first + i, target + i, start + i, min(longest, count - i))
                     for i in range(0, count, longest)]
        return cls(np.array(runs), common.astype(np.complex64).view(np.float32), cycles, n_cells)


def form_beams(spectra: np.ndarray, path_m: np.ndarray, bins: SpectrumBins, between: BeamGain,
               weights: np.ndarray | None, group: int, paired: bool, beams: np.ndarray,
               buffer: WorkSpace) -> None:
    """Sum of the echoes' spectra with the delays of each direction.

    That of `backends.reference.form_beams`, with a factor a of each bin and w of each echo. The
    gain is that of the middle of a group of beams, its logarithm a straight line over each run of
    bins. What lies between the bins of positive and those of negative number is set to zero.

    Parameters
    ----------
    spectra, path_m : (R, N) complex64, (M, R) float64
        S, contiguous, and L, metres.
    bins, between, weights : SpectrumBins, BeamGain, (R,) float32 or None
        a, c and which bins; g; w.
    group, paired : int, bool
        Beams of a group, see `phasors`: even, or one; echoes on opposite sides share phasors.
    beams : (M, at least n_cells) complex64
        Written to; contiguous.
    buffer : callable
        ``buffer(name, shape, dtype)`` gives work space.
    """
    n_beams, n_echoes = path_m.shape
    phasors = echo_phasors(path_m, group, paired, bins.cycles)
    n_tasks, half = numba.get_num_threads(), -(-group // 2)
    sizes = {'base re': BINS * len(phasors.order), 'base im': BINS * len(phasors.order),
             'middle re': len(phasors.middle) * LANES, 'middle im': len(phasors.middle) * LANES,
             'middle steps': 2 * len(phasors.middle), 'echoes': 4 * ECHOES * LANES,
             'phasor re': len(phasors.beside), 'phasor im': len(phasors.beside),
             'sums': 4 * half * BINS}
    work = tuple(buffer(name, (n_tasks * size,), np.float32) for name, size in sizes.items())
    jobs = job_counter()
    # plain tuples: Numba takes 20 us to tell the type of a named one
    _form_beams(spectra.reshape(-1).view(np.float32),
                (spectra.shape[1], n_beams, beams.shape[1]), tuple(bins),
                np.ones(n_echoes, np.float32) if weights is None else weights, tuple(phasors),
                (between.log_gain, between.step), group, beams.reshape(-1).view(np.float32),
                jobs.ctypes.data, work)


@njit(parallel=True, fastmath=DETERMINISTIC)
def _form_beams(samples, shape, bins, weight, phasors, gain, group, out, jobs, work):
    """Run by run of bins; `phasors` says how beams and echoes share phases.

    What a pair's cosines and sines count is summed apart: one beam is their sum, the other their
    difference. The growth of phases from bin to bin is held over a vector of bins. Complex arrays
    are flat, real and imaginary parts in turn; `shape` is bins, beams, and bins from one beam to
    the next. The middle one of an odd group is a pair's both.
    """
    runs, common, cycles_per_bin, n_cells = bins
    order, shift, carrier, slope, beside, middle_step, phasor_step = phasors
    base_re, base_im, middle_re, middle_im, middle_steps, echoes, phasor_re, phasor_im, sums = work
    for task in numba.prange(len(echoes) // (ECHOES * 4 * LANES)):
        _form_runs(np.int64(task), samples, shape, (runs, common, cycles_per_bin, n_cells), weight,
                   (order, shift, carrier, slope, beside, middle_step, phasor_step), gain, group,
                   out, jobs, (base_re, base_im, middle_re, middle_im, middle_steps, echoes,
                               phasor_re, phasor_im, sums))


@kernel_part(distinct=True, fastmath=DETERMINISTIC)
def _form_runs(task, samples, shape, bins, weight, phasors, gain, group, out, jobs, work):
    """What a task of `_form_beams` does."""
    runs, common, cycles_per_bin, n_cells = bins
    order, shift, carrier, slope, beside, middle_step, phasor_step = phasors
    log_gain, gain_step = gain
    base_re, base_im, middle_re, middle_im, middle_steps, echoes, phasor_re, phasor_im, sums = work
    n_bins, n_beams, n_out = shape
    kept = min(n_bins, n_cells)
    n_echoes, n_groups, half = len(order), (n_beams + group - 1) // group, (group + 1) // 2
    n_middles, n_phasors = n_groups * n_echoes * LANES, len(beside)
    n_blocks = n_phasors // (n_groups * half * ECHOES)
    per_block = n_echoes // n_blocks
    vector_middle = 0.5 * (LANES - 1)
    run = take_job(jobs)
    while run < len(runs):
        for m in range(run * n_beams // len(runs), (run + 1) * n_beams // len(runs)):
            for i in range(_u(2 * (m * n_out + (kept + 1) // 2)),
                           _u(2 * (m * n_out + n_cells - kept // 2))):
                out[i] = 0.0
        first, target, number, left = runs[run, 0], runs[run, 1], runs[run, 2], runs[run, 3]
        base, first_middle, phasor = task * BINS * n_echoes, task * n_middles, task * n_phasors
        echo, total = task * ECHOES * 4 * LANES, task * 4 * half * BINS
        n_steps = n_groups * n_echoes
        steps = 2 * task * n_steps
        ends = (cycles_per_bin[0] + (number + _GAUSS * left) * cycles_per_bin[1],
                cycles_per_bin[0] + (number + (1.0 - _GAUSS) * left) * cycles_per_bin[1])
        for k in range(n_steps):
            cycles = cycles_per_bin[1] * shift[k]
            start = fraction(carrier[k] + number * cycles)
            grown = _read_table(log_gain, np.abs(slope[k] * ends[0]) / gain_step)
            rate = _read_table(log_gain, np.abs(slope[k] * ends[1]) / gain_step) - grown
            rate /= (1.0 - 2.0 * _GAUSS) * left
            first_gain = np.float32(np.exp(grown - _GAUSS * left * rate))
            to, x = _u(first_middle + k * LANES), np.float32(rate)
            for i in range(LANES):
                c = np.float32(fraction(start + i * cycles))
                gain = first_gain * _exp(x * np.float32(i))
                middle_re[to + _u(i)] = gain * cos_cycles(c * c)
                middle_im[to + _u(i)] = gain * sin_cycles(c, c * c)
            gain = _exp(x * np.float32(LANES))
            middle_steps[_u(steps + k)] = gain * middle_step[_u(k)]
            middle_steps[_u(steps + n_steps + k)] = gain * middle_step[_u(n_steps + k)]
        per_metre = cycles_per_bin[0] + (number + vector_middle) * cycles_per_bin[1]
        for k in range(_u(n_phasors)):
            c = np.float32(fraction(per_metre * beside[k]))
            phasor_re[_u(phasor) + k] = cos_cycles(c * c)
            phasor_im[_u(phasor) + k] = sin_cycles(c, c * c)
        while left > 0:
            count = min(left, BINS)
            n_vectors = (count + LANES - 1) // LANES
            _load_echoes(samples, n_bins, first, count, common, weight, order, per_block,
                       base_re, base_im, base)
            for g in range(n_groups):
                for i in range(_u(4 * half * BINS)):
                    sums[_u(total) + i] = 0.0
                for b in range(g * n_blocks, (g + 1) * n_blocks):
                    source = base + (b - g * n_blocks) * per_block * BINS
                    for v in range(n_vectors):
                        _fill_echoes(base_re, base_im, source + v * per_block * LANES,
                                     middle_re, middle_im,
                                     first_middle + b * per_block * LANES, middle_steps,
                                     steps + b * per_block, n_steps, per_block, echoes, echo)
                        add_echoes(echoes, _u(echo), phasor_re, phasor_im,
                                   _u(phasor + b * half * ECHOES), _u(half), sums,
                                   _u(total + 4 * v * half * LANES))
                        now, step = _u(phasor + b * half * ECHOES), _u(b * half * ECHOES)
                        for i in range(_u(half * ECHOES)):
                            cosine, sine = phasor_re[now + i], phasor_im[now + i]
                            re = phasor_step[step + i]
                            im = phasor_step[_u(n_phasors) + step + i]
                            phasor_re[now + i] = cosine * re - sine * im
                            phasor_im[now + i] = cosine * im + sine * re
                n_some = min(group, n_beams - g * group)
                for m in range(n_some):
                    source = total + 4 * min(m, n_some - 1 - m) * LANES
                    side = np.float32(1.0 if 2 * m < n_some else -1.0)
                    to = 2 * ((g * group + m) * n_out + target)
                    _put_beam(sums, source, half, count, side, out, to)
            first, target, left = first + count, target + count, left - count
            number += count
        run = take_job(jobs)


@njit(inline='always')
def _read_table(table, place):
    i = min(np.int64(place), len(table) - 2)
    return table[i] + min(place - i, 1.0) * (table[i + 1] - table[i])


@njit(inline='always')
def _exp(x):
    """Of what a gain grows over a vector of bins, which is little."""
    return _E0 + x * (_E0 + x * (_E2 + x * (_E3 + x * (_E4 + x * _E5))))


@njit(inline='always')
def _load_echoes(samples, n_bins, first, count, common, weights, order, per_block, base_re,
               base_im, base):
    """Some bins of all echoes times their factors, vector by vector, zero beyond the last."""
    whole = count // LANES
    for place in range(len(order)):
        echo = order[place]
        begin = base + place // per_block * per_block * BINS + place % per_block * LANES
        if echo < 0:
            for v in range((count + LANES - 1) // LANES):
                to = _u(begin + v * per_block * LANES)
                for lane in range(LANES):
                    base_re[to + _u(lane)] = 0.0
                    base_im[to + _u(lane)] = 0.0
            continue
        weight = weights[echo]
        source, factor = _u(2 * (echo * n_bins + first)), _u(2 * first)
        for v in range(whole):
            to = _u(begin + v * per_block * LANES)
            for lane in range(LANES):
                i = _u(lane)
                re, im = samples[source + _u(2) * i], samples[source + _u(2) * i + _u(1)]
                cosine = weight * common[factor + _u(2) * i]
                sine = weight * common[factor + _u(2) * i + _u(1)]
                base_re[to + i] = re * cosine - im * sine
                base_im[to + i] = re * sine + im * cosine
            source += _u(2 * LANES)
            factor += _u(2 * LANES)
        for lane in range((count > whole * LANES) * LANES):
            to = _u(begin + whole * per_block * LANES + lane)
            base_re[to] = 0.0
            base_im[to] = 0.0
            if lane < count - whole * LANES:
                i = _u(2 * lane)
                re, im = samples[source + i], samples[source + i + _u(1)]
                cosine, sine = weight * common[factor + i], weight * common[factor + i + _u(1)]
                base_re[to] = re * cosine - im * sine
                base_im[to] = re * sine + im * cosine


@njit(inline='always')
def _times(base_re, base_im, source, middle_re, middle_im, now, cosine_step, sine_step):
    """Sample times its phasor, which moves on by a vector."""
    cosine, sine = middle_re[now], middle_im[now]
    x, y = base_re[source], base_im[source]
    middle_re[now] = cosine * cosine_step - sine * sine_step
    middle_im[now] = cosine * sine_step + sine * cosine_step
    return x * cosine - y * sine, x * sine + y * cosine


@njit(inline='always')
def _fill_echoes(base_re, base_im, base, middle_re, middle_im, middle, step, first, n_steps,
                 n_echoes, echoes, echo):
    """A block of echoes from the group's middle: what a phasor's real and imaginary part count.

    An echo's phasor multiplies its samples and j times them; where echoes share one, their sum and
    j times their difference.
    """
    for k in range(ECHOES):
        source, now, to = _u(base + k * LANES), _u(middle + k * LANES), _u(echo + 4 * k * LANES)
        cosine, sine = step[_u(first + k)], step[_u(n_steps + first + k)]
        if n_echoes == ECHOES:
            for lane in range(LANES):
                i = _u(lane)
                re, im = _times(base_re, base_im, source + i, middle_re, middle_im, now + i,
                                cosine, sine)
                echoes[to + i], echoes[to + _u(LANES) + i] = re, im
                echoes[to + _u(2 * LANES) + i], echoes[to + _u(3 * LANES) + i] = -im, re
        else:
            other, then = source + _u(ECHOES * LANES), now + _u(ECHOES * LANES)
            c, s = step[_u(first + ECHOES + k)], step[_u(n_steps + first + ECHOES + k)]
            for lane in range(LANES):
                i = _u(lane)
                re, im = _times(base_re, base_im, source + i, middle_re, middle_im, now + i,
                                cosine, sine)
                x, y = _times(base_re, base_im, other + i, middle_re, middle_im, then + i, c, s)
                echoes[to + i], echoes[to + _u(LANES) + i] = re + x, im + y
                echoes[to + _u(2 * LANES) + i], echoes[to + _u(3 * LANES) + i] = y - im, re - x


@njit(inline='always')
def _put_beam(sums, first, half, count, side, out, target):
    """Write some bins of the beam on one side of the group's middle."""
    for v in range((count + LANES - 1) // LANES):
        re, to = _u(first + 4 * v * half * LANES), _u(target + 2 * v * LANES)
        im, odd = re + _u(LANES), _u(2 * LANES)
        for i in range(_u(min(LANES, count - v * LANES))):
            out[to + _u(2) * i] = sums[re + i] + side * sums[re + odd + i]
            out[to + _u(2) * i + _u(1)] = sums[im + i] + side * sums[im + odd + i]


ALIGNED = 8  # cells of a line of the cache
_PIECES = 32  # of a job
_FIRST_BEAM, _FIRST_CELL = 1 - BEAM_TAPS // 2, 1 - CELL_TAPS // 2  # of the neighbours


def summed_cells(segment: int) -> int:
    """Cells that a segment is interpolated from, from the beginning of a line of the cache on."""
    return -(-(segment + CELL_TAPS + ALIGNED) // TILE) * TILE


def work_size(segment: int) -> int:
    """Numbers of the work space of a task."""
    return 6 * STORED + 8 * summed_cells(segment)


class BeamPlaces(NamedTuple):
    """Where beams and their cells are, as `interpolate_beams` takes it.

    Parameters
    ----------
    centre, track : (3,), (2,) float64
        Phase centre that the beams start from, metres, and the direction of the axis.
    range_m, direction : (3,), (2,) float64
        Range of the first cell, spacing of cells and of pixels, metres; direction cosine of the
        first beam, spacing of beams.
    cycles_per_m, zero_cycles : float
        Carrier phase per metre of half path, and that of no half path, cycles.
    curvature : (2,) float64
        Curvature of the beams, 1/m, and what its differences count between neighbouring beams, m.
    """

    centre: np.ndarray
    track: np.ndarray
    range_m: np.ndarray
    direction: np.ndarray
    cycles_per_m: float
    zero_cycles: float
    curvature: np.ndarray


@njit(parallel=True, fastmath=DETERMINISTIC)
def interpolate_beams(beams, shape, lines, geometry, between, along, index, image, work, jobs,
                      parabolas):
    """Interpolate beams to the lines of a polar image at range baseband.

    `backends.reference.interpolate_beams` has the formula. Within a segment of a line the places
    between beams and cells, and the phase that the line has beyond its range baseband, are
    polynomials of the pixel number, and weights are expanded to second order around the middle.
    The orders of the direction are kept apart until a pixel's own place between beams is known:
    its cells, mixed each for a place of its own, would have other frequencies than those that
    their spectrum is corrected for.

    Parameters
    ----------
    beams, image : (2 * M * n,), (2 * n_lines * n_pixels,) float32
        Beams at range baseband, cells ascending, real and imaginary parts in turn; image, real,
        then imaginary parts, written to.
    shape : tuple of int
        ``(M, n, n_lines, n_pixels, segment)``: beams, their cells, lines of the image, their
        pixels and those of a segment. `TILE` cells are to spare.
    lines : (S, n_lines, 12) float64
        From `lines.segment_middles`.
    geometry : BeamPlaces
        Where the beams are.
    between, along : (DEGREE + 1, STORED) float32
        Weights of the interpolation between beams and along range; zero beyond their taps.
    index : (summed_cells(segment),) float32
        Pixel numbers of a segment, counted from its middle, and those that follow; segments are
        whole vectors.
    work, jobs : (T * work_size(segment),) float32, int
        Work space of T tasks, and the address of a `job_counter`.
    parabolas : (3, n_lines, K) float32 or None
        Amplitude of echoes by their phase from beam to beam, see `AmplitudeParabolas.parabolas`;
        None where all pixels are illuminated alike. Support points are at the ends of segments.
    """
    centre, track, range_m, direction, cycles_per_m, zero_cycles, curvature = geometry
    n_beams, n_cells, n_lines, n_pixels, segment = shape
    n_mixed = len(index)
    size = 6 * STORED + 8 * n_mixed
    n_tasks = len(work) // size
    half, n_pieces = segment // 2, lines.shape[0] * n_lines
    apart, part = _u(2 * n_cells), _u(n_mixed)
    spacing = cycles_per_m * range_m[2]
    for task in numba.prange(n_tasks):
        w = _u(size * task)
        mixed = w + _u(6 * STORED)
        sums = mixed + _u(6 * n_mixed)
        # Neighbouring lines read the same part of the beams, so they come in turn.
        job = take_job(jobs)
        while job * _PIECES < n_pieces:
            for piece in range(job * _PIECES, min((job + 1) * _PIECES, n_pieces)):
                number, line = piece // n_lines, piece % n_lines
                x = lines[number, line, 0] - centre[0]
                y = lines[number, line, 1] - centre[1]
                z = lines[number, line, 2] - centre[2]
                ex, ey, ez = (lines[number, line, 3], lines[number, line, 4],
                              lines[number, line, 5])
                gx, gy, gz = (lines[number, line, 6], lines[number, line, 7],
                              lines[number, line, 8])
                hx, hy, hz = (lines[number, line, 9], lines[number, line, 10],
                              lines[number, line, 11])
                d = np.sqrt(x * x + y * y + z * z)
                d1 = (x * ex + y * ey + z * ez) / d
                d2 = (ex * ex + ey * ey + ez * ez + x * gx + y * gy + z * gz - d1 * d1) / d
                d3 = (3.0 * (ex * gx + ey * gy + ez * gz) + x * hx + y * hy + z * hz
                      - 3.0 * d1 * d2) / d
                s = (x * track[0] + y * track[1]) / d
                s1 = (ex * track[0] + ey * track[1] - s * d1) / d
                s2 = (gx * track[0] + gy * track[1] - 2.0 * s1 * d1 - s * d2) / d
                v = (d - range_m[0]) / range_m[1]
                cell = np.floor(v)
                v1 = np.float32(d1 / range_m[1] - 1.0)
                v2, v3 = np.float32(0.5 * d2 / range_m[1]), np.float32(d3 / range_m[1] / 6.0)
                u = (s - direction[0]) / direction[1]
                beam = np.floor(u)
                u1, u2 = np.float32(s1 / direction[1]), np.float32(0.5 * s2 / direction[1])
                c0 = np.float32(fraction(cycles_per_m * d - spacing * (number * segment + half)
                                          + zero_cycles))
                c1 = np.float32(cycles_per_m * d1 - spacing)
                c2, c3 = np.float32(0.5 * cycles_per_m * d2), np.float32(cycles_per_m * d3 / 6.0)
                bend = np.float32((1.0 - s * s) * (1.0 / d - curvature[0]) * curvature[1])
                bend1 = np.float32((s * s - 1.0) * d1 / (d * d) * curvature[1])
                _expand_weights(between, np.float32(u - beam), work, w)
                _expand_weights(along, np.float32(v - cell), work, w + _u(3 * STORED))
                place = np.int64(min(max(cell - half + _FIRST_CELL, 0.0), n_cells - n_mixed - 0.0))
                # Vectors that straddle two lines of the cache take twice as long to load.
                start = place // ALIGNED * ALIGNED
                row = np.int64(min(max(beam + _FIRST_BEAM, 0.0), n_beams - BEAM_TAPS - 0.0))
                source = _u(2 * (row * n_cells + start))
                fetch(beams, source + _u(BEAM_TAPS) * apart, _u(2 * n_mixed))  # for the next line
                sum_beams(beams, source, apart, part, work, w, mixed)
                if parabolas is None:
                    sum_cells(index, _u(segment), (v1, v2, v3), (u1, u2, bend, bend1), work,
                              w + _u(3 * STORED), mixed + _u(place - start), sums, part)
                else:
                    a0, a1 = _along_segment(parabolas, line, number, segment, 0)
                    b0, b1 = _along_segment(parabolas, line, number, segment, 1)
                    q0, q1 = _along_segment(parabolas, line, number, segment, 2)
                    sum_weighted_cells(index, _u(segment), (v1, v2, v3), (u1, u2, bend, bend1),
                                       work, w + _u(3 * STORED), mixed + _u(place - start), sums,
                                       part, (a0, a1, b0, b1, q0, q1))
                some = _u(min(segment, n_pixels - number * segment))
                real = _u(line * n_pixels + number * segment)
                imag = real + _u(n_lines * n_pixels)
                fetch(image, real + _u(n_pixels), _u(segment))
                fetch(image, imag + _u(n_pixels), _u(segment))
                for i in range(some):
                    f = index[i]
                    c = fraction(c0 + f * (c1 + f * (c2 + f * c3)))
                    sine, cosine = sin_cycles(c, c * c), cos_cycles(c * c)
                    re, im = work[sums + i], work[sums + part + i]
                    image[real + i] = re * cosine - im * sine
                    image[imag + i] = re * sine + im * cosine
            job = take_job(jobs)


@njit(inline='always')
def _along_segment(parabolas, line, number, segment, order):
    """Value in the middle of a segment, and growth by pixel, between its two support points."""
    grown = parabolas[order, line, number + 1] - parabolas[order, line, number]
    return parabolas[order, line, number] + np.float32(0.5) * grown, grown / np.float32(segment)


@njit(inline='always')
def _expand_weights(weights, t, work, to):
    """Weights of the taps at t, and their first two orders around it."""
    for k in range(STORED):
        w2, w3, w4, w5 = weights[2, k], weights[3, k], weights[4, k], weights[5, k]
        i = to + _u(k)
        work[i] = weights[0, k] + t * (weights[1, k] + t * (w2 + t * (w3 + t * (w4 + t * w5))))
        work[i + _u(STORED)] = weights[1, k] + t * (
            np.float32(2) * w2 + t * (np.float32(3) * w3 + t * (np.float32(4) * w4
                                                               + t * (np.float32(5) * w5))))
        work[i + _u(2 * STORED)] = w2 + t * (
            np.float32(3) * w3 + t * (np.float32(6) * w4 + t * (np.float32(10) * w5)))


_PAGE, _STRIDE = 512, 40  # complex samples


class BeamformedSubaperture:
    """Lines of the coarse grid of a plan, filled from the beams of a sub-aperture."""

    def __init__(self, plan: SubaperturePlan):
        polar, source, resampling, sampling = plan.coarse, plan.source, plan.resampling, plan.beams
        self._polar, self._source = polar, source
        self._resampling, self._sampling = resampling, sampling
        self._buffer = WorkSpace()
        cell_m = resampling.cell_m
        first = math.floor((plan.range_m[0] - source.range_start_m) / cell_m) - CELL_TAPS
        self._range_start_m = source.range_start_m + first * cell_m
        # Beyond the profile's ends a period repeats, what was recorded does not.
        n_cells = resampling.n_cells
        self._known = (0, n_cells) if source.periodic else tuple(
            min(max(end, 0), n_cells) for end in (-first, n_cells - first))
        gain = source.gain(resampling.n_padded)
        n_bins, per_bin = len(gain), 1 / (n_cells * resampling.cell_m)
        self._per_metre = 2 / source.radar.wavelength_m
        number = (np.arange(n_bins) - source.zero + n_bins // 2) % n_bins - n_bins // 2
        # Each bin's share is changed beforehand by what reading the cells takes from it.
        gain = sampling.range_gain(gain, number, n_cells)
        shift = np.fmod(number * (first / n_cells), 1.0)
        self._bins = SpectrumBins.of(
            gain * np.exp(2j * np.pi * shift), np.array([self._per_metre, per_bin]), source.zero,
            n_cells, bins_per_run(n_bins, n_bins * per_bin / self._per_metre))
        self._lines = segment_middles(polar.locate, np.arange(polar.n_alpha),
                                      polar.n_range, sampling.segment)
        self._edges = grid_edges(polar)
        self._amplitudes = plan.amplitudes and AmplitudeParabolas(polar, sampling.segment)

    def fill(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray,
             weights: np.ndarray | None = None, nodes: tuple[AmplitudeNodes, ...] | None = None
             ) -> None:
        """Image of some echoes at range baseband; the arguments are those of `PolarLines.fill`.

        But for `nodes`, of each image that makes this one, in place of an illumination.

        Raises
        ------
        ValueError
            The plane is too steep below the echoes for their directions to be told apart.
        """
        n = len(nodes) if nodes else 1
        for part in range(n):
            some = slice(part, None, n)
            to = self._buffer('part', image.shape, np.float32) if part else image
            self._fill(np.ascontiguousarray(samples[some]), tx_m[some], rx_m[some], to,
                       weights if weights is None else weights[some], nodes and nodes[part])
            if part:
                image += to

    def _fill(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray,
              weights: np.ndarray | None, nodes: AmplitudeNodes | None) -> None:
        geometry = CompiledBeamGeometry.of(self._polar, self._edges, tx_m, rx_m)
        if geometry is None:
            raise ValueError(f'the imaging plane, {self._polar.z_m:g} m high, is too steep below '
                             f'the phase centres around {tx_m.mean(axis=0).round(2)}; use exact '
                             'backprojection')
        start, spacing, n_beams = self._sampling.directions(geometry, tx_m, rx_m)
        directions = start + spacing * np.arange(n_beams)
        paired = geometry.uneven(tx_m, rx_m) < self._sampling.uneven_m
        beams = self._beams(samples, geometry.beam_path(tx_m, rx_m, directions), paired, weights)
        parabolas = self._amplitudes and self._amplitudes.parabolas(nodes, geometry,
                                                2 * math.pi * self._per_metre * spacing)
        self._read(beams, geometry, start, spacing, image, parabolas)

    def _beams(self, samples: np.ndarray, path: np.ndarray, paired: bool,
               weights: np.ndarray | None) -> np.ndarray:
        """(M, n_cells) complex64 beams at range baseband, valid until the next call."""
        n_beams, n_cells = len(path), self._resampling.n_cells
        group = self._sampling.group_of(n_beams)
        spectrum = spectra(self._source, samples, self._resampling.n_padded, self._buffer)
        stride = _uncrowded(n_cells + TILE)
        beams = self._buffer('beams', (n_beams, stride), np.complex64)
        form_beams(spectrum, path, self._bins, self._sampling.between, weights, group, paired,
                   beams, self._buffer)
        transform_rows(beams[:, :n_cells], inverse=True)
        beams[:, :self._known[0]] = 0.0
        beams[:, self._known[1]:] = 0.0
        return beams

    def _read(self, beams: np.ndarray, geometry: BeamGeometry, start: float, spacing: float,
              image: np.ndarray, parabolas: np.ndarray | None) -> None:
        polar, sampling, source = self._polar, self._sampling, self._source
        segment = sampling.segment
        cycles_per_m = self._per_metre
        # Half the curvature and twice the weight of the second order cancel.
        bend = -1 / (2 * np.pi * cycles_per_m * spacing ** 2)
        index = np.arange(summed_cells(segment), dtype=np.float32) - segment // 2
        size = numba.get_num_threads() * work_size(segment)
        work, jobs = self._buffer('read', (size,), np.float32), job_counter()
        interpolate_beams(
            beams.reshape(-1).view(np.float32), (*beams.shape, *image.shape[1:], segment),
            self._lines, BeamPlaces(
                geometry.centre_m, np.array(polar.track),
                np.array([self._range_start_m, self._resampling.cell_m, polar.range_spacing_m]),
                np.array([start, spacing]), cycles_per_m, -cycles_per_m * source.phase_range_m,
                np.array([1 / geometry.range_m, bend])),
            _table(sampling.between.interpolator), _table(sampling.along), index,
            image.reshape(-1), work, jobs.ctypes.data, parabolas)


def _uncrowded(n_cells: int) -> int:
    """Cells between beams, so that neighbours do not compete for the same lines of the cache."""
    return n_cells + (_STRIDE - n_cells) % _PAGE


def _table(interpolator: Interpolator) -> np.ndarray:
    weights = np.zeros((DEGREE + 1, STORED), np.float32)
    weights[:, :interpolator.weights.shape[1]] = interpolator.weights
    return weights


class SubapertureImager:
    """Images of the sub-apertures of a plan, see `backends.protocol.SubapertureImager`."""

    def __init__(self, plan: SubaperturePlan):
        self.plan = plan
        self._lines = BeamformedSubaperture(plan) if plan.beams else PolarLines(
            plan.coarse, Profiles(plan.source, plan.resampling, plan.range_m),
            plan.amplitudes and plan.amplitudes.lines)

    def image(self, number: int, block: PulseBlock, weights: np.ndarray | None = None,
              out: np.ndarray | None = None) -> np.ndarray:
        """Backproject one sub-aperture, see `backends.protocol.SubapertureImager`."""
        plan = self.plan
        plan.check_block(number, block)
        shape = (2, plan.coarse.n_alpha, plan.coarse.n_range)
        image = aligned_empty(shape, np.float32) if out is None else out
        if weights is not None:
            weights = np.repeat(weights, plan.n_channels)
        self._lines.fill(block.samples.reshape(-1, plan.n_samples), block.tx_m.reshape(-1, 3),
                         block.rx_m.reshape(-1, 3), image, weights, plan.weighed_by(block))
        return image
