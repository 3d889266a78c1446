"""Step of backprojection that forms volumes: phase centres in two dimensions resolve height."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from sar_imaging.streaming.aperture import ApertureImage

from .backprojection_parameters import IMAGE
from .backprojection_steps import ImageStep
from .images.terrain import TERRAIN_FILE
from .images.volume_cloud import VolumeCloud
from .runtime.health import Health, Part
from .runtime.managed import ManagedNode
from .runtime.parameters import ConfigurationError


class VolumeStep(ImageStep):
    """Range profiles to volumes; see `ApertureImager`."""

    def __init__(self, parameters: Mapping[str, object], health: Health | Part):
        if parameters[TERRAIN_FILE.name]:
            raise ConfigurationError(f'parameter {TERRAIN_FILE.name}: a volume has level '
                                     f'layers; use mode {IMAGE} on terrain')
        super().__init__(parameters, health)

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
                                            lambda: self._pulses.pulses(product.counters))
        if image is not None:
            self._cloud.publish(image, product.stamp_ns)
