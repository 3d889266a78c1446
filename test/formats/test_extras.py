# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What is told where the libraries of an extra are missing."""

import pytest

from sar_imaging.formats import MissingExtraError, require


def test_library_that_is_not_there():
    with pytest.raises(MissingExtraError, match=r'reading nothing needs no_such_library.*\n?.*'
                                                r'pip install sar_imaging\[formats\]'):
        require('no_such_library.part', 'reading nothing')


def test_library_that_is_there():
    assert require('json', 'nothing').loads('1') == 1
