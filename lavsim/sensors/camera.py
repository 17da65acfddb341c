"""Cameras in CARLA's formats: colour, class tags, depth and instances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.camera_view import SKY_DEPTH, CameraImages, CameraView
from lavsim.render.look import LOOKS
from lavsim.render.scene import Scene
from lavsim.render.tags import TAG_TABLES
from lavsim.sensors.base import DEGREES, SENSORS, ArraySpec, Sensor, SensorConfig, attribute
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


def _words(words: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """(H, W, 4) image of words with blue in the lowest byte (H, W), opaque."""
    pixels = (words | np.uint32(0xFF000000)).astype("<u4", copy=False)
    return pixels.view(np.uint8).reshape(*words.shape, 4)


@dataclass(frozen=True)
class ColourConfig(CameraConfig):
    """A colour camera. CARLA's attributes of lens, exposure and post-processing are taken and change nothing.

    Attributes:
        look: One of `lavsim.render.look.LOOKS`.
    """

    look: str = attribute("look", "fast")
    lens_circle_falloff: float = attribute("lens_circle_falloff", 5.0)
    lens_circle_multiplier: float = attribute("lens_circle_multiplier", 0.0)
    lens_k: float = attribute("lens_k", -1.0)
    lens_kcube: float = attribute("lens_kcube", 0.0)
    lens_x_size: float = attribute("lens_x_size", 0.08)
    lens_y_size: float = attribute("lens_y_size", 0.08)
    chromatic_aberration_intensity: float = attribute("chromatic_aberration_intensity", 0.0)
    chromatic_aberration_offset: float = attribute("chromatic_aberration_offset", 0.0)
    gamma: float = attribute("gamma", 2.2)
    fstop: float = attribute("fstop", 1.4)
    iso: float = attribute("iso", 100.0)
    shutter_speed: float = attribute("shutter_speed", 200.0)
    bloom_intensity: float = attribute("bloom_intensity", 0.675)
    motion_blur_intensity: float = attribute("motion_blur_intensity", 0.45)
    exposure_mode: str = attribute("exposure_mode", "histogram")
    exposure_compensation: float = attribute("exposure_compensation", 0.0)
    sensor_tick: float = attribute("sensor_tick", 0.0)

    def problem(self) -> str | None:
        if self.look not in LOOKS:
            return f"'look' must be one of {', '.join(LOOKS)}, got {self.look!r}"
        return super().problem()


@dataclass(frozen=True)
class LabelConfig(CameraConfig):
    """A camera of classes.

    Attributes:
        tags: "old" for CARLA's ids up to 0.9.13, "new" for those from 0.9.14 on.
    """

    tags: str = attribute("tags", "old")

    def problem(self) -> str | None:
        if self.tags not in TAG_TABLES:
            return f"'tags' must be one of {', '.join(TAG_TABLES)}, got {self.tags!r}"
        return super().problem()


@SENSORS.register("sensor.camera.rgb")
class ColourCamera(_Camera):
    """Colours, in the look that the attribute `look` names."""

    config_type = ColourConfig
    config: ColourConfig
    _codec = "jpeg"

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.uint8]:
        return self.view.colour(history[-1], scene, self.draws(draws), self.config.look)


@SENSORS.register("sensor.camera.semantic_segmentation")
class TagCamera(_Camera):
    """Class ids in the red channel."""

    config_type = LabelConfig
    config: LabelConfig

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.uint8]:
        tags, _ = self.view.labels(history[-1], scene, self.config.tags)
        return _words(tags.astype(np.uint32) << np.uint32(16))


@SENSORS.register("sensor.camera.depth")
class DepthCamera(_Camera):
    """Distance along the optical axis: (R + 256 G + 65536 B) / (2^24 - 1) * 1000 m."""

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.uint8]:
        depth = self.view.depth(history[-1], scene)
        code = (depth * np.float64((2**24 - 1) / SKY_DEPTH) + 0.5).astype(np.uint32)
        low, middle, high = code & np.uint32(255), code & np.uint32(0xFF00), code >> np.uint32(16)
        return _words((low << np.uint32(16)) | middle | high)


@SENSORS.register("sensor.camera.instance_segmentation")
class InstanceCamera(_Camera):
    """Class ids in the red channel, the low 16 bits of the actor's id in green (low byte) and blue."""

    config_type = LabelConfig
    config: LabelConfig

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.uint8]:
        tags, instance = self.view.labels(history[-1], scene, self.config.tags)
        actor = instance.view(np.uint32)
        low, high = (actor & np.uint32(255)) << np.uint32(8), (actor >> np.uint32(8)) & np.uint32(255)
        return _words((tags.astype(np.uint32) << np.uint32(16)) | low | high)
