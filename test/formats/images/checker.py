# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the reference implementation says of SICD files."""

import pytest


def failures(path):
    """What sicdcheck says against a file."""
    verification = pytest.importorskip(
        'sarkit.verification', reason='sarkit is not installed: it needs Python 3.11')
    with open(path, 'rb') as file:
        checker = verification.SicdConsistency.from_file(file)
    checker.check()
    return {name: [detail for detail in told['details'] if not detail['passed']]
            for name, told in checker.failures(omit_passed_sub=True).items()}
