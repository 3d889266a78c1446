"""Step of backprojection that forms the sub-aperture images of AFBP."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from msg_conversions.subaperture_image import to_message
from msg_conversions.subaperture_wire import as_received
from sar_imaging.backends import compile_beforehand
from sar_imaging.signal.pulses.sequence import describe_range
from sar_imaging.streaming.subaperture_image import SubapertureImage
from sar_imaging.streaming.subapertures import LiveSubapertures

from .backprojection_parameters import IMAGE
from .backprojection_steps import BackprojectionStep
from .images.image_grid import describe_grid
from .images.terrain import TERRAIN_FILE
from .runtime.backends import backend_of
from .runtime.block_output import BlockOutput
from .runtime.health import Cause, Health, Part
from .runtime.managed import ManagedNode
from .runtime.parameters import ConfigurationError


class SubapertureStep(BackprojectionStep):
    """Range profiles to sub-aperture images; see `LiveSubapertures`."""

    def __init__(self, parameters: Mapping[str, object], health: Health | Part):
        super().__init__(parameters, health)
        p = parameters
        if p[TERRAIN_FILE.name]:
            raise ConfigurationError(f'parameter {TERRAIN_FILE.name}: sub-apertures are fused on '
                                     f'a plane; use mode {IMAGE} on terrain')
        follow_m = ((p['subapertures.follow_ahead'], p['subapertures.follow_left'])
                    if p['subapertures.follow'] else None)
        chosen = backend_of(p)
        try:
            self._imager = LiveSubapertures(
                self._grid, pulses_per_aperture=p['pulses_per_aperture'],
                pulses_per_subaperture=p['subapertures.pulses'],
                target_db=p['subapertures.target_db'], sliding=p['subapertures.sliding'],
                follow_m=follow_m, illumination=self._pattern, backend=chosen)
        except ValueError as error:
            raise ConfigurationError(f'subapertures: {error}') from error
        compile_beforehand('SubapertureImager')  # the first sub-aperture must not wait for it

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publisher of the sub-aperture images; see `Step`."""
        self._output = BlockOutput(node, 'subaperture_images', self.parameters, self.health,
                                   to_message)

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
        images = self._follow(self._imager.catch_up)
        self._imager.plan_ahead()
        self.report(self._imager.take_events())
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
        s = self._imager.statistics
        self.health.set('plans_made', s.plans)
        self.health.set('plans_anew', s.plans_anew)
        self.health.set('last_plan_seconds', s.plan_seconds)
        since_s = self._imager.planning_since_s
        self.health.cause(Cause.PLANNING, '' if since_s is None else (
            f'planning an aperture for {time.perf_counter() - since_s:.1f} s so far; pulses wait'))

    def _follow(self, work, *arguments) -> list[SubapertureImage]:
        # Rounded as messages round them, so that the pipeline's images are those of the nodes.
        return [as_received(image) for image in super()._follow(work, *arguments)]
