"""The hazards of a route: when each is placed, set off and cleared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import RouteError, ScenarioError
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.scenarios.base import Scenario, ScenarioSpec, Script, Stage, make_scenario
from lavsim.world.snapshot import HAZARD_DTYPE
from lavsim.world.world import World

_PLACE_RANGE = 500.0  # [m] from the ego within which a hazard's actors appear
_RETRY_TICKS = 20  # between attempts to place a hazard whose place is taken
_TRIGGER_GAP = 2.0  # [m] and
_TRIGGER_TURN = np.radians(10.0)  # off the route: farther and the leaderboard ignores a trigger


@dataclass
class _Hazard:
    """A hazard and where it stands in its life."""

    spec: ScenarioSpec
    scenario: Scenario
    stage: Stage
    retry: int = 0  # tick from which on it may be placed
    is_placed: bool = False
    is_over: bool = False
    script: Script | None = field(default=None)


class Director:
    """Runs the hazards of one drive.

    Args:
        town: Where.
        route: What the ego drives.
        world: What they act on; the ego is there already.
        draws: Root of the drive's draws.
        specs: The hazards, in the order of the route file.
        route_id: For messages.
        progress: Reads how far the ego is along the route [m].

    Raises:
        RouteError: a hazard doesn't fit where its trigger is.
        UnknownName: no such hazard.
    """

    def __init__(
        self,
        town: TownMap,
        route: Route,
        world: World,
        draws: Draws,
        specs: Sequence[ScenarioSpec],
        route_id: str,
        progress: Callable[[], float],
    ) -> None:
        self._town, self._route, self._world, self._draws = town, route, world, draws
        self._route_id, self._progress = route_id, progress
        prepared = (self._prepare(number, spec) for number, spec in enumerate(specs))
        self._hazards = [hazard for hazard in prepared if hazard is not None]

    @property
    def active(self) -> NDArray[np.void]:
        """`(H,)` of `HAZARD_DTYPE`: hazards set off and not over."""
        rows = [(h.stage.instance, 0) for h in self._hazards if h.script is not None and not h.is_over]
        return np.array(rows, dtype=HAZARD_DTYPE)

    def tick(self, route_point: NDArray[np.float64]) -> None:
        """Places what the ego comes near and runs every script by one tick.

        Args:
            route_point: (2,) the point of the route that the ego is at [m].
        """
        self.place()
        for hazard in self._hazards:
            if hazard.is_over:
                continue
            if hazard.script is None:
                gap = route_point - np.array(hazard.spec.trigger[:2])
                if np.hypot(*gap) >= hazard.scenario.trigger_radius:
                    continue
                if not hazard.is_placed:  # never found room: left out, as the leaderboard skips what can't be set up
                    hazard.is_over = True
                    continue
                hazard.script = hazard.scenario.script(hazard.stage)
            try:
                next(hazard.script)
            except StopIteration:
                hazard.scenario.clear()
                hazard.is_over = True

    def place(self) -> None:
        """Places hazards whose trigger is near; one whose place is taken (by a walker, say) is tried again later."""
        for hazard in self._hazards:
            if hazard.is_placed or hazard.is_over or self._world.tick < hazard.retry:
                continue
            trigger = np.array(hazard.spec.trigger[:2])
            if np.hypot(*(trigger - self._world.ego.xy)) < _PLACE_RANGE:
                try:
                    hazard.scenario.place(hazard.stage)
                    hazard.is_placed = True
                except ScenarioError:
                    hazard.scenario.clear()
                    hazard.retry = self._world.tick + _RETRY_TICKS

    def _prepare(self, instance: int, spec: ScenarioSpec) -> _Hazard | None:
        """The hazard of `spec`; None when its trigger is not on the route, as the leaderboard ignores it then."""
        scenario = make_scenario(spec)
        index = self._trigger_index(spec)
        if index is None:
            return None
        anchor = self._town.waypoint_at(int(self._route.lane[index]), float(self._route.u[index]))
        reason = scenario.fits(anchor)
        if reason is not None:
            where = f"({spec.trigger[0]:.1f}, {spec.trigger[1]:.1f})"
            raise RouteError(
                f"route {self._route_id}, scenario {spec.name}: {spec.type} does not fit at {where}: {reason}."
            )
        draws = self._draws.stream("scenario", instance)
        stage = Stage(self._world, self._route, anchor, instance, self._progress, draws)
        return _Hazard(spec, scenario, stage)

    def _trigger_index(self, spec: ScenarioSpec) -> int | None:
        """First route point near the trigger and heading its way (reference `leaderboard.md` 3.3)."""
        x, y, z, yaw = spec.trigger
        near = np.hypot(self._route.points[:, 0] - x, self._route.points[:, 1] - y) < _TRIGGER_GAP
        level = self._route.points[:, 2] - z < _TRIGGER_GAP
        turned = np.abs(np.mod(self._route.yaw - yaw + np.pi, 2.0 * np.pi) - np.pi) < _TRIGGER_TURN
        found = np.flatnonzero(near & level & turned)
        return int(found[0]) if len(found) else None
