"""Contacts of the ego, told apart by whom it touches: `--rules corrected`."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import DT, ActorIds
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import CRITERIA, Criterion, Infraction, place, place_text
from leaderboard.criteria.collision import LAYOUT, PEDESTRIAN, VEHICLE, Place, classify


@CRITERIA.register("corrected_collision")
class CorrectedCollision(Criterion):
    """Fires once for each actor touched, and again when that actor is touched after 5 s without contact.

    The originals go by the last actor's id and by the ego's place, so a second actor hit nearby is free, and one that
    is pushed for long is charged several times. Here every actor has a clock of its own that each contact starts
    again. The static world is one actor with many walls: there a contact also counts 3 m away from the last one.
    An ego at rest is not at fault.
    """

    name = "corrected_collision"
    order = 30
    applies = ("corrected",)
    instead_of = "collision"
    charges = (LAYOUT, PEDESTRIAN, VEHICLE)

    apart = 5.0  # [s] without contact after which a touch is another collision
    wall = 3.0  # [m] beyond which the static world is another wall
    at_rest = 0.1  # [m/s] a slower ego is not at fault

    def start(self, town: TownMap, route: Route) -> None:
        self._touched: dict[int, tuple[int, Place]] = {}  # tick of the last contact, and the ego's place then
        self._speed = 0.0  # of the tick before: a contact may bring the ego to rest

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        found = []
        speed, self._speed = max(self._speed, snapshot.ego.speed), snapshot.ego.speed
        if len(snapshot.contacts):
            for a, b in zip(snapshot.contacts["a"].tolist(), snapshot.contacts["b"].tolist(), strict=True):
                if a == ActorIds.EGO or b == ActorIds.EGO:
                    infraction = self._contact(snapshot, b if a == ActorIds.EGO else a, speed)
                    found += [infraction] if infraction else []
        return found

    def _contact(self, snapshot: Snapshot, other: int, speed: float) -> Infraction | None:
        here = place(snapshot)
        before = self._touched.get(other)
        charge, type_id = classify(snapshot.table, other)
        if before is not None and other == ActorIds.STATIC and math.dist(here, before[1]) > self.wall:
            before = None
        is_new = before is None or (snapshot.tick - before[0]) * DT > self.apart
        # A wall remembers where it was hit, not where the ego left it: sliding along is one collision every 3 m.
        self._touched[other] = snapshot.tick, here if is_new or before is None else before[1]
        if not is_new or charge is None or speed < self.at_rest:
            return None
        text = f"Agent collided against object with type={type_id} and id={other} at {place_text(here)}"
        return Infraction(charge.key, snapshot.tick, here, text)
