"""Files of measured costs."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from .costs import CostModel


def write_costs(model: CostModel, path: Path) -> None:
    """Write costs as JSON."""
    path.write_text(json.dumps(dataclasses.asdict(model), indent=2) + '\n')


def read_costs(path: Path) -> CostModel:
    """Costs from a file that `write_costs` wrote.

    Raises
    ------
    ValueError
        The file holds something else.
    """
    try:
        return CostModel(**json.loads(path.read_text()))
    except (OSError, TypeError, ValueError) as error:
        raise ValueError(f'{path} holds no costs ({error}); write it with `sar-imaging '
                         'measure-costs`') from error
