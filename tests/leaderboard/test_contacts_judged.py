"""Collisions as the world makes them, judged: a parked car, a walker, a wall, hit from behind at rest, two in 5 s."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from lavsim.types import ActorIds, Control, Role
from lavsim.world.actor import Actor
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.snapshot import HAZARD_DTYPE, Snapshot
from lavsim.world.weather import Weather
from lavsim.world.world import World
from leaderboard.criteria.base import Criterion
from leaderboard.criteria.collision import Collision
from leaderboard.criteria.corrected_collision import CorrectedCollision
from leaderboard.rules import RULES
from tests.leaderboard.worlds import V1, V20, drive

CAR, WALKER, PROP = "vehicle.audi.tt", "walker.pedestrian.0001", "static.prop.vendingmachine"
WALL = np.array([[20.0, -5.0], [21.0, -5.0], [21.0, 5.0], [20.0, 5.0]])
GO, STAY = Control(throttle=0.75), Control(brake=1.0)

Move = Callable[[int, list[Actor]], None]


@dataclass
class Scene:
    """A world along +x with the ego at its origin, and who else is there: blueprint, x, y, role."""

    others: tuple[tuple[str, float, float, Role], ...] = ()
    walls: tuple[np.ndarray, ...] = ()

    def run(self, control: Control, seconds: float, move: Move | None = None) -> list[Snapshot]:
        world = World(list(self.walls))
        world.spawn(int(ActorIds.EGO), BLUEPRINTS["vehicle.lincoln.mkz_2017"], np.zeros(3), 0.0, Role.EGO)
        actors = [
            world.spawn(1000 + k, BLUEPRINTS[name], np.array([x, y, 0.0]), 0.0, role)
            for k, (name, x, y, role) in enumerate(self.others)
        ]
        snapshots = []
        for tick in range(round(seconds * 20)):
            if move is not None:
                move(tick, actors)
            world.drive_ego(control)
            world.step()
            snapshots.append(world.publish(np.zeros(0, np.uint8), Weather(), np.zeros(0, HAZARD_DTYPE)))
        return snapshots


def moved(dx: float, dy: float) -> np.ndarray:
    """`WALL` elsewhere."""
    return np.add(WALL, (dx, dy))


def judged(snapshots: list[Snapshot]) -> list[list[str]]:
    """Kinds of collision under 1.0, 2.x and corrected."""
    criteria: list[Criterion] = [Collision(V1), Collision(V20), CorrectedCollision(RULES["corrected"])]
    return [[i.key.removeprefix("collisions_") for i in drive(c, snapshots)] for c in criteria]


@pytest.mark.parametrize(
    ("name", "x", "role", "kind"),
    [
        (CAR, 20.0, Role.PARKED, "vehicle"),
        ("vehicle.bh.crossbike", 20.0, Role.TRAFFIC, "vehicle"),
        (WALKER, 15.0, Role.TRAFFIC, "pedestrian"),
        (PROP, 15.0, Role.PROP, "layout"),
    ],
)
def test_what_stands_in_the_way_is_hit_once_and_what_stands_beside_it_is_spared(
    name: str, x: float, role: Role, kind: str
) -> None:
    hit = Scene(((name, x, 0.0, role),)).run(GO, 3.5)
    assert judged(hit) == [[kind]] * 3
    spared = Scene(((name, x, 2.6, role),)).run(GO, 3.5)
    assert judged(spared) == [[], [], []]


def test_a_wall_is_hit_once_and_a_gap_in_it_is_spared() -> None:
    assert judged(Scene(walls=(WALL,)).run(GO, 5.0)) == [["layout"]] * 3
    gap = (moved(0.0, 7.0), moved(0.0, -7.0))
    assert judged(Scene(walls=gap).run(GO, 5.0)) == [[], [], []]


def driven_at(speed: float) -> Move:
    def move(tick: int, actors: list[Actor]) -> None:
        for actor in actors:
            actor.drive(speed, 0.0)

    return move


def test_being_hit_from_behind_at_rest_counts_in_1_0_alone() -> None:
    scene = Scene(((CAR, -15.0, 0.0, Role.SCENARIO),))
    at_rest = scene.run(STAY, 4.0, driven_at(6.0))
    first = next(s for s in at_rest if len(s.contacts))
    before = [s.ego.speed for s in at_rest if s.tick < first.tick]
    assert max(before) < 0.1
    assert judged(at_rest)[0] == ["vehicle"]
    assert judged(scene.run(STAY, 4.0)) == [[], [], []]  # nobody comes


def test_two_hits_within_five_seconds_are_two_where_they_lie_apart() -> None:
    """1.0 tells them apart by 3 m between places of the ego, 2.x by 5 m, we by whom it touched."""
    beside = ((CAR, 20.0, 1.6, Role.PARKED), (CAR, 20.0, -1.6, Role.PARKED))
    first, second, ours = judged(Scene(beside).run(GO, 4.0))
    assert first == second == ["vehicle"]
    assert ours == ["vehicle", "vehicle"]
    apart = Scene(((WALKER, 12.0, -0.8, Role.TRAFFIC),), (moved(4.0, 5.3),))
    assert judged(apart.run(GO, 4.5)) == [["pedestrian", "layout"]] * 3


def test_pushing_one_car_for_ten_seconds_counts_every_five_in_the_originals() -> None:
    pushed = Scene(((CAR, 6.0, 0.0, Role.PARKED),)).run(Control(throttle=0.9), 12.0)
    first, second, ours = judged(pushed)
    assert len(first) == len(second) >= 2
    assert ours == ["vehicle"]
