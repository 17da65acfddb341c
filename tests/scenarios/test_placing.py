"""Hazards whose place is taken at first."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lavsim.scenarios import director
from lavsim.scenarios.base import Scenario
from lavsim.simulation import Simulation
from lavsim.types import Control
from tests.scenarios.stands import Follower, drive, stand


def beside_another() -> tuple[Simulation, Scenario, Scenario]:
    """A drive with two hazards, of which the second finds the place of its second bicycle taken; both."""
    place = stand("HazardAtSideLane", "2.x", "us_large_a")
    farther = replace(place.spec, parameters={"distance": 109.0})  # the first of its bicycles where the second will be
    simulation = Simulation(drive(place, "us_large_a", scenarios=(farther, place.spec)))
    first, second = (hazard.scenario for hazard in simulation._director._hazards)
    assert (len(first.actors), len(second.actors)) == (2, 0)
    return simulation, first, second


def test_an_attempt_to_place_a_hazard_that_failed_leaves_nothing_behind() -> None:
    simulation, first, second = beside_another()
    first.clear()
    for _ in range(25):
        snapshot = simulation.tick(Control(brake=1.0))
    assert len(second.actors) == 2
    assert {actor.id for actor in second.actors} <= set(snapshot.ids.tolist())
    driver = Follower()
    for _ in range(600):
        simulation.tick(driver(simulation))
    assert simulation._director.fates[1] == "set off"


def test_a_hazard_is_left_out_before_its_attempts_use_up_its_ids(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(director, "_MOST_WITHDRAWN", 3)
    simulation, _, second = beside_another()
    fates = []
    for _ in range(100):
        simulation.tick(Control(brake=1.0))
        fates.append(simulation._director.fates[1])
    assert fates[20] == "not reached", "two attempts are not enough"
    assert fates[-1].startswith("no room: ")
    assert second.withdrawn == 3
