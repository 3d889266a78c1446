# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node moving_targets: find moving targets in the range profiles of several channels."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from nav_msgs.msg import MapMetaData
from sensor_msgs.msg import Image, PointCloud2

from msg_conversions.images import complex_to_message, map_metadata_to_message
from msg_conversions.point_cloud import FIELDS, to_message
from sar_imaging.backends import compile_beforehand
from sar_imaging.compilation import require_numba
from sar_imaging.exploitation.movers.moving_targets import (
    LiveMovingTargets,
    MovingTargetFinder,
    MovingTargets,
)
from sar_imaging.formats.points import FORMATS, GEOJSON, write_points
from sar_imaging.geometry.earth import Datum
from sar_imaging.signal.pulses import PulseBlock, check_frame
from sar_imaging.signal.pulses.sequence import describe_counters
from sar_imaging.signal.windows import parse_window

from .images.image_grid import GRID_PARAMETERS, describe_grid, imaging_settings
from .poses.frame_datum import DatumInput
from .runtime.block_output import PRODUCT_QOS, header_at
from .runtime.health import Health, Part
from .runtime.managed import LATCHED, ManagedNode, run
from .runtime.parameters import ANY_TIME, Parameter, one_of
from .runtime.saving import SAVE_FOLDER, file_stem
from .runtime.stage import Stage
from .runtime.step import APERTURE_TIMEOUT, MIN_PULSE_FRACTION, LiveStep

PARAMETERS = (
    *GRID_PARAMETERS,
    Parameter('false_alarm_rate', 1e-6, 'Wanted probability of a false alarm per pixel.', '',
              1e-12, 0.1),
    Parameter('largest_speed', 0.0, 'Range rates to search, plus and minus; 0.0 for all that the '
              'channels tell apart.', 'm/s', 0.0, 1e4),
    Parameter('clutter', 'k', 'Model of the residual clutter: k (estimated K distribution) '
              'or exponential.', check=one_of('k', 'exponential')),
    Parameter('window', 'hamming', 'Taper over the aperture, as the windows of '
              'range_compression.', check=parse_window),
    APERTURE_TIMEOUT,
    MIN_PULSE_FRACTION,
    SAVE_FOLDER,
    Parameter('save.points_format', GEOJSON, 'What ~/save_targets writes: geojson or csv.',
              check=one_of(*FORMATS), changes=ANY_TIME),
)


class MovingTargetsStep(LiveStep):
    """Range profiles to moving targets; see `LiveMovingTargets`."""

    NAME = 'moving_targets'
    PARAMETERS = PARAMETERS
    COUNTERS = ('apertures_searched', 'targets_found', 'pulses_used',
                'pulses_missing_in_last_aperture', 'pulses_skipped', 'last_search_seconds',
                'search_latency_seconds')
    FAULTS = ('pulses_missing', 'pulses_late', 'pulses_duplicate', 'pulses_corrupt',
              'apertures_dropped', 'restarts')
    STATISTICS = {'pulses_used': 'imaged', 'pulses_late': 'late', 'pulses_duplicate': 'duplicate',
                  'apertures_dropped': 'apertures_dropped', 'restarts': 'restarts'}
    WORK = 'search'
    IDLE_PARAMETER = 'aperture_timeout_s'
    SAVE_SERVICE = 'save_targets'

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        super().__init__(parameters, health)
        self._grid = imaging_settings(parameters).grid
        finder = MovingTargetFinder(
            self._grid, false_alarm_rate=parameters['false_alarm_rate'],
            largest_speed_m_per_s=parameters['largest_speed'] or None,
            window=parameters['window'], texture=parameters['clutter'])
        self.live = LiveMovingTargets(
            finder, pulses_per_aperture=parameters['pulses_per_aperture'])
        self._datum = DatumInput(parameters, health)
        self._latest: tuple[int, np.ndarray] | None = None  # time and points
        require_numba('a search for moving targets')
        compile_beforehand('Backprojection')  # the first search must not wait for it

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publishers; see `Step`."""
        self._targets = node.create_output(PointCloud2, 'moving_targets', PRODUCT_QOS)
        self._interferogram = node.create_output(Image, 'interferogram', PRODUCT_QOS)
        self._map_metadata = node.create_output(MapMetaData, 'interferogram_metadata', LATCHED)

    def activate(self, node: ManagedNode) -> None:
        """Tell where the interferograms will be; see `Step`."""
        self._datum.activate(node)
        self._map_metadata.publish(map_metadata_to_message(self._grid,
                                                           node.get_clock().now().to_msg()))

    def summary(self) -> str:
        """Settings for the log line at the start."""
        return (f' -> {self._targets.topic_name}, {describe_grid(self._grid)} in frame '
                f'{self.parameters["frame_id"]}, '
                f'{self.parameters["pulses_per_aperture"]} pulses per aperture, false alarm rate '
                f'{self.parameters["false_alarm_rate"]:g} per pixel')

    def process(self, block: PulseBlock) -> list[MovingTargets]:
        """Add profiles to their aperture; returns the movers of those that became complete."""
        check_frame(block, self.parameters['frame_id'])
        return self.follow(self.live.add, block)

    def nothing_formed(self) -> str:
        """Why the latest `flush` gave nothing."""
        return 'no aperture is being filled, or it was dropped; see the log'

    def publish(self, product: MovingTargets) -> None:
        """Publish the targets, and the interferogram for whoever listens."""
        header = header_at(product.stamp_ns, self.parameters)
        rows = [(*d.position_m, d.radial_velocity_m_per_s, d.snr_db,
                 d.radial_velocity_std_m_per_s) for d in product.detections]
        points = np.array(rows, float).reshape(-1, len(FIELDS))
        self._latest = product.stamp_ns, points
        self._targets.publish(to_message(points, header,
                                         geographic=self._datum.geographic(points[:, :3])))
        if self._interferogram.get_subscription_count():
            self._interferogram.publish(complex_to_message(product.interferogram, header))
        seconds = self.count_work()
        self.health.count('apertures_searched')
        self.health.count('targets_found', len(product.detections))
        self.health.count('pulses_missing', len(product.missing))
        self.health.set('pulses_missing_in_last_aperture', len(product.missing))
        self.health.info(f'{self.describe(product)}; {seconds:.3g} s of work')

    def saving(self) -> Callable[[], str]:
        """Function that writes the targets of the last aperture; see `Step`."""
        folder = self.parameters[SAVE_FOLDER.name]
        if not folder:
            raise ValueError(f'parameter {SAVE_FOLDER.name} is empty: set the folder for targets')
        if self._latest is None:
            raise ValueError('no aperture was searched yet')
        if self._datum.value is None:
            raise ValueError(self._datum.reason)
        stamp_ns, points = self._latest
        path = Path(folder, f'targets_{file_stem(stamp_ns)}.'
                    f'{self.parameters["save.points_format"]}')
        properties = dict(zip(FIELDS[3:], points.T[3:], strict=True))
        return functools.partial(_write, path, points[:, :3], self._datum.value, properties)

    def describe(self, product: MovingTargets) -> str:
        """Movers of an aperture in words."""
        missing = describe_counters(product.missing.tolist()) if len(product.missing) else 'none'
        return (f'aperture {product.aperture}: {len(product.detections)} moving targets, '
                f'{len(product.counters)} pulses, missing {missing}')


def _write(path: Path, points_m: np.ndarray, datum: Datum, properties: dict[str, Any]) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_points(path, points_m, datum, properties)
    return f'wrote {path}, {len(points_m)} targets'


class MovingTargetsNode(Stage):
    """Publishes movers from what comes on `range_profiles`."""

    NAME = 'moving_targets'
    INPUT = 'range_profiles'
    STEPS = (MovingTargetsStep,)


def main() -> int:
    """Run the node."""
    return run(MovingTargetsNode)


if __name__ == '__main__':
    sys.exit(main())
