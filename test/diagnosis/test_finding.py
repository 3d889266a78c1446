# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What a finding says."""

from sar_imaging.diagnosis.signals import Finding


def test_what_it_was_compared_with_is_said_where_there_was_something():
    plain = Finding('too strong', '3 % are clipped', 'lower the gain')
    assert str(plain) == 'too strong: 3 % are clipped. Lower the gain.'
    against = Finding('too strong', '3 % are clipped', 'lower the gain', 'noise', 'likely')
    assert str(against) == ('too strong: 3 % are clipped. Compared with noise: likely. '
                            'Lower the gain.')
