# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw every mermaid block of the pages that has no drawing; `make drawings` runs this.

mermaid-cli comes from npm by `npx`, and draws with the Chromium of this machine. Drawings whose
block is gone are removed.
"""

from __future__ import annotations

import json
import os
import pathlib
import re
import shutil
import subprocess
import tempfile

from drawings import FOLDER, SHADES, drawing

ROOT = FOLDER.parents[2]
PROGRAM = ['npx', '--yes', '--package', '@mermaid-js/mermaid-cli@11.17.0', 'mmdc']
THEMES = dict(zip(SHADES, ('neutral', 'dark'), strict=True))


def blocks() -> list[str]:
    """Mermaid blocks of all pages."""
    pages = [*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md'), ROOT / 'bags' / 'README.md']
    return [block for page in sorted(pages) for block in
            re.findall(r'^```mermaid\n(.*?)^```', page.read_text(), re.DOTALL | re.MULTILINE)]


def draw(block: str, shade: str) -> None:
    """Write the drawing of a block; labels are text of SVG, for HTML is not shown in images."""
    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    if not chromium:
        raise SystemExit('drawings need Chromium: on Debian, apt install chromium')
    with tempfile.TemporaryDirectory() as folder:
        place = pathlib.Path(folder)
        (place / 'block.mmd').write_text(block)
        (place / 'mermaid.json').write_text(json.dumps(
            {'theme': THEMES[shade], 'htmlLabels': False, 'fontFamily': 'sans-serif',
             'flowchart': {'htmlLabels': False}, 'deterministicIds': True}))
        (place / 'browser.json').write_text(json.dumps(
            {'executablePath': chromium, 'args': ['--no-sandbox']}))
        subprocess.run(
            [*PROGRAM, '--quiet', '--input', 'block.mmd', '--output', drawing(block, shade),
             '--configFile', 'mermaid.json', '--puppeteerConfigFile', 'browser.json',
             '--backgroundColor', 'transparent'],
            cwd=folder, check=True, env={**os.environ, 'PUPPETEER_SKIP_DOWNLOAD': '1'})
    # svgo makes paths of rectangles, which would be black without their style
    file = drawing(block, shade)
    file.write_text(file.read_text().replace('.edgeLabel rect{', '.edgeLabel .background{'))
    subprocess.run(['npx', '--yes', 'svgo@4.1.0', '--quiet', '--precision', '1',
                    file], check=True)  # a fifth of the bytes


def main() -> None:
    """Draw what is missing, remove what is left over."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    wanted = {drawing(block, shade): (block, shade) for block in blocks() for shade in SHADES}
    for file, (block, shade) in wanted.items():
        if not file.exists():
            draw(block, shade)
            print(file.relative_to(ROOT))
    for file in set(FOLDER.glob('*.svg')) - wanted.keys():
        file.unlink()
        print(f'removed {file.relative_to(ROOT)}')


if __name__ == '__main__':
    main()
