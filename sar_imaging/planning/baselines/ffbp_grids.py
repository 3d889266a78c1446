"""Polar grids of the sub-apertures of fast factorised backprojection: spacings and extents.

A grid is sampled as finely as the local frequencies of its image ask for. It covers the requested
grid and what the interpolation kernels of the levels above it reach beyond it.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from ..profiles.range_resampling import Paths, RangeResampling, plan_resampling, sample_paths
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
    slopes = local_slopes(np.array([n.centre for n in nodes]),
                          *(a[pulses].reshape(len(nodes), -1, 3) for a in (tx, rx)), points)
    band = radar.half_band_rad_per_m
    k = radar.wavenumber_rad_per_m + band
    half_range = band * np.abs(slopes[0]).max() + k * np.abs(slopes[0] - 1).max()
    return _SAFETY * float(half_range), _SAFETY * float(k * np.abs(slopes[1]).max())


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
    offset = points - origins[:, None]  # (N, K, 3)
    r = np.linalg.norm(offset, axis=-1)
    alpha, ground = offset[..., 0] / r, offset[..., 1]
    zero = np.zeros_like(r)
    by_range = np.stack([alpha, r * (1 - alpha ** 2) / ground, zero], axis=-1)
    by_alpha = np.stack([r, -r ** 2 * alpha / ground, zero], axis=-1)
    slopes = 0.0
    for centres in (tx, rx):
        ray = points - centres[:, :, None]  # (N, R, K, 3)
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        slopes = slopes + 0.5 * np.array([np.einsum('nrkc,nkc->nrk', ray, d)
                                          for d in (by_range, by_alpha)])
    return slopes


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
    nearest = min(float(np.linalg.norm(edge - n.centre, axis=-1).min()) for n in levels[0])
    grids = {}  # of nodes
    for nodes, alpha_spacing in zip(reversed(levels), reversed(alpha_spacings), strict=True):
        more_range, more_alpha = (
            more_range + more_alpha * offset + beyond * spacing,
            more_alpha * (1 + offset / nearest) + more_range * offset / nearest ** 2
            + beyond * alpha_spacing)
        for node in nodes:
            grids[node] = _grid(node, edge, edge_step, (spacing, alpha_spacing),
                                (more_range, more_alpha))
        offset = max((float(np.linalg.norm(c.centre - n.centre)) for n in nodes
                      for c in n.children), default=0.0)
    placed = {}
    for nodes in levels:  # parts before what is made of them
        for node in nodes:
            placed[node] = dataclasses.replace(
                node, children=tuple(placed[child] for child in node.children), **grids[node])
    return (tuple(Level(tuple(placed[n] for n in nodes), *shared) for nodes, *shared in
                  zip(levels, alpha_spacings, segments, strict=True)),
            tuple(placed[n] for n in top))


def _grid(node, edge, edge_step, spacings, more) -> dict:
    """First range, direction and shape of a grid; `spacings` and `more` of range and direction."""
    (spacing, alpha_spacing), (more_range, more_alpha) = spacings, more
    offset = edge - node.centre
    r = np.linalg.norm(offset, axis=-1)
    alpha = offset[:, 0] / r
    # between two samples of the edge
    more_range = more_range + edge_step ** 2 / r.min()
    more_alpha = more_alpha + 2 * edge_step ** 2 / r.min() ** 2
    range_start = float(r.min() - more_range)
    alpha_start = float(alpha.min() - more_alpha)
    steepest = max(abs(alpha_start), float(alpha.max() + more_alpha))
    height = abs(float(offset[0, 2]))
    if (offset[:, 1].min() <= more_range
            or range_start * math.sqrt(max(0.0, 1 - steepest ** 2)) <= height + spacing):
        raise ValueError(
            f'the scene begins {r.min():.1f} m from the sub-aperture of pulses '
            f'{node.pulses.start} to {node.pulses.stop - 1}, {height:.1f} m above it, at '
            f'direction cosines {alpha.min():.3f} to {alpha.max():.3f}: its grid would reach '
            'the ground below the antenna or the track; move the grid away or use exact '
            'backprojection')
    return {'range_start': range_start, 'alpha_start': alpha_start,
            'shape': (math.ceil((np.ptp(alpha) + 2 * more_alpha) / alpha_spacing) + 1,
                      math.ceil((np.ptp(r) + 2 * more_range) / spacing) + 1)}
