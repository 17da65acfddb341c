"""Contacts of the ego with vehicles, walkers and everything else, counted once each."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import DT, ActorClass, ActorIds
from lavsim.world.snapshot import ActorTable, Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place, place_text

PEDESTRIAN = Charge("collisions_pedestrian", "Collisions with pedestrians", 4, {"1.0": 0.50, "2.0": 0.50, "2.1": 1.0})
VEHICLE = Charge("collisions_vehicle", "Collisions with vehicles", 5, {"1.0": 0.60, "2.0": 0.60, "2.1": 0.70})
LAYOUT = Charge("collisions_layout", "Collisions with layout", 6, {"1.0": 0.65, "2.0": 0.65, "2.1": 0.60})

STATIC_WORLD = "static.layout"  # type of id 0 in messages

Place = tuple[float, float, float]


@CRITERIA.register("collision")
class Collision(Criterion):
    """Fires at a contact, unless it belongs to one that was counted.

    Which contacts belong together goes by the last actor's id (for 5 s) and by where the ego was, not by pairs:
    1.0 remembers every place of a collision until the ego is 5 m away and ignores contacts within 3 m of any;
    2.x remembers the last place alone and ignores contacts within 5 m of it. 1.0 knows no fault: being hit at rest
    counts. The static world (id 0) is never remembered as the last actor.
    """

    name = "collision"
    order = 30
    charges = (LAYOUT, PEDESTRIAN, VEHICLE)

    same_actor = 5.0  # [s]
    forget = 5.0  # [m]
    near = 3.0  # [m] 1.0, in plan
    at_rest = 0.1  # [m/s] 2.x: a slower ego is not at fault

    def start(self, town: TownMap, route: Route) -> None:
        self._places: list[Place] = []
        self._last: int | None = None
        self._tick = 0

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        found = []
        if len(snapshot.contacts):
            for a, b in zip(snapshot.contacts["a"].tolist(), snapshot.contacts["b"].tolist(), strict=True):
                if a == ActorIds.EGO or b == ActorIds.EGO:
                    infraction = self._contact(snapshot, b if a == ActorIds.EGO else a)
                    found += [infraction] if infraction else []
        if self._places or self._last is not None:
            self._forget(snapshot)
        return found

    def _contact(self, snapshot: Snapshot, other: int) -> Infraction | None:
        here = place(snapshot)
        if other == self._last:
            return None
        charge, type_id = classify(snapshot.table, other)
        if self.rules.generation == "1.0":
            if any(math.dist(here[:2], there[:2]) <= self.near for there in self._places) or charge is None:
                return None
            self._places.append(here)
        else:
            if self._places and math.dist(here, self._places[-1]) < self.forget:
                return None
            if snapshot.ego.speed < self.at_rest:
                return None
            self._places = [here]
        self._tick = snapshot.tick
        if other != ActorIds.STATIC:
            self._last = other
        if charge is None:  # 2.x: no event, but what follows is suppressed
            return None
        text = f"Agent collided against object with type={type_id} and id={other} at {place_text(here)}"
        return Infraction(charge.key, snapshot.tick, here, text)

    def _forget(self, snapshot: Snapshot) -> None:
        here = place(snapshot)
        flat = 2 if self.rules.generation == "1.0" else 3
        self._places = [there for there in self._places if math.dist(here[:flat], there[:flat]) <= self.forget]
        if self._last is not None and (snapshot.tick - self._tick) * DT > self.same_actor:
            self._last = None


def classify(table: ActorTable, actor: int) -> tuple[Charge | None, str]:
    """The charge for touching `actor` (None: nothing), and its type id.

    Two-wheelers are vehicles, props are layout as the static world is, sidewalks are nothing.
    """
    if actor == ActorIds.STATIC:
        return LAYOUT, STATIC_WORLD
    row = table.row_of.get(actor)
    if row is None:
        return None, "unknown"
    kind, type_id = ActorClass(int(table.classes[row])), table.blueprints[row]
    if kind.is_vehicle:
        return VEHICLE, type_id
    if kind == ActorClass.WALKER:
        return PEDESTRIAN, type_id
    return (None if "sidewalk" in type_id else LAYOUT), type_id
