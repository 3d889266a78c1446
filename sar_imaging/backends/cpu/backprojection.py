# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Exact backprojection of range profiles, by the route of a plan."""

from __future__ import annotations

import functools
import importlib

import numpy as np

from ...compilation_helper import helped
from ...planning.exact.backprojection import BackprojectionPlan
from .memory import WorkSpace

# Module and class of each route, imported when a plan takes it first.
_ROUTES = {'groups': ('groups', 'GroupImages'), 'polar': ('polar_image', 'PolarImage'),
           'lines': ('lines', 'GridLineImages'), 'points': ('points', 'PointImages')}


class Backprojection:
    """Adds range profiles to images by one plan, see `backends.protocol.Backprojection`.

    What blocks share is prepared once; `memory` is a `WorkSpace`.
    """

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace | None = None):
        self.plan, self.memory = plan, memory or WorkSpace()
        module, name = _ROUTES[plan.method]
        route = getattr(importlib.import_module(f'.{module}', __package__), name)
        self._route = route(plan, self.memory)

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        with helped(functools.partial(form_silently, self.plan, samples.shape[1])):
            self._route.add(samples, tx_m, rx_m, image)


def form_silently(plan: BackprojectionPlan, n_samples: int) -> None:
    """Form an image of silent echoes of so many samples, for who helps with its kernels."""
    Backprojection(plan).add(np.zeros((len(plan.tx_m), n_samples), np.complex64), plan.tx_m,
                             plan.rx_m, np.zeros(plan.grid.shape, np.complex64))
