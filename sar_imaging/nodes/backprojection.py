"""Node backprojection: form images, or sub-aperture images of AFBP, from range profiles."""

from __future__ import annotations

import sys

from .backprojection_steps import PARAMETERS, BackprojectionStep
from .runtime.managed import run
from .runtime.stage import Stage

__all__ = ['PARAMETERS', 'BackprojectionNode']


class BackprojectionNode(Stage):
    """Publishes images from what comes on `range_profiles`."""

    NAME = 'backprojection'
    INPUT = 'range_profiles'
    STEPS = (BackprojectionStep,)


def main() -> int:
    """Run the node."""
    return run(BackprojectionNode)


if __name__ == '__main__':
    sys.exit(main())
