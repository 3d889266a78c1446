# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the documentation shows works: code runs, links lead somewhere."""

from __future__ import annotations

import pathlib
import re
import shlex

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.signal.pulses import concatenate
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.simulation.scenarios.catalogue import TERRACE_HEIGHT_M
from sar_imaging.tools import command

ROOT = pathlib.Path(__file__).parent.parent
PAGES = [*sorted(ROOT.glob('*.md')), *sorted((ROOT / 'docs').rglob('*.md')),
         ROOT / 'bags' / 'README.md']
# What an abbreviation stands for: a page that uses it says so, or leads to where it is said.
ABBREVIATIONS = {
    'AFBP': 'accelerated fast', 'CFAR': 'constant false alarm', 'CNR': 'clutter-to-noise',
    'DPCA': 'displaced phase', 'FFBP': 'fast factorised', 'FMCW': 'frequency-modulated',
    'GMTI': 'moving target indication', 'IRW': 'impulse response width',
    'ISLR': 'integrated sidelobe', 'LFM': 'linear frequency modulation', 'PGA': 'phase gradient',
    'PSLR': 'peak sidelobe', 'SDR': 'distortion ratio', 'TDC': 'time-domain correlation',
    'UWB': 'ultra-wideband'}
# Words of the field that stopped readers: a page that uses one leads to the glossary.
TERMS = ('coherence', 'direction cosine', 'grating lobe', 'lever arm', 'limbs', 'phase centre')
EXPLANATIONS = ('glossary.md', 'theory.md#fast-backprojection-afbp-and-ffbp', 'waveforms.md')


def _run_python(page) -> dict:
    """Names that the page's Python examples leave behind."""
    names = {}
    for code in re.findall(r'^```python\n(.*?)^```', page.read_text(), re.DOTALL | re.MULTILINE):
        exec(code, names)
    return names


def test_the_example_without_ros_forms_the_image(capsys):
    names = _run_python(ROOT / 'docs' / 'install.md')
    brightest = max(names['scenario'].scatterers, key=lambda s: abs(s.amplitude))
    grid = names['scenario'].grid
    x, y = grid.x_m[names['column']], grid.y_m[names['row']]
    # The brightest pixel is one of those around the brightest scatterer.
    assert np.hypot(x - brightest.position_m[0], y - brightest.position_m[1]) <= grid.spacing_m
    assert 'brightest at' in capsys.readouterr().out


def test_scale_and_phase_are_as_the_theory_says():
    to_baseband = _run_python(ROOT / 'docs' / 'theory.md')['to_baseband']
    scenario = SCENARIOS['psf']()
    block = concatenate(list(scenario.blocks()))
    grid = scenario.grid
    image = exact_image(grid, block)
    [scatterer] = scenario.scatterers
    row, column = (round(float(v)) for v in grid.to_pixels(*scatterer.position_m[:2]))
    # M C |a| with the phase of a; 20-bit samples and interpolation stay below 1e-4 of it.
    expected = block.n_pulses * block.n_channels * scatterer.amplitude
    assert image[row, column] == pytest.approx(expected, rel=1e-4)
    centre = block.phase_centre_m[block.n_pulses // 2]
    baseband = to_baseband(image, grid, block.radar, centre)
    main_lobe = (slice(row - 5, row + 6), slice(column - 2, column + 3))
    turned = np.angle(baseband[main_lobe] / baseband[row, column])
    # The spectrum's wedge and the half pulse spacing between `centre` and the true middle leave
    # some milliradians over the main lobe; the carrier turns by 42 rad from pixel to pixel.
    assert np.abs(turned).max() < 0.02


def test_grids_show_reflectors_where_they_are(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = _run_page(ROOT / 'docs' / 'grids.md')
    told = re.search(r'(\d+) points, .* 30 dB or more above the median', capsys.readouterr().out)
    cloud = (tmp_path / 'out' / 'raster_scan' / 'cloud.ply').read_bytes()
    assert f'element vertex {told[1]}\n'.encode() in cloud and int(told[1]) > 100
    for grid, image, reflectors in (('wall', 'wall_image', 'window'),
                                    ('volume', 'volume_image', 'houses'),
                                    ('section', 'section_image', 'pipes'),
                                    ('bottom', 'sonar_image', 'mines')):
        magnitude, points = np.abs(names[image]).ravel(), names[grid].points().reshape(-1, 3)
        median = np.median(magnitude)
        for place in names[reflectors]:
            nearest = np.linalg.norm(points - place, axis=-1).argmin()
            assert magnitude[nearest] > 5 * median
        brightest = points[magnitude.argmax()]
        away = np.linalg.norm(names[reflectors] - brightest, axis=-1).min()
        step = np.linalg.norm(names[grid].steps_m, axis=1).max()
        assert away <= 1.5 * step  # neighbours add to each other


def test_brightness_of_a_meadow(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    names = _run_python(ROOT / 'docs' / 'radiometry.md')
    # one look, as an even surface has: 0.9 to 1.1 of so many pixels
    assert names['averaged'].shape == (20, 30)
    assert re.search(r'^-7\.\d dB, (0\.[89]|1\.[01]) looks', capsys.readouterr().out)


def test_two_passes_show_the_terrace(capsys):
    passes = _run_python(ROOT / 'docs' / 'exploitation.md')['passes']
    height = np.nanmedian(passes.height_m[40:70, 80:120])  # in the middle of the terrace
    assert height == pytest.approx(TERRACE_HEIGHT_M, rel=0.05)
    assert 'independent looks' in capsys.readouterr().out


def _run_page(page) -> dict:
    """Run the commands and the Python of a page, in its order; returns what names are left."""
    names = {}
    for language, code in re.findall(r'^```(bash|python)\n(.*?)^```', page.read_text(),
                                     re.DOTALL | re.MULTILINE):
        if language == 'python':
            exec(code, names)
            continue
        for line in code.splitlines():
            program, *words = shlex.split(line)
            assert (program, command.main(words)) == ('sar-imaging', 0), line
    return names


def test_from_files_to_maps(tmp_path, monkeypatch, capsys):
    for library in ('sarkit', 'rasterio', 'pyproj'):
        pytest.importorskip(library, reason='the extra formats is not installed')
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    monkeypatch.chdir(tmp_path)
    names = _run_page(ROOT / 'docs' / 'from_files_to_maps.md')
    assert names['quality']['measured_error']['error_db'] < -60.0
    told = {path.name for path in (tmp_path / 'out' / 'flight').iterdir()}
    assert told == {'image.png', 'image.nitf', 'image.tif', 'image.npy', 'quality.json',
                    'report.html'}
    # two formats, one place: half a centimetre and the rounding of a degree's seventh digit
    assert names['latitude'] == pytest.approx(names['latitude_sicd'], abs=5e-8)
    assert names['longitude'] == pytest.approx(names['longitude_sicd'], abs=7e-8)
    assert (tmp_path / 'out' / 'change' / 'coherence.png').exists()
    assert 'no warnings' in capsys.readouterr().out


def test_a_point_of_the_frame_is_found_on_the_earth(capsys):
    pytest.importorskip('rclpy', reason='the datum travels as a message')
    _run_python(ROOT / 'docs' / 'earth.md')
    latitude, longitude, height = map(float, capsys.readouterr().out.split())
    heading = np.radians(30.0)  # of the y axis: x = 120 m, y = -35 m
    north_m = -35.0 * np.cos(heading) - 120.0 * np.sin(heading)
    east_m = -35.0 * np.sin(heading) + 120.0 * np.cos(heading)
    # Radii of curvature of WGS 84 at this latitude; six decimals of a degree are 0.06 m.
    assert latitude == pytest.approx(47.397742 + np.degrees(north_m / 6_370_100), abs=1e-6)
    assert longitude == pytest.approx(8.545594 + np.degrees(
        east_m / (6_389_700 * np.cos(np.radians(47.397742)))), abs=1e-6)
    assert height == pytest.approx(535.3, abs=0.01)  # 125 m of a tangent plane: 1 mm


def _prose(page) -> str:
    return re.sub(r'^```.*?^```', '', page.read_text(), flags=re.DOTALL | re.MULTILINE)


def _anchors(page) -> set[str]:
    """Anchors of a page's headings, as GitHub and MyST derive them."""
    return {re.sub(r'[^\w\- ]', '', heading.lower()).strip().replace(' ', '-')
            for heading in re.findall(r'^#+ (.*)$', _prose(page), re.MULTILINE)}


def test_the_example_of_illumination_forms_the_image(capsys):
    image = _run_python(ROOT / 'docs' / 'illumination.md')['image']
    row, column = np.unravel_index(np.abs(image.samples).argmax(), image.shape)
    # the scatterer lies between the four pixels in the middle
    assert (row, column) in {(r, c) for r in (29, 30) for c in (99, 100)}
    assert image.report.errors_db['illumination'] < -60.0
    assert 'illumination' in capsys.readouterr().out


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    for target, anchor in re.findall(r'\]\(([^)#]*)#?([^)]*)\)', _prose(page)):
        if '://' in target:
            continue
        path = page.parent / target if target else page
        assert path.exists(), f'{target} does not exist'
        if anchor and path.suffix == '.md':
            assert anchor in _anchors(path), f'{target}#{anchor} is not a heading'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_abbreviations_are_explained_where_they_are_met(page):
    prose = _prose(page)
    words = re.sub(r'`[^`]*`', '', prose)
    text = ' '.join(words.lower().split())
    used = {name for name in ABBREVIATIONS if re.search(rf'\b{name}\b', words)}
    unexplained = {name for name in used if ABBREVIATIONS[name] not in text}
    assert not unexplained or any(e in prose for e in EXPLANATIONS), (
        f'{sorted(unexplained)} are not explained: write them out once, or link the glossary')


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_terms_lead_to_the_glossary(page):
    if page.name == 'glossary.md':
        assert all(f'| {term}' in page.read_text() for term in (*TERMS[:4], 'limb', TERMS[5]))
        return
    words = re.sub(r'`[^`]*`', '', _prose(page)).lower()
    used = [term for term in TERMS if re.search(rf'\b{term}', words)]
    assert not used or 'glossary.md' in _prose(page), f'{used} are used: link the glossary'
