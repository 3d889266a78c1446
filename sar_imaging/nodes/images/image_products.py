# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Publish an image on its topics, each built only while it has a subscriber."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import MapMetaData
from sensor_msgs.msg import Image

from msg_conversions.images import (
    amplitude_to_message,
    complex_to_message,
    map_metadata_to_message,
    quicklook_to_message,
)
from msg_conversions.quicklook import ANCHORS, CLUTTER, MAX_DYNAMIC_RANGE_DB
from sar_imaging.geometry.grids import MapGrid

from ..runtime.block_output import PRODUCT_QOS, header_at
from ..runtime.managed import LATCHED
from ..runtime.parameters import ANY_TIME, Parameter, one_of

if TYPE_CHECKING:
    from ..runtime.stage import Stage

PARAMETERS = (
    Parameter('quicklook.anchor', CLUTTER, 'What is dark in image_quicklook: clutter, the median '
              'of the image, or what lies so much below the peak.', check=one_of(*ANCHORS),
              changes=ANY_TIME),
    Parameter('quicklook.dynamic_range_db', 40.0, 'Range of image_quicklook from black to white.',
              'dB', 1.0, MAX_DYNAMIC_RANGE_DB, changes=ANY_TIME),
)


class ImageProducts:
    """Publishes images of one node on all their topics.

    Parameters
    ----------
    node : Stage
        Node whose outputs they are.
    parameters : mapping
        Current values of `PARAMETERS`.
    prefix : str
        What the names of the topics begin with.
    """

    def __init__(self, node: Stage, parameters: Mapping[str, Any], prefix: str = ''):
        self._parameters = parameters
        self._grid: MapGrid | None = None  # that map_metadata tells
        self._complex = node.create_output(Image, f'{prefix}image_complex', PRODUCT_QOS)
        self._amplitude = node.create_output(Image, f'{prefix}image', PRODUCT_QOS)
        self._quicklook = node.create_output(Image, f'{prefix}image_quicklook', PRODUCT_QOS)
        self._map_metadata = node.create_output(MapMetaData, f'{prefix}map_metadata', LATCHED)

    @property
    def topic(self) -> str:
        """Full name of the topic of the amplitudes."""
        return self._amplitude.topic_name

    @property
    def wanted(self) -> bool:
        """Whether somebody subscribes to any of the topics."""
        return any(p.get_subscription_count() for p in (
            self._complex, self._amplitude, self._quicklook, self._map_metadata))

    def announce(self, grid: MapGrid, stamp: Time) -> None:
        """Tell where the images will be, when that has changed."""
        if grid != self._grid:
            self._grid = grid
            self._map_metadata.publish(map_metadata_to_message(grid, stamp))

    def publish(self, image: np.ndarray, grid: MapGrid, stamp_ns: int) -> None:
        """Publish an image.

        Parameters
        ----------
        image : (n_y, n_x) complex64
            Row 0 is the largest y.
        grid : MapGrid
            Where its pixels are.
        stamp_ns : int
            Middle of the aperture, nanoseconds.
        """
        header = header_at(stamp_ns, self._parameters)
        self.announce(grid, header.stamp)
        if self._complex.get_subscription_count():
            self._complex.publish(complex_to_message(image, header))
        wanted = [p for p in (self._amplitude, self._quicklook) if p.get_subscription_count()]
        amplitude = np.abs(image) if wanted else None
        if self._amplitude in wanted:
            self._amplitude.publish(amplitude_to_message(amplitude, header))
        if self._quicklook in wanted:
            self._quicklook.publish(quicklook_to_message(
                amplitude, header,
                dynamic_range_db=self._parameters['quicklook.dynamic_range_db'],
                anchor=self._parameters['quicklook.anchor']))
