"""What the expert says it brakes for: a row for each cause, and one beside it that is none."""

from __future__ import annotations

from typing import Any

import pytest

from agents.behavior.road import StopPoint
from lavsim.types import ActorClass, LightState
from tests.agents.test_behavior import Other, Road, expert, straight, walker


def after(road: Road, seconds: float) -> dict[str, Any]:
    return road.drive(seconds).expert.labels()


def test_nothing_is_said_before_the_first_tick_and_no_brake_on_a_free_road() -> None:
    assert expert().labels() == {}
    free = after(Road(expert(), speed=0.0), 8.0)
    assert (free["brake"], free["brake_cause"], free["brake_actor"]) == (0, "none", 0)
    assert free["target_speed"] == pytest.approx(0.88 * 30.0 / 3.6, abs=0.3)


@pytest.mark.parametrize(
    ("kind", "cause"),
    [(ActorClass.CAR, "vehicle"), (ActorClass.BICYCLE, "vehicle"), (ActorClass.PROP, "prop")],
)
@pytest.mark.parametrize("seconds", [4.5, 15.0])
def test_standing_thing_is_braked_for_by_name(kind: ActorClass, cause: str, seconds: float) -> None:
    said = after(Road(expert(), [Other(60.0, 0.2, kind=kind)]), seconds)
    assert said == {"brake": 1, "brake_cause": cause, "brake_actor": 2, "target_speed": 0.0}


def test_walker_in_the_way_is_braked_for_by_name() -> None:
    said = after(Road(expert(), [walker(60.0, 0.0, 1.57)]), 15.0)
    assert said == {"brake": 1, "brake_cause": "walker", "brake_actor": 2, "target_speed": 0.0}


def test_slower_leader_is_no_brake() -> None:
    road = Road(expert(straight(400.0)), [Other(35.0, 0.0, 0.0, 4.0)], speed=7.0)
    braked = [after(road, 0.5)["brake"] for _ in range(40)]
    assert not any(braked)
    assert road.expert.labels()["target_speed"] == pytest.approx(4.0, abs=0.5)


def test_red_light_is_a_brake_and_green_none() -> None:
    red = after(Road(expert(stop=60.0), lights=lambda time: LightState.RED), 12.0)
    assert (red["brake"], red["brake_cause"], red["brake_actor"]) == (1, "light", 0)
    assert after(Road(expert(stop=60.0)), 5.0)["brake"] == 0


def test_stop_sign_is_a_brake_until_it_has_been_stood_at() -> None:
    made = expert()
    made.signs = [StopPoint(60.0, -1)]
    road, causes = Road(made), []
    for _ in range(60):
        causes.append(after(road, 0.25)["brake_cause"])
    assert "stop_sign" in causes
    assert causes[-1] == "none"
