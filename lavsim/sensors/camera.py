"""Cameras in CARLA's formats: colour, class tags, depth and instances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.camera_view import SKY_DEPTH, CameraImages, CameraView
from lavsim.render.scene import Scene
from lavsim.sensors.base import DEGREES, SENSORS, ArraySpec, Sensor, SensorConfig
from lavsim.world.snapshot import Snapshot

__all__ = ["CameraConfig", "CameraImages", "CameraView", "ColourCamera"]

LARGEST = 8192  # [px]


@dataclass(frozen=True)
class CameraConfig(SensorConfig):
    """A pinhole camera.

    Attributes:
        width, height: [px].
        fov: Horizontal field of view [rad] (degrees in the dict).
    """

    width: int = field(kw_only=True)
    height: int = field(kw_only=True)
    fov: float = field(kw_only=True, metadata={DEGREES: True})

    def problem(self) -> str | None:
        for key, value in (("width", self.width), ("height", self.height)):
            if not 1 <= value <= LARGEST:
                return f"'{key}' must be 1 to {LARGEST} pixels, got {value}"
        if not 0.0 < self.fov < math.pi:
            return f"'fov' must be more than 0 and less than 180 degrees, got {math.degrees(self.fov):g}"
        return None

    @property
    def view(self) -> CameraView:
        return CameraView(self.width, self.height, self.fov, self.mount)


class _Camera(Sensor):
    """What all cameras share: one BGRA image (H, W, 4) uint8."""

    config_type = CameraConfig
    config: CameraConfig
    _codec = "png"

    def __init__(self, config: CameraConfig) -> None:
        super().__init__(config)
        self.view = config.view

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((self.config.height, self.config.width, 4), np.uint8, "BGRA", self._codec)


def _image(blue: Any, green: Any, red: Any) -> NDArray[np.uint8]:
    """(H, W, 4) image of channels (H, W) or numbers, opaque."""
    image = np.empty((*np.shape(red), 4), np.uint8)
    image[..., 0], image[..., 1], image[..., 2], image[..., 3] = blue, green, red, 255
    return image


@SENSORS.register("sensor.camera.rgb")
class ColourCamera(_Camera):
    """Colours in the look `fast`."""

    _codec = "jpeg"

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.uint8]:
        return self.view.colour(history[-1], scene, self.draws(draws))


@SENSORS.register("sensor.camera.semantic_segmentation")
class TagCamera(_Camera):
    """`lavsim.types.Tag` in the red channel."""

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.uint8]:
        tags, _ = self.view.labels(history[-1], scene)
        return _image(0, 0, tags)


@SENSORS.register("sensor.camera.depth")
class DepthCamera(_Camera):
    """Distance along the optical axis: (R + 256 G + 65536 B) / (2^24 - 1) * 1000 m."""

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.uint8]:
        share = self.view.depth(history[-1], scene).astype(np.float64) / SKY_DEPTH
        code = np.rint(share * (2**24 - 1)).astype(np.uint32)
        return _image(code >> 16, (code >> 8) & 255, code & 255)


@SENSORS.register("sensor.camera.instance_segmentation")
class InstanceCamera(_Camera):
    """`Tag` in the red channel, the low 16 bits of the actor's id in green (low byte) and blue."""

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.uint8]:
        tags, instance = self.view.labels(history[-1], scene)
        return _image((instance >> 8) & 255, instance & 255, tags)
