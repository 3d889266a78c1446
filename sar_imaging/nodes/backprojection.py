# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node backprojection: form images, volumes, or sub-aperture images of AFBP, from profiles."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from msg_conversions.subaperture_image import to_message
from msg_conversions.subaperture_wire import as_received

from ..backends import AUTO, compile_beforehand
from ..configuration.startup import TrackWarnings, report_block
from ..exploitation.obstacles.aperture_view import PulseTracks
from ..formats.acquisition import Acquisition
from ..geometry.grids import TerrainGrid
from ..imaging.image import Image, Report, error_in_words
from ..imaging.methods import AFBP, EXACT
from ..signal.pulses import PulseBlock, check_frame
from ..signal.pulses.sequence import describe_counters, describe_range
from ..streaming.aperture import ApertureImage, ApertureImager
from ..streaming.subaperture_image import SubapertureImage
from ..streaming.subapertures import LiveSubapertures
from .antenna import PATTERN, PATTERN_PARAMETERS, pattern_from
from .images import (
    autofocus,
    corrected_pose,
    focus_watch,
    image_brightness,
    image_files,
    image_products,
    obstacle_products,
    volume_cloud,
)
from .images.autofocus import POSITION_STD, ImageFocus
from .images.corrected_pose import CorrectedPose
from .images.focus_watch import FocusWatch, count_focus
from .images.image_brightness import ImageBrightness
from .images.image_files import ImageFiles
from .images.image_grid import (
    GRID_PARAMETERS,
    TERRAIN_FILE,
    describe_grid,
    imaging_settings,
    terrain_heights,
)
from .images.image_products import ImageProducts
from .images.obstacle_products import ObstacleProducts
from .images.volume_cloud import VolumeCloud
from .poses import pose_input
from .poses.frame_datum import DatumInput
from .poses.known_positions import REMEMBERED
from .runtime.block_output import UNTAKEN, BlockOutput
from .runtime.health import Cause, Health, Part
from .runtime.managed import ManagedNode, run
from .runtime.parameters import (
    BACKEND,
    ConfigurationError,
    Parameter,
    backend_of,
    one_of,
    refused,
)
from .runtime.stage import Stage
from .runtime.step import APERTURE_TIMEOUT, MIN_PULSE_FRACTION, LiveStep, subaperture_qos

IMAGE, SUBAPERTURES, VOLUME = 'image', 'subapertures', 'volume'
PARAMETERS = (
    Parameter('mode', IMAGE, f'{IMAGE}: exact images of whole apertures; {SUBAPERTURES}: '
              f'sub-aperture images for afbp_fusion; {VOLUME}: exact volumes as point clouds.',
              check=one_of(IMAGE, SUBAPERTURES, VOLUME)),
    *GRID_PARAMETERS,
    TERRAIN_FILE,
    APERTURE_TIMEOUT,
    MIN_PULSE_FRACTION,
    Parameter('method', EXACT, f'Imager in mode {IMAGE}: {EXACT} backprojection, as pulses come; '
              f'{AFBP} of whole apertures; {AUTO}: of these the quicker one that meets target_db.',
              check=one_of(AUTO, EXACT, AFBP)),
    BACKEND,
    Parameter('target_db', -60.0, 'Largest predicted error against time-domain correlation in '
              f'modes {IMAGE} and {VOLUME}.', 'dB', -100.0, -20.0),
    Parameter('subapertures.target_db', -60.0, 'Largest predicted error in mode '
              f'{SUBAPERTURES}.', 'dB', -85.0, -20.0),
    Parameter('subapertures.pulses', 0, 'Length of a sub-aperture; 0 for the quickest.', 'pulses',
              0, 2**31 - 1),
    Parameter('subapertures.sliding', False, 'Every sub-aperture ends an image of one '
              "aperture's length."),
    Parameter('subapertures.follow', False, 'The image moves along with the antenna, on the '
              'pixels that the grid continues to.'),
    Parameter('subapertures.follow_ahead', 0.0, 'From the middle of an aperture to that of its '
              'image, along the direction of flight.', 'm', -1e6, 1e6),
    Parameter('subapertures.follow_left', 0.0, 'From the middle of an aperture to that of its '
              'image, to the left of the direction of flight.', 'm', -1e6, 1e6),
    *autofocus.PARAMETERS,
    *pose_input.TRACK_PARAMETERS,
    *PATTERN_PARAMETERS,
    *image_brightness.PARAMETERS,
    *image_products.PARAMETERS,
    *image_files.PARAMETERS,
    *obstacle_products.PARAMETERS,
    *volume_cloud.PARAMETERS,
)


class BackprojectionStep(LiveStep):
    """What both modes have in common: pulses are sorted into apertures as they come."""

    NAME = 'backprojection'
    PARAMETERS = PARAMETERS
    COUNTERS = ('images_published', 'subapertures_published', 'plans_made', 'plans_anew',
                'pulses_imaged', 'pulses_missing_in_last_aperture', 'pulses_skipped',
                'last_image_seconds', 'image_latency_seconds', 'last_plan_seconds',
                'predicted_error_db', *focus_watch.COUNTERS,
                *focus_watch.DIAGNOSIS_COUNTERS, *autofocus.COUNTERS,
                *corrected_pose.COUNTERS, *image_brightness.COUNTERS,
                *obstacle_products.COUNTERS, *volume_cloud.COUNTERS)
    FAULTS = ('pulses_missing', 'pulses_late', 'pulses_duplicate', 'pulses_corrupt',
              'apertures_dropped', 'restarts', UNTAKEN, *image_brightness.FAULTS,
              *obstacle_products.FAULTS)
    STATISTICS = {'pulses_imaged': 'imaged', 'pulses_late': 'late',
                  'pulses_duplicate': 'duplicate', 'apertures_dropped': 'apertures_dropped',
                  'restarts': 'restarts'}
    IDLE_PARAMETER = 'aperture_timeout_s'
    SAVE_SERVICE = 'save_image'
    WITHOUT_TERRAIN = ''  # why, where it is impossible on terrain

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        super().__init__(parameters, health)
        if parameters[TERRAIN_FILE.name] and self.WITHOUT_TERRAIN:
            raise ConfigurationError(f'parameter {TERRAIN_FILE.name}: {self.WITHOUT_TERRAIN}; use '
                                     f'mode {IMAGE} on terrain')
        imaging = imaging_settings(parameters)
        self._grid, self._pixels = imaging.grid, imaging.volume or imaging.grid
        self._pattern = pattern_from(parameters)
        self._watch = FocusWatch(imaging.middle_grid, parameters['pulses_per_aperture'], health,
                                 watching=not (parameters[TERRAIN_FILE.name]
                                               or parameters['mode'] == VOLUME))
        self._reported_for: tuple[Any, ...] | None = None  # radar and shape of the blocks
        self._refusal = ''  # why these cannot be imaged
        self._track: TrackWarnings | None = None  # that wait for more of it

    @classmethod
    def create(cls, parameters: Mapping[str, Any],
               health: Health | Part) -> BackprojectionStep:
        """Step of the mode that the parameters ask for."""
        kinds = {IMAGE: ImageStep, VOLUME: VolumeStep, SUBAPERTURES: SubapertureStep}
        return kinds[parameters['mode']](parameters, health)

    def process(self, block: PulseBlock) -> list[Any]:
        """Add profiles to their aperture; returns the products that became complete."""
        check_frame(block, self.parameters['frame_id'])
        self._check(block)
        self._check_pointing(block)
        self._watch.see(block)
        try:
            return self.follow(self.live.add, block)
        except ValueError as error:
            raise self._watch.explain(error, block) from error

    def _check(self, block: PulseBlock) -> None:
        """Tell, once for each radar, what follows from it, its track and the parameters.

        Raises
        ------
        ValueError
            No useful image can come of it.
        """
        key = (block.radar, block.samples.shape[1:])
        if key != self._reported_for:
            report = report_block(self.parameters, block)
            if report.lines:
                self._reported_for = key  # else the block is too short to tell
                self.health.info('\n  '.join(('derived quantities:', *report.lines)))
            for text in report.warnings:
                self.health.warning(text)
            self._refusal, self._track = '; '.join(report.errors), report.track
        self._judge_track(block)
        if self._refusal:
            raise ValueError(self._refusal)

    def _check_pointing(self, block: PulseBlock) -> None:
        if self._pattern is not None and block.pointing is None:
            raise ValueError(f'{PATTERN.name}={self.parameters[PATTERN.name]}: the pulses do not '
                             'tell where the antenna looked; set antenna.pointing of '
                             f'pulse_buffer, or {PATTERN.name}: none')

    def _judge_track(self, block: PulseBlock) -> None:
        """Give the warnings that hold for a straight track, once it has proved straight."""
        if self._track is None or (straight := self._track.straight(block)) is None:
            return
        for text in self._track.texts if straight else ():
            self.health.warning(text)
        if not straight:
            self.health.info('the track is not straight; the derived quantities assume that it '
                             'is')
        self._track = None

    def _count_product(self, n_missing: int, predicted_error_db: float | None) -> float:
        """Count what both kinds of products have; returns the seconds of work on this one."""
        self.health.count('pulses_missing', n_missing)
        self.health.set('predicted_error_db',
                        math.nan if predicted_error_db is None else predicted_error_db)
        return self.count_work()


class ImageStep(BackprojectionStep):
    """Range profiles to images; see `ApertureImager`."""

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        super().__init__(parameters, health)
        self._datum = DatumInput(parameters, health)
        self._focus = ImageFocus.wanted(parameters, self._grid, health, self._datum)
        self._positions = None if self._focus is None else self._focus.positions
        self._heights_m = terrain_heights(parameters, self._grid)
        chosen = backend_of(parameters)
        with refused(f'parameters method and {PATTERN.name}: '):
            self.live = ApertureImager(
                self._pixels, pulses_per_aperture=parameters['pulses_per_aperture'],
                target_db=parameters['target_db'], height_m=self._heights_m,
                keep_pulses=self._focus is not None, method=parameters['method'],
                illumination=self._pattern, backend=chosen)
        self._brightness = ImageBrightness(parameters, self._pattern, health)
        self._files = ImageFiles(parameters, self._datum)
        self._pulses = (PulseTracks(REMEMBERED * parameters['pulses_per_aperture'])
                        if self._positions is None else self._positions.pulses)
        self._obstacles: ObstacleProducts | None = None  # images on terrain have none
        self._pose: CorrectedPose | None = None  # where its errors are told
        compile_beforehand('Backprojection')  # the first image must not wait for it
        if parameters['method'] != EXACT:
            compile_beforehand('SubapertureImager', 'SpectrumFusion')

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publishers of the images; see `Step`."""
        self._products = ImageProducts(node, self.parameters)
        if not self.parameters[TERRAIN_FILE.name]:
            self._obstacles = ObstacleProducts(node, self.parameters, self.health, self._datum)
        if self._positions is not None:
            self._positions.configure(node)
        if self.parameters[POSITION_STD.name]:
            self._pose = CorrectedPose(node, self.parameters, self.health, self._positions)

    def activate(self, node: ManagedNode) -> None:
        """Tell where the images will be; see `Step`."""
        self._datum.activate(node)
        self._products.announce(self._grid, node.get_clock().now().to_msg())
        if self._obstacles is not None:
            self._obstacles.activate(node)
        if self._positions is not None:
            self._positions.activate(node)

    def process(self, block: PulseBlock) -> list[ApertureImage]:
        """Add profiles to their aperture; see `BackprojectionStep`."""
        (self._positions or self._pulses).add(block)
        return super().process(block)

    def collect(self) -> list[ApertureImage]:
        """Images that waited for positions behind their aperture; see `Step`."""
        return [] if self._positions is None else self._focused([])

    def flush(self) -> list[ApertureImage]:
        """Close the aperture, and let no image wait any longer; see `Step`."""
        images = super().flush()
        return images if self._focus is None else images + self._focused([], final=True)

    def discard(self) -> int:
        """Forget the aperture being filled and images that wait; see `Step`."""
        return super().discard() + (self._focus.discard() if self._focus is not None else 0)

    def summary(self) -> str:
        """Settings for the log line at the start."""
        return (f' -> {self._topic}, {describe_grid(self._pixels)} in frame '
                f'{self.parameters["frame_id"]}, '
                f'{self.parameters["pulses_per_aperture"]} pulses per aperture'
                + ('' if self._focus is None else f', {self._focus.summary()}'))

    def publish(self, product: ApertureImage) -> None:
        """Publish an image on all its topics."""
        self._send(product)
        seconds = self._count_product(product.n_missing, product.predicted_error_db)
        self.health.set('pulses_missing_in_last_aperture', product.n_missing)
        details = f'; {product.focus.details}' if product.focus else ''
        figure = count_focus(product.image, self.health)
        self.health.info(f'{self.describe(product)}; {seconds:.3g} s of work, '
                         f'{error_in_words(product.predicted_error_db)}, {figure}'
                         f'{self._brightness.told}{details}')
        self.health.count('images_published')
        self._watch.judge(product.aperture, figure)
        if self._pose is not None:
            self._pose.publish(product)

    def describe(self, product: ApertureImage) -> str:
        """An image in words."""
        missing = describe_counters(product.missing.tolist()) if product.n_missing else 'none'
        verdict = f', {product.focus.verdict}' if product.focus else ''
        method = '' if product.method == EXACT else f', by {product.method}'
        return (f'image of aperture {product.aperture}: {product.n_pulses} pulses, '
                f'missing {missing}{method}{verdict}')

    def saving(self) -> Callable[[], str]:
        """Function that writes the last image; see `Step`."""
        return self._files.saving()

    @property
    def _topic(self) -> str:
        """What the log names."""
        return self._products.topic

    def _send(self, product: ApertureImage) -> None:
        """Publish an image, and keep it for whoever wants it as a file."""
        which = product.counters, product.stamp_ns  # counters may have begun anew since

        def pulses() -> PulseBlock:
            return self._pulses.pulses(*which)

        image = self._brightness.calibrated(self._image(product), pulses)
        if image is not None:
            self._products.publish(image.samples, product.grid, product.stamp_ns)
            self._files.keep(image, lambda: Acquisition.of(pulses(), antenna=self._pattern),
                             self._brightness.factors(image, pulses))
        if self._obstacles is not None:  # by the contrast to what is around: as it was formed
            illuminated = (None if self._pattern is None else
                           lambda: self._pulses.lit(product.counters, product.grid,
                                                    self._pattern, product.stamp_ns))
            self._obstacles.publish(product.image, product.grid, product.stamp_ns,
                                    lambda: self._pulses.view(*which), illuminated)

    def _image(self, product: ApertureImage) -> Image:
        """The image with all that files tell of it."""
        grid = (product.grid if self._heights_m is None
                else TerrainGrid(product.grid, self._heights_m))
        report = Report(product.method, 'as configured', self.parameters['target_db'],
                        product.predicted_error_db)
        return Image(product.image, grid, product.carrier_hz, report, product.stamp_ns,
                     product.counters.astype(np.int64))

    def follow(self, work: Callable[..., list[Any]], *arguments: object) -> list[ApertureImage]:
        """Images, in focus where that was asked for; see `LiveStep`."""
        images = super().follow(work, *arguments)
        return images if self._focus is None else self._focused(images)

    def _focused(self, images: list[ApertureImage], *, final: bool = False
                 ) -> list[ApertureImage]:
        """Those images that autofocus is through with; its time is work on them."""
        return super().follow(lambda: self._focus.take(images, final=final))


class SubapertureStep(BackprojectionStep):
    """Range profiles to sub-aperture images; see `LiveSubapertures`."""

    WITHOUT_TERRAIN = 'sub-apertures are fused on a plane'
    LIVE_PARAMETERS = ()
    STATISTICS = BackprojectionStep.STATISTICS | {
        'plans_made': 'plans', 'plans_anew': 'plans_anew', 'last_plan_seconds': 'plan_seconds'}

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        super().__init__(parameters, health)
        p = parameters
        follow_m = ((p['subapertures.follow_ahead'], p['subapertures.follow_left'])
                    if p['subapertures.follow'] else None)
        chosen = backend_of(p)
        with refused('subapertures: '):
            self.live = LiveSubapertures(
                self._grid, pulses_per_aperture=p['pulses_per_aperture'],
                pulses_per_subaperture=p['subapertures.pulses'],
                target_db=p['subapertures.target_db'], sliding=p['subapertures.sliding'],
                follow_m=follow_m, illumination=self._pattern, backend=chosen)
        compile_beforehand('SubapertureImager')  # the first sub-aperture must not wait for it

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publisher of the sub-aperture images; see `Step`."""
        self._output = BlockOutput(node, 'subaperture_images', self.parameters, self.health,
                                   to_message, subaperture_qos)

    def summary(self) -> str:
        """Settings for the log line at the start."""
        p = self.parameters
        slide = ', sliding' if p['subapertures.sliding'] else ''
        follow = (f', following the antenna {p["subapertures.follow_ahead"]:g} m ahead, '
                  f'{p["subapertures.follow_left"]:g} m to the left'
                  if p['subapertures.follow'] else '')
        return (f' -> {self._output.topic} for {describe_grid(self._grid)}{follow}, '
                f'{p["pulses_per_aperture"]} pulses per aperture{slide}')

    def prepare(self) -> list[SubapertureImage]:
        """What could wait; then plan the next aperture before its pulses come; see `Step`."""
        images = self.follow(self.live.catch_up)
        self.live.plan_ahead()
        self.report(self.live.take_events())
        return images

    def publish(self, product: SubapertureImage) -> None:
        """Publish a sub-aperture image when somebody subscribes."""
        self._output.publish(product)
        self._count_product(product.n_missing, product.predicted_error_db)
        self.health.count('subapertures_published')
        length = self.parameters['pulses_per_aperture']
        if product.first_counter + product.length >= (product.aperture + 1) * length:
            self._watch.judge(product.aperture)

    def describe(self, product: SubapertureImage) -> str:
        """A sub-aperture image in words."""
        last = product.first_counter + product.length - 1
        return (f'sub-aperture {product.number} of aperture {product.aperture}: pulses '
                f'{describe_range(product.first_counter, last)}, {product.n_missing} missing')

    def saving(self) -> Callable[[], str]:
        """Refuse: images are formed by the next node."""
        raise ValueError('sub-aperture images are no images yet: ask afbp_fusion, which fuses '
                         'them, for save_image')

    def update_counters(self) -> None:
        """Take the statistics over."""
        super().update_counters()
        since_s = self.live.planning_since_s
        self.health.cause(Cause.PLANNING, '' if since_s is None else (
            f'planning an aperture for {time.perf_counter() - since_s:.1f} s so far; pulses wait'))

    def follow(self, work: Callable[..., list[Any]], *arguments: object
               ) -> list[SubapertureImage]:
        """Images, rounded as messages round them: the pipeline's are those of the nodes."""
        return [as_received(image) for image in super().follow(work, *arguments)]


class VolumeStep(ImageStep):
    """Range profiles to volumes; see `ApertureImager`."""

    WITHOUT_TERRAIN = 'a volume has level layers'

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publisher of the clouds; see `Step`."""
        self._cloud = VolumeCloud(node, self.parameters, self.health, self._datum)

    def activate(self, node: ManagedNode) -> None:
        """Listen to the datum; see `Step`."""
        self._datum.activate(node)

    def saving(self) -> Callable[[], str]:
        """Function that writes the latest cloud; see `Step`."""
        return self._cloud.saving()

    @property
    def _topic(self) -> str:
        return self._cloud.topic

    def _send(self, product: ApertureImage) -> None:
        image = self._brightness.calibrated(self._image(product),
                                            lambda: self._pulses.pulses(product.counters,
                                                                        product.stamp_ns))
        if image is not None:
            self._cloud.publish(image, product.stamp_ns)


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
