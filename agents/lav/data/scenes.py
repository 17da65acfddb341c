"""What perception is held to in a frame: boxes of actors, and the map, turned with the world.

Boxes are (x, y, heading, half length, half width) in the planner frame, as `agents.lav.models.detection` has them; a
turn rotates the world about the ego, clockwise from above [rad], while the ego's own box keeps its heading: it is the
ego that stands askew on its road. Likewise it may stand beside its place, to the right [m].
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.lav.config import GridConfig
from agents.lav.data.points import turned
from agents.lav.frames import planner_from_vehicle
from agents.lav.models.detection import NOBODY, PEDESTRIAN, VEHICLE
from lavsim.dataset.tables import Table
from lavsim.geometry import wrap_angle
from lavsim.sensors.bev import BevConfig, ego_column, ego_row
from lavsim.types import ActorClass

MAP_LAYERS = (0, 3, 4)  # road, solid, broken among the recorded five
MOST_ACTORS = 48  # labelled in a frame, the nearest
_KNOWN = 255


class Actors(NamedTuple):
    """Vehicles and walkers of a frame, the ego first, then the nearest.

    Attributes:
        boxes: (A, 5) float32.
        kinds: (A,) int64 `PEDESTRIAN` or `VEHICLE`; `NOBODY` for padding.
        hits: (A,) int64 LiDAR points on each; the ego has as many as wanted, as have all where nobody counted.
    """

    boxes: NDArray[np.float32]
    kinds: NDArray[np.int64]
    hits: NDArray[np.int64]


def actors_of(table: Table, frame: int, angle: float = 0.0, right: float = 0.0, most: int = MOST_ACTORS) -> Actors:
    """Whom a frame shows."""
    columns = table.columns
    ends = columns["actor_id"].ends
    assert ends is not None
    rows = np.arange(ends[frame], ends[frame + 1])
    kinds = np.array([_kind(value) for value in range(max(ActorClass) + 1)])[columns["actor_class"].values[rows]]
    rows, kinds = rows[kinds != NOBODY], kinds[kinds != NOBODY]
    position, yaw = columns["actor_position"].values[rows, :2], columns["actor_yaw"].values[rows]
    offset = turned(turned(position - position[0], -yaw[0]) - [0.0, right], angle)
    offset[0] = 0.0
    order = np.argsort(np.hypot(*offset.T), kind="stable")[:most]  # the ego, at no distance, is first
    heading = wrap_angle(yaw - yaw[0] + angle)
    heading[0] = 0.0
    halves = columns["actor_size"].values[rows, :2] / 2.0
    boxes = np.concatenate([planner_from_vehicle(offset), heading[:, None], halves], axis=1)[order]
    counted = columns.get("actor_lidar_hits")
    hits = (
        np.full(len(rows), np.iinfo(np.int32).max, np.int64)
        if counted is None
        else counted.values[rows].astype(np.int64)
    )
    hits[0] = np.iinfo(np.int32).max
    found = Actors(np.zeros((most, 5), np.float32), np.full(most, NOBODY), np.zeros(most, np.int64))
    found.boxes[: len(order)], found.kinds[: len(order)], found.hits[: len(order)] = boxes, kinds[order], hits[order]
    return found


def turned_map(
    layers: NDArray[np.uint8], bev: BevConfig, grid: GridConfig, angle: float, right: float = 0.0
) -> NDArray[np.uint8]:
    """(4, rows, cols) 0 or 1: road, solid and broken marks on a grid of the turned world, and where they are known.

    Args:
        layers: (5, H, W) as recorded.
        bev: How they were drawn.
        grid: A cell is set if any of the recorded pixels in it is.
        angle: Of the turn.
        right: Of the ego's own place [m].
    """
    parts = max(1, round(grid.cell * bev.pixels_per_metre))  # samples along a cell's side
    step = grid.cell / parts
    stacked = np.dstack([*layers[list(MAP_LAYERS)], np.full(layers.shape[1:], _KNOWN, np.uint8)])
    # From the middle of sample (u, v) to planner metres, back by the turn, to the recorded pixel's number.
    c, s, scale = np.cos(angle), np.sin(angle), bev.pixels_per_metre
    x0, y0 = step / 2.0 - grid.aside, step / 2.0 - grid.ahead
    back = np.array([[c * step, s * step, c * x0 + s * y0 + right], [-s * step, c * step, c * y0 - s * x0]]) * scale
    back[:, 2] += np.array([ego_column(bev), ego_row(bev)]) - 0.5
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    samples = cv2.warpAffine(stacked, back, (grid.cols * parts, grid.rows * parts), flags=flags, borderValue=0)
    found = samples[::parts, ::parts].copy()
    for row, col in np.ndindex(parts, parts):
        part = samples[row::parts, col::parts]
        np.maximum(found[..., :3], part[..., :3], out=found[..., :3])
        np.minimum(found[..., 3], part[..., 3], out=found[..., 3])
    return np.ascontiguousarray((found > 0).astype(np.uint8).transpose(2, 0, 1))


def _kind(value: int) -> int:
    if value == ActorClass.WALKER:
        return PEDESTRIAN
    return VEHICLE if value <= ActorClass.BICYCLE else NOBODY
