"""The ground that vehicles may be on, as polygons and as an image."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from lavsim.errors import MapError

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

SIMPLER = 0.01  # [m] outlines may be this far off
OVERLAP = 0.005  # [m] lanes are grown by, so that neighbours become one area
MOST_PIXELS = 400_000_000
SHIFT = 4  # fractional bits of pixel coordinates


@lru_cache(maxsize=8)
def drivable_area(town: TownMap, types: int) -> shapely.MultiPolygon:
    """Union of the lanes of `types`."""
    outlines = [shapely.Polygon(town.lane_polygon(int(k))) for k in town.lanes.where(types)]
    ground = shapely.simplify(np.array(outlines, dtype=object), SIMPLER)
    joined = shapely.union_all(shapely.buffer(shapely.make_valid(ground), OVERLAP, join_style="mitre"))
    parts = [part for part in getattr(joined, "geoms", [joined]) if isinstance(part, shapely.Polygon)]
    return shapely.MultiPolygon([part for part in parts if not part.is_empty])


def drivable_raster(town: TownMap, resolution: float, types: int) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether each pixel's middle lies on a lane of `types`, to a pixel's edge; and the corner of the image.

    Raises:
        MapError: the image would be too large.
    """
    origin = np.floor(town.bounds[:2] / resolution) * resolution
    columns, rows = (int(v) + 1 for v in np.ceil((town.bounds[2:] - origin) / resolution))
    if columns * rows > MOST_PIXELS:
        raise MapError(f"{town.name}: an image of {columns} x {rows} pixels is too large; take a coarser resolution.")
    image = np.zeros((rows, columns), np.uint8)
    for lane in town.lanes.where(types):
        corners = (town.lane_polygon(int(lane)) - origin) / resolution - 0.5
        half = len(corners) // 2
        left, right = corners[:half], corners[half:][::-1]
        quads = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
        for quad in np.rint(quads * (1 << SHIFT)).astype(np.int32):
            cv2.fillConvexPoly(image, quad, 1, shift=SHIFT)
    return image.astype(np.bool_), origin
