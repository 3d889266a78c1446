"""Node backprojection: range profiles to an image of every aperture."""

from __future__ import annotations

import sys
import time

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import MapMetaData
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from msg_conversions.images import (
    MAX_DYNAMIC_RANGE_DB,
    amplitude_to_message,
    complex_to_message,
    map_metadata_to_message,
    quicklook_to_message,
)
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.aperture import ApertureImage, ApertureImager
from sar_imaging.imaging.backprojection import compile_kernels
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.sequence import describe_counters

from .managed import LATCHED, run
from .parameters import ANY_TIME, ConfigurationError, Parameter
from .stage import Stage

PARAMETERS = (
    Parameter('grid.centre_x', 0.0, 'Middle of the image, x in the imaging frame.', 'm',
              -1e8, 1e8),
    Parameter('grid.centre_y', 0.0, 'Middle of the image, y in the imaging frame.', 'm',
              -1e8, 1e8),
    Parameter('grid.centre_z', 0.0, 'Height of the image plane in the imaging frame.', 'm',
              -1e8, 1e8),
    Parameter('grid.size_x', 100.0, 'Extent of the image along x.', 'm', 0.0, 1e6),
    Parameter('grid.size_y', 100.0, 'Extent of the image along y.', 'm', 0.0, 1e6),
    Parameter('grid.spacing', 0.25, 'Pixel spacing along x and y; at most half the resolution.',
              'm', 1e-4, 1e4),
    Parameter('max_image_pixels', 2**25, 'Larger images are refused.', 'pixels',
              1, 2**31 - 1),
    Parameter('pulses_per_aperture', 1024, 'Length of an aperture; the same in pulse_buffer.',
              'pulses', 1, 2**31 - 1),
    Parameter('aperture_timeout_s', 5.0, 'An aperture is closed when no input came for this long, '
              'by the wall clock.', 's', 0.01, 3600.0, changes=ANY_TIME),
    Parameter('min_pulse_fraction', 0.5, 'Share of its pulses that an aperture must have to be '
              'imaged.', '', 0.0, 1.0, changes=ANY_TIME),
    Parameter('target_db', -80.0, 'Largest error against exact correlation to plan for.', 'dB',
              -100.0, -20.0),
    Parameter('quicklook.dynamic_range_db', 60.0, 'Range of image_quicklook below the brightest '
              'pixel.', 'dB', 1.0, MAX_DYNAMIC_RANGE_DB, changes=ANY_TIME),
    Parameter('frame_id', 'map', 'Frame of the phase centres and of the images.'),
)


class BackprojectionNode(Stage):
    """Publishes images from what comes on `range_profiles`."""

    NAME = 'backprojection'
    IDLE_PARAMETER = 'aperture_timeout_s'

    def __init__(self):
        super().__init__(
            input_topic='range_profiles', parameters=PARAMETERS,
            counters=('images_published', 'pulses_imaged', 'pulses_missing_in_last_aperture',
                      'last_image_seconds', 'image_latency_seconds', 'predicted_error_db'),
            faults=('pulses_missing', 'pulses_late', 'pulses_duplicate', 'apertures_dropped',
                    'restarts'))
        self.create_trigger('~/form_image', self._form_image)

    def configure(self) -> None:
        """Create the imager and the outputs; see `ManagedNode.configure`."""
        super().configure()
        self._grid = self._make_grid()
        self._imager = ApertureImager(
            self._grid, pulses_per_aperture=self.parameters['pulses_per_aperture'],
            min_pulse_fraction=self.parameters['min_pulse_fraction'],
            target_db=self.parameters['target_db'])
        self._seconds = 0.0  # of work since the last image
        qos = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
        self._amplitude = self.create_output(Image, 'image', qos)
        self._complex = self.create_output(Image, 'image_complex', qos)
        self._quicklook = self.create_output(Image, 'image_quicklook', qos)
        self._map_metadata = self.create_output(MapMetaData, 'map_metadata', LATCHED)
        compile_kernels()  # the first image must not wait for it

    def activate(self) -> None:
        """Tell where the images will be and begin to work; see `ManagedNode.activate`."""
        self._map_metadata.publish(map_metadata_to_message(self._grid,
                                                           self.get_clock().now().to_msg()))
        super().activate()

    def _make_grid(self) -> MapGrid:
        p = self.parameters
        spacing = p['grid.spacing']
        n_pixels = (p['grid.size_x'] / spacing + 1) * (p['grid.size_y'] / spacing + 1)
        if n_pixels > p['max_image_pixels']:
            raise ConfigurationError(
                f'the grid of {p["grid.size_x"]:g} m by {p["grid.size_y"]:g} m has '
                f'{n_pixels:.3g} pixels, more than max_image_pixels={p["max_image_pixels"]}; '
                f'raise grid.spacing={spacing:g} or max_image_pixels')
        return MapGrid.from_size((p['grid.centre_x'], p['grid.centre_y'], p['grid.centre_z']),
                                 p['grid.size_x'], p['grid.size_y'], spacing)

    def summary(self) -> str:
        """Settings for the log line at the start."""
        g = self._grid
        return (f' -> {self._amplitude.topic_name}, {g.n_x} x {g.n_y} pixels of {g.spacing_m:g} m '
                f'around ({g.centre_m[0]:g}, {g.centre_m[1]:g}, {g.centre_m[2]:g}) m in frame '
                f'{self.parameters["frame_id"]}, '
                f'{self.parameters["pulses_per_aperture"]} pulses per aperture')

    def process(self, block: PulseBlock) -> None:
        """Add profiles to their aperture and publish the images that became complete."""
        self._follow(self._imager.add, block)

    def idle(self) -> None:
        """Close the aperture, since the input pauses."""
        self._follow(self._imager.flush)

    def discard(self) -> int:
        """Forget the aperture being filled; returns the number of its pulses."""
        dropped = self._imager.reset()
        self.report(self._imager.take_events())
        self._seconds = 0.0
        return dropped

    def update_counters(self) -> None:
        """Take the imager's statistics over."""
        s = self._imager.statistics
        for key in ('imaged', 'late', 'duplicate'):
            self.health.set(f'pulses_{key}', getattr(s, key))
        self.health.set('apertures_dropped', s.apertures_dropped)
        self.health.set('restarts', s.restarts)

    def _form_image(self) -> tuple[bool, str]:
        """Close the aperture now: answer of the service form_image."""
        dropped = self._imager.statistics.apertures_dropped
        images = self._follow(self._imager.flush)
        if images:
            return True, '; '.join(_describe(image) for image in images)
        if self._imager.statistics.apertures_dropped > dropped:
            return False, ('the aperture has fewer pulses than '
                           f'min_pulse_fraction={self.parameters["min_pulse_fraction"]:g} of it '
                           'and was dropped')
        return False, 'no aperture is being filled'

    def _follow(self, work, *arguments) -> list[ApertureImage]:
        self._imager.min_pulse_fraction = self.parameters['min_pulse_fraction']
        started = time.perf_counter()
        try:
            images = work(*arguments)
        finally:
            self._seconds += time.perf_counter() - started
            self.report(self._imager.take_events())
        for image in images:
            self._publish(image)
        return images

    def _publish(self, result: ApertureImage) -> None:
        header = Header(stamp=Time(sec=result.stamp_ns // 10**9,
                                   nanosec=result.stamp_ns % 10**9),
                        frame_id=self.parameters['frame_id'])
        amplitude = np.abs(result.image)
        self._complex.publish(complex_to_message(result.image, header))
        self._amplitude.publish(amplitude_to_message(amplitude, header))
        self._quicklook.publish(quicklook_to_message(
            amplitude, header, dynamic_range_db=self.parameters['quicklook.dynamic_range_db']))
        seconds, self._seconds = self._seconds, 0.0
        self.health.count('images_published')
        self.health.count('pulses_missing', result.n_missing)
        self.health.set('pulses_missing_in_last_aperture', result.n_missing)
        self.health.set('last_image_seconds', seconds)
        self.health.set('image_latency_seconds', time.monotonic() - self.received_s)
        self.health.set('predicted_error_db', result.predicted_error_db)
        self.health.info(f'{_describe(result)}; {seconds:.3g} s of work, predicted error '
                         f'{result.predicted_error_db:.0f} dB')


def _describe(result: ApertureImage) -> str:
    missing = describe_counters(result.missing.tolist()) if result.n_missing else 'none'
    return f'image of aperture {result.aperture}: {result.n_pulses} pulses, missing {missing}'


def main() -> int:
    """Run the node."""
    return run(BackprojectionNode)


if __name__ == '__main__':
    sys.exit(main())
