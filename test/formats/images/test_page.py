"""The page about formats: what it shows of images runs as it stands."""

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]


def test_code_of_the_page(tmp_path, monkeypatch, capsys):
    pytest.importorskip('sarkit', reason='sarkit is not installed: it needs Python 3.11')
    pytest.importorskip('rasterio', reason='rasterio is not installed')
    pytest.importorskip('pystac', reason='pystac is not installed')
    page = (ROOT / 'docs/formats.md').read_text()
    images = page[page.index('\n## SICD'):]
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    monkeypatch.chdir(tmp_path)
    names = {}
    for code in re.findall(r'^```python\n(.*?)^```', images, re.DOTALL | re.MULTILINE):
        exec(compile(code, 'formats.md', 'exec'), names)
    assert (names['back'].image.samples == names['image'].samples).all()
    assert 'exact' in capsys.readouterr().out
    written = {path.name for path in tmp_path.iterdir()} - {'bags'}
    assert written == {'image.nitf', 'map.tif', 'complex.tif', 'north_up.tif', 'map.png',
                       'map.pgw', 'map.prj', 'map.kml', 'image.json'}
