"""Phases of the channels of an array across the track, by the sharpness of their common image.

Across the track the phases of channels tell the direction of a scatterer as well as errors: a
phase that grows in proportion to the place in the array turns the image, whatever the scene. What
no such line explains is error. The phases are those with which the image of all channels is
sharpest.
"""

from __future__ import annotations

import math

import numpy as np

FEWEST = 4  # channels: a line explains two, and a third beside it could be any of the three
_STARTS, _STEPS = 7, 60
_ON_LINE_RAD = math.radians(30.0)
_LINES = 721
_MOST_PIXELS = 4000  # the brightest ones
_MOST_OFF = 0.34  # of the channels
_SHARPER = 1.15  # with the errors undone


def array_phases(images: np.ndarray, places_m: np.ndarray) -> np.ndarray:
    """Phases of channels besides a line over their places.

    Parameters
    ----------
    images : (C, K) complex128
        Of each channel alone, at the same pixels.
    places_m : (C,) float64
        Along the array, metres.

    Returns
    -------
    (C,) float64
        Radians; 0 where undoing them makes the image no sharper.
    """
    power = np.square(np.abs(images)).sum(axis=0)
    images = images[:, np.argsort(-power)[:_MOST_PIXELS]]
    best = max((_ascended(images, turns) for turns in _starts(len(images))),
               key=lambda turns: _sharpness(images, turns))
    phases = _besides_line(np.angle(best), places_m)
    if np.mean(np.abs(phases) > _ON_LINE_RAD) > _MOST_OFF:
        return np.zeros(len(images))  # there is no line
    gain = _sharpness(images, best) / _sharpness(images, best * np.exp(-1j * phases))
    return phases if gain > _SHARPER else np.zeros(len(images))


def _starts(n: int) -> np.ndarray:
    """(S, C) turns from which the sharpest image is looked for: as they are, and at random."""
    rng = np.random.default_rng(0)
    return np.exp(2j * np.pi * np.vstack([np.zeros(n), rng.random((_STARTS - 1, n))]))


def _ascended(images: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """(C,) turns after steps that each make the image (C, K) sharper.

    The sharpness grows with the sum over the pixels of ``|S|^2 Re(t_c* f_c S*)``, S being the
    image; the turn t_c that makes it largest is that of ``f_c |S|^2 S*``.
    """
    for _ in range(_STEPS):
        image = turns.conj() @ images
        turns = images @ (np.square(np.abs(image)) * image.conj())
        turns = turns / np.maximum(np.abs(turns), 1e-300)
    return turns


def _sharpness(images: np.ndarray, turns: np.ndarray) -> float:
    """Mean square of the intensity over its squared mean without coherence."""
    image = turns.conj() @ images
    return float(np.mean(np.abs(image) ** 4)
                 / max(np.mean(np.square(np.abs(images)).sum(axis=0)) ** 2, 1e-300))


def _besides_line(phases: np.ndarray, places_m: np.ndarray) -> np.ndarray:
    """Phases (C,) less the line on which most of them lie, radians from -pi to pi."""
    order = np.sort(places_m)
    pitch = np.min(np.diff(order)[np.diff(order) > 1e-3 * np.ptp(order)])
    slopes = np.linspace(-np.pi, np.pi, _LINES) / pitch
    turned = np.exp(1j * (phases - slopes[:, None] * (places_m - places_m.mean())))
    common = turned.sum(axis=1, keepdims=True)
    for _ in range(3):  # the mean of those that are on the line
        rest = np.angle(turned * common.conj())
        on = np.abs(rest) < _ON_LINE_RAD
        common = np.where(on.any(axis=1, keepdims=True),
                          np.sum(turned * on, axis=1, keepdims=True), common)
    rest = np.angle(turned * common.conj())
    score = np.where(on, np.cos(rest), 0.0).sum(axis=1)
    return rest[np.argmax(score)]
