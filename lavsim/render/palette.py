"""Colours of pictures for people, as blue, green, red (OpenCV's order)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.render.ground import Surface
from lavsim.types import LightState, Tag

Bgr = tuple[int, int, int]

# CARLA's palette of class tags (reference `carla.md` 6.1), red, green, blue.
_TAG_RGB = {
    Tag.NONE: (0, 0, 0), Tag.BUILDING: (70, 70, 70), Tag.FENCE: (190, 153, 153), Tag.OTHER: (55, 90, 80),
    Tag.PEDESTRIAN: (220, 20, 60), Tag.POLE: (153, 153, 153), Tag.ROAD_LINE: (157, 234, 50), Tag.ROAD: (128, 64, 128),
    Tag.SIDEWALK: (244, 35, 232), Tag.VEGETATION: (107, 142, 35), Tag.VEHICLE: (0, 0, 142), Tag.WALL: (102, 102, 156),
    Tag.TRAFFIC_SIGN: (220, 220, 0), Tag.SKY: (70, 130, 180), Tag.GROUND: (81, 0, 81), Tag.BRIDGE: (150, 100, 100),
    Tag.RAIL_TRACK: (230, 150, 140), Tag.GUARD_RAIL: (180, 165, 180), Tag.TRAFFIC_LIGHT: (250, 170, 30),
    Tag.STATIC: (110, 190, 160), Tag.DYNAMIC: (170, 120, 50), Tag.WATER: (45, 60, 150), Tag.TERRAIN: (145, 170, 100),
}  # fmt: skip

TAG_BGR: NDArray[np.uint8] = np.zeros((256, 3), np.uint8)
for _tag, _rgb in _TAG_RGB.items():
    TAG_BGR[_tag] = _rgb[::-1]

_SURFACE_RGB = {
    Surface.TERRAIN: (178, 198, 156), Surface.ROAD: (106, 108, 112), Surface.SIDEWALK: (204, 200, 192),
    Surface.SHOULDER: (140, 138, 134), Surface.PARKING: (122, 122, 128), Surface.MEDIAN: (168, 192, 144),
    Surface.CROSSWALK_GAP: (100, 102, 106), Surface.CROSSWALK: (240, 240, 236), Surface.STOP_LINE: (255, 255, 255),
    Surface.WHITE_SOLID: (250, 250, 246), Surface.WHITE_BROKEN: (250, 250, 246), Surface.YELLOW_SOLID: (244, 196, 60),
    Surface.YELLOW_BROKEN: (244, 196, 60), Surface.CURB: (160, 156, 150),
}  # fmt: skip

# By the bytes of a ground raster: the high bits count bare quarters, which show the road.
SURFACE_BGR: NDArray[np.uint8] = np.zeros((256, 3), np.uint8)
for _surface, _rgb in _SURFACE_RGB.items():
    for _bare in range(16):
        _share = _bare.bit_count() / 4.0
        _blend = [round(a * (1.0 - _share) + b * _share) for a, b in zip(_rgb, _SURFACE_RGB[Surface.ROAD], strict=True)]
        SURFACE_BGR[_surface | (_bare << 4)] = _blend[::-1]

LIGHT_BGR: dict[int, Bgr] = {
    LightState.RED: (48, 48, 226),
    LightState.YELLOW: (32, 190, 250),
    LightState.GREEN: (84, 190, 40),
    LightState.OFF: (90, 90, 90),
    LightState.UNKNOWN: (90, 90, 90),
}

EGO_BGR: Bgr = (200, 90, 20)
ROUTE_BGR: Bgr = (226, 140, 60)
INK_BGR: Bgr = (40, 40, 44)
PAPER_BGR: Bgr = (246, 246, 244)
