# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images, predictions and plans are those that were pinned before the imaging core is rebuilt."""

import json

import pytest

from benchmarks import goldens
from benchmarks.goldens import FOLDER, MOST_PREDICTION_DB, difference_db, form, load
from benchmarks.support.golden_cases import CASES

# Processors with AVX-512 and AVX2 make equal bits; without fused multiply-add images were -95 to
# -128 dB away. What `python -m benchmarks.goldens compare` allows on one processor is -120 dB.
ROUNDING_DB = -90.0


@pytest.mark.parametrize('name', CASES)
@pytest.mark.filterwarnings('ignore:pulses every')  # of the wavenumber domain, sparse on purpose
def test_image_is_the_pinned_one(name):
    golden, facts = load(FOLDER, name)
    found = form(CASES[name])
    assert difference_db(found.image, golden) <= ROUNDING_DB
    assert found.plan == facts['plan']
    if facts['predicted_error_db'] is not None:
        assert found.predicted_error_db == pytest.approx(facts['predicted_error_db'],
                                                         abs=MOST_PREDICTION_DB)


def test_a_changed_image_is_noticed():
    golden, _ = load(FOLDER, 'exact_100m')
    changed = golden.copy()
    changed[40:44, 40:44] *= 1.01
    assert ROUNDING_DB < difference_db(changed, golden) < -60.0
    assert difference_db(golden[:, :-1], golden) == float('inf')


def test_one_case_is_pinned_beside_the_others(tmp_path, monkeypatch):
    pinned = {'machine': {'processor': 'another'}, 'cases': {'exact_50km': {'plan': 'as it was'}}}
    (tmp_path / 'goldens.json').write_text(json.dumps(pinned))
    monkeypatch.setattr(goldens, '_ROUNDS', 1)
    goldens.write(tmp_path, ['exact_100m'])
    facts = json.loads((tmp_path / 'goldens.json').read_text())
    assert facts['machine'] == pinned['machine']
    assert facts['cases'].keys() == {'exact_50km', 'exact_100m'}
    assert facts['cases']['exact_50km'] == pinned['cases']['exact_50km']
    assert facts['cases']['exact_100m']['machine'] != pinned['machine']  # whose times they are
    assert [path.name for path in tmp_path.glob('*.npy')] == ['exact_100m.npy']
    monkeypatch.setattr('sys.argv', ['goldens', 'write', 'new'])
    with pytest.raises(SystemExit):
        goldens.main()
