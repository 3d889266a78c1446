# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Links of the Markdown pages lead to the same place on the site as on GitHub.

Pages link files outside docs/. A few of these files are pages of the site, too (`OUTER`); a folder
that is a Python package is a page of the reference; any other file is offered for download.
"""

from __future__ import annotations

import os
import pathlib
import re

DOCS = pathlib.Path(__file__).parent.parent
ROOT = DOCS.parent
# Pages of the site whose text stands elsewhere.
OUTER = {'project/readme.md': 'README.md', 'project/contributing.md': 'CONTRIBUTING.md',
         'project/recordings.md': 'bags/README.md', 'project/changelog.rst': 'CHANGELOG.rst',
         'project/security-policy.md': 'SECURITY.md',
         'project/quality-declaration.md': 'QUALITY_DECLARATION.md'}
CONTENTS = DOCS / '_contents.md'  # which page follows which; GitHub would show it as code
LINK = re.compile(r'(\]\()([^)#\s]+)(#[^)]*)?(\))')
CODE = re.compile(r'(^```.*?^```|`[^`\n]+`)', re.DOTALL | re.MULTILINE)


def place_on_the_site(path: pathlib.Path, site: pathlib.Path = DOCS) -> pathlib.Path:
    """Source of the page that shows a file or folder of the repository, or the file itself.

    `site` is where the pages are built from: this folder, or a copy of it.
    """
    name = path.relative_to(ROOT).as_posix()
    for page, outer in OUTER.items():
        if name in (outer, pathlib.PurePath(outer).parent.as_posix()):
            return site / page
    if DOCS in path.parents:
        return site / path.relative_to(DOCS)
    reference = site / 'api' / 'generated' / f'{name.replace("/", ".")}.rst'
    return reference if reference.exists() else path


def _relinked(text, folder, page, site):
    """Text of `folder` as it stands in `page`: relative links lead from there."""
    def link(match):
        opening, target, anchor, closing = match.groups(default='')
        path = pathlib.Path(os.path.normpath(folder / target))
        if '://' in target or target.startswith('mailto:') or not path.exists():
            return match[0]  # MyST tells what does not exist
        place = os.path.relpath(place_on_the_site(path, site), page.parent)
        return f'{opening}{place}{anchor}{closing}'

    return ''.join(part if i % 2 else LINK.sub(link, part)
                   for i, part in enumerate(CODE.split(text)))


def _read(app, docname, source):
    page = pathlib.Path(app.env.doc2path(docname))
    site = pathlib.Path(app.srcdir)
    name = page.relative_to(site)
    file = ROOT / OUTER.get(name.as_posix(), pathlib.Path('docs', name))
    if page.suffix != '.md' and name.as_posix() not in OUTER or not file.exists():
        return  # it needs no links, or Sphinx made it
    app.env.note_dependency(str(file))
    if page.suffix == '.rst':
        source[0] = file.read_text()
        return
    source[0] = _relinked(file.read_text(), file.parent, page, site)
    if docname == app.config.root_doc:
        app.env.note_dependency(str(CONTENTS))
        source[0] += CONTENTS.read_text()


def setup(app):
    """Have every page read through this module."""
    app.connect('source-read', _read)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
