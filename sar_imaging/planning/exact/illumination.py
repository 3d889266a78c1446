# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How amplitudes of echoes are interpolated over lines, points and polar images, and how well.

Computing an echo's amplitude at every pixel would take longer than backprojection. It is computed
at nodes instead: along an image line at both ends and in the middle of each segment, with
a parabola through them, and from line to line at every few lines, with a straight line between
them; over tiles of points on the edges of the tiles and in their middle, with parabolas.

Along a segment a phasor is a cubic in the pixel number, less what all echoes of a pass share, and
the amplitude a parabola; of the product the cubic is kept. What that leaves out is computed here
pair by pair of an echo and a pixel, since it is the largest where amplitudes are.

Where a pattern ends, the amplitude has high frequencies, and there the echo's phasor has the
highest ones as well: neither spectrum alone tells the error of a polar image. So the sum over the
taps is compared with the value for random pairs.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...geometry.grids import even_positions
from ...geometry.half_paths import pair_lengths, pair_paths
from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from ..echo_pixels import LEAST_DB, EchoPixels
from ..interpolators import LINE_DEGREE, Interpolator, design_interpolator
from ..plan import EXACT_SHARES, error_budget, total_db
from ..polar_cover import PolarCover
from ..profiles import (
    DRIFT_SLACK,
    ECHOES_PER_PASS,
    MOST_DRIFT,
    PhaseHistory,
    RangeGate,
    RangeResampling,
    middle_of_pass,
)

if TYPE_CHECKING:
    from .backprojection import GridLines
    from .polar_image import AzimuthParts

    # of pixels and lines to positions and their derivatives; of lines and pixels to positions
    _Locate = Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]]
    _Positions = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True, eq=False)
class ImageLines:
    """Lines of an image, as pairs of an echo and a pixel are looked up.

    Attributes
    ----------
    locate : callable
        ``locate(pixel, line)`` gives positions (..., 3), metres, and their first derivatives by
        the pixel number.
    positions : callable
        ``positions(line, pixel)`` gives positions alone.
    n_lines, n_pixels : int
        Size of the image.
    flat : bool
        They lie side by side on a plane.
    """

    locate: _Locate
    positions: _Positions
    n_lines: int
    n_pixels: int
    flat: bool = True

    @classmethod
    def of_polar(cls, polar: PolarGrid) -> ImageLines:
        """Lines of a polar image."""
        return cls(polar.locate, polar.positions, *polar.shape)

    @classmethod
    def of_grid(cls, lines: GridLines) -> ImageLines:
        """Lines of a map or plane, or of the middle layer of a volume."""
        locate = lines.locate(len(lines.layouts) // 2)
        return cls(locate, lambda line, pixel: locate(pixel, line)[0], lines.n_lines,
                   lines.n_pixels, lines.layers_together == 1)


@dataclasses.dataclass(frozen=True, eq=False)
class Echoes:
    """Echoes that are added in passes.

    Attributes
    ----------
    tx_m, rx_m : (R, 3) float64
        Phase centres, metres.
    starts : tuple of int
        First echo of each part that is added by itself.
    radar : RadarParameters
        Radar parameters of their profiles.
    """

    tx_m: np.ndarray
    rx_m: np.ndarray
    starts: tuple[int, ...]
    radar: RadarParameters


class SegmentPhasors:
    """Phasors of pairs along segments of one length.

    Parameters
    ----------
    pairs : EchoPixels
        Pairs of the lines and echoes.
    lines : ImageLines
        Lines of the image.
    echoes : Echoes
        Whose phasors they are.
    resampling : RangeResampling
        How the lines read the profiles.

    Attributes
    ----------
    drift : (n,) float64
        How far the pixels drift over half a segment, range steps.
    squares : (n,) float64
        Squared error by the expansion of path and phasor alone.
    """

    def __init__(self, pairs: EchoPixels, lines: ImageLines, echoes: Echoes,
                 resampling: RangeResampling):
        line, pixel = pairs.index
        half, radar = resampling.segment // 2, echoes.radar
        middle = pixel // resampling.segment * resampling.segment + half
        numbers = pairs.echoes, middle_of_pass(pairs.echoes, echoes.starts, len(echoes.tx_m),
                                               resampling.echoes_per_pass)
        at = lines.locate(middle, line)
        path, shared = (pair_paths(echoes.tx_m[n], echoes.rx_m[n], at) for n in numbers)
        length = pair_lengths(echoes.tx_m[pairs.echoes], echoes.rx_m[pairs.echoes],
                              pairs.points_m)
        self._place, self._half, k = pixel - middle, half, radar.wavenumber_rad_per_m
        f, away = self._place, length - path[0]
        self.drift = np.abs(path[1] - resampling.cell_m) * (half / resampling.step_m)
        a, b, c = (k * (path[n] - shared[n]) / math.factorial(n) for n in (1, 2, 3))
        self._cubic = _economised(a, b, c, half)
        # what echoes share has its quartic term economised
        self._exact = np.exp(1j * k * (away - f * (
            shared[1] + f * (shared[2] / 2 + f * shared[3] / 6))
            - shared[4] / 24 * half ** 2 * (f ** 2 - half ** 2 / 8)))
        # The envelope is read where a parabola leads, whose slope has a part of the cubic term.
        beside = radar.half_band_rad_per_m / math.sqrt(3) * (
            away - f * (path[1] + path[3] * half ** 2 / 8 + f * path[2] / 2))
        self._beside = (pairs.amplitude * beside) ** 2
        self._true = pairs.amplitude * self._exact
        self.squares = self._beside + pairs.amplitude ** 2 * np.abs(
            _polynomial(self._cubic, f) - self._exact) ** 2

    def illuminated_squares(self, values: np.ndarray) -> np.ndarray:
        """(n,) squared errors with amplitudes (n, 3) at the ends and in the middle of segments."""
        f, half, cubic = self._place, self._half, self._cubic
        w0 = values[:, 1]
        w1 = 0.5 * (values[:, 2] - values[:, 0]) / half
        w2 = (0.5 * (values[:, 2] + values[:, 0]) - w0) / half ** 2
        quartic = cubic[3] * w1 + cubic[2] * w2
        product = (cubic[0] * w0 - half ** 4 / 8 * quartic, cubic[1] * w0 + cubic[0] * w1,
                   cubic[2] * w0 + cubic[1] * w1 + cubic[0] * w2 + half ** 2 * quartic,
                   cubic[3] * w0 + cubic[2] * w1 + cubic[1] * w2)
        return self._beside + np.abs(_polynomial(product, f) - self._true) ** 2


def _economised(a: np.ndarray, b: np.ndarray, c: np.ndarray, half: int) -> tuple[np.ndarray, ...]:
    """Cubic of ``exp(j (a f + b f^2 + c f^3))`` over `half` pixels on either side."""
    quartic = a ** 4 / 24 - b ** 2 / 2 - a * c - 0.5j * a ** 2 * b
    return (1 - half ** 4 / 8 * quartic, 1j * a, half ** 2 * quartic - a ** 2 / 2 + 1j * b,
            -a * b + 1j * (c - a ** 3 / 6))


def _polynomial(coefficients: Sequence[np.ndarray], f: np.ndarray) -> np.ndarray:
    c0, c1, c2, c3 = coefficients
    return c0 + f * (c1 + f * (c2 + f * c3))


LINES = 32  # whose geometry is computed together; nodes of every group begin anew
APART = (32, 16, 8, 4, 2, 1)  # lines between nodes
_LEAST_SEGMENT = 8


@dataclasses.dataclass(frozen=True)
class LineAmplitudes:
    """Nodes of amplitudes over lines.

    Attributes
    ----------
    apart : int
        Lines between nodes, one of `APART`.
    share : float
        Share of all pairs of an echo and a pixel, what is lit and computed.
    predicted_error_db : float
        Error of the image because amplitudes are interpolated, dB.
    """

    apart: int
    share: float
    predicted_error_db: float

    def nodes(self, locate: _Locate, n_lines: int, n_pixels: int, segment: int
              ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `node_positions`."""
        return node_positions(locate, n_lines, n_pixels, segment, self.apart)

    def n_bytes(self, n_lines: int, n_pixels: int, segment: int, n_layers: int = 1) -> int:
        """Memory of the nodes' positions, in float64, and of a pass's amplitudes, in float32."""
        groups, segments, nodes = (-(-n_lines // LINES), -(-n_pixels // segment),
                                   LINES // self.apart + 1)
        return groups * (nodes * (2 * segments + 1) * (24 * n_layers + 4 * ECHOES_PER_PASS)
                         + segments * ECHOES_PER_PASS)


def node_positions(locate: _Locate, n_lines: int, n_pixels: int, segment: int, apart: int
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions of the nodes over some lines, and how lines lie between them.

    Parameters
    ----------
    locate : callable
        ``locate(pixel, line)`` gives positions (..., 3), metres, and their derivatives.
    n_lines, n_pixels, segment : int
        Size of the image, and pixels of a segment.
    apart : int
        Lines between nodes.

    Returns
    -------
    positions : (3, G, 2 S + 1, K) float64
        Positions of G groups of `LINES` lines, at the ends and middles of S segments and at K
        lines, metres.
    node, between : (G, LINES) int64, float32
        Knot before each line of a group, and the share of the next.
    """
    n_groups, half = -(-n_lines // LINES), segment // 2
    first = np.arange(n_groups)[:, None] * LINES
    # the last node of a group lies on the first line of the next, or on the last one of all
    nodes = np.minimum(first + np.arange(LINES // apart + 1) * apart, n_lines - 1)
    places = np.arange(2 * -(-n_pixels // segment) + 1) * half
    positions = locate(places[:, None], nodes[:, None])[0]
    line = np.minimum(first + np.arange(LINES), n_lines - 1)
    node = np.tile(np.arange(LINES) // apart, (n_groups, 1))
    before, after = (np.take_along_axis(nodes, node + i, axis=1) for i in (0, 1))
    between = np.where(after > before, (line - before) / np.maximum(after - before, 1), 0.0)
    return (np.ascontiguousarray(np.moveaxis(positions, -1, 0)), node,
            between.astype(np.float32))


def plan_line_amplitudes(illumination: Illumination, lines: GridLines, tx_m: np.ndarray,
                         rx_m: np.ndarray, radar: RadarParameters,
                         window: RangeGate | PhaseHistory, resampling: RangeResampling,
                         target_db: float) -> tuple[
                             RangeResampling | None, LineAmplitudes | None, dict[str, float]]:
    """As `plan_weighed_segments`, for lines of a grid itself, and errors by cause, dB.

    Phase centres (R, 3) in metres; `resampling` reads the profiles, of which `window` is needed,
    for the lines without illumination.
    """
    fitted, amplitudes, pairs = plan_weighed_segments(
        illumination, ImageLines.of_grid(lines), Echoes(tx_m, rx_m, (0,), radar), resampling,
        target_db, error_budget(target_db, EXACT_SHARES)['illumination'])
    return fitted, amplitudes, {} if fitted is None or amplitudes is None else {
        'ends of profiles': pairs.ends_db(window, fitted.oversampling(radar), tx_m, rx_m),
        'illumination': amplitudes.predicted_error_db}


def plan_weighed_segments(illumination: Illumination, lines: ImageLines, echoes: Echoes,
                          resampling: RangeResampling, profiles_db: float, amplitudes_db: float
                          ) -> tuple[RangeResampling | None, LineAmplitudes | None, EchoPixels]:
    """Nodes over lines, with shorter segments where phasors or amplitudes bend much.

    Parameters
    ----------
    illumination : Illumination
        Illumination of the echoes.
    lines, echoes :
        Of the image, and what is added to it.
    resampling : RangeResampling
        For the lines without illumination.
    profiles_db, amplitudes_db : float
        Wanted errors of reading the profiles, and of the amplitudes, dB.

    Returns
    -------
    resampling : RangeResampling or None
        With the error of what is lit; None where no segments are short enough.
    amplitudes : LineAmplitudes or None
        Likewise.
    pairs : EchoPixels
        Pairs of which the errors were told.
    """
    pairs = EchoPixels.draw(illumination, lines.positions, (lines.n_lines, lines.n_pixels),
                            (LINES, max(resampling.segment // 2, 1)), flat=lines.flat)
    if not len(pairs):
        return resampling, LineAmplitudes(APART[0], pairs.share, LEAST_DB), pairs
    while True:
        phasors = SegmentPhasors(pairs, lines, echoes, resampling)
        fitted = _fitted(resampling, phasors, pairs, echoes.radar)
        if fitted is not None and fitted.predicted_error_db <= profiles_db:
            amplitudes = _fewest_nodes(pairs, lines, phasors, resampling.segment, amplitudes_db)
            if amplitudes is not None:
                return fitted, amplitudes, pairs
        if resampling.segment <= _LEAST_SEGMENT:
            return None, None, pairs
        resampling = dataclasses.replace(resampling, segment=resampling.segment // 2)


def _fitted(resampling: RangeResampling, phasors: SegmentPhasors, pairs: EchoPixels,
            radar: RadarParameters) -> RangeResampling | None:
    """Resampling with the error of the pairs; None where pixels drift too far for its segments."""
    furthest = float(phasors.drift.max())
    if furthest > MOST_DRIFT:
        return None
    if furthest > resampling.interpolator.margin + DRIFT_SLACK:
        resampling = dataclasses.replace(resampling, interpolator=design_interpolator(
            resampling.oversampling(radar), furthest, degree=LINE_DEGREE))
    read = resampling.interpolator.error_with_drift(phasors.drift) * pairs.amplitude ** 2
    return dataclasses.replace(resampling, predicted_error_db=total_db(
        pairs.error_db(read + phasors.squares)))


def _fewest_nodes(pairs: EchoPixels, lines: ImageLines, phasors: SegmentPhasors, segment: int,
                  wanted_db: float) -> LineAmplitudes | None:
    """Most lines between nodes that meet an error; None where nodes on every line do not.

    Errors, dB, grow with the distance of the nodes, so the closest are tried first.
    """
    line, pixel = pairs.index
    half = max(segment // 2, 1)
    node = (pixel // segment * segment)[:, None] + half * np.arange(3)
    expansion = pairs.error(phasors.squares)
    found = None
    for apart in reversed(APART):  # of most segments that are too long, even the finest fail
        first = line // apart * apart
        last = np.minimum(first + apart, lines.n_lines - 1)
        ends = [pairs.amplitude_at(lines.positions(at[:, None], node)) for at in (first, last)]
        across = ((line - first) / np.maximum(last - first, 1))[:, None]
        values = ends[0] + across * (ends[1] - ends[0])
        error = pairs.error(phasors.illuminated_squares(values)) - expansion
        error_db = 10 * math.log10(max(error, 0.0) + 10 ** (LEAST_DB / 10))
        if error_db > wanted_db:
            break
        found = apart, error_db
    if found is None:
        return None
    apart, error_db = found
    return LineAmplitudes(apart, _share_of_tiles(pairs, lines, segment), error_db)


def _share_of_tiles(pairs: EchoPixels, lines: ImageLines, segment: int) -> float:
    """Share of the pairs in tiles of which a part is lit, from pairs that are."""
    lit, along = pairs.amplitude > 0, 0.5 * np.array([-segment, segment])
    line, pixel = pairs.index
    dark = [np.mean(pairs.amplitude_at(lines.positions(
        line + step * LINES / 2, pixel + shift))[lit] == 0) for step in (-1, 1) for shift in along]
    # a pair half a tile off that is dark stands for one that is computed beyond the edge
    return min(1.0, pairs.share * (1 + float(np.mean(dark)))) if lit.any() else 0.0


# Time of a point and echo over that without illumination, by the points of a tile (measured)
_DEARER = {256: 1.2, 64: 1.4, 16: 2.9}
_EACH = 1.5  # more for an amplitude at each point
_LEAST_TILE = 64  # points, below which those at each point take no longer
# Rms error of the sines of angles in float32; 0.5e-8 to 2.3e-8 were measured
_ROUNDING, _STEP = 3e-8, 1e-3  # and step for derivatives, of a cut


@dataclasses.dataclass(frozen=True)
class PointAmplitudes:
    """How amplitudes are found at points: by parabolas along the rows and columns of tiles.

    Attributes
    ----------
    each : bool
        At each point by itself instead.
    share : float
        Share of all pairs of an echo and a point, what is lit and computed.
    dearer : float
        Time of such a pair over that of a pair without illumination.
    predicted_error_db : float
        Error of the image because amplitudes are interpolated, dB.
    """

    each: bool
    share: float
    dearer: float
    predicted_error_db: float

    def nodes(self, shape: tuple[int, int], tile: tuple[int, int]) -> list[np.ndarray]:
        """Rows and columns of the nodes of tiles, (K,) int64 each."""
        sides = (1, 1) if self.each else tile
        return [node_numbers(*sizes) for sizes in zip(shape, sides, strict=True)]

    def n_bytes(self, shape: tuple[int, int], tile: tuple[int, int]) -> int:
        """Memory of the nodes' positions, in float64, and of a pass's amplitudes, in float32."""
        return math.prod(map(len, self.nodes(shape, tile))) * (24 + 4 * ECHOES_PER_PASS)


def node_numbers(size: int, side: int) -> np.ndarray:
    """(K,) int64 numbers of the points of an axis that are nodes of its tiles.

    A tile's last node is the first point of the next tile, or the last of all. Tiles of one point
    along the axis share one node.
    """
    if side == 1:
        return np.zeros(1, np.int64)
    first = np.arange(0, size, side)
    last = np.minimum(first + side, size - 1)
    return np.append(np.stack([first, first + (last - first) // 2], axis=1).ravel(), size - 1)


def plan_point_amplitudes(illumination: Illumination, positions: _Positions,
                          shape: tuple[int, int], tiles: Sequence[tuple[int, int]],
                          wanted_db: float) -> tuple[tuple[int, int], PointAmplitudes, EchoPixels]:
    """Choose the largest tile over which parabolas meet an error.

    Where none does, amplitudes are found at each point, in the first tile. Returned are also the
    pairs of an echo and a point that tell the error. `positions` gives points (n, 3), metres, from
    rows and columns of the image; `tiles` are the rows and columns of those to choose from.
    """
    pairs = draw_points(illumination, positions, shape, tiles[0])
    dearer = _DEARER[math.prod(tiles[0])] + _EACH
    rounded_db = _rounded_db(pairs)
    large = [tile for tile in tiles if math.prod(tile) >= _LEAST_TILE]
    for tile in large if len(pairs) else ():
        error_db, dark = tile_error_db(pairs, positions, shape, tile)
        if error_db <= wanted_db:
            return tile, PointAmplitudes(False, min(1.0, pairs.share * (1 + dark)),
                                         _DEARER[math.prod(tile)],
                                         total_db(error_db, rounded_db)), pairs
    return tiles[0], PointAmplitudes(True, pairs.share, dearer, rounded_db), pairs


def draw_points(illumination: Illumination, positions: _Positions, shape: tuple[int, int],
                tile: tuple[int, int]) -> EchoPixels:
    """Pairs of an echo and a point in tiles that may be lit; positions as of
    `plan_point_amplitudes`.
    """
    def clipped(*index: np.ndarray) -> np.ndarray:
        return positions(*(np.clip(i, 0, size - 1).astype(np.int64)
                           for i, size in zip(index, shape, strict=True)))

    return EchoPixels.draw(illumination, clipped, shape, tile, flat=False)


def tile_error_db(pairs: EchoPixels, positions: _Positions, shape: tuple[int, int],
                  tile: tuple[int, int]) -> tuple[float, float]:
    """Error of interpolated amplitudes, dB, and the share of dark corners of lit tiles."""
    weights, nodes = [], []
    for at, side, size in zip(pairs.index, tile, shape, strict=True):
        first = at // side * side
        last = np.minimum(first + side, size - 1)
        some = [first + (last - first) * part // 2 for part in range(3)] if side > 1 else [first]
        weights.append(_lagrange(at, some))
        nodes.append(some)
    found, dark, lit = np.zeros(len(pairs)), [], pairs.amplitude > 0
    for row, v in zip(nodes[0], weights[0], strict=True):
        for column, u in zip(nodes[1], weights[1], strict=True):
            value = pairs.amplitude_at(positions(row, column))
            found = found + v * u * value
            dark.append(value[lit] == 0)
    return (pairs.error_db((found - pairs.amplitude) ** 2),
            float(np.mean(dark)) if lit.any() else 0.0)


def _rounded_db(pairs: EchoPixels) -> float:
    """Error because angles off boresight are computed in float32, dB."""
    squares, illumination = np.zeros(len(pairs)), pairs.illumination
    distance = np.linalg.norm(pairs.points_m - illumination.centre_m[pairs.echoes], axis=1)
    for axis, cut in ((0, illumination.pattern.azimuth), (2, illumination.pattern.elevation)):
        step = _STEP * cut.step * (len(cut.amplitude) - 1)
        moved = (step * distance)[:, None] * illumination.axes[pairs.echoes, axis]
        ahead, behind = (pairs.amplitude_at(pairs.points_m + m) for m in (moved, -moved))
        squares += (_ROUNDING * (ahead - behind) / (2 * step)) ** 2
    return pairs.error_db(squares)


def _lagrange(at: np.ndarray, nodes: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Weights of values at one node or three, as the compiled loops have them."""
    if len(nodes) == 1:
        return [np.ones(len(at))]
    length = np.maximum(nodes[-1] - nodes[0], 1)
    t = (at - nodes[0]) / length
    m = (nodes[1] - nodes[0]) / length
    bent = nodes[1] > nodes[0]  # three points at least
    m = np.where(bent, m, 0.5)
    first, second = t / m, t * (t - m) / (1 - m)
    # w0 + (w1 - w0) t / m + (w2 - w1) (t (t - m)) / (1 - m) - (w1 - w0) t (t - m) / m
    weights = (1 - first + t * (t - m) / m, first - second - t * (t - m) / m, second)
    return [np.where(bent, w, straight)
            for w, straight in zip(weights, (1 - t, 0 * t, t), strict=True)]


_TRIES = 4  # of finer and finer sampling
_CLOSE_DB = 0.5  # below what is wanted
_GAIN_TAPS, _THINNED = 96, 4  # over which deapodisation mixes lines; of fewer pairs


class WeighedPolar:
    """Plans the polar image of echoes with amplitudes: samples it as finely as these need.

    Parameters
    ----------
    illumination : Illumination
        Illumination of the echoes.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the echoes, metres.
    radar : RadarParameters
        Radar parameters of their profiles.
    """

    def __init__(self, illumination: Illumination, tx_m: np.ndarray, rx_m: np.ndarray,
                 radar: RadarParameters):
        self._illumination, self._radar = illumination, radar
        self._tx_m, self._rx_m = tx_m, rx_m
        self._read: _PolarReading  # of the latest cover

    def cover(self, cover_of: Callable[[float], PolarCover | None], wanted_db: float
              ) -> PolarCover | None:
        """Polar grid that is read well, or nearly, with the errors of reading it.

        ``cover_of(error_db)`` gives one as if amplitudes were even, or None; each pass of the
        interpolation to the map may err by `wanted_db`.
        """
        cover, asked_db = cover_of(wanted_db), wanted_db
        for _ in range(_TRIES):
            if cover is None:
                return None
            self._read = read = _PolarReading(cover, self._tx_m, self._rx_m, self._illumination)
            found = dataclasses.replace(
                cover, along_db=read.along_db(cover),
                between_db=read.between_db(cover.polar, cover.between, np.zeros(len(self._tx_m))),
                profile_db=read.pairs.ends_db(
                    cover.window, cover.resampling.oversampling(cover.window.radar), self._tx_m,
                    self._rx_m))
            above_db = max(found.between_db, found.along_db) - wanted_db
            if above_db <= 0:
                break
            asked_db -= above_db + _CLOSE_DB
            cover = cover_of(asked_db)
        return found

    def parts(self, parts_of: Callable[[float], AzimuthParts | None], wanted_db: float
              ) -> AzimuthParts | None:
        """Parts with lines enough for the amplitudes.

        ``parts_of(error_db)`` gives them as if amplitudes were even, or None.
        """
        asked_db = wanted_db
        for _ in range(_TRIES):
            parts = parts_of(asked_db)
            if parts is None:
                return None
            frequency = np.repeat(parts.frequency, [e.stop - e.start for e in parts.echoes])
            error_db = self._read.between_db(parts.coarse, parts.interpolator, frequency)
            if error_db <= wanted_db:
                return dataclasses.replace(parts, error_db=error_db)
            asked_db -= error_db - wanted_db + _CLOSE_DB
        return None

    def lines(self, polar: PolarGrid, resampling: RangeResampling, parts: AzimuthParts | None,
              profiles_db: float, amplitudes_db: float
              ) -> tuple[RangeResampling | None, LineAmplitudes | None]:
        """How the lines of an image, or of images of its parts, read the profiles."""
        starts = (0,) if parts is None else tuple(e.start for e in parts.echoes)
        echoes = Echoes(self._tx_m, self._rx_m, starts, self._radar)
        return plan_weighed_segments(self._illumination, ImageLines.of_polar(polar), echoes,
                                     resampling, profiles_db, amplitudes_db)[:2]


class _PolarReading:
    """Pairs of an echo and a pixel of a map, read from a polar image.

    Parameters
    ----------
    cover : PolarCover
        Cover of the map.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the echoes, metres.
    illumination : Illumination
        Illumination of the echoes.
    """

    def __init__(self, cover: PolarCover, tx_m: np.ndarray, rx_m: np.ndarray,
                 illumination: Illumination):
        grid, polar = cover.grid, cover.polar
        reach_m = max(cover.along.n_taps * polar.range_spacing_m,
                      cover.between.n_taps * polar.alpha_spacing * polar.range_m[-1]) / 2
        self.pairs = pairs = EchoPixels.draw(
            illumination, functools.partial(even_positions, grid), grid.shape,
            (math.ceil(reach_m / grid.spacing_m),) * 2)
        if cover.between.deapodised:
            self.pairs = pairs = pairs.thinned(_THINNED)
        self._centres = tx_m[pairs.echoes], rx_m[pairs.echoes]
        self._length_m = pair_lengths(*self._centres, pairs.points_m)
        self._weight = cover.weight[0, pairs.echoes]
        low, high = cover.window.radar.wavenumbers_rad_per_m
        self._wavenumber = low + (high - low) * pairs.place
        self._range, self._alpha = polar.from_map(*pairs.points_m[:, :2].T)

    def between_db(self, polar: PolarGrid, interpolator: Interpolator, frequency: np.ndarray
                   ) -> float:
        """Error of the interpolation between lines, dB.

        Images are taken to baseband along direction, by `frequency` of each echo, (R,) float64,
        radians per unit of it.
        """
        weights, alpha = _taps(interpolator, self._alpha, polar.alpha_start, polar.alpha_spacing)
        points = polar.at(self._range[:, None], alpha)
        turn = frequency[self.pairs.echoes][:, None] * (alpha - self._alpha[:, None])
        return self._error_db(weights, points, turn)

    def along_db(self, cover: PolarCover) -> float:
        """Error of the interpolation along the lines of the map, dB."""
        polar, axis = cover.polar, cover.axis
        weights, r = _taps(cover.along, self._range, polar.range_start_m, polar.range_spacing_m)
        offset = self.pairs.points_m - [*polar.origin_m[:2], polar.z_m]
        ahead = r ** 2 - (offset[:, 1 - axis] ** 2 + polar.height_m ** 2)[:, None]
        points = np.repeat(self.pairs.points_m[:, None], r.shape[1], axis=1)
        points[..., axis] = polar.origin_m[axis] + np.sign(offset[:, axis])[:, None] * np.sqrt(
            np.maximum(ahead, 0.0))
        turn = cover.window.radar.wavenumber_rad_per_m * (r - self._range[:, None])
        return self._error_db(weights, points, turn)

    def _error_db(self, weights: np.ndarray, points: np.ndarray, turn: np.ndarray) -> float:
        """Error of weighted sums over taps (n, T) whose carriers have turned so far, dB."""
        phase = self._wavenumber[:, None] * (
            pair_lengths(*self._centres, points) - self._length_m[:, None]) - turn
        read = (weights * self.pairs.amplitude_at(points) * np.exp(1j * phase)).sum(axis=1)
        return self.pairs.error_db(np.abs(read - self.pairs.amplitude) ** 2, self._weight)


def _taps(interpolator: Interpolator, at: np.ndarray, start: float, spacing: float
          ) -> tuple[np.ndarray, np.ndarray]:
    """Weights (n, T) with which places (n,) are read, and the places of the samples.

    The gain of spectra that are deapodised is a part of the weights.
    """
    number, t = np.divmod((at - start) / spacing, 1.0)
    weights = t[:, None] ** np.arange(len(interpolator.weights)) @ interpolator.weights
    first, n_taps = interpolator.first, interpolator.n_taps
    if interpolator.deapodised:
        kernel = np.fft.fftshift(np.fft.ifft(interpolator.gain(np.fft.fftfreq(_GAIN_TAPS))).real)
        mixed = np.zeros((n_taps, n_taps + _GAIN_TAPS - 1))
        for tap in range(n_taps):
            mixed[tap, tap:tap + _GAIN_TAPS] = kernel
        weights, first, n_taps = weights @ mixed, first - _GAIN_TAPS // 2, mixed.shape[1]
    taps = number[:, None] + first + np.arange(n_taps)
    return weights, start + spacing * taps
