# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Antennas of CPHD files, as the standard says them.

- `writing`: pattern as a table and as polynomials, and how far these depart, frames of vectors;
- `reading`: antennas of files as our patterns and pointing.
"""
