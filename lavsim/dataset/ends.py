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


class DriveEnds:
    """Observer that ends a drive as LAV's collector does (reference `lav.md` 3.2).

    Whatever was seen up to then is kept, the tick of a collision included.

    Attributes:
        distance: Driven along the route [m].
    """

    def start(self, simulation: Simulation) -> None:
        self._tracker = RouteTracker(simulation.route)
        self._stood = 0
        self.distance = 0.0

    def observe(self, snapshot: Snapshot) -> str | None:
        ego = snapshot.ego
        index = self._tracker.update(ego.xy)
        self.distance = self._tracker.metres()
        self._stood = self._stood + 1 if ego.speed < STAND_SPEED else 0
        contacts = snapshot.contacts
        if len(contacts) and bool(((contacts["a"] == ActorIds.EGO) | (contacts["b"] == ActorIds.EGO)).any()):
            return COLLISION
        if index == len(self._tracker.route) - 1:
            return ROUTE_END
        return STOOD if self._stood >= STAND_TICKS else None

    def finish(self, result: EpisodeResult) -> None:
        pass
