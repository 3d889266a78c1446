# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The datum of the imaging frame as a step knows it: given, found and told, or listened to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped

from msg_conversions.errors import WireFormatError
from msg_conversions.navigation import datum_from_message, datum_to_message
from sar_imaging.configuration.datum import FIX, NONE, configured_datum, describe_datum
from sar_imaging.configuration.positions import plain_frame
from sar_imaging.geometry.earth import Datum

from ..runtime.health import Health, Part
from ..runtime.managed import LATCHED, ManagedNode

TOPIC = 'datum'
DATUM_TEXT = 'datum'  # key of the text on /diagnostics


class FrameDatum:
    """What is known of the datum; may be read in any thread.

    Parameters
    ----------
    parameters : mapping
        Current values of the parameters common to all nodes.
    health : Health or Part
        Log and diagnostics.

    Attributes
    ----------
    value : Datum or None
        None where there is none, or none yet.
    reason : str
        Why there is none, with what to do.
    """

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        self.value: Datum | None = configured_datum(parameters)
        self._source, self._health = parameters['datum.source'], health
        self._frame = plain_frame(parameters['frame_id'])
        self.reason = ('nobody says where on the Earth the frame is: set datum.source'
                       if self._source == NONE else 'the datum is not known yet')

    @property
    def wanted(self) -> bool:
        """Whether there is one, or will be."""
        return self._source != NONE

    @property
    def awaited(self) -> bool:
        """Whether it comes from fixes."""
        return self._source == FIX

    def geographic(self, points_m: np.ndarray) -> np.ndarray | None:
        """(n, 3) latitudes, longitudes, degrees, and ellipsoidal heights, metres, of points.

        NaN while the datum is awaited; None without one.
        """
        if not self.wanted:
            return None
        if self.value is None:
            return np.full_like(points_m, np.nan)
        return np.stack(self.value.to_geographic(points_m), axis=-1)

    def set(self, datum: Datum, how: str) -> None:
        """A datum became known."""
        if datum != self.value:
            self.value = datum
            self._tell(how)

    def wait_for(self, reason: str) -> None:
        """Say what is missing; it stands in the diagnostics until a datum is known."""
        self.reason = reason
        if self.value is None and self.wanted:
            self._health.tell(DATUM_TEXT, f'not determined: {reason}')

    def _tell(self, how: str) -> None:
        text = describe_datum(self.value)
        self._health.tell(DATUM_TEXT, text)
        self._health.info(f'origin of frame {self._frame} at {text} (latitude and longitude in '
                          f'degrees, above the WGS 84 ellipsoid, y axis clockwise from north), '
                          f'{how}')


class DatumOutput(FrameDatum):
    """Publishes the datum, latched, as soon as it is known."""

    def create(self, node: ManagedNode) -> None:
        """Create the publisher, where there will be something to publish."""
        self._node = node
        self._publisher = node.create_output(TransformStamped, TOPIC, LATCHED)

    def activate(self) -> None:
        """Publish what is known already."""
        if self.value is not None:
            self._tell('as found before' if self.awaited else 'as configured')
            self._publish()
        else:
            self.wait_for('no good fix yet')

    def set(self, datum: Datum, how: str) -> None:
        """Publish a datum that became known."""
        super().set(datum, how)
        self._publish()

    def _publish(self) -> None:
        self._publisher.publish(datum_to_message(
            self.value, self._frame, self._node.get_clock().now().to_msg()))


class DatumInput(FrameDatum):
    """Listens to the datum that `pulse_buffer` finds; knows at once what parameters give."""

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        super().__init__(parameters, health)
        self._refusal = ''

    def activate(self, node: ManagedNode) -> None:
        """Subscribe, where the datum is to be found by others; what is known stays."""
        if not self.awaited:
            return
        self.wait_for(f'nothing came on {node.resolve_topic_name(TOPIC)} yet, which pulse_buffer '
                      'publishes once fixes tell it')
        node.create_input(TransformStamped, TOPIC, self._receive, LATCHED)

    def _receive(self, message: TransformStamped) -> None:
        frame = plain_frame(message.child_frame_id)
        try:
            if frame != self._frame:
                raise WireFormatError(f'it is that of frame {frame!r}; images are in '
                                      f'{self._frame}')
            datum = datum_from_message(message)
        except WireFormatError as error:
            if str(error) != self._refusal:
                self._refusal = str(error)
                self._health.warning(f'no datum in a message of {TOPIC}: {error}')
            return
        self.set(datum, f'from {TOPIC}')
