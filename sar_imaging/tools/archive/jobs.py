# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Former place of `sar_imaging.archive`, which a warning names; goes with the next release."""

from ...names import moved

__getattr__ = moved(__name__, 'sar_imaging.archive', ('read_job',))
