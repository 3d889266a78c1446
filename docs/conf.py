# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Sphinx configuration of the documentation site, which `make docs` builds.

docs.ros.org builds it with rosdoc2, from a copy of this folder alone, whose conf.py runs this file
and names it. Pages and programs are then read where they stand.
"""

import importlib.util
import pathlib
import re
import sys

HERE = pathlib.Path(__file__).parent
RUN_BY_ROSDOC2 = re.search(r'^exec\(open\("(.+)"\)', pathlib.Path(__file__).read_text(),
                           re.MULTILINE)
DOCS = pathlib.Path(RUN_BY_ROSDOC2[1]).parent if RUN_BY_ROSDOC2 else HERE
sys.path[:0] = [str(DOCS.parent), str(DOCS / 'extensions')]

from sphinx.ext.autodoc.mock import mock  # noqa: E402

import sar_imaging  # noqa: E402
from docs.public_names import pages  # noqa: E402

# Where the site is built no ROS need be installed.
ROS = [name for name in ('builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs',
                         'rcl_interfaces', 'rclpy', 'sensor_msgs', 'std_msgs', 'std_srvs')
       if not importlib.util.find_spec(name)]

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
if RUN_BY_ROSDOC2:  # which brings Sphinx and MyST, and runs no examples
    extensions = [name for name in extensions if importlib.util.find_spec(
        'latex2mathml' if name == 'mathml' else name)]
exclude_patterns = ['_contents.md', '_templates', 'examples', 'extensions', 'paper']
if RUN_BY_ROSDOC2:  # its pages for each module add nothing to the reference of public names
    exclude_patterns += ['index.rst', 'modules.rst', 'sar_imaging.rst', 'sar_imaging.*.rst']
templates_path = ['_templates']

# Markdown is written for GitHub: headings have its anchors, `$` and ```mermaid work as there.
myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 4
myst_fence_as_directive = ['mermaid']
html_math_renderer = 'mathml'

# A page for each public name, which `public_names.py` finds.
autosummary_generate = True
autosummary_ignore_module_all = False
with mock(ROS):
    autosummary_context = {'pages': pages()}
autodoc_mock_imports = ROS
autodoc_typehints = 'none'  # numpydoc's sections state them
autodoc_use_type_comments = False  # there are none, and to look for them takes time
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
    **({'plot_gallery': 'False'} if RUN_BY_ROSDOC2 else {}),
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
