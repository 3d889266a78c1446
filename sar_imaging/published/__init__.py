# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Published methods, for comparison; each is imported when `plan_image` is given its name."""

from ..compilation import require_numba

require_numba('a published method')
