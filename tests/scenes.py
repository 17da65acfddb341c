"""Small scenes without a map: a street with houses, and a bare plain."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lavsim.map.prisms import Prisms
from lavsim.render.ground import RESOLUTION, GroundRaster, Surface, fill_polygon
from lavsim.render.scene import Scene
from lavsim.types import Tag
from tests.prisms import box

LAMPS = ((255, 40, 30), (255, 190, 40), (40, 220, 110))


def plain(*statics: Prisms, surface: Surface = Surface.ROAD, reach: float = 100.0) -> Scene:
    """A scene with one kind of ground."""
    return Scene(None, GroundRaster.blank((-reach, -reach, reach, reach), surface), Prisms.concatenate(statics))


def signal(x: float, y: float, light: int = 0) -> Prisms:
    """A pole with a three-lamp head that looks along -x."""
    parts = [box(x, y, 0.15, 0.15, 0.0, 3.0, tag=Tag.POLE), box(x, y, 0.25, 0.4, 3.0, 4.2, tag=Tag.TRAFFIC_LIGHT)]
    for lamp, colour in enumerate(LAMPS):
        top = 4.1 - 0.36 * lamp
        parts.append(
            box(x - 0.15, y, 0.05, 0.28, top - 0.28, top, tag=Tag.TRAFFIC_LIGHT, colour=colour, light=light, lamp=lamp)
        )
    return Prisms.concatenate(parts)


@lru_cache(maxsize=1)
def street() -> Scene:
    """A road along x with a mark in its middle, sidewalks, houses on both sides and a light at x = 60."""
    classes = np.zeros((1000, 3000), np.uint8)
    low = np.array([-100.0, -50.0])
    for half, surface in ((7.0, Surface.SIDEWALK), (4.0, Surface.ROAD), (0.1, Surface.WHITE_SOLID)):
        corners = np.array([[-100.0, -half], [200.0, -half], [200.0, half], [-100.0, half]])
        fill_polygon(classes, (corners - low) / RESOLUTION, int(surface))
    houses = [box(x, side * 16.0, 18.0, 10.0, 0.0, 9.0) for x in range(-80, 160, 24) for side in (-1, 1)]
    return Scene(None, GroundRaster(classes, low), Prisms.concatenate([*houses, signal(60.0, 5.0)]))
