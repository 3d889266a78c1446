# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Words of the pages are spelled right, and pages begin with what they are about.

A word is right if a dictionary of English, the glossary or `words.txt` has it. That file lists
British spellings and names that a dictionary lacks. `make release-check` looks at the words.
"""

from __future__ import annotations

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = [*sorted(ROOT.glob('*.md')), *sorted((ROOT / 'docs').rglob('*.md')),
         ROOT / 'bags' / 'README.md']
PLACES = re.compile(r'^---\n.*?^---\n|^```.*?^```|`[^`]*`|\$\$.*?\$\$|\$[^$\n]*\$|\]\([^)]*\)|'
                    r'https?://\S+|<[^>]*>|\[?@\w+\]?', re.DOTALL | re.MULTILINE)


def words_of(text: str) -> set[str]:
    """Words of a page's prose, lower-case; what is code, a formula or an address is none."""
    found = re.findall(r"\b[A-Za-z][A-Za-z'’]+", PLACES.sub(' ', text))
    return {re.sub(r"['’]s?$", '', word).lower().replace('’', "'") for word in found}


@pytest.fixture(scope='module')
def unknown():
    """Function that tells which words are in no dictionary."""
    spellchecker = pytest.importorskip('spellchecker', reason='`make release-check` installs it')
    english = spellchecker.SpellChecker(language='en', distance=1)
    glossary = (ROOT / 'docs' / 'glossary.md').read_text().lower()
    known = {*re.findall(r'[a-z]+', glossary),
             *(pathlib.Path(__file__).parent / 'words.txt').read_text().split()}
    return lambda words: {w for w in words - known if len(w) > 1 and w not in english}


@pytest.mark.release
def test_mistakes_are_noticed(unknown):
    text = 'The imgae of a backprojection, `a_nmae`, [lnik](adress.md) and $x_{mni}$'
    assert unknown(words_of(text)) == {'imgae', 'lnik'}


@pytest.mark.release
@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_words_are_spelled_right(page, unknown):
    assert unknown(words_of(page.read_text())) == set(), 'or add a name to test/docs/words.txt'


@pytest.mark.parametrize('page', [p for p in PAGES if p.name[0] != '_' and p.name != 'paper.md'],
                         ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_begins_with_what_it_is_about(page):
    title, first = [part.strip() for part in page.read_text().split('\n\n')][:2]
    assert title.startswith('# ')
    assert re.match(r'[A-Z`*\[]', first) and len(first) > 40, first  # a sentence, no table or code
