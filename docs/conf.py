# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Sphinx configuration of the documentation site, which `make docs` builds."""

import pathlib
import sys

DOCS = pathlib.Path(__file__).parent
sys.path[:0] = [str(DOCS.parent), str(DOCS / 'extensions')]

import sar_imaging  # noqa: E402
from docs.public_names import pages  # noqa: E402

project = 'sar_imaging'
author = 'SAR Imaging maintainers'
copyright = f'{author}, Apache License 2.0'
version = release = sar_imaging.__version__

extensions = [
    'myst_parser',
    'numpydoc',
    'sphinx.ext.autodoc',
    'sphinx.ext.autosummary',
    'sphinx.ext.viewcode',
    'sphinx_copybutton',
    'sphinx_gallery.gen_gallery',
    # of docs/extensions
    'drawings',
    'links',
    'mathml',
]
exclude_patterns = ['_contents.md', '_templates', 'examples', 'extensions', 'paper']
templates_path = ['_templates']

# Markdown is written for GitHub: headings have its anchors, `$` and ```mermaid work as there.
myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 4
myst_fence_as_directive = ['mermaid']
html_math_renderer = 'mathml'

# A page for each public name, which `public_names.py` finds.
autosummary_generate = True
autosummary_ignore_module_all = False
autosummary_context = {'pages': pages()}
autodoc_typehints = 'none'  # numpydoc's sections state them
autodoc_member_order = 'bysource'
numpydoc_show_class_members = False

# The examples run when the site is built; `-D plot_gallery=0` leaves that out.
sphinx_gallery_conf = {
    'examples_dirs': 'examples',
    'gallery_dirs': 'auto_examples',
    'filename_pattern': '',
    'ignore_pattern': '__init__',
    'within_subsection_order': 'FileNameSortKey',
    'abort_on_example_error': True,
    'download_all_examples': False,
    'min_reported_time': 1e9,
    'write_computation_times': False,  # its page takes scripts from the network
}

html_theme = 'furo'
html_title = f'sar_imaging {release}'
html_favicon = '_static/icon.svg'
html_static_path = ['_static']
html_css_files = ['site.css']
html_copy_source = False
pygments_style = 'friendly'
pygments_dark_style = 'github-dark'
copybutton_exclude = '.linenos, .gp, .go'
