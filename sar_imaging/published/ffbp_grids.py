"""Polar grids of the sub-apertures of fast factorised backprojection: spacings and extents.

A grid is sampled as finely as the local frequencies of its image ask for. It covers the requested
grid and what the interpolation kernels of the levels above it reach beyond it.
"""

from __future__ import annotations

import math

import numpy as np

from ..geometry.grids import MapGrid
from ..geometry.half_paths import Paths, sample_paths
from ..geometry.polar import PolarGrid
from ..planning.profiles.range_resampling import RangeResampling, plan_resampling
from ..signal.radar import RadarParameters
from .ffbp_segments import LANES
from .ffbp_tree import Frame, Level, Node
from .neighbour_weights import MARGIN

_EDGE_SAMPLES = 33  # per edge of the requested grid
_PULSES_PER_NODE = 5  # whose paths bound the local frequencies
_NARROW = 0.01  # spacing of directions that any geometry allows
_SAFETY = 1.02  # of bandwidths, for what lies between the sampled pulses and positions


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


def widest_spacings(levels: list[list[Node]], points) -> list[float]:
    """Spacings of directions by level that keep the margins of short sub-apertures near the scene.

    Parameters
    ----------
    levels : list of lists of Node
        Sub-apertures with centres.
    points : (K, 3) float64
        Positions all over the scene, in the frame, metres.
    """
    along, _, _, r = _offsets(_centres(levels), points)
    spread = np.maximum.reduceat(np.ptp(along / r, axis=1), _firsts(levels))
    return np.maximum(spread / 2, _NARROW).tolist()


def half_bands(levels: list[list[Node]], tx, rx, points, radar: RadarParameters
               ) -> tuple[list[float], list[float]]:
    """Half the bandwidth of local images along range (rad/m) and direction (rad) by level.

    They are the derivatives of the half path times the wavenumber, largest over the
    sub-apertures' pulses (their first and last among them) and over the scene.

    Parameters
    ----------
    levels, points :
        As for `widest_spacings`.
    tx, rx : (P, C, 3) float64
        Phase centres in the frame, metres.
    radar : RadarParameters
        Of the profiles.
    """
    share = np.linspace(0.0, 1.0, _PULSES_PER_NODE)
    start, stop = (np.array([[getattr(n.pulses, e)] for nodes in levels for n in nodes])
                   for e in ('start', 'stop'))
    pulses = np.rint(start + share * (stop - 1 - start)).astype(int)
    slopes = local_slopes(_centres(levels),
                          *(a[pulses].reshape(len(pulses), -1, 3) for a in (tx, rx)), points)
    by_range, beside, by_alpha = (
        np.maximum.reduceat(np.abs(s).max(axis=(1, 2)), _firsts(levels))
        for s in (slopes[0], slopes[0] - 1, slopes[1]))
    band = radar.half_band_rad_per_m
    k = radar.wavenumber_rad_per_m + band
    return (_SAFETY * (band * by_range + k * beside)).tolist(), (_SAFETY * (k * by_alpha)).tolist()


def _centres(levels: list[list[Node]]) -> np.ndarray:
    """(N, 3) centres of all sub-apertures, level by level, metres."""
    return np.array([n.centre for nodes in levels for n in nodes])


def _firsts(levels: list[list[Node]]) -> np.ndarray:
    """(L,) number of the first sub-aperture of each level among them all."""
    return np.cumsum([0, *map(len, levels[:-1])])


def local_slopes(origins, tx, rx, points) -> np.ndarray:
    """Derivatives of half paths by range and direction from some origins.

    Parameters
    ----------
    origins : (N, 3) float64
        Of polar grids in the frame, metres.
    tx, rx : (N, R, 3) float64
        Phase centres that each of them is looked at with, metres.
    points : (K, 3) float64
        Positions on the ground, metres.

    Returns
    -------
    (2, N, R, K) float64
        By range, and by direction cosine, metres.
    """
    along, ground, _, r = _offsets(origins, points)
    alpha = along / r
    by_range = alpha, r * (1 - alpha ** 2) / ground
    by_alpha = r, -r ** 2 * alpha / ground
    slopes = 0.0
    for centres in (tx, rx):
        *ray, _, length = _offsets(centres, points)  # (N, R, K)
        u, v = (part / length for part in ray)
        slopes = slopes + 0.5 * np.array([u * a[:, None] + v * b[:, None]
                                          for a, b in (by_range, by_alpha)])
    return slopes


def _offsets(origins, points) -> tuple[np.ndarray, ...]:
    """Along track, across and up from origins (..., 3) to points (K, 3), and distance, metres."""
    along, across, up = (points[:, axis] - origins[..., axis, None] for axis in range(3))
    return along, across, up, np.sqrt(along * along + across * across + up * up)


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
        echoes = [a[node.pulses].reshape(-1, 3) - [*node.centre[:2], 0.0] for a in (tx, rx)]
        paths = sample_paths(*echoes, local.lines(r, offset[:, 0] / r))
        lengths.append(paths.length)
        derivatives.append(paths.derivatives)
        span = max(span, float(np.ptp(r)))
    joined = Paths(np.concatenate(lengths),
                   tuple(np.concatenate(d) for d in zip(*derivatives, strict=True)))
    return plan_resampling(joined, spacing, math.ceil(span / spacing) + LANES, radar, n_samples,
                        target_db, fit_spacing=True)


def place_grids(levels: list[list[Node]], top: list[Node], alpha_spacings: list[float],
                segments: list[int], edge, edge_step: float, spacing: float, taps: int
                ) -> tuple[tuple[Level, ...], tuple[Node, ...]]:
    """Choose first range, direction and size of every local grid.

    Parameters
    ----------
    levels, top :
        The tree.
    alpha_spacings, segments : list of float and int
        Of each level.
    edge : (E, 3) float64
        Outline of the requested grid in the frame, metres.
    edge_step : float
        Distance of its samples, metres.
    spacing : float
        Range spacing, metres.
    taps : int
        Neighbours that the kernel reads.

    Returns
    -------
    levels : tuple of Level
    top : tuple of Node
    """
    beyond = taps // 2 + 1 + MARGIN
    more_range, more_alpha = 0.0, 0.0  # of the grids that read this level, beyond the scene
    offset = 0.0  # of their origins from those of their parts
    nearest = float(_offsets(_centres(levels[:1]), edge)[-1].min())
    grids = {}  # of nodes
    for nodes, alpha_spacing in zip(reversed(levels), reversed(alpha_spacings), strict=True):
        more_range, more_alpha = (
            more_range + more_alpha * offset + beyond * spacing,
            more_alpha * (1 + offset / nearest) + more_range * offset / nearest ** 2
            + beyond * alpha_spacing)
        grids |= zip(nodes, _grids(nodes, edge, edge_step, (spacing, alpha_spacing),
                                   (more_range, more_alpha)), strict=True)
        away = [c.centre - n.centre for n in nodes for c in n.children]
        offset = float(np.linalg.norm(away, axis=-1).max()) if away else 0.0
    placed = {}
    for nodes in levels:  # parts before what is made of them
        for n in nodes:
            placed[n] = Node(n.pulses, n.level, tuple(placed[c] for c in n.children), n.centre,
                             *grids[n])
    return (tuple(Level(tuple(placed[n] for n in nodes), *shared) for nodes, *shared in
                  zip(levels, alpha_spacings, segments, strict=True)),
            tuple(placed[n] for n in top))


def _grids(nodes, edge, edge_step, spacings, more) -> list[tuple]:
    """First range, direction and shape of the grids of a level.

    `spacings` and `more` are those of range and direction.
    """
    (spacing, alpha_spacing), (more_range, more_alpha) = spacings, more
    along, across, up, r = _offsets(_centres([nodes]), edge)
    alpha = along / r
    r_lo, alpha_lo, alpha_hi = r.min(axis=1), alpha.min(axis=1), alpha.max(axis=1)
    # between two samples of the edge
    more_range = more_range + edge_step ** 2 / r_lo
    more_alpha = more_alpha + 2 * edge_step ** 2 / r_lo ** 2
    range_start, alpha_start = r_lo - more_range, alpha_lo - more_alpha
    steepest = np.maximum(np.abs(alpha_start), alpha_hi + more_alpha)
    height = np.abs(up[:, 0])
    ground = range_start * np.sqrt(np.maximum(0.0, 1 - steepest ** 2))
    below = (across.min(axis=1) <= more_range) | (ground <= height + spacing)
    if below.any():
        i = int(below.argmax())
        raise ValueError(
            f'the scene begins {r_lo[i]:.1f} m from the sub-aperture of pulses '
            f'{nodes[i].pulses.start} to {nodes[i].pulses.stop - 1}, {height[i]:.1f} m above it, '
            f'at direction cosines {alpha_lo[i]:.3f} to {alpha_hi[i]:.3f}: its grid would reach '
            'the ground below the antenna or the track; move the grid away or use exact '
            'backprojection')
    shape = [(np.ceil((extent + 2 * more) / step) + 1).astype(int).tolist() for extent, more, step
             in ((alpha_hi - alpha_lo, more_alpha, alpha_spacing),
                 (np.ptp(r, axis=1), more_range, spacing))]
    return list(zip(range_start.tolist(), alpha_start.tolist(), zip(*shape, strict=True),
                    strict=True))
