"""What is told when kernels are compiled."""

import numpy as np

from sar_imaging.compilation import announced, numba


def test_the_first_compilation_is_announced_once():
    """And none where the machine code is there already."""
    compiled = [numba.njit(f) for f in (lambda x: x + 1, lambda x: x + 2)]
    told = []
    with announced(lambda: told.append('now')):
        assert [f(np.float32(1.0)) for f in compiled] == [2.0, 3.0]
    assert told == ['now']
    with announced(lambda: told.append('again')):
        compiled[0](np.float32(2.0))
    assert told == ['now']
    compiled[0](1)  # outside nobody is told
    assert told == ['now']
