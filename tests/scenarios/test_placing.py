"""Hazards whose place is taken at first."""

from __future__ import annotations

from dataclasses import replace

from lavsim.simulation import Simulation
from lavsim.types import Control
from tests.scenarios.stands import Follower, drive, stand


def test_an_attempt_to_place_a_hazard_that_failed_leaves_nothing_behind() -> None:
    place = stand("HazardAtSideLane", "2.x", "us_large_a")
    farther = replace(place.spec, parameters={"distance": 109.0})  # the first of its bicycles where the second will be
    simulation = Simulation(drive(place, "us_large_a", scenarios=(farther, place.spec)))
    first, second = (hazard.scenario for hazard in simulation._director._hazards)
    assert (len(first.actors), len(second.actors)) == (2, 0)
    first.clear()
    for _ in range(25):
        snapshot = simulation.tick(Control(brake=1.0))
    assert len(second.actors) == 2
    assert {actor.id for actor in second.actors} <= set(snapshot.ids.tolist())
    driver = Follower()
    for _ in range(600):
        simulation.tick(driver(simulation))
    assert simulation._director.fates[1] == "set off"
