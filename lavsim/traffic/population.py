"""Background traffic of a drive: who is spawned where, and the kernel that drives them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.traffic.drivers import draw_driver
from lavsim.traffic.obstacles import Boxes, fill_grid, make_grid
from lavsim.traffic.vehicles import PATH_LANES, Fleet, drive, extend_path, lanes_of, make_approaches
from lavsim.types import ActorIds, LaneType, Role
from lavsim.world.blueprints import BLUEPRINTS, Blueprint
from lavsim.world.world import World

_SPACING = 12.0  # [m] between spawn points of a lane
_CLEAR_OF_EGO = 15.0  # [m]
_GRID_MARGIN = 1.7  # [m] half the widest driver and its side margin


def spawn_points(town: TownMap) -> NDArray[np.float64]:
    """Places for vehicles `(S, 2)`: lane and travelled length, evenly along driving lanes outside junctions."""
    lanes = town.lanes
    points = []
    for lane in np.flatnonzero((lanes.type == LaneType.DRIVING) & (lanes.junction < 0)):
        count = int((lanes.length[lane] - 8.0) // _SPACING)
        points += [(lane, 6.0 + _SPACING * k) for k in range(count)]
    return np.array(points, dtype=np.float64).reshape(-1, 2)


class Traffic:
    """The vehicles that are just there.

    Args:
        town: Where they drive.
        world: What they are spawned into; the ego must be there already.
        draws: Root of the drive's draws.
        count: Vehicles wanted; fewer where the town has no room.
    """

    def __init__(self, town: TownMap, world: World, draws: Draws, count: int) -> None:
        self._world = world
        self._draws = draws.stream("traffic")
        self._lanes = lanes_of(town)
        self._bounds = np.asarray(town.bounds) + np.array([-20.0, -20.0, 20.0, 20.0])
        self._grid = make_grid(self._bounds, 256)
        points = spawn_points(town)
        order = self._draws.stream("places").permutation(0, len(points))
        points = points[order]
        places = town.centre(points[:, 0].astype(np.int64), points[:, 1])
        far = np.hypot(*(places[:, :2] - world.ego.xy).T) > _CLEAR_OF_EGO
        points, places = points[far][:count], places[far][:count]
        self._fleet = self._spawn(points, places)
        self._near = make_approaches(len(town.lanes.length), len(points))

    def __len__(self) -> int:
        return len(self._fleet.row)

    @property
    def rows(self) -> NDArray[np.int64]:
        """Rows of the background vehicles in the world."""
        return self._fleet.row

    def control(self, lights: NDArray[np.uint8]) -> None:
        """Lets every driver decide on this tick; writes the world's commands."""
        world, n = self._world, self._world.count
        boxes = Boxes(world.present[:n], world.pose[:n], world.velocity[:n], self._half_sizes(), world.height[:n])
        if len(self._grid.box) < 48 * n:
            self._grid = make_grid(self._bounds, 2 * n)
        fill_grid(self._grid, boxes, _GRID_MARGIN)
        drive(
            self._lanes, self._fleet, boxes, self._grid, self._near, lights, world.touched[:n], world.tick,
            world.body[:n, 0], world.command[:n], world.lights[:n],
        )  # fmt: skip

    def _half_sizes(self) -> NDArray[np.float64]:
        return self._world.table.sizes[:, :2].astype(np.float64) / 2.0

    def _spawn(self, points: NDArray[np.float64], places: NDArray[np.float64]) -> Fleet:
        count = len(points)
        fleet = Fleet(
            row=np.zeros(count, np.int64),
            key=np.zeros(count, np.uint64),
            lane=points[:, 0].astype(np.int32),
            u=points[:, 1].copy(),
            path=np.full((count, PATH_LANES), -1, np.int32),
            hops=np.zeros(count, np.int64),
            driver=np.zeros((count, 5)),
            committed=np.full(count, -1, np.int32),
            halted=np.full(count, -1, np.int32),
        )
        for i in range(count):
            actor_id = int(ActorIds.TRAFFIC) + i
            blueprint = self._blueprint(actor_id)
            colour = blueprint.colour(self._draws, actor_id)
            actor = self._world.spawn(actor_id, blueprint, places[i, :3], float(places[i, 3]), Role.TRAFFIC, colour)
            driver = draw_driver(self._draws, actor_id)
            fleet.row[i] = actor.row
            fleet.key[i] = self._draws.stream("branch", actor_id).key
            fleet.driver[i] = (
                driver.speed_factor, driver.headway, driver.min_gap, driver.acceleration, driver.deceleration
            )  # fmt: skip
            extend_path(self._lanes, fleet, i)
        return fleet

    def _blueprint(self, actor_id: int) -> Blueprint:
        """A vehicle of background traffic, by weight."""
        choices = [blueprint for blueprint in BLUEPRINTS.values() if blueprint.weight > 0.0]
        ends = np.cumsum([blueprint.weight for blueprint in choices])
        share = self._draws.stream("blueprint", actor_id).uniform(0, 1)[0]
        return choices[int(np.searchsorted(ends, share * ends[-1], side="right"))]
