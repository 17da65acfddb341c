"""Background walkers of a drive: who is spawned where, and the state that the kernel of `walkers_step` moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.map.footways import FootwayKind, Footways, get_footways
from lavsim.map.town_map import TownMap
from lavsim.portable_math import atan2, snapped
from lavsim.random import Draws
from lavsim.traffic.walkers_ground import Ground, get_ground
from lavsim.traffic.walkers_look import Actors, Signals
from lavsim.traffic.walkers_steer import make_crowds
from lavsim.traffic.walkers_step import WALKER, draw_next, walk
from lavsim.types import DT, ActorClass, ActorIds, LightState, Role
from lavsim.world.blueprints import BLUEPRINTS, Blueprint
from lavsim.world.lights import LightCycle
from lavsim.world.world import World

Floats = NDArray[np.float64]

CHILDREN = 0.15  # share of them
SPEED, SPEED_SPREAD = 1.4, 0.2  # [m/s] mean and deviation
SLOWEST, FASTEST = 0.9, 1.9  # [m/s]
RUNNERS, RUNNING = 0.0, (2.8, 3.2)  # share of who runs, and how fast [m/s]
CHILD_PACE = 0.9  # of a child, in an adult's speeds
PATIENCE = (18.0, 24.0)  # [s] at a kerb
PAUSE = (0.4, 1.4)  # [s] that one looks before setting out, at least
KEEP_RIGHT = (0.15, 0.9)  # share of the room to the right that a walker keeps to
CLEAR_OF_WALKERS, CLEAR_OF_OTHERS = 2.0, 1.0  # [m] where one is spawned
SMALLEST_PART = 60.0  # [m] of sidewalk; smaller parts stay empty
MOST_TRIES = 40
UNSEEN = -1_000_000  # tick


class Walkers:
    """The people that are just there.

    Args:
        town: Where they walk.
        world: What they are spawned into; who is there keeps their place.
        draws: Root of the drive's draws.
        count: Walkers wanted; fewer where the town has no room, none where it has no sidewalks.
        jaywalking: Share of those that cross roads anywhere; 0 for none.
    """

    def __init__(self, town: TownMap, world: World, draws: Draws, count: int, jaywalking: float = 0.0) -> None:
        self._world = world
        self._draws = draws.stream("walkers")
        self._ground = get_ground(town)
        self._signals = _unseen(town)
        self._walkers = np.zeros(0, WALKER)
        if count > 0:
            self._walkers = self._spawn(get_footways(town), count, jaywalking)
        self._crowds = make_crowds(world.count)
        self._movers = np.zeros(0, np.int32)
        self._seen: tuple[Floats, Actors, Floats] | None = None

    def __len__(self) -> int:
        return len(self._walkers)

    @property
    def rows(self) -> NDArray[np.int64]:
        """Rows of the background walkers in the world."""
        rows: NDArray[np.int64] = self._walkers["row"]
        return rows

    def control(self, lights: NDArray[np.uint8]) -> None:
        """Lets every walker decide on this tick; writes the world's commands and the walkers' heights."""
        if not len(self._walkers):
            return
        if lights is not self._signals.state:
            self._signals = self._signals._replace(state=lights)
        actors, command = self._look_at_world()
        walk(
            self._ground, self._walkers, self._crowds, actors, self._signals, self._movers, self._world.tick, command
        )  # fmt: skip

    def _look_at_world(self) -> tuple[Actors, Floats]:
        """The arrays of the world, which stay the same until somebody is spawned, and its commands."""
        world, n = self._world, self._world.count
        if self._seen is None or self._seen[0] is not world.pose or len(self._seen[1].present) != n:
            table = world.table
            self._movers = np.zeros(n, np.int32)
            self._crowds = make_crowds(n)
            actors = Actors(
                world.present[:n], world.motion[:n], world.pose[:n], world.velocity[:n], table.sizes, table.classes,
                world.height[:n], world.lights[:n],
            )  # fmt: skip
            self._seen = (world.pose, actors, world.command[:n])
        return self._seen[1], self._seen[2]

    def _spawn(self, footways: Footways, count: int, jaywalking: float) -> NDArray[np.void]:
        walkers, places, blueprints = np.zeros(count, WALKER), np.zeros((count, 4)), []
        taken = self._taken()
        spread = _Spread(footways)
        kept = []
        for i in range(count):
            actor_id = int(ActorIds.WALKERS) + i
            self._describe(walkers, i, actor_id, jaywalking)
            blueprint = _blueprint(self._draws, actor_id)
            if blueprint.size[2] < 1.5:
                walkers[i]["speed"] *= CHILD_PACE
            place = self._place(spread, walkers, i, actor_id, taken)
            if place is not None:
                kept.append(i)
                places[i] = place
                blueprints.append(blueprint)
                taken = np.concatenate([taken, [[place[0], place[1], CLEAR_OF_WALKERS]]])
        walkers, places = walkers[kept].copy(), places[kept]
        ids = [int(ActorIds.WALKERS) + i for i in kept]
        colours = [kind.colour(self._draws, number) for kind, number in zip(blueprints, ids, strict=True)]
        walkers["row"] = self._world.spawn_many(ids, blueprints, places[:, :3], places[:, 3], Role.TRAFFIC, colours)
        for i in range(len(walkers)):
            draw_next(self._ground, walkers, i)
        return walkers

    def _taken(self) -> Floats:
        """Circles (n, 3) of x, y and radius [m] that those who are there keep free."""
        world, n = self._world, self._world.count
        rows = np.flatnonzero(world.present[:n])
        sizes = world.table.sizes[rows, :2].astype(np.float64)
        return np.column_stack([world.pose[rows, :2], np.hypot(*sizes.T) / 2.0 + CLEAR_OF_OTHERS])

    def _describe(self, walkers: NDArray[np.void], i: int, actor_id: int, jaywalking: float) -> None:
        """Draws what kind of a walker it is."""
        draws = self._draws.stream("character", actor_id)
        unit = draws.uniform(0, 6)
        walker = walkers[i]
        walker["key"] = self._draws.stream("ways", actor_id).key
        walker["speed"] = float(np.clip(snapped(draws.normal(1, 1, SPEED, SPEED_SPREAD))[0], SLOWEST, FASTEST))
        if unit[0] < RUNNERS:
            walker["speed"] = RUNNING[0] + (RUNNING[1] - RUNNING[0]) * unit[1]
        walker["share"] = KEEP_RIGHT[0] + (KEEP_RIGHT[1] - KEEP_RIGHT[0]) * unit[2]
        walker["patience"] = round((PATIENCE[0] + (PATIENCE[1] - PATIENCE[0]) * unit[3]) / DT)
        walker["pause"] = round((PAUSE[0] + (PAUSE[1] - PAUSE[0]) * unit[4]) / DT)
        walker["jaywalks"] = unit[5] < jaywalking
        walker["since"] = -1

    def _place(
        self, spread: _Spread, walkers: NDArray[np.void], i: int, actor_id: int, taken: Floats
    ) -> tuple[float, float, float, float] | None:
        """A free place on a sidewalk: x, y, z [m] and heading; None where `MOST_TRIES` found none."""
        draws = self._draws.stream("place", actor_id)
        for attempt in range(MOST_TRIES):
            unit = draws.uniform(attempt, 3)
            edge, u = spread.at(float(unit[0]))
            if edge < 0:
                return None
            forward = unit[1] < 0.5
            x, y, z, yaw = _pose(self._ground, edge, u, forward, float(walkers[i]["share"]))
            if (np.hypot(taken[:, 0] - x, taken[:, 1] - y) >= taken[:, 2]).all():
                walkers[i]["edge"], walkers[i]["u"], walkers[i]["forward"] = edge, u, forward
                return x, y, z, yaw
        return None


class _Spread:
    """Sidewalks of a town end to end, without those that lead nowhere."""

    def __init__(self, footways: Footways) -> None:
        edges = footways.where(FootwayKind.SIDEWALK)
        part = footways.part[footways.ends[edges, 0]] if len(edges) else np.zeros(0, np.int32)
        size = np.bincount(part, footways.length[edges]) if len(edges) else np.zeros(0)
        self._edges = edges[size[part] >= SMALLEST_PART] if len(edges) else edges
        self._length = footways.length[self._edges]
        self._ends = np.cumsum(self._length)

    def at(self, share: float) -> tuple[int, float]:
        """Edge and place on it [m] after `share` of all sidewalks; edge -1 where there are none."""
        if not len(self._edges):
            return -1, 0.0
        k = min(int(np.searchsorted(self._ends, share * self._ends[-1], side="right")), len(self._edges) - 1)
        return int(self._edges[k]), float(share * self._ends[-1] - (self._ends[k] - self._length[k]))


def _pose(ground: Ground, number: int, u: float, forward: bool, share: float) -> tuple[float, float, float, float]:
    """x, y, z [m] and heading of a walker at `u` on an edge, to the right of its middle."""
    edge = ground.edge[number]
    points = ground.points[edge["first"] : edge["last"] + 1]
    row = min(round(u / float(edge["step"])), len(points) - 1)
    x, y, z, cos, sin, low, high = points[row]
    aside = float(np.clip(share * (high if forward else low), low, high))
    heading = atan2(sin, cos) if forward else atan2(-sin, -cos)
    return float(x - aside * sin), float(y + aside * cos), float(z), float(heading)


def _blueprint(draws: Draws, actor_id: int) -> Blueprint:
    """An adult, or a child of either kind."""
    people = [b for b in BLUEPRINTS.values() if b.actor_class == ActorClass.WALKER]
    children = [b for b in people if b.size[2] < 1.5]
    adults = [b for b in people if b.size[2] >= 1.5]
    unit = draws.stream("blueprint", actor_id).uniform(0, 2)
    kinds = children if unit[0] < CHILDREN else adults
    return kinds[int(unit[1] * len(kinds))]


def _unseen(town: TownMap) -> Signals:
    """The lights of a town before anybody looked: how long they stay red by the usual cycle, but not since when."""
    count, cycle = len(town.lights), LightCycle()
    red = np.zeros(count)
    for group in town.light_groups:
        for phase in group.phases:
            red[list(phase)] = (len(group.phases) - 1) * cycle.ticks * DT + cycle.red
    unknown = np.full(count, int(LightState.UNKNOWN), np.uint8)
    return Signals(unknown, unknown.copy(), np.full(count, UNSEEN, np.int64), red)
