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
from lavsim.scenarios.hands import EgoHand, FlagsHand, LightsHand, TrafficHand
from lavsim.scenarios.place import Site
from lavsim.scenarios.user_files import file_of, located
from lavsim.traffic.population import Traffic
from lavsim.world.lights import TrafficLights
from lavsim.world.snapshot import HAZARD_DTYPE, HAZARD_OWNS_TIMER
from lavsim.world.world import World

_PLACE_RANGE = 500.0  # [m] from the ego within which a hazard's actors appear
_RETRY_TICKS = 20  # between attempts to place a hazard whose place is taken; as long, one is tried at its trigger
_MOST_WITHDRAWN = 500  # actors of attempts in vain, half of a hazard's ids: after them it is left out
TRIGGER_RADIUS = {"1.0": 1.5, "2.x": 2.0}  # [m] of the ego's route point from the trigger that sets a hazard off
_TRIGGER_GAP = 2.0  # [m] and
_TRIGGER_TURN = np.radians(10.0)  # off the route: farther and the leaderboard ignores a trigger
_PASSING = 5  # route points from the first near a trigger that belong to the same visit
_LONGEST = 4800  # ticks after which a hazard that owns a timer is over, come what may: 240 s (reference, 6.3)
_NONE = np.zeros(0, dtype=HAZARD_DTYPE)


@dataclass
class _Hazard:
    """A hazard and where it stands in its life."""

    spec: ScenarioSpec
    scenario: Scenario
    stage: Stage
    retry: int = 0  # tick from which on it may be placed
    given_up: int | None = None  # tick up to which a hazard that is set off is tried
    is_placed: bool = False
    is_over: bool = False
    begun: int = 0  # tick at which it was set off
    refusal: str = ""  # why it could not be placed
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
        lights: The town's lights, for hazards that hold them.
        traffic: Background vehicles, for hazards that slow them down.
        rules: Rule set of the drive.

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
        lights: TrafficLights,
        traffic: Traffic,
        rules: str,
    ) -> None:
        self._town, self._route, self._world, self._draws = town, route, world, draws
        self._route_id, self._progress, self._rules = route_id, progress, rules
        self._lights, self._light_owners, self._traffic, self._ego = lights, dict[int, int](), traffic, EgoHand()
        self._count, self._hazards = 0, list[_Hazard]()
        for spec in specs:
            self.add(spec)

    @property
    def active(self) -> NDArray[np.void]:
        """`(H,)` of `HAZARD_DTYPE`: hazards set off and not over, and those over whose flags last."""
        if not self._hazards:
            return _NONE
        rows = [
            (h.stage.instance, h.stage.flags.bits)
            for h in self._hazards
            if h.script is not None and (not h.is_over or h.stage.flags.bits)
        ]
        return np.array(rows, dtype=HAZARD_DTYPE)

    @property
    def fates(self) -> dict[int, str]:
        """What became of each hazard so far, by its number in the route."""
        found = {}
        for hazard in self._hazards:
            if hazard.script is not None:
                found[hazard.stage.instance] = "set off"
            elif hazard.is_over:
                found[hazard.stage.instance] = f"no room: {hazard.refusal}"
            else:
                found[hazard.stage.instance] = "not reached"
        return found

    @property
    def disturbance(self) -> tuple[float, float]:
        """What the scripts of this tick add to the ego's throttle and steer."""
        return self._ego.take()

    def add(self, spec: ScenarioSpec) -> None:
        """Takes in a hazard, before the drive or under way; its number is the next one.

        Raises:
            RouteError: it doesn't fit where its trigger is.
            UnknownName: no such hazard.
        """
        hazard = self._prepare(self._count, spec)
        self._count += 1
        if hazard is not None:
            self._hazards.append(hazard)

    def tick(self, route_point: NDArray[np.float64]) -> None:
        """Places what the ego comes near and runs every script by one tick.

        Args:
            route_point: (2,) the point of the route that the ego is at [m].
        """
        self.place()
        for hazard in self._hazards:
            if hazard.is_over or (hazard.script is None and not self._set_off(hazard, route_point)):
                continue
            if not self._step(hazard):
                self._end(hazard)
                continue
            owns_timer = hazard.stage.flags.bits & HAZARD_OWNS_TIMER
            if owns_timer and self._world.tick - hazard.begun >= _LONGEST:
                self._end(hazard)

    def _step(self, hazard: _Hazard) -> bool:
        """Runs a script by one tick; whether it goes on."""
        assert hazard.script is not None, "it has been set off"
        try:
            next(hazard.script)
        except (StopIteration, ScenarioError):  # what finds no room later on is left out, too
            return False
        except Exception as error:
            raise _mistake(hazard.scenario, error) from error
        return True

    def _set_off(self, hazard: _Hazard, route_point: NDArray[np.float64]) -> bool:
        """Starts the script of a hazard whose trigger the ego has reached; whether it runs."""
        if hazard.given_up is None:
            gap = route_point - np.array(hazard.spec.trigger[:2])
            if np.hypot(*gap) >= TRIGGER_RADIUS[hazard.spec.generation]:
                return False
            hazard.given_up = self._world.tick + (_RETRY_TICKS if hazard.scenario.appears_at_trigger else 0)
        if not hazard.is_placed and hazard.scenario.appears_at_trigger:
            self._try_to_place(hazard)
        if hazard.is_placed:
            hazard.script, hazard.begun = hazard.scenario.script(hazard.stage), self._world.tick
            return True
        if self._world.tick >= hazard.given_up:  # no room: left out, as the leaderboard skips what can't be set up
            self._end(hazard)
        return False

    def _end(self, hazard: _Hazard) -> None:
        hazard.is_over = True
        hazard.scenario.clear()
        hazard.stage.release()

    def place(self) -> None:
        """Places hazards whose trigger is near; one whose place is taken (by a walker, say) is tried again later."""
        for hazard in self._hazards:
            if hazard.is_placed or hazard.is_over or hazard.scenario.appears_at_trigger:
                continue
            trigger = np.array(hazard.spec.trigger[:2])
            if self._world.tick >= hazard.retry and np.hypot(*(trigger - self._world.ego.xy)) < _PLACE_RANGE:
                self._try_to_place(hazard)

    def _try_to_place(self, hazard: _Hazard) -> None:
        try:
            hazard.scenario.place(hazard.stage)
            hazard.is_placed = True
        except ScenarioError as error:
            hazard.refusal = str(error)
            hazard.scenario.withdraw()
            hazard.retry = self._world.tick + _RETRY_TICKS
            if hazard.scenario.withdrawn >= _MOST_WITHDRAWN:
                self._end(hazard)
        except Exception as error:
            raise _mistake(hazard.scenario, error) from error

    def _prepare(self, instance: int, spec: ScenarioSpec) -> _Hazard | None:
        """The hazard of `spec`; None when its trigger is not on the route, as the leaderboard ignores it then."""
        scenario = make_scenario(spec)
        index = trigger_index(self._route, spec)
        if index is None:
            return None
        site = Site(self._town, self._route, index)
        try:
            reason = scenario.fits(site)
        except Exception as error:
            raise _mistake(scenario, error) from error
        if reason is not None:
            where = f"({spec.trigger[0]:.1f}, {spec.trigger[1]:.1f})"
            raise RouteError(
                f"route {self._route_id}, scenario {spec.name}: {spec.type} does not fit at {where}: {reason}."
            )
        stage = Stage(
            self._world, site, instance, self._progress, self._draws.stream("scenario", instance),
            LightsHand(self._lights, self._world, self._light_owners, instance), FlagsHand(),
            TrafficHand(self._traffic, self._world, self._route, self._progress), self._ego, self._rules,
        )  # fmt: skip
        return _Hazard(spec, scenario, stage)


def _mistake(scenario: Scenario, error: Exception) -> Exception:
    """An error in a user's file, with file and line; one in ours stays what it is."""
    path = file_of(scenario)
    return error if path is None else ScenarioError(located(error, path))


def trigger_index(route: Route, spec: ScenarioSpec) -> int | None:
    """The point of `route` at the trigger, where it first passes it heading its way; None: the hazard is ignored.

    Near and heading its way as reference `leaderboard.md` 3.3 has it.
    """
    x, y, z, yaw = spec.trigger
    near = np.hypot(route.points[:, 0] - x, route.points[:, 1] - y) < _TRIGGER_GAP
    level = route.points[:, 2] - z < _TRIGGER_GAP
    turned = np.abs(np.mod(route.yaw - yaw + np.pi, 2.0 * np.pi) - np.pi) < _TRIGGER_TURN
    found = np.flatnonzero(near & level & turned)
    if not len(found):
        return None
    passing = found[found <= found[0] + _PASSING]
    return int(passing[np.argmin(np.hypot(route.points[passing, 0] - x, route.points[passing, 1] - y))])
