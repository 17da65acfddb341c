"""When a collected drive ends: at the end of its route, in a collision, or when nothing moves any more."""

from __future__ import annotations

from lavsim.episode import EpisodeResult
from lavsim.map.route import RouteTracker
from lavsim.simulation import Simulation
from lavsim.types import ActorIds
from lavsim.world.snapshot import Snapshot

ROUTE_END, COLLISION, STOOD = "end of the route", "collision", "stood still"
STAND_SPEED = 0.1  # [m/s]
STAND_TICKS = 1000
_EVERY = 5  # ticks between looks at the place on the route …
_WINDOW = 30  # … of which so many points ahead are looked at: 120 m/s


class DriveEnds:
    """Observer that ends a drive as LAV's collector does (reference `lav.md` 3.2).

    Whatever was seen up to then is kept, the tick of a collision included.
    """

    def start(self, simulation: Simulation) -> None:
        self._tracker = RouteTracker(simulation.route, _WINDOW)
        self._stood = 0

    def observe(self, snapshot: Snapshot) -> str | None:
        ego = snapshot.ego
        self._stood = self._stood + 1 if ego.speed < STAND_SPEED else 0
        contacts = snapshot.contacts
        if len(contacts) and bool(((contacts["a"] == ActorIds.EGO) | (contacts["b"] == ActorIds.EGO)).any()):
            return COLLISION
        if snapshot.tick % _EVERY == 0 and self._tracker.update(ego.xy) == len(self._tracker.route) - 1:
            return ROUTE_END
        return STOOD if self._stood >= STAND_TICKS else None

    def finish(self, result: EpisodeResult) -> None:
        pass
