# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of other programs: what they hold, and recordings made of them and of which they are."""
