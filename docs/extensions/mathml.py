# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Formulas as MathML, which browsers draw themselves: no script, nothing from the network."""

from __future__ import annotations

from docutils import nodes
from latex2mathml.converter import convert


def _inline(visitor, node):
    visitor.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(visitor, node):
    visitor.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>\n')
    raise nodes.SkipNode


def setup(app):
    """Register the renderer; `html_math_renderer` of conf.py chooses it."""
    app.add_html_math_renderer('mathml', (_inline, None), (_block, None))
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
