# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Publish the bright cells of a volume as a point cloud, and write them when asked to."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from sensor_msgs.msg import PointCloud2

from msg_conversions.point_cloud import CELL_FIELDS, to_message
from sar_imaging.exploitation.bright_cells import LEVELS, BrightCells, bright_cells
from sar_imaging.formats import write_ply
from sar_imaging.imaging.image import Image
from sar_imaging.imaging.radiometry import Radiometry

from ..poses.frame_datum import FrameDatum
from ..runtime.block_output import PRODUCT_QOS, header_at
from ..runtime.health import Health, Part
from ..runtime.parameters import ANY_TIME, Parameter
from ..runtime.saving import SAVE_FOLDER, file_stem

if TYPE_CHECKING:
    from ..runtime.stage import Stage

PARAMETERS = (
    Parameter('volume.height', 0.0, 'Extent of the volume above grid.centre_z in mode volume, '
              'which needs it.', 'm', 0.0, 1e6),
    Parameter('volume.spacing', 0.0, 'Distance between the layers of a volume; 0.0 for '
              'grid.spacing.', 'm', 0.0, 1e4),
    Parameter('volume.threshold_db', 20.0, 'Least power of a cell in the cloud above the median '
              'of the volume.', 'dB', -100.0, 200.0, changes=ANY_TIME),
    Parameter('volume.max_points', 20_000, 'Most points of the cloud: the brightest.', 'points', 1,
              2**24, changes=ANY_TIME),
)
COUNTERS = ('points_in_last_cloud',)


class VolumeCloud:
    """Publishes `volume` of one node.

    Parameters
    ----------
    node : Stage
        Node whose output it is.
    parameters : mapping
        Current values of `PARAMETERS`.
    health : Health or Part
        Where points are counted.
    datum : FrameDatum
        Tells latitudes and longitudes of points.
    """

    def __init__(self, node: Stage, parameters: Mapping[str, Any], health: Health | Part,
                 datum: FrameDatum):
        self._parameters, self._health, self._datum = parameters, health, datum
        self._latest: tuple[BrightCells, int, Radiometry | None] | None = None  # and their time
        self._output = node.create_output(PointCloud2, 'volume', PRODUCT_QOS)

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        return self._output.topic_name

    def publish(self, image: Image, stamp_ns: int) -> None:
        """Publish the bright cells, if somebody listens, and keep them for a file.

        Parameters
        ----------
        image : Image
            Volume, (n_z, n_y, n_x) complex64, calibrated or not.
        stamp_ns : int
            Middle of the aperture, nanoseconds.
        """
        p = self._parameters
        listened, self._latest = self._output.get_subscription_count(), None
        if not (listened or p[SAVE_FOLDER.name]):
            return
        cells = bright_cells(image.samples, image.grid, threshold_db=p['volume.threshold_db'],
                             most=p['volume.max_points'])
        self._health.set('points_in_last_cloud', len(cells.points_m))
        if cells.n_above > len(cells.points_m):
            self._health.info(f'{cells.n_above} cells are {p["volume.threshold_db"]:g} dB above '
                              'the median; the cloud has the brightest volume.max_points='
                              f'{p["volume.max_points"]}')
        if p[SAVE_FOLDER.name]:
            self._latest = cells, stamp_ns, image.radiometry
        if listened:
            self._output.publish(to_message(
                np.column_stack([cells.points_m, cells.level_db(image.radiometry)]),
                header_at(stamp_ns, p), CELL_FIELDS, self._datum.geographic(cells.points_m)))

    def saving(self) -> Callable[[], str]:
        """Function that writes the latest cloud and says what it wrote; for any thread.

        Raises
        ------
        ValueError
            There is nothing to write, or nowhere to write it.
        """
        folder = self._parameters[SAVE_FOLDER.name]
        if not folder:
            raise ValueError(f'parameter {SAVE_FOLDER.name} is empty: set the folder for clouds; '
                             'those formed from then on can be saved')
        if self._latest is None:
            raise ValueError(f'no volume was formed since {SAVE_FOLDER.name} was set')
        cells, stamp_ns, told = self._latest
        path = Path(folder, f'volume_{file_stem(stamp_ns)}.ply')
        return functools.partial(_write, path, cells, told)


def _write(path: Path, cells: BrightCells, told: Radiometry | None) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_ply(path, cells.points_m, {'intensity': cells.level_db(told)},
              f'radar volume; intensity: {LEVELS[told is not None]}')
    return f'wrote {path}, {len(cells.points_m)} points'
