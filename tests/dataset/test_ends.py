"""A collected drive ends at its goal, at a collision, or when it stands for 50 s; not before."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lavsim.dataset.ends import COLLISION, ROUTE_END, STOOD, DriveEnds
from lavsim.types import Role
from lavsim.world.snapshot import CONTACT_DTYPE, Snapshot
from tests.drives import straight_route
from tests.snapshots import Body, snapshot_of


def drive(places: list[tuple[float, float]], contacts: dict[int, tuple[int, int]] | None = None) -> list[str | None]:
    """What is said at each tick of an ego at `places`; `contacts` by tick."""
    ends = DriveEnds()
    ends.start(SimpleNamespace(route=straight_route()))  # type: ignore[arg-type]
    before = places[0]
    said = []
    for tick, place in enumerate(places, 1):
        speed = float(np.hypot(place[0] - before[0], place[1] - before[1])) * 20.0
        said.append(ends.observe(snapshot_at(tick, place, speed, (contacts or {}).get(tick))))
        before = place
    return said


def snapshot_at(tick: int, place: tuple[float, float], speed: float, contact: tuple[int, int] | None) -> Snapshot:
    snapshot = snapshot_of([Body(id=1, x=place[0], y=place[1], speed=speed, role=Role.EGO)], tick)
    contacts = np.zeros(0 if contact is None else 1, CONTACT_DTYPE)
    if contact is not None:
        contacts["a"], contacts["b"] = contact
    return replace(snapshot, contacts=contacts)


def along(first: float, last: float, step: float = 0.5) -> list[tuple[float, float]]:
    """Places on the route from `first` to `last` metres, `step` apart."""
    route = straight_route()
    at = np.arange(first, last, step)
    return [(float(np.interp(s, route.distance, route.xy[:, 0])), float(np.interp(s, route.distance, route.xy[:, 1])))
            for s in at]  # fmt: skip


def test_the_goal_ends_a_drive_and_no_place_before_it() -> None:
    length = straight_route().length
    said = drive(along(0.0, length + 5.0))
    first = next(tick for tick, text in enumerate(said) if text is not None)
    assert said[first] == ROUTE_END
    assert length - 1.0 <= first * 0.5 <= length + 4.0
    assert drive(along(0.0, length - 2.0)) == [None] * len(along(0.0, length - 2.0))


def test_a_fast_drive_reaches_its_goal_too() -> None:
    assert ROUTE_END in drive(along(0.0, straight_route().length + 12.0, 2.0))


@pytest.mark.parametrize(("contact", "ends"), [((1, 7), True), ((7, 1), True), ((0, 1), True), ((7, 8), False)])
def test_a_contact_of_the_ego_ends_a_drive_and_one_of_others_does_not(contact: tuple[int, int], ends: bool) -> None:
    assert drive(along(0.0, 10.0), {12: contact})[11] == (COLLISION if ends else None)


def test_fifty_seconds_of_standing_end_a_drive_and_a_move_in_between_does_not() -> None:
    place = along(5.0, 5.4)[0]
    assert drive([place] * 1001)[998:] == [None, STOOD, STOOD]
    moved = [place] * 600 + along(5.0, 7.0) + [along(6.5, 7.0)[0]] * 600
    assert drive(moved) == [None] * len(moved)
