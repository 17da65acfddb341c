"""Background traffic of a drive: who is spawned where, and the kernel that drives them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.map.town_map import TownMap
from lavsim.portable_math import snapped
from lavsim.random import Draws
from lavsim.traffic.around_ego import LEADING_DISTANCE, LOOK_EVERY, left_behind, places_around
from lavsim.traffic.corridor import corridor_of
from lavsim.traffic.drive import Scene, drive
from lavsim.traffic.drivers import MIN_GAP, Driver, draw_driver
from lavsim.traffic.fleet import clear_slot, extend_path, make_fleet
from lavsim.traffic.guests import find_lost, make_guests
from lavsim.traffic.near import make_near
from lavsim.traffic.network import lanes_of
from lavsim.traffic.obstacles import Boxes, cells_of, make_grid
from lavsim.traffic.sorting import make_sorting
from lavsim.types import DT, ActorIds, LaneType, Role, VehicleLight
from lavsim.world.actor import Actor
from lavsim.world.blueprints import BLUEPRINTS, Blueprint
from lavsim.world.world import World

_SPACING = 12.0  # [m] between spawn points of a lane
_CLEAR_OF_EGO = 15.0  # [m]
_MARGIN = 20.0  # [m] of the grid around the town
_MOST_AROUND_EGO = 80  # vehicles that follow the ego
_CLEAR_AT_START, _CLEAR_OF_EGO_LATER, _CLEAR_OF_OTHERS = 12.0, 35.0, 9.0  # [m] where they appear
_MOST_CALLS = 8  # vehicles on call at once
_SEEN = 40.0  # [m] from the ego: nobody vanishes there
_OUT_OF_SIGHT = 80.0  # [m] from the ego: there others may appear
_ROOM_TO_APPEAR = 15.0  # [m]
_DISSOLVE_PAUSE = 200  # ticks between two vehicles that are taken out
_FLAT = 0.3  # [m] things lower than that are driven over
_SEARCH_TICKS = 10  # between two looks at the whole map for guests that have no lane


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
        follows_ego: Vehicles appear around the ego and are taken out behind it (2.x) instead of filling the town.
        places: (S, 2) lane and travelled length [m] of the places, taken in this order; None draws them.
        driver: Who drives all of them; None draws everybody's driver.

    Attributes:
        dissolved: Vehicles taken out so far because nothing else would have ended a deadlock.
        lamps: `VehicleLight` bits that all have on, as the weather and the hour want it.
    """

    def __init__(
        self,
        town: TownMap,
        world: World,
        draws: Draws,
        count: int,
        follows_ego: bool = False,
        places: NDArray[np.float64] | None = None,
        driver: Driver | None = None,
    ) -> None:
        self._driver = driver
        self._town = town
        self._world = world
        self._draws = draws.stream("traffic")
        self._lanes = lanes_of(town)
        self._corridor = corridor_of(town)
        self._bounds = np.asarray(town.bounds) + _MARGIN * np.array([-1.0, -1.0, 1.0, 1.0])
        self._guests = make_guests()
        self._held: dict[int, tuple[float, float]] = {}  # speed and deceleration by row, where a hazard sets them
        self._calls = np.full(_MOST_CALLS, -1, np.int64)
        self._changes_lanes = True
        self._half = np.zeros((0, 2))
        self._is_flat, self._has_flat = np.zeros(0, np.bool_), False
        self._known = 0
        self._meet()
        self._cells = np.zeros(len(self._lanes.points), np.int32)
        cells_of(self._grid, self._lanes.points, self._cells)
        self.lamps = VehicleLight.NONE
        self.dissolved = 0
        self._dissolved_at = -_DISSOLVE_PAUSE
        self._follows_ego = follows_ego
        self._next_id = int(ActorIds.TRAFFIC)
        if follows_ego:
            self._changes_lanes = False
            self._fleet = make_fleet(min(count, _MOST_AROUND_EGO))
            self._near = make_near(len(town.lanes), len(self._fleet.row))
            self._surround_ego()
            return
        if places is None:
            places = spawn_points(town)
            places = places[self._draws.stream("places").permutation(0, len(places))]
        self._places = places
        poses = snapped(town.centre(places[:, 0].astype(np.int64), places[:, 1]))
        free = np.flatnonzero(np.hypot(*(poses[:, :2] - world.ego.xy).T) > _CLEAR_OF_EGO)[:count]
        self._fleet = make_fleet(len(free))
        self._near = make_near(len(town.lanes), len(free))
        for slot, place in enumerate(free):
            self._spawn(slot, int(places[place, 0]), float(places[place, 1]), poses[place])

    def __len__(self) -> int:
        return int(np.count_nonzero(self._fleet.row >= 0))

    @property
    def rows(self) -> NDArray[np.int64]:
        """Rows of the background vehicles in the world."""
        return self._fleet.row[self._fleet.row >= 0]

    def control(self, lights: NDArray[np.uint8]) -> None:
        """Lets every driver decide on this tick; writes the world's commands."""
        world = self._world
        if self._follows_ego and world.tick % LOOK_EVERY == 0:
            self._leave_behind()
            self._surround_ego()
        n = world.count
        if n > self._known:
            self._meet()
        boxes = Boxes(
            self._in_the_way(n), world.pose[:n], world.velocity[:n], self._half[:n], world.height[:n],
            world.body[:n, 0], self._is_fleet[:n],
        )  # fmt: skip
        if world.tick % _SEARCH_TICKS == 0:
            find_lost(self._town, self._guests, boxes)
        scene = Scene(
            self._lanes, self._corridor, self._cells, boxes, world.motion[:n], world.touched[:n], lights,
            self._sorting, self._grid, self._guests, self._near, self._calls, self._changes_lanes,
        )  # fmt: skip
        stuck = drive(scene, self._fleet, world.tick, int(self.lamps), world.command[:n], world.lights[:n])
        if self._held:
            self._hold_back()
        if stuck >= 0 and not self._follows_ego and world.tick - self._dissolved_at >= _DISSOLVE_PAUSE:
            self._dissolve(stuck)

    def hold(self, row: int, speed: float, deceleration: float) -> None:
        """Keeps the vehicle in `row` from driving faster than `speed` [m/s] until `let_go`; it brakes that hard."""
        self._held[row] = speed, deceleration

    def let_go(self, row: int) -> None:
        """Ends `hold`."""
        self._held.pop(row, None)

    def take_out_near(self, xy: NDArray[np.float64], radius: float) -> int:
        """Takes out the vehicles whose middle is within `radius` of `xy` [m]; returns how many."""
        fleet, taken = self._fleet, 0
        for slot in np.flatnonzero(fleet.row >= 0):
            row = int(fleet.row[slot])
            if np.hypot(*(self._world.pose[row, :2] - xy)) < radius:
                self._world.remove(Actor(self._world, row))
                fleet.row[slot] = -1
                taken += 1
        return taken

    def _hold_back(self) -> None:
        """What hazards have told drivers comes before what they decided."""
        world, rows = self._world, np.fromiter(self._held, np.int64, len(self._held))
        speed, deceleration = np.array(list(self._held.values())).T
        now = world.body[rows, 0]
        allowed = np.maximum(speed, now - deceleration * DT)
        world.command[rows, 0] = np.minimum(world.command[rows, 0], allowed)
        braking = rows[(now > speed) | (speed == 0.0)]
        world.lights[braking] |= int(VehicleLight.BRAKE)

    def _in_the_way(self, count: int) -> NDArray[np.bool_]:
        """(count,) which rows drivers heed: those present but for flat things, debris, which they drive over."""
        present = self._world.present[:count]
        return present & ~self._is_flat[:count] if self._has_flat else present

    def _meet(self) -> None:
        """Takes in the sizes of rows that are new in the world, making room where there is none."""
        count = self._world.count
        if count > len(self._half):
            self._half = np.zeros((max(64, 2 * count), 2))
            self._known = 0
            self._is_fleet = np.zeros(len(self._half), np.bool_)
            self._is_flat = np.zeros(len(self._half), np.bool_)
            self._sorting = make_sorting(len(self._half))
            self._grid = make_grid(self._bounds, len(self._half))
        new = slice(self._known, count)
        self._half[new] = self._world.table.sizes[new, :2].astype(np.float64) / 2.0
        self._is_flat[new] = self._world.table.sizes[new, 2] < _FLAT
        self._has_flat = bool(self._is_flat.any())
        self._known = count

    def _spawn(self, slot: int, lane: int, u: float, pose: NDArray[np.float64]) -> None:
        """Lets a new vehicle appear in a slot of the fleet, at `pose` on a lane's centre."""
        fleet, actor_id = self._fleet, self._next_id
        self._next_id += 1
        blueprint = self._blueprint(actor_id)
        colour = blueprint.colour(self._draws, actor_id)
        actor = self._world.spawn(actor_id, blueprint, pose[:3], float(pose[3]), Role.TRAFFIC, colour)
        clear_slot(fleet, slot)
        fleet.row[slot] = actor.row
        fleet.key[slot] = self._draws.stream("branch", actor_id).key
        fleet.lane[slot], fleet.u[slot] = lane, u
        driver = self._driver or draw_driver(self._draws, actor_id, blueprint.actor_class)
        fleet.driver[slot] = driver.traits
        extend_path(self._lanes, fleet, slot)

    def _surround_ego(self) -> None:
        """Lets vehicles appear where some are missing around the ego."""
        world, ego = self._world, self._world.ego
        hit = self._town.nearest(np.append(ego.xy, world.height[0])[None])
        is_start = not (self._fleet.row >= 0).any()
        others = world.pose[: world.count, :2][world.present[: world.count]]
        for lane, u in places_around(self._town, self._draws, int(hit.lane[0]), float(hit.u[0])):
            free = np.flatnonzero(self._fleet.row < 0)
            if not len(free):
                return
            pose = snapped(self._town.centre(np.array([lane]), np.array([u]))[0])
            far = np.hypot(*(pose[:2] - ego.xy)) > (_CLEAR_AT_START if is_start else _CLEAR_OF_EGO_LATER)
            if far and np.hypot(*(others - pose[:2]).T).min() > _CLEAR_OF_OTHERS:
                self._spawn(int(free[0]), lane, u, pose)
                self._fleet.driver[free[0], MIN_GAP] = LEADING_DISTANCE
                others = np.vstack([others, pose[:2]])

    def _leave_behind(self) -> None:
        """Takes out vehicles that the ego has left behind."""
        world, fleet = self._world, self._fleet
        slots = np.flatnonzero(fleet.row >= 0)
        gone = left_behind(world.pose[fleet.row[slots], :2], world.ego.xy, float(world.pose[0, 2]))
        for slot in slots[gone]:
            world.remove(Actor(world, int(fleet.row[slot])))
            fleet.row[slot] = -1

    def _dissolve(self, slot: int) -> None:
        """Takes a vehicle out that nothing else gets going, and lets a new one appear out of the ego's sight."""
        world, fleet = self._world, self._fleet
        row = int(fleet.row[slot])
        if np.hypot(*(world.pose[row, :2] - world.ego.xy)) < _SEEN:
            return
        self.dissolved += 1
        self._dissolved_at = world.tick
        world.remove(Actor(world, row))
        fleet.row[slot] = -1
        here = world.present[: world.count]
        others = world.pose[: world.count, :2][here]
        order = self._draws.stream("again", self._next_id).permutation(0, len(self._places))
        for place in order:
            lane, u = int(self._places[place, 0]), float(self._places[place, 1])
            pose = snapped(self._town.centre(np.array([lane]), np.array([u]))[0])
            far = np.hypot(*(pose[:2] - world.ego.xy)) > _OUT_OF_SIGHT
            if far and np.hypot(*(others - pose[:2]).T).min() > _ROOM_TO_APPEAR:
                self._spawn(slot, lane, u, pose)
                return

    def _blueprint(self, actor_id: int) -> Blueprint:
        """A vehicle of background traffic, by weight."""
        choices = [blueprint for blueprint in BLUEPRINTS.values() if blueprint.weight > 0.0]
        ends = np.cumsum([blueprint.weight for blueprint in choices])
        share = self._draws.stream("blueprint", actor_id).uniform(0, 1)[0]
        return choices[int(np.searchsorted(ends, share * ends[-1], side="right"))]
