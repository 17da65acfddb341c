"""Lane marks that the ego's footprint crossed since the last tick, from the map."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lavsim.geometry import box_corners
from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

INVASION_DTYPE = np.dtype([("kind", "<U16"), ("colour", "<U8"), ("width", "<f4")])
_LEVEL_GAP = 3.0  # [m] marks so far above or below the ego lie on another road
_PIECE = 20  # points of a mark in one shape: with short shapes the search tree's boxes stay small
_FARTHEST = 5.0  # [m] a corner that moved more in a tick was set somewhere else


@SENSORS.register("sensor.other.lane_invasion")
class LaneInvasion(Sensor):
    """(N,) of `INVASION_DTYPE`: each mark that a corner of the ego's box crossed, once; empty in most ticks.

    It depends on the map alone, as CARLA's does: what is painted but in no lane's records is no mark. Stop lines are
    none.
    """

    history = 1

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((None,), INVASION_DTYPE, "OpenDRIVE type, colour, m")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[Any]:
        if len(history) < 2 or not scene.has_town:
            return np.zeros(0, INVASION_DTYPE)
        before, now = (_corners(snapshot) for snapshot in history[-2:])
        if np.hypot(*(now - before).T).max() > _FARTHEST:
            return np.zeros(0, INVASION_DTYPE)
        tree, rows = _marks(scene.town)
        found = np.unique(tree.query(shapely.linestrings(np.stack([before, now], axis=1)), predicate="intersects")[1])
        height = float(history[-1].xyz[0, 2])
        crossed = {rows[k][4]: rows[k][:3] for k in found.tolist() if abs(rows[k][3] - height) < _LEVEL_GAP}
        return np.array([crossed[number] for number in sorted(crossed)], INVASION_DTYPE)


def _corners(snapshot: Snapshot) -> NDArray[np.float64]:
    """(4, 2) of the ego's box."""
    length, width, _ = (float(v) for v in snapshot.sizes[0])
    ego = snapshot.ego
    return box_corners([ego.x], [ego.y], [ego.yaw], [length], [width])[0]


@lru_cache(maxsize=4)
def _marks(town: TownMap) -> tuple[shapely.STRtree, list[tuple[str, str, float, float, int]]]:
    """Marks of a town for search: kind, colour, width, height and number of each."""
    lines: list[shapely.LineString] = []
    rows: list[tuple[str, str, float, float, int]] = []
    for number, mark in enumerate(town.marks):
        if mark.kind == "stop" or len(mark.points) < 2:
            continue
        z = np.zeros(len(mark.points)) if mark.z is None else mark.z
        for k in range(0, len(mark.points) - 1, _PIECE):
            lines.append(shapely.LineString(mark.points[k : k + _PIECE + 1]))
            rows.append((mark.kind, mark.colour, float(mark.width), float(z[k]), number))
    return shapely.STRtree(lines), rows
