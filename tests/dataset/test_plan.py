"""The plan of a dataset: pure, spread over its towns, and refused where it can't be meant."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.cli import main
from lavsim.config import parse_config
from lavsim.dataset.hazards import AFTER_START, BEFORE_END, known_hazards, named_hazards
from lavsim.dataset.plan import CollectPlan, named_towns
from lavsim.errors import ConfigError, LavsimError, RouteError, UnknownName
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.scenarios.suggest import fits_at
from lavsim.world.weather_redrawn import RedrawnWeather

TOWNS = ("eu_small_a", "eu_small_b")
PLAN = CollectPlan(towns=TOWNS, frames=100, seed=3, vehicles=(5, 9), walkers=(0, 3), length=(150.0, 400.0))


def told(plan: CollectPlan, number: int) -> str:
    episode = plan.episode(number)
    return f"{episode.number} {episode.spec} {episode.spec.keypoints.tolist()} {episode.weather}"


def test_towns_take_turns_and_every_draw_keeps_to_its_range() -> None:
    for number in range(12):
        episode = PLAN.episode(number)
        spec = episode.spec
        route = get_planner(load_town(spec.town)).trace(spec.keypoints)
        assert spec.town == TOWNS[number % 2]
        assert 150.0 <= route.length <= 400.0
        assert spec.vehicles in range(5, 10)
        assert spec.walkers in range(4)
        assert isinstance(spec.weather, RedrawnWeather)
        assert (episode.name, episode.max_ticks) == (f"ep_{number:06d}", 2000)


def test_episodes_differ_in_seed_route_and_weather() -> None:
    specs = [PLAN.episode(number).spec for number in range(0, 24, 2)]
    assert len({spec.seed for spec in specs}) == len(specs)
    assert len({spec.weather for spec in specs}) == len(specs)
    assert len({spec.keypoints.tobytes() for spec in specs}) == len(specs)
    assert len({spec.vehicles for spec in specs}) > 1


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**5), st.integers(0, 2**63))
def test_an_episode_is_a_pure_function_of_plan_and_number(number: int, seed: int) -> None:
    plan = CollectPlan(**{**PLAN.model_dump(), "seed": seed})
    assert told(plan, number) == told(CollectPlan.from_json(json.loads(json.dumps(plan.to_json()))), number)


def test_how_much_is_collected_changes_no_episode() -> None:
    more = CollectPlan(**{**PLAN.model_dump(), "frames": 10**6, "episode_frames": 40})
    assert told(more, 5) == told(PLAN, 5)


def test_named_weathers_are_those_of_the_episodes() -> None:
    plan = CollectPlan(towns=TOWNS[:1], frames=1, weathers=("ClearNoon", "HardRainSunset"), length=(150.0, 400.0))
    names = [plan.episode(number).weather for number in range(12)]
    assert set(names) == {"ClearNoon", "HardRainSunset"}
    frames = plan.episode(names.index("ClearNoon")).spec.weather
    assert isinstance(frames, tuple)
    assert frames[0].weather.sun_altitude_angle == 75.0


def test_counts_are_the_profiles_unless_given() -> None:
    spec = CollectPlan(towns=TOWNS[:1], frames=1, length=(150.0, 400.0)).episode(0).spec
    assert (spec.vehicles, spec.walkers, spec.traffic) == (None, None, "lav")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"towns": ()}, "towns"),
        ({"frames": 0}, "frames: .*greater than or equal to 1, got 0"),
        ({"episode_frames": 401}, "episode_frames: .*less than or equal to 400, got 401"),
        ({"vehicles": (9, 5)}, "vehicles: a range must rise and not be negative"),
        ({"weathers": ("ClearNon",)}, "no weather 'ClearNon'. Did you mean 'ClearNoon'"),
        ({"traffic": "lavv"}, "no traffic profile 'lavv'. Did you mean 'lav'"),
        ({"town": "x"}, "unknown key 'town'. Did you mean 'towns'"),
        ({"noise": {"shortest": 3.0, "longest": 2.0}}, "noise: bursts of 3 to 2 s must fit into 5 s"),
    ],
)
def test_a_plan_that_can_not_be_meant_is_refused_in_one_line(change: dict[str, object], message: str) -> None:
    with pytest.raises(LavsimError, match=message):
        parse_config(CollectPlan, {"towns": TOWNS, "frames": 1, **change})


def test_towns_and_lengths_that_are_not_there_are_found_before_the_first_drive() -> None:
    with pytest.raises(UnknownName, match=r"no town 'eu_smal_a'\. Did you mean 'eu_small_a'"):
        CollectPlan(towns=("eu_smal_a",), frames=1).check()
    with pytest.raises(RouteError, match="eu_small_a has no route of 90000 to 90001 m"):
        CollectPlan(towns=TOWNS[:1], frames=1, length=(90000.0, 90001.0)).check()
    assert PLAN.check() == {name: load_town(name).digest for name in TOWNS}


def test_a_plan_of_another_schema_is_refused() -> None:
    with pytest.raises(ConfigError, match="the plan has schema 99"):
        CollectPlan.from_json({**PLAN.to_json(), "schema": 99})


def test_routes_start_anywhere_in_town() -> None:
    starts = np.array([PLAN.episode(2 * number).spec.keypoints[0, :2] for number in range(20)])
    assert np.ptp(starts, axis=0).min() > 150.0


def test_hazards_stand_where_they_fit_at_most_one_on_a_stretch() -> None:
    plan = CollectPlan(towns=TOWNS, frames=1, hazards=("DynamicObjectCrossing", "VehicleTurningRoute"))
    kinds = set()
    for number in range(6):
        spec = plan.episode(number).spec
        town = load_town(spec.town)
        route = get_planner(town).trace(spec.keypoints)
        at = [int(np.argmin(np.hypot(*(route.xy - hazard.trigger[:2]).T))) for hazard in spec.scenarios]
        stretches = [int((route.distance[index] - AFTER_START) // (1000.0 / 3.0)) for index in at]
        assert all(AFTER_START <= route.distance[index] <= route.length - BEFORE_END + 2.0 for index in at)
        assert len(set(stretches)) == len(stretches)
        assert len({hazard.name for hazard in spec.scenarios}) == len(spec.scenarios)
        for index, hazard in zip(at, spec.scenarios, strict=True):
            assert fits_at(town, route, index, hazard.type, hazard.generation) is None
        kinds |= {hazard.type for hazard in spec.scenarios}
    assert kinds == {"DynamicObjectCrossing", "VehicleTurningRoute"}


def test_hazards_are_named_one_by_one_or_by_set() -> None:
    assert named_hazards("none") == ()
    assert named_hazards("lav")[0] == "Scenario1"
    assert named_hazards("all") == known_hazards()
    assert named_hazards("Accident, ParkedObstacle") == ("Accident", "ParkedObstacle")
    with pytest.raises(UnknownName, match=r"no hazard 'Acident'\. Did you mean 'Accident'"):
        CollectPlan(hazards=("Acident",))


def test_splits_stand_for_their_towns() -> None:
    assert named_towns("training") == ("eu_small_a", "us_large_a", "us_large_b", "us_highway") == CollectPlan().towns
    assert named_towns("test,eu_small_a") == ("eu_small_b", "us_large_c", "eu_small_a")


@pytest.mark.parametrize(
    "plan",
    [
        CollectPlan(),
        CollectPlan(**{**PLAN.model_dump(), "noise": {"push": 1.5}, "hazards": ("Accident",), "log_only": True}),
        CollectPlan(weathers=("ClearNoon", "WetNoon"), traffic="empty", hazards_per_km=1.5, episode_frames=40),
        CollectPlan(suite="lav", look="full", agent="a.b:C", agent_config="x", noise={}),  # type: ignore[arg-type]
    ],
)
def test_the_command_of_a_plan_makes_that_plan(plan: CollectPlan, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def collect(plan: CollectPlan, *_: object, **__: object) -> Nothing:
        made.append(plan)
        return Nothing()

    monkeypatch.setattr("lavsim.dataset.collect.collect", collect)
    assert main([*plan.command().split()[1:], "--out", "data"]) == 0
    assert made == [plan]


class Nothing:
    frames, bytes, records = 0, 0, ()
