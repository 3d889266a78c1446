# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node afbp_fusion: fuse sub-aperture images while they arrive, and at the end of apertures."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable, Mapping
from typing import Any

from sar_imaging.backends import compile_beforehand
from sar_imaging.exploitation.obstacles.aperture_view import SubapertureTracks
from sar_imaging.formats import Acquisition
from sar_imaging.imaging.image import Image, Report, error_in_words
from sar_imaging.imaging.methods import AFBP
from sar_imaging.streaming.fusion import FusedImage, LiveFusion
from sar_imaging.streaming.mosaic import StripMosaic
from sar_imaging.streaming.subaperture_image import SubapertureImage

from .antenna import PATTERN_PARAMETERS, pattern_from
from .images import (
    autofocus,
    focus_watch,
    image_brightness,
    image_files,
    image_products,
    obstacle_products,
)
from .images.autofocus import PHASE_GRADIENT, Note, PolarFocus
from .images.image_brightness import ImageBrightness
from .images.image_files import ImageFiles
from .images.image_grid import MAX_IMAGE_PIXELS
from .images.image_products import ImageProducts
from .images.obstacle_products import ObstacleProducts
from .poses.frame_datum import DatumInput
from .runtime.health import Health, Part
from .runtime.inlet import SubapertureImages
from .runtime.managed import ManagedNode, run
from .runtime.parameters import ANY_TIME, BACKEND, Parameter, backend_of
from .runtime.stage import Stage
from .runtime.step import MIN_PULSE_FRACTION, LiveStep, subaperture_qos

PARAMETERS = (
    Parameter('images_every', 0, 'Sub-apertures from one image of an aperture underway to the '
              'next; 0 for none.', 'sub-apertures', 0, 2**31 - 1, changes=ANY_TIME),
    BACKEND,
    MIN_PULSE_FRACTION,
    MAX_IMAGE_PIXELS,
    Parameter('fusion_timeout_s', 10.0, 'An aperture is closed when no sub-aperture came for this '
              'long, by the wall clock; longer than aperture_timeout_s of backprojection.', 's',
              0.01, 3600.0, changes=ANY_TIME),
    Parameter('strip_max_pixels', 0, 'Final images are also joined to a strip of at most so many '
              'pixels; 0 for no strip.', 'pixels', 0, 2**31 - 1),
    PHASE_GRADIENT,
    *PATTERN_PARAMETERS,
    *image_brightness.PARAMETERS,
    *image_products.PARAMETERS,
    *image_files.PARAMETERS,
    *obstacle_products.PARAMETERS,
)


class FusionStep(LiveStep):
    """Sub-aperture images to images; see `LiveFusion`."""

    NAME = 'afbp_fusion'
    INLET = SubapertureImages
    PARAMETERS = PARAMETERS
    COUNTERS = ('images_published', 'images_progressive', 'images_final', 'subapertures_fused',
                'subapertures_skipped', 'pulses_missing_in_last_aperture', 'last_image_seconds',
                'image_latency_seconds', 'predicted_error_db', 'revisions',
                *focus_watch.COUNTERS, *autofocus.FUSION_COUNTERS,
                *image_brightness.COUNTERS,
                *obstacle_products.COUNTERS)
    FAULTS = ('subapertures_missing', 'subapertures_late', 'subapertures_duplicate',
              'subapertures_refused', 'pulses_missing', 'apertures_dropped', 'restarts',
              *image_brightness.FAULTS, *obstacle_products.FAULTS)
    LIVE_PARAMETERS = 'images_every', 'min_pulse_fraction'
    STATISTICS = {**{f'subapertures_{key}': key
                     for key in ('fused', 'late', 'duplicate', 'refused')},
                  **{key: key for key in ('apertures_dropped', 'restarts', 'revisions')}}
    UNDERWAY = 'fused'
    IDLE_PARAMETER = 'fusion_timeout_s'
    SAVE_SERVICE = 'save_image'

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        super().__init__(parameters, health)
        self.live = LiveFusion(max_image_pixels=parameters['max_image_pixels'],
                               backend=backend_of(parameters))
        if parameters[PHASE_GRADIENT.name]:
            self.live.focus = PolarFocus(health)
        most = parameters['strip_max_pixels']
        self._strip = StripMosaic(most) if most else None
        self._tracks = SubapertureTracks()
        self._datum = DatumInput(parameters, health)
        self._files = ImageFiles(parameters, self._datum)
        pattern = pattern_from(parameters)
        self._weighted = pattern is not None
        self._brightness = ImageBrightness(parameters, pattern, health)
        self._n_window = 0  # sub-apertures of a complete image
        self._underway = 0  # pulses since the last aperture was closed
        compile_beforehand('SpectrumFusion')  # the first image must not wait for it

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publishers of the images; see `Step`."""
        self._products = ImageProducts(node, self.parameters)
        self._obstacles = ObstacleProducts(node, self.parameters, self.health, self._datum)
        if self._strip is not None:
            self._strip_products = ImageProducts(node, self.parameters, 'strip/')

    def activate(self, node: ManagedNode) -> None:
        """Listen to the datum, where others find it; see `Step`."""
        self._datum.activate(node)
        self._obstacles.activate(node)

    def summary(self) -> str:
        """Settings for the log line at the start."""
        every = self.parameters['images_every']
        return (f' -> {self._products.topic} in frame {self.parameters["frame_id"]}, '
                + (f'an image every {every} sub-apertures' if every else 'final images only'))

    def process(self, subaperture: SubapertureImage) -> list[FusedImage]:
        """Fuse a sub-aperture image; returns the images that this made possible."""
        before = dataclasses.replace(self.live.statistics)
        images = self.follow(self.live.add, subaperture)
        self._tracks.add(subaperture)
        statistics = self.live.statistics
        self._underway += subaperture.n_pulses * (statistics.fused - before.fused)
        closed = [image.aperture for image in images if image.final]
        if closed or statistics.apertures_dropped > before.apertures_dropped:
            # One that began the next aperture is no part of them.
            ended = subaperture.aperture in closed or not self.live.is_open(subaperture)
            self._underway = 0 if ended else subaperture.n_pulses
        self._n_window = min(subaperture.n_window, subaperture.n_subapertures)
        return images

    def flush(self) -> list[FusedImage]:
        """Close the aperture: the input pauses, or somebody asks."""
        self._underway = 0
        return super().flush()

    def publish(self, product: FusedImage) -> None:
        """Publish an image on all its topics."""
        self._send(product)
        if product.final and self._tracks.is_new(product.aperture):
            self._obstacles.publish(product.image, product.grid, product.stamp_ns,
                                    lambda: self._tracks.view(product.aperture))
        seconds = self.count_work()
        self.health.count('images_published')
        self.health.count('images_final' if product.final else 'images_progressive')
        if product.final:
            self.health.count('pulses_missing', product.n_missing)
            self.health.count('subapertures_missing',
                              max(0, self._n_window - product.n_subapertures))
            self.health.set('pulses_missing_in_last_aperture', product.n_missing)
        error_db = product.predicted_error_db
        self.health.set('predicted_error_db', math.nan if error_db is None else error_db)
        if isinstance(note := self._note(product), Note) and product.final:
            autofocus.tell(self.health, product.aperture, note)
        figure = focus_watch.count_focus(product.image, self.health)
        self.health.info(f'{self.describe(product)}; {seconds:.3g} s of work, '
                         f'{error_in_words(error_db)}, {figure}{self._brightness.told}'
                         + (f'; {note.details}' if note else ''))

    def _send(self, product: FusedImage) -> None:
        """Publish an image, join it to the strip, keep it for whoever wants it as a file."""
        report = Report(AFBP, 'fused while pulses arrived', product.predicted_error_db,
                        product.predicted_error_db)
        image = self._brightness.calibrated(
            Image(product.image, product.grid, product.carrier_hz, report, product.stamp_ns),
            lambda: self._tracks.pulses(product.aperture, weighted=self._weighted))
        if image is None:
            return
        self._products.publish(image.samples, product.grid, product.stamp_ns)
        if product.final and self._strip is not None:
            self._extend_strip(image)
        self._files.keep(image, _acquisition)

    def saving(self) -> Callable[[], str]:
        """Function that writes the last image, and the strip; see `Step`."""
        return self._files.saving(None if self._strip is None else self._strip.form)

    def _extend_strip(self, image: Image) -> None:
        try:
            self._strip.add(image.samples, image.grid)
        except ValueError as error:
            self.health.warning(f'a new strip begins: {error}')
            self._strip.clear()
            return
        if self._strip_products.wanted:
            self._strip_products.publish(*self._strip.form(), image.stamp_ns)

    def describe(self, product: FusedImage) -> str:
        """An image in words."""
        kind = 'image' if product.final else 'progressive image'
        note = self._note(product)
        return (f'{kind} of aperture {product.aperture}: {product.n_subapertures} sub-apertures, '
                f'{product.n_pulses} pulses, {product.n_missing} missing'
                + (f', {note.verdict}' if note else ''))

    def _note(self, product: FusedImage) -> Note | None:
        """What to tell about autofocus, if it was wanted."""
        if self.live.focus is None or isinstance(product.focus, Note):
            return product.focus
        return Note('autofocus not tried', 'final images of apertures that do not slide have it')

    def skip(self, aperture: int | None) -> list[FusedImage]:
        """Leave out an aperture; see `Step`."""
        if aperture is not None and self.live.filling == aperture:
            self.health.count('subapertures_skipped', self.live.reset())
        return []

    def discard(self) -> int:
        """Forget the aperture being fused; returns the number of its pulses."""
        super().discard()
        if self._strip is not None:
            self._strip.clear()
        underway, self._underway = self._underway, 0
        return underway


def _acquisition() -> Acquisition:
    raise ValueError('sub-aperture images do not tell where each pulse was sent, which SICD '
                     'needs: set save.format to geotiff, or use mode image')


class FusionNode(Stage):
    """Publishes images from what comes on `subaperture_images`."""

    NAME = 'afbp_fusion'
    INPUT = 'subaperture_images'
    INPUT_QOS = staticmethod(subaperture_qos)
    STEPS = (FusionStep,)


def main() -> int:
    """Run the node."""
    return run(FusionNode)


if __name__ == '__main__':
    sys.exit(main())
