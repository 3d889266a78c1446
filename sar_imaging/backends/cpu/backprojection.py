# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Exact backprojection of range profiles, by the route of a plan."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from ...planning.exact.backprojection import BackprojectionPlan
from .memory import WorkSpace

if TYPE_CHECKING:
    import numpy as np

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
        self._route.add(samples, tx_m, rx_m, image)
