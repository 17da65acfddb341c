"""Driving slower than the traffic around (2.x)."""

from __future__ import annotations

from collections.abc import Sequence

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place
from leaderboard.progress import PlaneProgress


@CRITERIA.register("min_speed")
class MinSpeed(Criterion):
    """One event for each quarter of the route on which the ego's mean speed was below the background vehicles'.

    The last piece is entered twice, as in the original, whose end hook runs twice after a normal finish.
    """

    name = "min_speed"
    order = 60
    applies = ("2.x",)
    charges = (
        Charge(
            "min_speed_infractions",
            "Min speed infractions",
            15,
            {"2.0": 0.70, "2.1": 0.40, "bench2drive": 1.0},  # recorded there, but costs nothing
            by="shortfall",
        ),
    )

    pieces = {"2.x": 4, "bench2drive": 20}  # noqa: RUF012 - checkpoints of a route
    last_piece = 0.95  # share of the route after which the rest is judged too
    window = 2  # points ahead

    def start(self, town: TownMap, route: Route) -> None:
        self._distance = route.distance
        self._progress = PlaneProgress(route, self.window)
        self._piece = float(route.distance[-1]) / self.rules.require(self.pieces)
        self._checkpoint = 0.0
        self.percentages: list[float] = []  # of all pieces judged that had traffic around
        self._where: tuple[int, tuple[float, float, float]] = (0, (0.0, 0.0, 0.0))
        self._reset()

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        ego = snapshot.ego
        self._where = snapshot.tick, place(snapshot)
        if (traffic := snapshot.traffic_speed) is not None:
            self._traffic += traffic
            self._ego += ego.speed
        self._progress.advance(ego.x, ego.y)
        driven = float(self._distance[self._progress.index])
        if driven - self._checkpoint <= self._piece:
            return ()
        found = self._judge()
        self._checkpoint = driven
        self._reset()
        return found

    def finish(self) -> Sequence[Infraction]:
        if float(self._distance[self._progress.index]) <= self.last_piece * float(self._distance[-1]):
            return ()
        return [*self._judge(), *self._judge()]

    def _reset(self) -> None:
        self._ego = self._traffic = 0.0

    def _judge(self) -> list[Infraction]:
        percent = round(100.0 * self._ego / self._traffic, 2) if self._traffic > 0.0 else 100.0
        if self._traffic > 0.0:
            self.percentages.append(percent)
        if percent >= 100.0:
            return []
        tick, where = self._where
        text = f"Average speed is {percent}% of the surrounding traffic's one"
        return [Infraction("min_speed_infractions", tick, where, text, value=percent)]
