"""SICD files as the reference implementation checks and projects them, and as we read them."""

import numpy as np
import pytest

from sar_imaging.formats import write_sicd

sksicd = pytest.importorskip('sarkit.sicd', reason='sarkit is not installed: it needs Python 3.11')
verification = pytest.importorskip('sarkit.verification')


def failures(path):
    """What sicdcheck says against a file."""
    with open(path, 'rb') as file:
        checker = verification.SicdConsistency.from_file(file)
    checker.check()
    return {name: [detail for detail in told['details'] if not detail['passed']]
            for name, told in checker.failures(omit_passed_sub=True).items()}


@pytest.mark.parametrize('plane', ['ground', 'slant'])
@pytest.mark.parametrize('left', [True, False], ids=['left', 'right'])
@pytest.mark.parametrize(('heading_deg', 'datum'), [
    (10.0, (0.0, 8.0, 0.0, 0.0)), (190.0, (70.0, 25.0, 300.0, 100.0)),
    (80.0, (-12.0, 180.0, 50.0, 0.0))],
    ids=['ascending at the equator', 'descending at 70 degrees', 'across the date line'])
def test_checker_finds_nothing(flight, tmp_path, plane, left, heading_deg, datum):
    flown = flight(left=left, heading_deg=heading_deg, datum=datum)
    path = tmp_path / 'image.nitf'
    write_sicd(path, flown.sicd_image(plane), flown.datum, flown.acquisition)
    assert failures(path) == {}


def stored(path):
    """Metadata and pixels as the reference implementation reads them."""
    with open(path, 'rb') as file, sksicd.NitfReader(file) as reader:
        return reader.metadata.xmltree, reader.read_image()


def missed_by(tree, pixels, points_ecef, peaks):
    """(S,) metres on the image plane from maxima to where the reference projects points."""
    [expected, _, found] = sksicd.scene_to_image(tree, points_ecef)
    assert found
    scp = [int(tree.findtext(f'{{*}}ImageData/{{*}}SCPPixel/{{*}}{name}'))
           for name in ('Row', 'Col')]
    spacing = [float(tree.findtext(f'{{*}}Grid/{{*}}{name}/{{*}}SS')) for name in ('Row', 'Col')]
    maxima = peaks(pixels.astype(complex), expected / spacing + scp)
    return np.linalg.norm((maxima - scp) * spacing - expected, axis=1)


@pytest.mark.parametrize('plane', ['ground', 'slant'])
@pytest.mark.parametrize('left', [True, False], ids=['left', 'right'])
@pytest.mark.parametrize('squint_m', [0.0, 900.0])
def test_reflectors_are_where_the_reference_projects_them(flight, peaks, tmp_path, plane, left,
                                                          squint_m):
    flown = flight(left=left, heading_deg=37.0, squint_m=squint_m)
    path = tmp_path / 'image.nitf'
    write_sicd(path, flown.sicd_image(plane), flown.datum, flown.acquisition)
    tree, pixels = stored(path)
    on_ground = missed_by(tree, pixels, flown.datum.to_ecef(flown.points_m), peaks)
    assert on_ground.max() < 0.004
