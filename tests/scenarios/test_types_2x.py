"""What single types of 2.x do, beyond what all of them promise."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from lavsim.errors import RouteError, ScenarioError
from lavsim.scenarios.base import ScenarioSpec, make_scenario
from lavsim.simulation import Simulation
from lavsim.types import ActorClass, ActorIds, LightState, VehicleLight
from lavsim.world.actor import VehicleDoor
from lavsim.world.snapshot import HAZARD_OWNS_TIMER, HAZARD_WRONG_LANE_OFF, Snapshot
from tests.drives import hazard, straight_drive
from tests.scenarios.test_every_type import FIRST, Ghost, drives, ghost_drive, of_hazard


@cache
def ghost_snapshots(kind: str) -> tuple[Simulation, list[Snapshot]]:
    """The drive's snapshots while the hazard is on."""
    ticks = [(simulation, snapshot) for simulation, snapshot in ghost_drive(kind) if len(snapshot.hazards)]
    return ticks[0][0], [snapshot for _, snapshot in ticks]


def lights_of(snapshot: Snapshot, actor: int) -> VehicleLight:
    row = snapshot.index_of(actor)
    assert row is not None
    return VehicleLight(int(snapshot.state[row, 0]))


def offsets(simulation: Simulation, snapshots: Sequence[Snapshot], actor: int) -> np.ndarray:
    """Distance of an actor from the route's line, tick by tick [m]."""
    places = [snapshot.xy[row] for snapshot in snapshots if (row := snapshot.index_of(actor)) is not None]
    return np.array([np.hypot(*(simulation.route.xy - place).T).min() for place in places])


def test_the_police_has_its_lights_on_at_an_accident() -> None:
    _, snapshots = ghost_snapshots("Accident")
    assert VehicleLight.SPECIAL1 in lights_of(snapshots[0], FIRST)
    assert np.count_nonzero(snapshots[0].is_vehicle[of_hazard(snapshots[0])]) == 3


def test_a_parked_obstacle_blinks_on_both_sides() -> None:
    _, snapshots = ghost_snapshots("ParkedObstacle")
    both = VehicleLight.LEFT_BLINKER | VehicleLight.RIGHT_BLINKER
    assert lights_of(snapshots[0], FIRST) & both == both


@pytest.mark.parametrize(("kind", "clear"), [("ParkingCutIn", 1.5), ("StaticCutIn", 2.5)])
def test_who_cuts_in_waits_beside_and_ends_in_the_egos_lane(kind: str, clear: float) -> None:
    simulation, snapshots = ghost_snapshots(kind)
    moved = [row for row in of_hazard(snapshots[-1]) if snapshots[-1].speeds[row] > 1.0]
    assert len(moved) == 1
    away = offsets(simulation, snapshots, int(snapshots[-1].ids[moved[0]]))
    assert away[0] > clear
    assert away.min() < 0.3


def test_the_door_opens_into_the_lane_as_the_ego_comes() -> None:
    simulation, snapshots = ghost_snapshots("VehicleOpensDoorTwoWays")
    car = snapshots[0].index_of(FIRST)
    assert car is not None
    assert snapshots[0].state[car, 1] == 0
    opened = next(s for s in snapshots if s.index_of(FIRST + 1) is not None)
    assert opened.state[opened.index_of(FIRST), 1] == VehicleDoor.FRONT_LEFT
    assert offsets(simulation, [opened], FIRST + 1)[0] < offsets(simulation, [opened], FIRST)[0]
    ahead = float(np.hypot(*(opened.xy[car] - opened.ego.xy)))
    assert ahead < max(3.0 * opened.ego.speed, 10.0) + 1.0


def test_a_stream_keeps_its_speed_and_its_gaps() -> None:
    simulation, snapshots = ghost_snapshots("InterurbanActorFlow")
    gaps = []
    for snapshot in snapshots[::10]:
        rows = of_hazard(snapshot)
        gaps += [float(np.hypot(*(snapshot.xy[a] - snapshot.xy[b]))) for a, b in pairwise(rows)]
    low, high = simulation._director._hazards[0].scenario.config.source_dist_interval
    assert gaps
    assert 0.5 * low < min(gaps)  # bends push them together
    assert max(gaps) < 1.2 * high


def test_the_ego_has_red_for_five_seconds_and_then_green_with_the_stream() -> None:
    simulation, snapshots = ghost_snapshots("SignalizedJunctionLeftTurn")
    light = simulation._director._hazards[0].stage.site.light
    states = np.array([snapshot.lights[light] for snapshot in snapshots])
    assert (states[2:98] == LightState.RED).all()
    assert (states[103:-2] == LightState.GREEN).all()


def test_all_others_have_red_where_an_emergency_vehicle_runs_its_light() -> None:
    simulation, snapshots = ghost_snapshots("OppositeVehicleRunningRedLight")
    light = simulation._director._hazards[0].stage.site.light
    members = simulation._lights.group_of(light)
    middle = snapshots[len(snapshots) // 2]
    assert [member for member in members if middle.lights[member] == LightState.GREEN] == [light]
    assert VehicleLight.SPECIAL1 in lights_of(snapshots[1], FIRST)


def test_three_walkers_cross_the_whole_lane() -> None:
    simulation, snapshots = ghost_snapshots("PedestrianCrossing")
    for actor in range(FIRST, FIRST + 3):
        away = offsets(simulation, snapshots, actor)
        assert away.min() < 0.6, "nobody stops before the middle of the lane"
        assert away[-1] > 1.5


def test_bicycles_ride_their_distance_and_stop() -> None:
    _, snapshots = ghost_snapshots("HazardAtSideLane")
    rows = of_hazard(snapshots[0])
    assert (snapshots[0].classes[rows] == ActorClass.BICYCLE).all()
    way = [snapshot.xy[snapshot.index_of(FIRST)] for snapshot in snapshots]
    driven = float(np.hypot(*np.diff(np.array(way), axis=0).T).sum())
    assert driven == pytest.approx(50.0, abs=2.0) or driven < 50.0


def test_wrong_lanes_stay_allowed_after_bicycles_against_traffic() -> None:
    for kind, lasting in (("HazardAtSideLaneTwoWays", True), ("ParkedObstacleTwoWays", False)):
        *_, (simulation, last) = ghost_drive(kind)
        assert len(of_hazard(last)) == 0
        last = Ghost(simulation).tick()
        flags = int(last.hazards["flags"].sum()) if len(last.hazards) else 0
        assert bool(flags & HAZARD_WRONG_LANE_OFF) == lasting
        assert not flags & HAZARD_OWNS_TIMER


def test_the_wheel_trembles_only_near_debris() -> None:
    def track(scenarios: tuple[ScenarioSpec, ...]) -> np.ndarray:
        simulation = Simulation(straight_drive(scenarios=scenarios, generation="2.x"))
        driver = Ghost(simulation)
        return np.array([driver.tick().ego.xy for _ in range(260)])

    bare, disturbed = track(()), track((hazard("ControlLoss", 30),))
    apart = np.hypot(*(bare - disturbed).T)
    begun = int(np.argmax(apart > 1e-3))
    assert apart.max() > 0.05
    assert np.hypot(*(bare[begun] - bare[0])) == pytest.approx(30 + 14 - 2, abs=3.0)


def test_an_ego_that_goes_on_has_the_emergency_vehicle_behind_it() -> None:
    _, snapshots = ghost_snapshots("YieldToEmergencyVehicle")
    last = snapshots[-1]
    row = last.index_of(FIRST)
    assert row is not None
    ahead = (last.xy[row] - last.ego.xy) @ np.array([np.cos(last.ego.yaw), np.sin(last.ego.yaw)])
    assert -60.0 < float(ahead) < -3.0 or float(ahead) > 0.0


@pytest.mark.parametrize(
    ("kind", "parameters", "message"),
    [
        ("Accident", {"distance": "-5"}, "distance must be positive, got -5"),
        ("Accident", {"direction": "up"}, "direction must be 'right' or 'left', got 'up'"),
        ("AccidentTwoWays", {"frequency": "often"}, "frequency must be an interval"),
        ("OppositeVehicleTakingPriority", {"direction": "above"}, "direction must be 'right', 'left' or 'opposite'"),
        ("EnterActorFlow", {"start_actor_flow": (1.0, 2.0, 3.0)}, "give both or none"),
        ("InvadingTurn", {"offset": 9.0}, "offset must lie in -1 to 1.5"),
        ("StaticCutIn", {"distance": 20.0}, "distance must be above 22"),
    ],
)
def test_bad_parameters_are_named(kind: str, parameters: dict[str, object], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        make_scenario(hazard(kind, 30, **parameters))


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("Accident", "there is no lane to the left to pass it by"),
        ("StaticCutIn", "there is no lane to the right for the queue"),
        ("ParkingCutIn", "there is no parking lane to the right"),
        ("PedestrianCrossing", "the route enters no junction after it"),
        ("SequentialLaneChange", "the route changes no lane after it"),
        ("EnterActorFlow", "nobody's way meets that of the route"),
    ],
)
def test_where_it_cant_stand_the_reason_is_said_when_the_route_loads(kind: str, message: str) -> None:
    with pytest.raises(RouteError, match=f"scenario {kind}_1: .*{message}"):
        Simulation(straight_drive(scenarios=(hazard(kind, 30),)))


def test_ids_of_a_hazard_stay_in_its_range() -> None:
    for kind in ("InvadingTurn", "ConstructionObstacle"):
        assert kind in drives()
        _, snapshots = ghost_snapshots(kind)
        ids = snapshots[-1].ids[of_hazard(snapshots[-1])]
        assert (ids < int(ActorIds.of_scenario(1))).all()
