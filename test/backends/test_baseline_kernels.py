"""Kernels of FFBP and of the wavenumber imager against their formulas."""

import math

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cpu.baselines import ffbp_kernels as ffbp
from sar_imaging.backends.cpu.baselines.stolt import SlantImage, spread
from sar_imaging.backends.reference.factorised import carrier, read_neighbours
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.geometry.straight_track import StraightTrack
from sar_imaging.planning.baselines.ffbp_segments import LANES
from sar_imaging.planning.baselines.neighbour_weights import TAPS, kernel_weights

SEEDS = st.integers(0, 2 ** 32)
KERNELS = st.sampled_from(sorted(TAPS))


def local_image(rng, polar):
    """Noise on a grid, as kernels take it and as complex numbers."""
    flat = rng.standard_normal(2 * polar.n_alpha * polar.n_range + ffbp.PADDING)
    flat = flat.astype(np.float32)
    real, imag = flat[:-ffbp.PADDING].reshape(2, polar.n_alpha, polar.n_range).astype(float)
    return flat, real + 1j * imag


@settings(max_examples=30)
@given(seed=SEEDS, kernel=KERNELS, n_x=st.integers(1, 80), n_y=st.integers(1, 30),
       polar_target=st.booleans())
def test_local_images_are_added_to_any_grid(seed, kernel, n_x, n_y, polar_target):
    rng = np.random.default_rng(seed)
    local = PolarGrid((1.0, -2.0, 30.0), (0.6, 0.8), -1, 0.0, 480.0, 0.4, 140, -0.06, 1e-3, 120)
    flat, image = local_image(rng, local)
    wavelength_m, turn = rng.uniform(0.02, 0.3), rng.uniform(0, 0.5)
    weights = kernel_weights(kernel, 1.5)
    middle = local.lines(508.0, 0.0)[0]
    if polar_target:
        beside = PolarGrid((1.3, -1.6, 29.0), (0.6, 0.8), -1, 0.0, 500.0, 0.17, n_x, -0.02, 1e-3,
                           n_y)
        grid = [*beside.origin_m[:2], beside.height_m, *beside.track, *beside.across,
                beside.range_start_m, beside.range_spacing_m, beside.alpha_start,
                beside.alpha_spacing]
        points = beside.lines(beside.range_m, beside.alpha[:, None])[0]
    else:
        target = MapGrid((middle[0] + rng.random(), middle[1], 0.0), n_x, n_y, 0.23)
        grid = [target.x_m[0], target.y_m[0], target.spacing_m, -target.spacing_m]
        points = target.points()
    geometry = np.array([*local.origin_m[:2], local.height_m, *local.track, local.range_start_m,
                         local.range_spacing_m, local.alpha_start, local.alpha_spacing,
                         2 / wavelength_m, turn])
    added = rng.standard_normal((n_y, n_x, 2)).astype(np.float32)
    before = added.astype(float).view(complex)[..., 0]
    groups = min(n_y, 4) * ffbp.PIXELS
    table = np.ascontiguousarray(weights.T).reshape(-1)
    ffbp.add_to_grid(flat, (local.n_alpha, local.n_range), geometry, np.array(grid),
                     np.array([n_y, n_x, 2 * n_x, 2, 1]), table, table, len(weights),
                     added.reshape(-1), *np.empty((2, groups)), np.empty(groups, np.int64),
                     *np.empty((4, groups), np.float32))
    r, alpha = local.from_map(points[..., 0], points[..., 1])
    wanted = before + (read_neighbours(image, local, r, alpha, weights, weights)
                       * carrier(r - local.range_start_m, wavelength_m)
                       * np.exp(-2j * np.pi * turn * np.arange(n_x)))
    # float32 positions between neighbours, and sine polynomials
    error = np.linalg.norm(added.astype(float).view(complex)[..., 0] - wanted)
    assert error <= 3e-5 * (np.linalg.norm(wanted) + np.sqrt(wanted.size))


@settings(max_examples=30)
@given(seed=SEEDS, kernel=KERNELS, n_range=st.integers(1, 90), n_alpha=st.integers(1, 20),
       add=st.booleans())
def test_local_images_are_merged(seed, kernel, n_range, n_alpha, add):
    """Far away both grids run side by side: segments of 16 pixels need no expansion."""
    rng = np.random.default_rng(seed)
    step_m, wavelength_m = 0.4, rng.uniform(0.02, 0.3)
    child = PolarGrid((0.0, 0.0, 800.0), (1.0, 0.0), 1, 0.0, 1e5, step_m, 160, -0.01, 1e-4, 200)
    offset = rng.uniform(-3.0, 3.0, 3)
    parent = PolarGrid(tuple(np.array(child.origin_m) - offset), (1.0, 0.0), 1, 0.0,
                       1e5 + 20.0 + rng.random(), step_m, n_range, -0.005, 3e-4, n_alpha)
    flat, image = local_image(rng, child)
    weights = kernel_weights(kernel, 1.5)
    pairs, segment = ffbp.paired(weights), 16
    geometry = np.array([offset[0], offset[1], parent.height_m, child.height_m, step_m,
                         parent.range_start_m, child.range_start_m, parent.alpha_start,
                         parent.alpha_spacing, child.alpha_start, child.alpha_spacing,
                         2 * step_m / wavelength_m])
    width = segment + LANES
    merged, before = local_image(rng, parent)
    ffbp.merge(flat, (200, 160), merged, (n_alpha, n_range), geometry, pairs, pairs,
               len(weights) // 2, segment, np.arange(width, dtype=np.float32), int(not add),
               *np.empty((5, min(n_alpha, 4) * width), np.float32))
    points = parent.lines(parent.range_m, parent.alpha[:, None])[0]
    r, alpha = child.from_map(points[..., 0], points[..., 1])
    # at the range baseband of the parent, whose first range is another
    beyond_m = r - child.range_start_m - step_m * np.arange(n_range)
    wanted = (read_neighbours(image, child, r, alpha, weights, weights)
              * carrier(beyond_m, wavelength_m))
    wanted = wanted + before if add else wanted
    size = n_alpha * n_range
    real, imag = merged[:2 * size].astype(float).reshape(2, n_alpha, n_range)
    # float32; polynomials of neighbouring intervals, which a segment reads a little beyond
    error = np.linalg.norm(real + 1j * imag - wanted)
    assert error <= 2e-4 * (np.linalg.norm(wanted) + np.sqrt(wanted.size))


@settings(max_examples=30)
@given(seed=SEEDS, n_rows=st.integers(1, 4), n=st.integers(1, 60), half=st.integers(1, 8))
def test_values_are_spread_by_a_windowed_sinc(seed, n_rows, n, half):
    """Rosenberg & Gray, equation 11: Hamming window over `taps` samples around each place."""
    rng = np.random.default_rng(seed)
    taps, n_out = 2 * half, 120
    place = rng.uniform(taps, n_out - taps, (n_rows, n))
    place[0, 0] = np.rint(place[0, 0])  # a sample itself
    values = rng.standard_normal((n_rows, n, 2)).view(complex)[..., 0]
    out = np.zeros((n_rows, n_out), np.complex64)
    spread(values, place, taps, out)
    t = place[..., None] - np.arange(n_out)
    first = np.floor(place)[..., None] - half + 1
    inside = (np.arange(n_out) >= first) & (np.arange(n_out) < first + taps)
    window = np.where(inside, 0.54 + 0.46 * np.cos(2 * np.pi * t / taps), 0.0)
    wanted = np.einsum('rn,rnj->rj', values, window * np.sinc(t))
    # complex64 sums
    assert np.linalg.norm(out - wanted) <= 1e-6 * np.linalg.norm(wanted)


@settings(max_examples=30)
@given(seed=SEEDS, n_y=st.integers(1, 12), n_x=st.integers(1, 12), rows=st.integers(1, 20),
       columns=st.integers(1, 20))
def test_pixels_of_a_slant_plane_image(seed, n_y, n_x, rows, columns):
    """``sum_yx F_yx exp(j k_y (y - Y_c) + j k_x (x - X_c))``, written out."""
    rng = np.random.default_rng(seed)
    spectrum = rng.standard_normal((rows, columns, 2)).astype(np.float32)
    spectrum = spectrum.view(np.complex64)[..., 0]
    turn = rng.uniform(0, 2 * math.pi)
    track = StraightTrack(np.array([1.0, -2.0, 40.0]),
                          np.array([math.cos(turn), math.sin(turn), 0.0]), 1.0, 1, np.zeros(1))
    grid = MapGrid((60.0, 20.0, 0.0), n_x, n_y, 0.7)
    offset = grid.points() - track.origin_m
    along = offset @ track.direction
    distance = np.linalg.norm(offset - along[..., None] * track.direction, axis=-1)
    centre = float(along.mean()), float(distance.mean())
    first, steps = rng.uniform(-20, 20, 2), rng.uniform(0.05, 0.2, 2)
    scale = complex(*rng.standard_normal(2))
    image = SlantImage.from_spectrum(spectrum, first, steps, centre).read(grid, track, scale)
    k_y, k_x = (f + s * np.arange(n) for f, s, n in zip(first, steps, spectrum.shape, strict=True))
    wanted = np.einsum('kl,kyx,lyx->yx', spectrum, np.exp(
        1j * np.multiply.outer(k_y, along - centre[0])), np.exp(
            1j * np.multiply.outer(k_x, distance - centre[1])))
    wanted = wanted * scale * np.sqrt(distance)
    # The kernel of non-uniform transforms errs by 1e-5 of all terms together (rms).
    allowed = 1e-4 * abs(scale) * np.linalg.norm(spectrum) * np.sqrt(distance.max() * grid.n_x
                                                                     * grid.n_y)
    assert np.linalg.norm(image - wanted) <= allowed
