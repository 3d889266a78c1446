# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Mermaid blocks of the pages as pictures that were drawn beforehand, one for light, one for dark.

GitHub draws a ```mermaid block itself. Here the block is replaced by `images/drawings`, whose file
names are digests of the blocks: a block that was changed has no drawing until `make drawings`.
"""

from __future__ import annotations

import pathlib
import re

from digest import digest
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

FOLDER = pathlib.Path(__file__).parent.parent / 'images' / 'drawings'
SHADES = ('light', 'dark')


def drawing(block: str, shade: str) -> pathlib.Path:
    """File that holds the drawing of a block, in one of `SHADES`."""
    return FOLDER / f'{digest(block)}-{shade}.svg'


class Mermaid(SphinxDirective):
    """A block becomes two images, of which the theme shows one."""

    has_content = True

    def run(self):
        """Return the images; the block's `accTitle` is what they show."""
        block = '\n'.join(self.content)
        title = re.search(r'^\s*accTitle:\s*(.+)$', block, re.MULTILINE)
        if not title:
            raise self.error('the drawing has no line `accTitle: what it shows`')
        missing = [f for f in (drawing(block, shade) for shade in SHADES) if not f.exists()]
        if missing:
            raise self.error(f'{missing[0].name} does not exist; `make drawings` draws it')
        return [nodes.image(uri=f'/images/drawings/{drawing(block, shade).name}',
                            alt=title[1], classes=['drawing', f'only-{shade}'])
                for shade in SHADES]


def setup(app):
    """Add the directive; `myst_fence_as_directive` of conf.py leads blocks to it."""
    app.add_directive('mermaid', Mermaid)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
