# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw radar images as pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patheffects import withStroke

from sar_imaging.geometry.grids import MapGrid

LONG_SIDE = 7.0  # inches of the image's longer side
SLIMMEST = 8.0  # ratio of the sides up to which the axes have equal scales
MARGINS = (0.85, 1.45, 0.7, 0.5)  # inches left, right (colour bar), below, above the image
NARROWEST = 5.0  # inches of the figure: the title must fit
DPI = 150
MAX_PIXELS = 1600  # along the longer side of what is drawn; finer images are multilooked
FAR_M = 1000.0  # axes with longer numbers are labelled from the middle of the grid
MOST_NAMES = 20  # more scatterers than these are marked without their names
MARK = '#ffb454'
CHANGED = '#ff4d4d'
WHITE_SHARE = 0.01  # of the summed amplitude that may lie in white pixels
BLACK_DB = 10.0  # below the median: 7 % of speckle lie lower
MOST_DB = 60.0  # from black to white
# Of PNG: half of the time of a picture for speckle's sake, which 6, the usual, packs no better.
COMPRESSION = 2


def save_image_png(path: Path | str, image: np.ndarray, grid: MapGrid, *,
                   truth: Sequence[dict[str, Any]] = (), title: str = '',
                   limits_db: tuple[float, float] | None = None, quantity: str | None = None
                   ) -> None:
    """Draw the magnitude of an image in decibels on axes in metres.

    Parameters
    ----------
    path : path
        PNG file to write.
    image : (n_y, n_x) complex or float
        Image on `grid`; decibels are relative to its brightest pixel.
    grid : MapGrid
        Pixel positions.
    truth : sequence of dict
        Scatterers to mark, each with ``name`` and ``position_m`` (x, y, z in metres).
    title : str
        Title line.
    limits_db : (2,) floats, optional
        Levels that are drawn black and white, dB relative to the brightest pixel; from
        `grey_limits_db` if left out.
    quantity : str, optional
        What the squared magnitude is, such as ``'sigma0'``: decibels are its own then.

    Raises
    ------
    ValueError
        The image does not have the shape of the grid.

    Examples
    --------
    >>> import os
    >>> import numpy as np
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.tools.plots import save_image_png
    >>> grid = MapGrid((100.0, 0.0, 0.0), 32, 32, 0.5)
    >>> noise = np.random.default_rng(1).standard_normal((32, 64)).view(complex)
    >>> save_image_png('image.png', noise, grid, title='noise')
    >>> os.path.getsize('image.png') > 1000
    True
    """
    image = np.asarray(image)
    grid.check_image(image)
    magnitude = _multilook(image)
    black_db, white_db = grey_limits_db(magnitude) if limits_db is None else limits_db
    level = _decibels(magnitude, black_db)
    peak_db = 0.0 if quantity is None or not magnitude.max() > 0 else (
        20 * math.log10(float(magnitude.max())))
    drawing = _Drawing(grid)
    figure, axes = drawing.figure, drawing.axes
    drawn = drawing.show(level + peak_db, cmap='gray', interpolation='bilinear',
                         norm=Normalize(black_db + peak_db, white_db + peak_db))
    for scatterer in truth:
        drawing.mark(scatterer['position_m'],
                     scatterer['name'] if len(truth) <= MOST_NAMES else '')
    slim = axes.get_position().width * figure.get_figwidth() < NARROWEST - sum(MARGINS[:2])
    low = drawing.bar.get_position().height * figure.get_figheight() < 2.5
    unit = 'dB relative to the brightest pixel' if quantity is None else f'{quantity}, dB'
    drawing.save(path, drawn, 'dB' if low else unit, title, centred=slim)


def save_values_png(path: Path | str, values: np.ndarray, grid: MapGrid, *, title: str, label: str,
                    limits: tuple[float, float], colours: str, marked: np.ndarray | None = None
                    ) -> None:
    """Draw values of a map in colours on axes in metres.

    Parameters
    ----------
    path : path
        PNG file to write.
    values : (n_y, n_x) float
        Values on `grid`; NaN, where there are none, stays white.
    grid : MapGrid
        Pixel positions.
    title, label : str
        Title line, and what the colour bar shows.
    limits : (2,) floats
        Values at the ends of the colour bar.
    colours : str
        Colour map of Matplotlib.
    marked : (n_y, n_x) bool, optional
        Pixels to lay red over.

    Raises
    ------
    ValueError
        The values do not have the shape of the grid.
    """
    values = np.asarray(values)
    grid.check_image(values)
    drawing = _Drawing(grid)
    drawing.axes.set_facecolor('white')
    drawn = drawing.show(values, cmap=colours, interpolation='nearest', norm=Normalize(*limits))
    if marked is not None:
        drawing.show(np.ma.masked_equal(marked, False), alpha=0.75, interpolation='nearest',
                     cmap=ListedColormap([CHANGED]))
    drawing.save(path, drawn, label, title)


class _Drawing:
    """A picture of a map: axes in metres and a colour bar."""

    def __init__(self, grid: MapGrid) -> None:
        (self._x_ref, x_label), (self._y_ref, y_label) = _axis('x', grid.x_m), _axis('y', grid.y_m)
        half = grid.spacing_m / 2
        self._extent = (grid.x_m[0] - half - self._x_ref, grid.x_m[-1] + half - self._x_ref,
                        grid.y_m[-1] - half - self._y_ref, grid.y_m[0] + half - self._y_ref)
        left, right, bottom, top = self._extent
        self.figure, self.axes, self.bar = _layout(right - left, top - bottom)
        self.axes.set(xlabel=x_label, ylabel=y_label)
        self.axes.tick_params(direction='out', labelsize=8)

    def show(self, values: np.ndarray, **style: Any) -> AxesImage:
        """Draw values over the whole map."""
        return self.axes.imshow(values, extent=self._extent, aspect='auto', **style)

    def mark(self, position_m: Sequence[float], name: str) -> None:
        """Thin circle around a true position, its name beside it; nothing outside the image."""
        left, right, bottom, top = self._extent
        x, y = position_m[0] - self._x_ref, position_m[1] - self._y_ref
        if not (left <= x <= right and bottom <= y <= top):
            return
        self.axes.plot(x, y, 'o', markersize=11, markerfacecolor='none', markeredgecolor=MARK,
                       markeredgewidth=0.7)
        to_left = x > left + 0.75 * (right - left)
        self.axes.annotate(
            name, (x, y), xytext=(-6 if to_left else 6, 7), textcoords='offset points',
            ha='right' if to_left else 'left', va='center', color=MARK, fontsize=7,
            path_effects=[withStroke(linewidth=1.2, foreground='black')])

    def save(self, path: Path | str, drawn: AxesImage, label: str, title: str, *,
             centred: bool = False) -> None:
        """Write the picture, with the colours of what was drawn in the bar."""
        self.axes.set(xlim=self._extent[:2], ylim=self._extent[2:])
        self.axes.annotate(title, (0.5 if centred else 0, 1), xytext=(0, 9),
                           xycoords='axes fraction', textcoords='offset points', fontsize=10,
                           ha='center' if centred else 'left')
        bar = self.figure.colorbar(drawn, cax=self.bar)
        bar.set_label(label, fontsize=9)
        bar.ax.tick_params(labelsize=8)
        self.figure.savefig(path, dpi=DPI, pil_kwargs={'compress_level': COMPRESSION})


def _multilook(image: np.ndarray) -> np.ndarray:
    """Magnitude, averaged in power over square blocks when there are too many pixels to draw."""
    factor = math.ceil(max(image.shape) / MAX_PIXELS)
    rows, columns = (max(1, n // factor) for n in image.shape)
    if factor == 1 or rows * factor > image.shape[0] or columns * factor > image.shape[1]:
        return np.abs(image)
    blocks = image[:rows * factor, :columns * factor].reshape(rows, factor, columns, factor)
    return np.sqrt(np.mean(np.abs(blocks) ** 2, axis=(1, 3), dtype=float))


def grey_limits_db(magnitude: np.ndarray) -> tuple[float, float]:
    """Levels to draw black and white so that clutter is grey beside any reflector.

    The brightest pixels that together hold a hundredth of the summed amplitude are white. In an
    image of few points those are the points; in clutter they are reflectors, however bright, and
    what is beside them keeps its shades.

    Parameters
    ----------
    magnitude : (n_y, n_x) float
        Image, not negative.

    Returns
    -------
    black_db, white_db : float
        Relative to the brightest pixel, dB: black is 10 dB below the median, at most 60 dB below
        white.
    """
    falling = np.sort(np.asarray(magnitude, float), axis=None)[::-1]
    peak = falling[0]
    if not (math.isfinite(peak) and peak > 0):
        return -MOST_DB, 0.0
    share = np.cumsum(falling) / falling.sum()
    white_db = 20 * math.log10(falling[np.searchsorted(share, WHITE_SHARE)] / peak)
    median = falling[falling.size // 2] / peak
    black_db = 20 * math.log10(median) - BLACK_DB if median > 0 else -math.inf
    return max(black_db, white_db - MOST_DB), white_db


def _decibels(magnitude: np.ndarray, black_db: float) -> np.ndarray:
    """Decibels relative to the maximum, no lower than black."""
    peak = float(magnitude.max())
    if not (math.isfinite(peak) and peak > 0):
        return np.full(magnitude.shape, black_db)
    return 20 * np.log10(np.maximum(magnitude / peak, 10 ** (black_db / 20)))


def _axis(name: str, values: np.ndarray) -> tuple[float, str]:
    """Offset to subtract from an axis and its label."""
    if max(abs(values[0]), abs(values[-1])) < FAR_M:
        return 0.0, f'{name} (m)'
    middle = round(float(values[0] + values[-1]) / 2)
    sign = '\N{MINUS SIGN}' if middle >= 0 else '+'
    number = f'{abs(middle):,}'.replace(',', '\N{THIN SPACE}')
    return float(middle), f'{name} {sign} {number} m  (m)'


def _layout(width_m: float, height_m: float) -> tuple[Figure, Axes, Axes]:
    """Figure, axes of the image and axes of the colour bar, with equal scales where possible."""
    left, right, bottom, top = MARGINS
    longest = max(width_m, height_m)
    width = LONG_SIDE * max(width_m / longest, 1 / SLIMMEST)
    height = LONG_SIDE * max(height_m / longest, 1 / SLIMMEST)
    bar_height = max(height, 1.4)  # a low image gets a bar that its labels fit
    total_w = max(left + width + right, NARROWEST)
    total_h = bottom + bar_height + top
    figure = Figure(figsize=(total_w, total_h))
    left += (total_w - left - width - right) / 2  # a slim image stands under its title
    axes = figure.add_axes((left / total_w, bottom / total_h, width / total_w, height / total_h))
    bar = figure.add_axes(((left + width + 0.2) / total_w, bottom / total_h, 0.16 / total_w,
                           bar_height / total_h))
    return figure, axes, bar
