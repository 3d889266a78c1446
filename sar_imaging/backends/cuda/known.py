# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What plans say that this backend computes; anything more it refuses."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from ...planning.afbp.subapertures import SubaperturePlan
from ...planning.exact.backprojection import BackprojectionPlan, LinePlan
from ...planning.exact.points import PointPlan
from ...planning.exact.polar_image import PolarPlan

if TYPE_CHECKING:
    from ...planning.plan import Plan

_ROUTE = {'window', 'resampling', 'errors_db', 'cost', 'amplitudes'}
_KNOWN = {BackprojectionPlan: {'grid', 'radar', 'tx_m', 'rx_m', 'range_m', 'route', 'warnings',
                              'chance_db', 'illumination'},
          LinePlan: _ROUTE | {'lines'},
          PointPlan: _ROUTE | {'range_m', 'tile', 'reach_m'},
          PolarPlan: _ROUTE | {'polar', 'range_m', 'axis', 'between', 'along', 'parts',
                             'wavelength_m'},
          SubaperturePlan: {'polar', 'given', 'source', 'n_samples', 'n_channels', 'sampling',
                            'fusion_grid', 'resampling', 'beams', 'range_m', 'limits', 'warnings',
                            'amplitudes'}}


def refuse_unknown(plan: Plan) -> None:
    """Refuse a plan that says more than this backend computes.

    Raises
    ------
    ValueError
        An attribute of the plan is unknown here, and set.
    """
    known = set().union(*(names for kind, names in _KNOWN.items() if isinstance(plan, kind)))
    unknown = [field.name for field in dataclasses.fields(plan)
               if field.name not in known and getattr(plan, field.name) is not None]
    if unknown:
        raise ValueError(f"backend='cuda' does not compute {', '.join(unknown)} of "
                         f"{type(plan).__name__} yet; use backend='cpu'")
