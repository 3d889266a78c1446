# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures: what is drawn, at which size."""

import numpy as np
import pytest
from matplotlib.image import imread

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.tools.plots import grey_limits_db, save_image_png, save_values_png


def draw(path, image, grid, **options):
    save_image_png(path, image, grid, **options)
    return imread(path)


def panel_of(picture):
    """Grey values of the part of the picture that shows a mostly black image."""
    grey = picture[..., :3].mean(axis=-1)
    dark = grey < 0.1
    rows = np.flatnonzero(dark.mean(axis=1) > 0.4)
    columns = np.flatnonzero(dark.mean(axis=0) > 0.4)
    columns = columns[:np.argmax(np.diff(columns) > 1) + 1]  # the frame of the bar lies beyond
    return grey[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1]


def test_north_is_up_and_east_is_right(tmp_path):
    grid = MapGrid((0.0, 0.0, 0.0), 101, 101, 0.5)
    image = np.zeros(grid.shape, complex)
    image[5:15, 20:30] = 1j  # north, a little west
    panel = panel_of(draw(tmp_path / 'a.png', image, grid))
    rows, columns = np.nonzero(panel > 0.9)
    # the middle of the bright square, rows 9.5 and columns 24.5 of 101
    assert rows.mean() / panel.shape[0] == pytest.approx(10 / 101, abs=0.01)
    assert columns.mean() / panel.shape[1] == pytest.approx(25 / 101, abs=0.01)


@pytest.mark.parametrize('n_x, n_y', [(81, 401), (401, 81), (2000, 10), (7, 3000), (2, 2)])
def test_size_stays_sensible_for_any_shape(tmp_path, n_x, n_y):
    grid = MapGrid((10_000.0, -3.0, 0.0), n_x, n_y, 0.1)
    picture = draw(tmp_path / 'a.png', np.ones(grid.shape, np.complex64), grid, title='title')
    assert all(250 < n < 1600 for n in picture.shape[:2])


def test_large_images_are_averaged_in_power_not_thinned_out(tmp_path):
    grid = MapGrid((0.0, 0.0, 0.0), 3300, 3300, 0.1)
    image = np.zeros(grid.shape, np.float32)
    image[::3, ::3] = 1  # every block of three has the same power
    picture = draw(tmp_path / 'a.png', image, grid)
    height, width = picture.shape[:2]
    middle = picture[height // 3:height // 2, width // 3:width // 2, 0]
    assert middle.min() > 0.9


@pytest.mark.parametrize('fill', [0.0, np.nan])
def test_image_without_a_peak_is_black_not_an_error(tmp_path, fill):
    grid = MapGrid((0.0, 0.0, 0.0), 20, 20, 1.0)
    draw(tmp_path / 'a.png', np.full(grid.shape, fill), grid)


def test_scatterers_are_marked_inside_the_image_only(tmp_path):
    grid = MapGrid((0.0, 0.0, 0.0), 50, 50, 1.0)
    image = np.full(grid.shape, 1e-3)
    image[0, 0] = 1

    def coloured(truth):
        picture = draw(tmp_path / 'a.png', image, grid, truth=truth)
        return int((np.ptp(picture[..., :3], axis=-1) > 0.3).sum())

    assert coloured([]) == 0
    assert coloured([{'name': 'far', 'position_m': [99.0, 0.0, 0.0]}]) == 0
    assert coloured([{'name': 'near', 'position_m': [9.0, 0.0, 0.0]}]) > 50


def test_image_of_another_shape_is_refused(tmp_path):
    with pytest.raises(ValueError, match='does not match grid.shape'):
        draw(tmp_path / 'a.png', np.ones((3, 3)), MapGrid((0.0, 0.0, 0.0), 2, 3, 1.0))


def test_clutter_is_grey_however_bright_a_reflector_is():
    rng = np.random.default_rng(8)
    speckle = np.abs(rng.normal(size=(300, 400)) + 1j * rng.normal(size=(300, 400)))
    levels = []
    for reflector_db in (30.0, 50.0):
        image = speckle.copy()
        image[100:102, 200:202] = 10 ** (reflector_db / 20) * np.median(speckle)
        black_db, white_db = grey_limits_db(image)
        levels.append([reflector_db + black_db, reflector_db + white_db])
    black, white = np.transpose(levels)
    np.testing.assert_allclose(black, -10, atol=0.01)  # below the median
    # The tail of Rayleigh's distribution that holds 1 % of the amplitude begins 9 dB above the
    # median; of that percent four pixels of 50 dB hold up to four fifths.
    np.testing.assert_allclose(white, [9.0, 11.0], atol=1)


def test_few_points_are_shown_over_60_db():
    image = np.full((200, 200), 1e-5)
    image[20, 30] = image[150, 60] = 1
    assert grey_limits_db(image) == (-60, 0)
    assert grey_limits_db(np.zeros((4, 4))) == (-60, 0)


def test_values_are_drawn_with_what_is_marked(tmp_path):
    grid = MapGrid((0.0, 0.0, 0.0), 40, 30, 1.0)
    values, marked = np.full(grid.shape, 0.5), np.zeros(grid.shape, bool)
    marked[10:20, 10:20] = True
    values[:, 30:] = np.nan
    options = {'title': 'a', 'label': 'b', 'limits': (0.0, 1.0), 'colours': 'gray'}
    save_values_png(tmp_path / 'a.png', values, grid, marked=marked, **options)
    picture = imread(tmp_path / 'a.png')[..., :3]
    red = (picture[..., 0] > picture[..., 1] + 0.2).mean()
    grey = (np.abs(picture - 0.5).max(axis=-1) < 0.02).mean()
    # of 1200 pixels 100 are red, 800 grey and 300 white; the bar has greys of its own
    assert 0.7 < 8 * red / grey < 1.1
    with pytest.raises(ValueError, match='does not match'):
        save_values_png(tmp_path / 'b.png', values[1:], grid, **options)
