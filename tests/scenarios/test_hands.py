"""What hazards hold is held, shown and let go."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from lavsim.errors import ScenarioError
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.scenarios.base import SCENARIOS, Scenario, ScenarioSpec, Script, Stage
from lavsim.scenarios.moves.wait import seconds
from lavsim.scenarios.parameters import Interval, Location, OtherActor, parse_parameters
from lavsim.scenarios.place import Site
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control, LightState
from lavsim.world.snapshot import HAZARD_OWNS_TIMER, HAZARD_WRONG_LANE_OFF
from tests.drives import TOWN, hazard, straight_drive

HERE = ("2.x", "Tried")
STAND = Control(brake=1.0)


@dataclass(frozen=True)
class Nothing:
    """No parameters."""


class Tried(Scenario):
    """Runs whatever the test wants."""

    Config = Nothing
    wanted: Callable[[Scenario, Stage], Script]

    def fits(self, site: Site) -> str | None:
        return None

    def place(self, stage: Stage) -> None:
        """Nothing."""

    def script(self, stage: Stage) -> Script:
        return type(self).wanted(self, stage)


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    assert ("2.x", "DynamicObjectCrossing") in SCENARIOS
    monkeypatch.setitem(SCENARIOS._entries, HERE, Tried)


def drive(script: Callable[[Scenario, Stage], Script], **changes: object) -> Simulation:
    Tried.wanted = staticmethod(script)
    return Simulation(straight_drive(**{"scenarios": (hazard("Tried", 0),), **changes}))


def junction_drive() -> DriveSpec:
    """A drive that meets a traffic light, with a hazard at its start."""
    town = load_town(TOWN)
    light = town.lights[0]
    line = light.stop_lines[0]
    after = int(light.lanes[0])
    ends = [town.waypoint_at(line.lane, line.u - 40.0), town.waypoint_at(int(town.lanes.successors(after)[0]), 15.0)]
    route = get_planner(town).trace(np.array([end.xyz for end in ends]))
    x, y, z = route.points[0].tolist()
    spec = ScenarioSpec("Tried_1", "Tried", "2.x", (x, y, z, float(route.yaw[0])), {})
    return DriveSpec(TOWN, "light", route.keypoints, scenarios=(spec,), traffic="empty")


def test_a_junction_is_held_and_goes_on_where_it_was_when_the_hazard_ends() -> None:
    seen: list[int] = []

    def script(scenario: Scenario, stage: Stage) -> Script:
        seen.append(stage.site.light)
        stage.lights.hold_junction(stage.site.light, [stage.site.light])
        yield from seconds(2.0)
        stage.lights.hold(stage.site.light, LightState.YELLOW)
        yield from seconds(2.0)

    Tried.wanted = staticmethod(script)
    spec = junction_drive()
    held, plain = Simulation(spec), Simulation(DriveSpec(TOWN, "light", spec.keypoints, traffic="empty"))
    snapshots = [held.tick(STAND) for _ in range(300)]
    free = [plain.tick(STAND) for _ in range(300)]
    light = seen[0]
    assert light >= 0
    group = next(g for g in held.town.light_groups if any(light in phase for phase in g.phases))
    members = [k for phase in group.phases for k in phase]
    others = [k for k in members if k != light]
    assert {int(s.lights[light]) for s in snapshots[:38]} == {LightState.GREEN}
    assert {int(s.lights[light]) for s in snapshots[42:75]} == {LightState.YELLOW}
    assert all(s.lights[k] == LightState.RED for s in snapshots[:75] for k in others)
    late = zip(snapshots[90:], free[10:], strict=False)
    assert all((a.lights[members] == b.lights[members]).all() for a, b in late), "80 ticks later"


def test_flags_are_shown_and_vanish_with_the_hazard_unless_they_last() -> None:
    def script(scenario: Scenario, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        yield from seconds(0.5)
        stage.flags.set(HAZARD_WRONG_LANE_OFF, lasting=True)
        yield from seconds(0.5)

    simulation = drive(script)
    flags = [simulation.tick(Control()).hazards["flags"].tolist() for _ in range(30)]
    assert flags[2] == [HAZARD_OWNS_TIMER]
    assert flags[15] == [HAZARD_OWNS_TIMER | HAZARD_WRONG_LANE_OFF]
    assert flags[29] == [HAZARD_WRONG_LANE_OFF]


def test_a_disturbed_ego_leaves_its_line_and_logs_what_its_agent_asked_for() -> None:
    def script(scenario: Scenario, stage: Stage) -> Script:
        for _ in range(40):
            stage.disturb(0.1, 0.3)
            yield

    def end(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
        for _ in range(80):
            simulation.tick(Control(throttle=0.5, steer=0.0))
        return simulation.snapshot.ego.xy, simulation.controls[-50]

    disturbed, control = end(drive(script))
    plain, same = end(drive(script, scenarios=()))
    assert np.hypot(*(disturbed - plain)) > 0.5
    np.testing.assert_array_equal(control, same)


def test_held_vehicles_stop_and_drive_on_when_the_hazard_ends() -> None:
    """Fires on who is ahead on the ego's way, spares who comes towards it."""
    held: list[int] = []
    speeds: dict[str, list[float]] = {"held": [], "others": []}

    def script(scenario: Scenario, stage: Stage) -> Script:
        while not len(rows := stage.traffic.ahead(80.0)):
            yield
        held.extend(rows.tolist())
        yield from seconds(2.0)
        stage.traffic.hold(rows)
        for _ in range(100):
            yield
            others = [row for row in stage.traffic.rows.tolist() if row not in held]
            speeds["held"].append(float(stage.world.body[held, 0].max()))
            speeds["others"].append(float(stage.world.body[others, 0].max()))

    simulation = drive(script, traffic="leaderboard", generation="2.x", vehicles=30)
    for _ in range(130):
        simulation.tick(STAND)
    assert held
    assert max(speeds["held"][60:]) < 0.05
    assert max(speeds["others"]) > 2.0
    for _ in range(100):
        simulation.tick(STAND)
    assert simulation._world.body[held, 0].max() > 2.0


@dataclass(frozen=True)
class Everything:
    """One field of each type."""

    speed: float = 1.0
    count: int = 1
    side: str = "left"
    is_on: bool = False
    gap: Interval = Interval(1.0, 2.0)  # noqa: RUF009 - frozen
    source: Location | None = None
    others: tuple[OtherActor, ...] = ()


@pytest.mark.parametrize(
    ("given", "field", "value"),
    [
        ({"speed": {"value": "3"}}, "speed", 3.0),
        ({"speed": "3"}, "speed", 3.0),
        ({"count": 3.0}, "count", 3),
        ({"is_on": "true"}, "is_on", True),
        ({"gap": {"from": "20", "to": 40}}, "gap", (20.0, 40.0)),
        ({"gap": [20.0, 40.0]}, "gap", (20.0, 40.0)),
        ({"gap": 30.0}, "gap", (30.0, 30.0)),
        ({"source": {"x": "1", "y": "2", "z": "3"}}, "source", (1.0, 2.0, 3.0, None)),
        ({"source": (1.0, 2.0, 3.0, 0.5)}, "source", (1.0, 2.0, 3.0, 0.5)),
        ({"source": None}, "source", None),
        (
            {"others": [{"position": (1.0, 2.0, 0.0), "model": "a", "yaw": 0.5}]},
            "others",
            (((1.0, 2.0, 0.0, 0.5), "a"),),
        ),
    ],
)
def test_parameters_take_their_types(given: dict[str, object], field: str, value: object) -> None:
    assert getattr(Everything(**parse_parameters(Everything, given)), field) == value


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"speed": "fast"}, "speed must be a float, got 'fast'"),
        ({"speed": float("nan")}, "speed must be a float, got nan"),
        ({"gap": (40.0, 20.0)}, r"gap must be an interval \(from, to\), got \(40.0, 20.0\)"),
        ({"source": (1.0,)}, r"source must be a place \(x, y, z\), got \(1.0,\)"),
        ({"is_on": "perhaps"}, "is_on must be true or false, got 'perhaps'"),
        ({"side": 3.0}, "side must be a str, got 3.0"),
    ],
)
def test_ill_typed_parameters_are_named(given: dict[str, object], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        parse_parameters(Everything, given)


def test_a_hazard_that_owns_a_timer_is_over_after_240_s() -> None:
    def script(scenario: Scenario, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        while True:
            yield

    simulation = drive(script)
    shown = [len(simulation.snapshot.hazards)] + [len(simulation.tick(STAND).hazards) for _ in range(4810)]
    assert sum(shown) == 4800
    assert shown[-1] == 0
