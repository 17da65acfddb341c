"""Which contacts count, by the table made with the original code (reference `leaderboard.md` 2.1)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lavsim.types import DT, ActorClass, Role
from leaderboard.criteria.base import criteria_of
from leaderboard.criteria.collision import Collision
from leaderboard.rules import Rules
from tests.leaderboard.worlds import V1, V20, drive, ego_at
from tests.snapshots import Body

A, B, WALL, SIDEWALK = 1001, 1002, 0, 200_001
OTHERS = (
    Body(A, 50.0),
    Body(B, 60.0, kind=ActorClass.BICYCLE, blueprint="vehicle.bh.crossbike"),
    Body(100_000, 70.0, kind=ActorClass.WALKER, blueprint="walker.pedestrian.0001"),
    Body(SIDEWALK, 80.0, kind=ActorClass.PROP, role=Role.PROP, blueprint="static.sidewalk"),
    Body(200_002, 90.0, kind=ActorClass.PROP, role=Role.PROP, blueprint="static.prop.vendingmachine"),
)


def events(rules: Rules, contacts: list[tuple[float, float, int]], speed: float = 5.0) -> list[int]:
    """1 for each contact (time [s], ego x [m], other id) that is registered; the ticks between pass, too."""
    by_tick = {round(t / DT): (x, other) for t, x, other in contacts}
    snapshots, x = [], 0.0
    for tick in range(max(by_tick) + 1):
        x, other = by_tick.get(tick, (x, None))
        touches = () if other is None else (other,)
        snapshots.append(ego_at(x, tick=tick, speed=speed, others=OTHERS, touches=touches))
    kind = next(c for c in criteria_of(rules) if "collisions_vehicle" in {charge.key for charge in c.charges})
    fired = {i.tick for i in drive(kind(rules), snapshots)}
    return [int(round(t / DT) in fired) for t, _, _ in contacts]


@pytest.mark.parametrize(
    ("contacts", "first", "second"),
    [
        ([(float(t), float(t), A) for t in range(13)], {0, 6, 12}, {0, 6, 12}),
        ([(0.0, 0.0, A), (1.0, 4.0, B), (2.0, 8.0, A)], {0, 1, 2}, {0}),
        ([(0.0, 0.0, A), (1.0, 6.0, B), (2.0, 12.0, A)], {0, 1, 2}, {0, 1, 2}),
        ([(0.0, 0.0, WALL), (0.3, 2.0, WALL), (0.6, 4.0, WALL), (0.9, 6.0, WALL)], {0, 2}, {0, 3}),
        ([(0.0, 0.0, SIDEWALK), (0.2, 1.0, A)], {1}, set()),
    ],
    ids=["pushing one car", "A B A 4 m apart", "A B A 6 m apart", "wall", "sidewalk then car"],
)
def test_contacts_that_count(contacts: list[tuple[float, float, int]], first: set[int], second: set[int]) -> None:
    for rules, expected in ((V1, first), (V20, second)):
        assert {k for k, fired in enumerate(events(rules, contacts)) if fired} == expected


def test_being_hit_at_rest_counts_in_1_0_and_not_in_2_0() -> None:
    contact = [(1.0, 0.0, A)]
    assert events(V1, contact, speed=0.0) == [1]
    assert events(V20, contact, speed=0.0) == [0]


@pytest.mark.parametrize(
    ("other", "key", "type_id"),
    [
        (A, "collisions_vehicle", "vehicle.seat.leon"),
        (B, "collisions_vehicle", "vehicle.bh.crossbike"),
        (100_000, "collisions_pedestrian", "walker.pedestrian.0001"),
        (200_002, "collisions_layout", "static.prop.vendingmachine"),
        (WALL, "collisions_layout", "static.layout"),
    ],
)
def test_class_of_a_collision(other: int, key: str, type_id: str) -> None:
    (infraction,) = drive(Collision(V1), [ego_at(1.5, 2.25, others=OTHERS, touches=(other,))])
    assert infraction.key == key
    assert infraction.message == (
        f"Agent collided against object with type={type_id} and id={other} at (x=1.5, y=2.25, z=0.0)"
    )


def test_contacts_of_others_are_not_the_egos() -> None:
    snapshot = ego_at(0.0, others=OTHERS, touches=(A,))
    contacts = snapshot.contacts.copy()
    contacts["a"] = B
    assert not drive(Collision(V1), [replace(snapshot, contacts=contacts)])


def test_two_actors_touched_in_one_tick_are_one_place() -> None:
    assert len(drive(Collision(V1), [ego_at(0.0, others=OTHERS, touches=(A, B))])) == 1
