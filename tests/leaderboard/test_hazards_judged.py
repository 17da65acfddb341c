"""Hazards as the director runs them, judged by what snapshots tell of them."""

from __future__ import annotations

from lavsim.scenarios.base import ScenarioSpec
from lavsim.simulation import Simulation
from lavsim.types import Control
from leaderboard.observer import CriteriaObserver
from leaderboard.rules import RULES
from tests.drives import follow, hazard, straight_drive


def judged(spec: ScenarioSpec, ticks: int, version: str = "2.0", stops: bool = True) -> list[str]:
    """Infractions of a drive that brakes for good once the hazard has begun, or never."""
    simulation = Simulation(straight_drive(generation="2.x", rules=version, scenarios=(spec,)))
    criteria = CriteriaObserver(RULES[version])
    criteria.start(simulation)
    began = False
    for _ in range(ticks):
        snapshot = simulation.snapshot
        began = began or len(snapshot.hazards) > 0
        control = Control(brake=1.0) if began and stops else follow(simulation.route, snapshot)
        if criteria.observe(simulation.tick(control)) is not None:
            break
    criteria.close(None)
    assert began
    return [infraction.key for infraction in criteria.verdict().infractions]


def test_a_hazard_that_is_not_passed_in_time_times_out_and_suspends_the_blocked_test() -> None:
    spec = hazard("ParkedObstacleTwoWays", 20, distance=60.0)
    assert judged(spec, 4900) == ["scenario_timeouts"]
    assert judged(spec, 4800, "bench2drive") == []


def test_who_stands_before_an_emergency_vehicle_has_not_yielded() -> None:
    spec = hazard("YieldToEmergencyVehicle", 170)
    assert judged(spec, 1600) == ["yield_emergency_vehicle_infractions"]
