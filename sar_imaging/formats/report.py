# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A report in one HTML file: pictures, tables, warnings; nothing is loaded from elsewhere."""

from __future__ import annotations

import base64
import dataclasses
import html
from collections.abc import Mapping, Sequence
from pathlib import Path

_STYLE = """\
body { font: 15px/1.45 system-ui, sans-serif; color: #222; max-width: 68rem; margin: 2rem auto;
       padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
img { max-width: 100%; height: auto; } figure { margin: 1rem 0; }
figcaption { color: #555; font-size: .9rem; }
table { border-collapse: collapse; margin: .5rem 0; }
th { text-align: left; font-weight: 500; color: #444; padding: .15rem 1.2rem .15rem 0; }
td { padding: .15rem 0; } tr { border-bottom: 1px solid #e6e6e6; }
.warning { background: #fff4d6; border-left: 4px solid #d99a00; padding: .5rem .8rem;
           margin: .4rem 0; }
.fine { background: #e9f5e9; border-left: 4px solid #3b873b; padding: .5rem .8rem; }
"""


@dataclasses.dataclass(frozen=True)
class ReportSection:
    """A part of a report.

    Parameters
    ----------
    title : str
        Its heading.
    pictures : mapping of Path to str
        PNG files and their captions.
    rows : mapping of str to str
        A table: names and values.
    lines : sequence of str
        Paragraphs.
    """

    title: str
    pictures: Mapping[Path, str] = dataclasses.field(default_factory=dict)
    rows: Mapping[str, str] = dataclasses.field(default_factory=dict)
    lines: Sequence[str] = ()


def write_report(path: Path, title: str, sections: Sequence[ReportSection],
                 warnings: Sequence[str]) -> None:
    """Write a report that can be sent by itself.

    Parameters
    ----------
    path : Path
        HTML file to write.
    title : str
        Heading.
    sections : sequence of ReportSection
        In their order.
    warnings : sequence of str
        All that a reader has to know, shown first.
    """
    told = ''.join(f'<p class="warning">{html.escape(text)}</p>\n' for text in warnings)
    body = ''.join(map(_section, sections))
    path.write_text(
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<title>{html.escape(title)}</title>\n<style>\n{_STYLE}</style>\n</head>\n<body>\n'
        f'<h1>{html.escape(title)}</h1>\n'
        f'{told or "<p class=fine>No warnings.</p>"}\n{body}</body>\n</html>\n', encoding='utf-8')


def _section(section: ReportSection) -> str:
    parts = [f'<h2>{html.escape(section.title)}</h2>\n']
    for picture, caption in section.pictures.items():
        data = base64.b64encode(picture.read_bytes()).decode('ascii')
        text = html.escape(caption)
        parts.append(f'<figure><img alt="{text}" src="data:image/png;base64,{data}">'
                     f'<figcaption>{text}</figcaption></figure>\n')
    if section.rows:
        rows = ''.join(f'<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>\n'
                       for name, value in section.rows.items())
        parts.append(f'<table>\n{rows}</table>\n')
    parts += [f'<p>{html.escape(line)}</p>\n' for line in section.lines]
    return ''.join(parts)
