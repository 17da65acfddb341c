"""The walker hurts who does not look and spares who brakes."""

import numpy as np
import pytest

from lavsim.errors import RouteError, ScenarioError, UnknownName
from lavsim.scenarios.base import make_scenario
from lavsim.simulation import Simulation
from lavsim.types import ActorIds, Control
from lavsim.world.snapshot import Snapshot
from tests.drives import follow, hazard, run, straight_drive, straight_route

WALKER = int(ActorIds.of_scenario(0)) + 1
TRIGGER = 30


def crossing(**parameters: object) -> object:
    return hazard("DynamicObjectCrossing", TRIGGER, distance="20", **parameters)


def hits(snapshots: list[Snapshot], actor: int) -> bool:
    return any(actor in (c["a"], c["b"]) for s in snapshots for c in s.contacts)


def careful(snapshot: Snapshot) -> Control:
    """Brakes for a walker that moves within 25 m."""
    row = snapshot.index_of(WALKER)
    if row is None or snapshot.speeds[row] < 0.5 or abs(offset_of(snapshot.xy[row])) > 6.5:
        return follow(straight_route(), snapshot)
    near = np.hypot(*(snapshot.xy[row] - snapshot.ego.xy)) < 25.0
    return Control(brake=1.0) if near else follow(straight_route(), snapshot)


def straight_direction() -> np.ndarray:
    yaw = straight_route().yaw[TRIGGER]
    return np.array([np.cos(yaw), np.sin(yaw)])


def test_a_blind_driver_hits_the_walker() -> None:
    assert hits(run(straight_drive(scenarios=(crossing(),)), 300), WALKER)


@pytest.mark.parametrize(("direction", "side"), [("right", 1.0), ("left", -1.0)])
def test_the_walker_crosses_the_whole_lane_from_its_side(direction: str, side: float) -> None:
    """From the left it has the oncoming lane to cross first, so at 2 m/s a fast ego is gone before it arrives."""
    snapshots = run(straight_drive(scenarios=(crossing(direction=direction),)), 300, careful)
    offsets = [offset_of(s.xy[row]) for s in snapshots if (row := s.index_of(WALKER)) is not None]
    assert side * offsets[0] > 2.0
    assert side * offsets[-1] < -2.0


def offset_of(xy: np.ndarray) -> float:
    """Distance to the right of the route's line at the trigger [m]."""
    forward, delta = straight_direction(), xy - straight_route().xy[TRIGGER]
    return float(forward[0] * delta[1] - forward[1] * delta[0])


def test_a_driver_who_brakes_does_not() -> None:
    snapshots = run(straight_drive(scenarios=(crossing(),)), 500, careful)
    assert not hits(snapshots, WALKER)
    assert snapshots[-1].index_of(WALKER) is None, "walker and blocker leave once the ego is 40 m on"
    assert len(snapshots[-1].rows) == 1


def test_the_walker_waits_behind_its_blocker_until_the_ego_is_near() -> None:
    snapshots = run(straight_drive(scenarios=(crossing(),)), 250)
    first = snapshots[0]
    walker, blocker = first.xy[first.index_of(WALKER)], first.xy[first.index_of(WALKER - 1)]
    ego = first.ego.xy
    assert np.hypot(*(blocker - ego)) < np.hypot(*(walker - ego))
    moving = next(s for s in snapshots if s.speeds[s.index_of(WALKER)] > 0.5)
    ahead = np.hypot(*(walker - moving.ego.xy))
    assert 5.0 < ahead < 2.2 * moving.ego.speed + 6.0
    assert len(moving.hazards) == 1
    assert len(first.hazards) == 0


def test_it_is_off_the_road_until_it_starts() -> None:
    simulation = Simulation(straight_drive(scenarios=(crossing(),)))
    snapshot = simulation.snapshot
    for actor in (WALKER, WALKER - 1):
        row = snapshot.index_of(actor)
        hit = simulation.town.nearest(snapshot.xy[row])
        half = max(snapshot.sizes[row, :2]) / 2
        assert hit.distance[0] > hit.width[0] / 2 + half - 0.3


def test_a_trigger_off_the_route_is_ignored() -> None:
    spec = crossing()
    far = type(spec)(spec.name, spec.type, spec.generation, (9999.0, 0.0, 0.0, 0.0), spec.parameters)
    assert len(run(straight_drive(scenarios=(far,)), 2)[-1].rows) == 1


def test_where_a_junction_follows_at_once_it_does_not_fit() -> None:
    spec = hazard("DynamicObjectCrossing", len(straight_route()) - 3, distance="20")
    with pytest.raises(RouteError, match=r"route straight, scenario DynamicObjectCrossing_1: .*20 m after the trigger"):
        Simulation(straight_drive(scenarios=(spec,)))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"distanse": "20"}, r"no parameter 'distanse'. Did you mean 'distance'\?"),
        ({"distance": "far"}, "distance must be a float, got 'far'"),
        ({"distance": "-3"}, r"distance must be positive \[m\], got -3.0"),
        ({"direction": "up"}, "direction must be 'right' or 'left', got 'up'"),
    ],
)
def test_bad_parameters_are_named(parameters: dict[str, str], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        make_scenario(hazard("DynamicObjectCrossing", TRIGGER, **parameters))


def test_unknown_names_point_to_the_nearest() -> None:
    with pytest.raises(UnknownName, match=r"Did you mean '2\.x:DynamicObjectCrossing'"):
        make_scenario(hazard("DynamicObjectCrosing", TRIGGER))
    with pytest.raises(UnknownName, match=r"Did you mean 'static\.prop\.vendingmachine'"):
        make_scenario(hazard("DynamicObjectCrossing", TRIGGER, blocker_model="static.prop.vendingmachin"))
