"""Plan of an image of one aperture by fast factorised backprojection (FFBP).

Ulander, Hellsten & Stenström, IEEE Trans. AES 39, 2003; Zhang et al., section II.A and figure 2a.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..geometry.grids import MapGrid
from ..geometry.half_paths import half_paths
from ..geometry.polar import PolarGrid
from ..geometry.track_frame import side_of
from ..memory import IMAGE_BYTES
from ..planning.costs import costs
from ..planning.error_budget import total_db
from ..planning.plan import Plan
from ..planning.profiles.profile_reach import (
    check_reach,
    covered_ranges,
    reach_warnings,
    some_pixels,
)
from ..planning.profiles.range_gate import RangeGate
from ..planning.profiles.range_resampling import ECHOES_PER_PASS, RangeResampling
from ..signal.radar import RadarParameters
from .ffbp_error import LocalTones, expansion_error, read_errors, rounding_error
from .ffbp_geometry import FfbpGeometry
from .ffbp_grids import place_grids, plan_profiles
from .ffbp_segments import LANES, Segment, choose_segment
from .ffbp_tree import Frame, Level, Node
from .neighbour_weights import TAPS

ENDS = 'ends of profiles'  # the cause that no sampling helps

# A few dozen scatterers are by chance darker than their pulses; bright parts that are small are
# read at some places between samples only.
_CHANCE_DB = 2.0
_LEAST = 1e-20  # mean squared error
_ECHOES = 33  # whose profiles' ends are looked at


@dataclasses.dataclass(frozen=True)
class FfbpSampling:
    """How local images are sampled and read, and how well profiles are read to make them.

    Attributes
    ----------
    kernel : str
        A key of `neighbour_weights.TAPS`.
    oversampling : (float, float)
        Samples per reciprocal bandwidth along range and direction.
    first_stage_db : float
        Largest error of the first local images, dB.
    """

    kernel: str
    oversampling: tuple[float, float]
    first_stage_db: float = -75.0


@dataclasses.dataclass(frozen=True, eq=False)
class FfbpPlan(Plan):
    """How the image of an aperture is formed by FFBP.

    Attributes
    ----------
    grid : MapGrid or PolarGrid
        Where the pixels are.
    radar : RadarParameters
        Of the compressed profiles.
    n_samples : int
        Samples of each profile.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres that it is for, metres.
    sampling : FfbpSampling
        Of the local images.
    frame : Frame
        Track direction and plane that all local grids share.
    levels : tuple of Level
        Sub-apertures and their grids, shortest first.
    top : tuple of Node
        Sub-apertures from which the image is made at last.
    lattice : RangeResampling
        Of the profiles; its spacing is the range spacing of all local grids.
    range_m : (float, float)
        Bounds of the half path over all first images, metres.
    errors_db : mapping of str to float
        Predicted error against time-domain correlation by cause, dB, of a scene that is evenly
        bright.
    warnings : tuple of str
        What makes the image worse than predicted.
    """

    grid: MapGrid | PolarGrid
    radar: RadarParameters
    n_samples: int
    tx_m: np.ndarray
    rx_m: np.ndarray
    sampling: FfbpSampling
    frame: Frame
    levels: tuple[Level, ...]
    top: tuple[Node, ...]
    lattice: RangeResampling
    range_m: tuple[float, float]
    errors_db: Mapping[str, float]
    warnings: tuple[str, ...]

    @property
    def range_spacing_m(self) -> float:
        """Range spacing of all local grids, metres."""
        return self.lattice.spacing

    def polar_grid(self, node: Node) -> PolarGrid:
        """Pixels of a sub-aperture's own image, in the imaging frame."""
        frame = self.frame
        return PolarGrid(frame.leave(node.centre), tuple(frame.track),
                         side_of(frame.track, frame.across), frame.z_m, node.range_start,
                         self.range_spacing_m, node.shape[1], node.alpha_start,
                         self.levels[node.level].alpha_spacing, node.shape[0])

    @property
    def operations(self) -> dict[str, float]:
        """How often the operations of `CostModel` are done."""
        taps, counts = TAPS[self.sampling.kernel], {'image': 1.0}
        n_echoes = self.tx_m.shape[0] * self.tx_m.shape[1]
        first = sum(_pixels(n) * (n.pulses.stop - n.pulses.start) for n in self.levels[0].nodes)
        counts |= self.lattice.operations(n_echoes, first / len(self.tx_m))
        merged, gathered = 0.0, len(self.top) * math.prod(self.grid.shape)
        for level in self.levels:
            read = sum(_pixels(n) * len(n.children) for n in level.nodes)
            if level.segment:
                merged += read * (1 + LANES / level.segment)
            else:
                gathered += read
        return counts | {'merged_pixel': merged, 'merged_tap': merged * taps,
                         'gathered_pixel': gathered, 'gathered_tap': gathered * taps}

    @property
    def seconds(self) -> float:
        """Predicted time on one thread."""
        return costs().seconds(self.operations)

    @property
    def n_bytes(self) -> int:
        """Memory that forming the image takes: itself, one per level, and some profiles, bytes."""
        lattice = self.lattice
        profiles = (min(ECHOES_PER_PASS, self.tx_m.shape[0] * self.tx_m.shape[1]) * 4
                    * lattice.interpolator.n_planes * lattice.n_phases * lattice.n_cells)
        return profiles + IMAGE_BYTES * (math.prod(self.grid.shape)
                                         + sum(level.size for level in self.levels))

    def __str__(self) -> str:
        counts = ', '.join(str(len(level.nodes)) for level in self.levels)
        along_range, along_alpha = self.sampling.oversampling
        return (f'local images of {counts} sub-apertures, kernel {self.sampling.kernel}, '
                f'oversampled {along_range:.2f} times along range and {along_alpha:.2f} along '
                'direction')


def _pixels(node: Node) -> int:
    return node.shape[0] * node.shape[1]


def plan_from_geometry(grid: MapGrid | PolarGrid, radar: RadarParameters, n_samples: int, tx_m,
                       rx_m, geometry: FfbpGeometry, tones: LocalTones, sampling: FfbpSampling
                       ) -> FfbpPlan:
    """Plan with a given tree and sampling.

    Parameters
    ----------
    grid, radar, n_samples, tx_m, rx_m :
        As `FfbpPlan` has them.
    geometry : FfbpGeometry
        Of the aperture.
    tones : LocalTones
        Of the geometry.
    sampling : FfbpSampling
        Of the local images.

    Raises
    ------
    ValueError
        The scene is too near, or no profile reaches it.
    """
    levels, frame, inside = geometry.levels, geometry.frame, geometry.inside
    lattice = plan_profiles(levels[0], frame, geometry.tx, geometry.rx, inside,
                            geometry.range_spacing(sampling.oversampling[0]), radar, n_samples,
                            sampling.first_stage_db)
    if lattice is None:
        raise ValueError('range does not follow the lines of the local polar grids closely '
                         f'enough: sub-apertures of {levels[0][0].pulses.stop} pulses are too '
                         'long for a scene this near; use fewer pulses_per_subaperture')
    alpha_spacings = geometry.alpha_spacings(sampling.oversampling[1])
    segments = [choose_segment(nodes, alpha_spacings, inside, lattice.spacing,
                               radar.wavelength_m) for nodes in levels]
    placed, top = place_grids(levels, geometry.top, alpha_spacings, [s.length for s in segments],
                              geometry.edge, geometry.edge_step, lattice.spacing,
                              TAPS[sampling.kernel])
    range_m = _reach(placed[0].nodes, geometry, lattice.spacing)
    check_reach(range_m, radar, n_samples)
    start, stop = covered_ranges(radar, n_samples)
    within = start <= range_m[0] and range_m[1] <= stop
    warnings = () if within else reach_warnings(some_pixels(grid), tx_m, rx_m, radar, n_samples)
    errors = _errors_db(geometry, radar, RangeGate.whole(radar, n_samples), tones, sampling,
                        lattice, alpha_spacings, segments)
    return FfbpPlan(grid, radar, n_samples, tx_m.copy(), rx_m.copy(), sampling, frame, placed,
                    top, lattice, range_m, errors, warnings)


def _reach(nodes: Sequence[Node], geometry: FfbpGeometry, spacing: float) -> tuple[float, float]:
    """Bounds of the half path over all first images, metres."""
    first = [n.pulses.start for n in nodes]
    centres = np.repeat([n.centre for n in nodes], np.diff([*first, nodes[-1].pulses.stop]),
                        axis=0)[:, None]
    path = 0.5 * sum(np.linalg.norm(a - centres, axis=-1) for a in (geometry.tx, geometry.rx))
    away = np.maximum.reduceat(path.max(axis=1), first)
    start = np.array([n.range_start for n in nodes])
    stop = start + np.array([n.shape[1] for n in nodes]) * spacing
    return float((start - away).min()), float((stop + away).max())


def _errors_db(geometry, radar, window, tones, sampling, lattice, alpha_spacings, segments
               ) -> dict[str, float]:
    reading = reading_segments(geometry, segments)
    spacings = [lattice.spacing] * len(segments), alpha_spacings
    *each, both = read_errors(tones, (0, 1), sampling.kernel, sampling.oversampling, spacings,
                              reading)
    shares = both / max(sum(each), _LEAST)  # losses along the two add up in amplitude
    cycles = 2 * lattice.spacing / radar.wavelength_m
    echoes = np.linspace(0, geometry.tx[..., 0].size - 1, _ECHOES).round().astype(int)
    length = half_paths(*(a.reshape(-1, 3)[echoes] for a in (geometry.tx, geometry.rx)),
                        geometry.inside)[0]
    errors = {'sub-aperture images': lattice.predicted_error_db}
    errors |= {cause: 10 * math.log10(max(error, _LEAST)) for cause, error in (
        ('interpolated ranges', each[0] * shares), ('interpolated directions', each[1] * shares),
        ('expanded geometry', expansion_error(segments)),
        ('rounded places', rounding_error(segments, cycles)))}
    whole = total_db(*errors.values())
    return errors | {'chance': whole + 10 * math.log10(10 ** (_CHANCE_DB / 10) - 1),
                     ENDS: window.mean_end_error_db(
                         length, oversampling=lattice.oversampling(radar))}


def reading_segments(geometry: FfbpGeometry, segments: Sequence[Segment]) -> list[Segment]:
    """Segments by which the images of each level are read, from those that it is merged along."""
    found = [Segment()] * len(segments)
    for nodes, segment in zip(geometry.levels, segments, strict=True):
        for level in {child.level for node in nodes for child in node.children}:
            found[level] = segment
    return found
