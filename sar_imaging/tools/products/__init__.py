# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of pulses to images, maps and comparisons that other programs read, one command each."""
