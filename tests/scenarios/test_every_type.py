"""What every type of 2.x and Bench2Drive promises, on one route each (`every_type.xml`)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from lavsim.map.route import RouteTracker
from lavsim.scenarios.base import SCENARIOS, make_scenario
from lavsim.scenarios.moves.meeting import calm_pace
from lavsim.scenarios.moves.pursuit import STEP
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import ActorIds, Control
from lavsim.world.snapshot import HAZARD_EMERGENCY_TEST, HAZARD_OWNS_TIMER, HAZARD_WRONG_LANE_OFF, Snapshot
from leaderboard.routes import read_routes

KINDS = sorted(str(key[1]) for key in SCENARIOS if key[0] == "2.x")
ACTING = [kind for kind in KINDS if SCENARIOS["2.x", kind].acts]
# Types that no contact shows: they act through traffic, on the wheel, or from behind.
UNTOUCHED = {"HardBreakRoute", "ControlLoss", "YieldToEmergencyVehicle"}
TIMED = {
    "Accident", "BlockedIntersection", "ConstructionObstacle", "CrossingBicycleFlow", "EnterActorFlow", "HighwayExit",
    "HazardAtSideLane", "InterurbanActorFlow", "InterurbanAdvancedActorFlow", "InvadingTurn", "MergerIntoSlowTraffic",
    "NonSignalizedJunctionLeftTurn", "NonSignalizedJunctionRightTurn", "ParkedObstacle", "ParkingExit",
    "SignalizedJunctionLeftTurn", "SignalizedJunctionRightTurn", "T_Junction", "VehicleOpensDoor",
}  # fmt: skip
FIRST = int(ActorIds.SCENARIOS)
LONGEST = 900  # ticks


@cache
def drives() -> dict[str, DriveSpec]:
    entries = read_routes(Path(__file__).parent / "every_type.xml")
    return {
        entry.scenarios[0].type: DriveSpec(
            entry.town, entry.id, entry.keypoints, entry.weather, entry.scenarios, traffic="empty", generation="2.x"
        )
        for entry in entries
    }


class Blind:
    """Keeps to the route at 8 m/s, slower in bends, and looks at nobody."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation, self.route = simulation, simulation.route
        self.tracker = RouteTracker(self.route, 8)
        self.pace = calm_pace(self.route, 0.0, self.route.length)

    def tick(self) -> Snapshot:
        ego = self.simulation.snapshot.ego
        aim = self.route.xy[min(self.tracker.update(ego.xy) + 5, len(self.route) - 1)] - ego.xy
        angle = (np.arctan2(aim[1], aim[0]) - ego.yaw + np.pi) % (2.0 * np.pi) - np.pi
        excess = ego.speed - min(8.0, self.pace[min(int(self.tracker.metres() / STEP), len(self.pace) - 1)])
        throttle, brake = 0.75 if excess < 0.0 else 0.0, 0.3 if excess > 0.5 else 0.0
        if self.is_done:
            return self.simulation.tick(Control(brake=1.0))
        return self.simulation.tick(Control(throttle, float(np.clip(1.5 * angle, -1.0, 1.0)), brake))

    @property
    def is_done(self) -> bool:
        return self.tracker.metres() > self.route.length - 3.0


class Ghost(Blind):
    """The same, but nobody can touch or see it: hazards run to their end."""

    def __init__(self, simulation: Simulation) -> None:
        super().__init__(simulation)
        simulation._world.half_sizes[0] = 0.0


def ghost_drive(kind: str) -> Iterator[tuple[Simulation, Snapshot]]:
    """Ticks until the hazard is over."""
    simulation = Simulation(drives()[kind])
    driver = Ghost(simulation)
    for _ in range(LONGEST):
        snapshot = driver.tick()
        yield simulation, snapshot
        if not running(simulation):
            return


def running(simulation: Simulation) -> bool:
    """Whether the hazard is not over."""
    return any(not hazard.is_over for hazard in simulation._director._hazards)


def of_hazard(snapshot: Snapshot) -> np.ndarray:
    return np.flatnonzero(snapshot.ids >= FIRST)


def test_every_type_has_a_route() -> None:
    assert sorted(drives()) == KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_it_runs_from_its_trigger_to_its_end_and_leaves_nothing_behind(kind: str) -> None:
    flags, most, begun = 0, 0, 0
    for simulation, snapshot in ghost_drive(kind):  # noqa: B007 - read below
        most = max(most, len(of_hazard(snapshot)))
        if len(snapshot.hazards):
            flags |= int(snapshot.hazards["flags"][0])
            begun = begun or snapshot.tick
            at_trigger = np.hypot(*(snapshot.ego.xy - drives()[kind].scenarios[0].trigger[:2])) < 4.0
            assert at_trigger or snapshot.tick > begun
    assert begun, "never set off"
    assert not running(simulation), "not over at the end of the route"
    assert len(of_hazard(snapshot)) == 0
    assert not simulation._lights._held, "lights are held for good"
    assert (most > 0) == (SCENARIOS["2.x", kind].acts and kind != "HardBreakRoute")
    name = kind.removesuffix("V2").removesuffix("TwoWays").removesuffix("EnterFlow")
    assert bool(flags & HAZARD_OWNS_TIMER) == (name in TIMED)
    assert bool(flags & HAZARD_EMERGENCY_TEST) == (kind == "YieldToEmergencyVehicle")
    assert bool(flags & HAZARD_WRONG_LANE_OFF) == kind.endswith("TwoWays")


@pytest.mark.parametrize("kind", [kind for kind in ACTING if kind not in UNTOUCHED])
def test_it_hurts_who_does_not_look(kind: str) -> None:
    simulation = Simulation(drives()[kind])
    driver = Blind(simulation)
    for _ in range(LONGEST):
        contacts = driver.tick().contacts
        if any(min(c["a"], c["b"]) == ActorIds.EGO and max(c["a"], c["b"]) >= FIRST for c in contacts):
            return
        if driver.is_done:
            break
    pytest.fail("passed without looking")


def test_unknown_and_ill_typed_parameters_are_named() -> None:
    for kind, spec in drives().items():
        hazard = spec.scenarios[0]
        with pytest.raises(Exception, match=rf"{kind}_1 \({kind}\): no parameter 'colour'"):
            make_scenario(type(hazard)(hazard.name, kind, "2.x", hazard.trigger, {"colour": "red"}))
