# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The command `archive`, and former places of `sar_imaging.archive`, until the next release."""
