# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures and tables of the papers that this package builds on, reproduced and judged.

`reproduce_multichannel`: Rosenberg & Gray, multichannel backprojection.
`reproduce_spotlight_letter`: Zhang et al. 2014, accelerated fast backprojection (AFBP).
"""
