"""Tree of sub-apertures for fast factorised backprojection, and the polar grid of each of them.

Every sub-aperture has a grid around its own centre (Zhang et al., figure 2a), sampled as finely
along direction as its length asks for. The grids of one level share their spacings; each covers
the requested grid and what the interpolation kernels of the levels above it reach beyond it.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...geometry.track_frame import track_beside
from ...signal.radar import RadarParameters
from ..profiles.range_resampling import Paths, RangeResampling, plan_resampling, sample_paths

MARGIN = 0.25  # how far beyond its interval a kernel is evaluated, pixels
LANES = 16  # pixels beyond a segment, whole vectors
_SEGMENTS = (112, 48, 16)  # with LANES more, whole vectors
_EDGE_SAMPLES = 33  # per edge of the requested grid
_PULSES_PER_NODE = 5  # whose paths bound the local frequencies
_SAMPLED_NODES = 64  # per level, where the geometry is looked at closely
_CUBIC_CYCLES = 2e-5  # error of the expansion of the carrier phase along a segment: -78 dB
_NARROW = 0.01  # spacing of directions that any geometry allows
_SAFETY = 1.02  # of bandwidths, for what lies between the sampled pulses and positions


@dataclasses.dataclass
class Node:
    """A sub-aperture: its pulses, its parts and its image's grid.

    Attributes
    ----------
    pulses : slice
        Its pulses.
    level : int
        0 for the shortest ones.
    children : list of Node
        Parts from which its image is made; none at level 0.
    centre : (3,) float64
        Origin of its grid: along track, across track and up, metres.
    range_start, alpha_start : float
        First range, metres, and direction cosine.
    shape : (int, int)
        Directions and ranges.
    """

    pulses: slice
    level: int
    children: list[Node]
    centre: np.ndarray = None
    range_start: float = 0.0
    alpha_start: float = 0.0
    shape: tuple[int, int] = (0, 0)


@dataclasses.dataclass
class Level:
    """What the sub-apertures of one length share.

    Attributes
    ----------
    nodes : list of Node
        The sub-apertures, in order.
    alpha_spacing : float
        Spacing of direction cosines.
    segment : int
        Pixels along which geometry is expanded when their images are made from their parts;
        0 where it must be computed for every pixel.
    size : int
        Pixels of the largest image.
    """

    nodes: list[Node]
    alpha_spacing: float = 0.0
    segment: int = 0
    size: int = 0


def build_tree(n_pulses: int, pulses_per_subaperture: int, merge_factor: int
               ) -> tuple[list[Level], list[Node]]:
    """Sub-apertures of every level, and those from which the image is made at last.

    Groups are as even as can be; a group of one stays as it is, so that any number of
    sub-apertures will do.

    Returns
    -------
    levels : list of Level
        Shortest first.
    top : list of Node
        At most `merge_factor` sub-apertures that make up the whole aperture.
    """
    size = pulses_per_subaperture
    top = [Node(slice(start, min(start + size, n_pulses)), 0, [])
           for start in range(0, n_pulses, size)]
    levels = [Level(list(top))]
    while len(top) > merge_factor:
        groups = -(-len(top) // merge_factor)
        edges = [len(top) * i // groups for i in range(groups + 1)]
        parts = [top[a:b] for a, b in zip(edges[:-1], edges[1:], strict=True)]
        top = [part[0] if len(part) == 1
               else Node(slice(part[0].pulses.start, part[-1].pulses.stop), len(levels), part)
               for part in parts]
        levels.append(Level([node for node in top if node.level == len(levels)]))
    return levels, top


@dataclasses.dataclass(frozen=True)
class Frame:
    """Common track direction and plane of all local grids.

    Attributes
    ----------
    track, across : (2,) float64
        Horizontal unit vectors along the track and from it into the scene.
    side : int
        1 when the scene lies to the left of the track, -1 to the right.
    z_m : float
        Height of the plane, metres.
    """

    track: np.ndarray
    across: np.ndarray
    side: int
    z_m: float

    def enter(self, points) -> np.ndarray:
        """Positions (..., 3) as along track, across track and up."""
        points = np.asarray(points, float)
        return np.stack([points[..., :2] @ self.track, points[..., :2] @ self.across,
                         points[..., 2]], axis=-1)

    def leave(self, point) -> tuple[float, float, float]:
        """A position along track, across track and up in the imaging frame."""
        x, y = point[0] * self.track + point[1] * self.across
        return float(x), float(y), float(point[2])


def find_frame(outline, centres, z_m: float) -> Frame:
    """Frame of an aperture and the scene that it looks at.

    Parameters
    ----------
    outline : (E, 3) float64
        Edge of the scene, metres.
    centres : (P, 3) float64
        Phase centres, metres.
    z_m : float
        Height of the plane, metres.
    """
    track, side = track_beside(centres, outline.mean(axis=0))
    return Frame(track, side * np.array([-track[1], track[0]]), side, z_m)


def outline_of(grid: MapGrid | PolarGrid) -> tuple[np.ndarray, np.ndarray, float]:
    """Edge of a grid, positions all over it, and the distance between samples of the edge.

    Returns
    -------
    edge : (E, 3) float64
    inside : (9, 3) float64
    step : float
        Metres.
    """
    def place(a, b):
        if isinstance(grid, MapGrid):
            x, y = (v[0] + s * (v[-1] - v[0]) for v, s in ((grid.x_m, a), (grid.y_m, b)))
            return np.stack([x, y, np.full(x.shape, grid.z_m)], axis=-1)
        return grid.lines(grid.range_start_m + a * (grid.n_range - 1) * grid.range_spacing_m,
                          grid.alpha_start + b * (grid.n_alpha - 1) * grid.alpha_spacing)[0]

    s = np.linspace(0.0, 1.0, _EDGE_SAMPLES)
    zero = np.zeros_like(s)
    edges = [place(s, zero), place(s, zero + 1), place(zero, s), place(zero + 1, s)]
    step = max(np.linalg.norm(np.diff(e, axis=0), axis=-1).max() for e in edges)
    a, b = (v.ravel() for v in np.meshgrid(*[np.linspace(0.0, 1.0, 3)] * 2))
    return np.concatenate(edges), place(a, b), float(step)


def place_centres(levels: list[Level], centres) -> None:
    """Put the origin of every sub-aperture into the middle of its phase centres (P, 3)."""
    for level in levels:
        for node in level.nodes:
            part = centres[node.pulses]
            node.centre = 0.5 * (part.min(axis=0) + part.max(axis=0))


def check_side(nodes: list[Node], edge) -> None:
    """Raise ValueError where a scene does not lie on one side of the track.

    Parameters
    ----------
    nodes : list of Node
        Sub-apertures with centres.
    edge : (E, 3) float64
        Outline of the scene in the frame, metres.
    """
    furthest, nearest = max(n.centre[1] for n in nodes), edge[:, 1].min()
    if nearest <= furthest:
        raise ValueError(f'the scene begins {nearest - furthest:.1f} m beside the track; fast '
                         'factorised backprojection needs it on one side; use exact '
                         'backprojection')


def widest_spacing(nodes: list[Node], points) -> float:
    """Spacing of directions that keeps the margins of a short sub-aperture near the scene."""
    origin = np.array([n.centre for n in nodes])[:, None]
    offset = points - origin
    alpha = offset[..., 0] / np.linalg.norm(offset, axis=-1)
    return max(float(np.ptp(alpha, axis=1).max()) / 2, _NARROW)


def half_bands(nodes: list[Node], tx, rx, points, radar: RadarParameters) -> tuple[float, float]:
    """Half the bandwidth of local images along range (rad/m) and direction (rad).

    They are the derivatives of the half path times the wavenumber, largest over the
    sub-apertures' pulses (their first and last among them) and over the scene.

    Parameters
    ----------
    nodes : list of Node
        Sub-apertures with centres.
    tx, rx : (P, C, 3) float64
        Phase centres in the frame, metres.
    points : (K, 3) float64
        Positions all over the scene, in the frame, metres.
    radar : RadarParameters
        Of the profiles.
    """
    share = np.linspace(0.0, 1.0, _PULSES_PER_NODE)
    start, stop = (np.array([[getattr(n.pulses, e)] for n in nodes]) for e in ('start', 'stop'))
    pulses = np.rint(start + share * (stop - 1 - start)).astype(int)
    origin = np.array([n.centre for n in nodes])[:, None]
    offset = points - origin  # (n, K, 3)
    r = np.linalg.norm(offset, axis=-1)
    alpha, ground = offset[..., 0] / r, offset[..., 1]
    zero = np.zeros_like(r)
    by_range = np.stack([alpha, r * (1 - alpha ** 2) / ground, zero], axis=-1)
    by_alpha = np.stack([r, -r ** 2 * alpha / ground, zero], axis=-1)
    slopes = 0.0
    for centres in (tx, rx):
        ray = points - centres[pulses].reshape(len(nodes), -1, 1, 3)  # (n, rows, K, 3)
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        slopes = slopes + 0.5 * np.array([np.einsum('nrkc,nkc->nrk', ray, d)
                                          for d in (by_range, by_alpha)])
    band = radar.half_band_rad_per_m
    k = radar.wavenumber_rad_per_m + band
    half_range = band * np.abs(slopes[0]).max() + k * np.abs(slopes[0] - 1).max()
    return _SAFETY * float(half_range), _SAFETY * float(k * np.abs(slopes[1]).max())


def plan_profiles(nodes: list[Node], frame: Frame, tx, rx, points, spacing: float,
                  radar: RadarParameters, n_samples: int, target_db: float
                  ) -> RangeResampling | None:
    """Lattice of the profiles for the first stage; its spacing is that of all local grids."""
    lengths, derivatives, span = [], [], 0.0
    for node in nodes[::max(1, len(nodes) // 8)]:
        offset = points - node.centre
        r = np.linalg.norm(offset, axis=-1)
        local = PolarGrid((0.0, 0.0, node.centre[2]), (1.0, 0.0), 1, frame.z_m,
                          abs(node.centre[2] - frame.z_m) + 1.0, 1.0, 1, 0.0, 1.0, 1)
        rows = [a[node.pulses].reshape(-1, 3) - [*node.centre[:2], 0.0] for a in (tx, rx)]
        paths = sample_paths(*rows, local.lines(r, offset[:, 0] / r))
        lengths.append(paths.length)
        derivatives.append(paths.derivatives)
        span = max(span, float(np.ptp(r)))
    joined = Paths(np.concatenate(lengths),
                   tuple(np.concatenate(d) for d in zip(*derivatives, strict=True)))
    return plan_resampling(joined, spacing, math.ceil(span / spacing) + LANES, radar, n_samples,
                        target_db, fit_spacing=True)


def place_grids(levels: list[Level], top: list[Node], edge, edge_step: float, spacing: float,
                taps: int) -> None:
    """Choose first range, direction and size of every local grid.

    Parameters
    ----------
    levels, top :
        The tree, with centres and spacings of direction.
    edge : (E, 3) float64
        Outline of the requested grid in the frame, metres.
    edge_step : float
        Distance of its samples, metres.
    spacing : float
        Range spacing, metres.
    taps : int
        Neighbours that the kernel reads.
    """
    beyond = taps // 2 + 1 + MARGIN
    more_range, more_alpha = 0.0, 0.0  # of the grids that read this level, beyond the scene
    offset = 0.0  # of their origins from those of their parts
    nearest = min(float(np.linalg.norm(edge - n.centre, axis=-1).min()) for n in levels[0].nodes)
    for level in reversed(levels):
        more_range, more_alpha = (
            more_range + more_alpha * offset + beyond * spacing,
            more_alpha * (1 + offset / nearest) + more_range * offset / nearest ** 2
            + beyond * level.alpha_spacing)
        for node in level.nodes:
            _place_grid(node, level, edge, edge_step, spacing, more_range, more_alpha)
        level.size = max((n.shape[0] * n.shape[1] for n in level.nodes), default=0)
        offset = max((float(np.linalg.norm(c.centre - n.centre)) for n in level.nodes
                      for c in n.children), default=0.0)


def _place_grid(node, level, edge, edge_step, spacing, more_range, more_alpha):
    offset = edge - node.centre
    r = np.linalg.norm(offset, axis=-1)
    alpha = offset[:, 0] / r
    # between two samples of the edge
    more_range = more_range + edge_step ** 2 / r.min()
    more_alpha = more_alpha + 2 * edge_step ** 2 / r.min() ** 2
    node.range_start = float(r.min() - more_range)
    node.alpha_start = float(alpha.min() - more_alpha)
    node.shape = (math.ceil((np.ptp(alpha) + 2 * more_alpha) / level.alpha_spacing) + 1,
                  math.ceil((np.ptp(r) + 2 * more_range) / spacing) + 1)
    steepest = max(abs(node.alpha_start), float(alpha.max() + more_alpha))
    height = abs(float(offset[0, 2]))
    if (offset[:, 1].min() <= more_range
            or node.range_start * math.sqrt(max(0.0, 1 - steepest ** 2)) <= height + spacing):
        raise ValueError(
            f'the scene begins {r.min():.1f} m from the sub-aperture of pulses '
            f'{node.pulses.start} to {node.pulses.stop - 1}, {height:.1f} m above it, at '
            f'direction cosines {alpha.min():.3f} to {alpha.max():.3f}: its grid would reach '
            'the ground below the antenna or the track; move the grid away or use exact '
            'backprojection')


def choose_segments(levels: list[Level], points, spacing: float, wavelength_m: float) -> None:
    """Longest segments along which the expansions of `ffbp_kernels.merge` are exact enough."""
    child_alpha = {id(n): lv.alpha_spacing for lv in levels for n in lv.nodes}
    for level in levels[1:]:
        if not level.nodes:
            continue
        some = level.nodes[::max(1, len(level.nodes) // _SAMPLED_NODES)]
        pairs = [(n, c) for n in some for c in n.children]
        spacings = np.array([child_alpha[id(c)] for _, c in pairs])[:, None]
        parent = np.array([n.centre for n, _ in pairs])[:, None]
        child = np.array([c.centre for _, c in pairs])[:, None]
        level.segment = next(
            (s for s in _SEGMENTS
             if _expands(points, parent, child, spacings, spacing, s, wavelength_m)), 0)


def _expands(points, parent, child, alpha_spacing, spacing, segment, wavelength_m) -> bool:
    """Whether the child's coordinates follow their expansions along a segment of the parent."""
    half = segment / 2 * spacing
    offset = points - parent
    r = np.linalg.norm(offset, axis=-1)
    alpha, height = offset[..., 0] / r, offset[..., 2]

    def coordinates(f):
        ground = np.sqrt(np.maximum((r + f) ** 2 * (1 - alpha ** 2) - height ** 2, 0.0))
        a, c = (r + f) * alpha, ground
        shift = parent - child
        rc = np.sqrt((a + shift[..., 0]) ** 2 + (c + shift[..., 1]) ** 2
                     + (height + shift[..., 2]) ** 2)
        return rc, (a + shift[..., 0]) / rc

    nodes = half * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    ranges, alphas = zip(*(coordinates(f) for f in nodes), strict=True)
    # the fourth difference over a segment is 4! (half / 2)^4 / 24 of the fourth derivative
    fourth = ranges[0] - 4 * ranges[1] + 6 * ranges[2] - 4 * ranges[3] + ranges[4]
    quartic = np.abs(fourth).max() * 16 / 24 * 2 / wavelength_m
    drift_range = np.abs(np.array([ranges[0] + half, ranges[4] - half])
                         - ranges[2]).max() / spacing
    drift_alpha = max(float((np.abs(a - alphas[2]) / alpha_spacing).max())
                      for a in (alphas[0], alphas[4])) * (1 + LANES / segment)
    return quartic <= _CUBIC_CYCLES and max(drift_range, drift_alpha) <= MARGIN
