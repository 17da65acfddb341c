"""What every hazard of the registry promises: it repeats, leaves nothing behind, and lets the town go on."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from lavsim.scenarios.base import SCENARIOS
from lavsim.simulation import DriveSpec, Simulation
from lavsim.world.snapshot import Snapshot
from leaderboard.hazard_maker import hazard_types
from leaderboard.routes import read_routes
from tests.scenarios.test_every_type import FIRST, Ghost, running

KEYS = hazard_types()
REPEATED = 40  # ticks from the trigger on
LONGEST = 2400  # ticks to the end of a hazard
PATIENCE = 1500  # ticks: longer than the lights of a junction take for a round
SETTLED = 200  # ticks after its end
NEAR, MOVES = 60.0, 0.1  # [m] of the trigger, [m/s]


@cache
def routes() -> dict[tuple[str, str], DriveSpec]:
    """The first route of each type in the bundled file, without traffic."""
    found: dict[tuple[str, str], DriveSpec] = {}
    for entry in read_routes("hazards"):
        hazard = entry.scenarios[0]
        generation = hazard.generation
        spec = DriveSpec(
            entry.town, entry.id, entry.keypoints, entry.weather, entry.scenarios, seed=3, traffic="empty",
            rules="corrected" if generation == "1.0" else "2.1", generation=generation,
        )  # fmt: skip
        found.setdefault((generation, hazard.type), spec)
    return found


def ticks(spec: DriveSpec) -> Iterator[tuple[Simulation, Snapshot]]:
    """A drive through a hazard by one whom nobody touches."""
    simulation = Simulation(spec)
    driver = Ghost(simulation)
    for _ in range(LONGEST):
        yield simulation, driver.tick()


def named(key: tuple[str, str]) -> str:
    return ":".join(key)


def test_the_file_has_a_route_of_every_key() -> None:
    assert set(routes()) == set(KEYS)
    assert {key for key in SCENARIOS if isinstance(key, tuple)} == set(KEYS)


@pytest.mark.parametrize("key", KEYS, ids=named)
def test_it_repeats_exactly_under_its_seed(key: tuple[str, str]) -> None:
    seen = 0
    for (_, first), (_, second) in zip(ticks(routes()[key]), ticks(routes()[key]), strict=True):
        assert first.pose.tobytes() == second.pose.tobytes()
        assert first.lights.tobytes() == second.lights.tobytes()
        assert first.state.tobytes() == second.state.tobytes()
        assert first.control.tobytes() == second.control.tobytes()
        assert first.hazards.tobytes() == second.hazards.tobytes()
        seen += len(first.hazards) > 0
        if seen == REPEATED:
            return
    pytest.fail(f"on for {seen} ticks")


@pytest.mark.parametrize("key", [key for key in KEYS if key[0] == "1.0"], ids=named)
def test_it_ends_and_leaves_nothing_behind(key: tuple[str, str]) -> None:
    """Those of 2.x are held to it in `test_every_type`."""
    begun = False
    for simulation, snapshot in ticks(routes()[key]):
        begun = begun or len(snapshot.hazards) > 0
        if begun and not running(simulation):
            break
    assert begun
    assert not running(simulation)
    assert not (snapshot.ids >= FIRST).any()
    assert not simulation._lights._held


@pytest.mark.slow
@pytest.mark.parametrize("key", KEYS, ids=named)
def test_traffic_goes_on_when_it_is_over(key: tuple[str, str]) -> None:
    """Whoever is near the trigger ten seconds later moves before its lights have gone through a round."""
    spec = routes()[key]
    simulation = Simulation(DriveSpec(**{**vars(spec), "traffic": "lav", "walkers": 0, "parked": 0.0}))
    driver, trigger = Ghost(simulation), np.array(spec.scenarios[0].trigger[:2])
    begun = False
    for _ in range(LONGEST):
        begun |= len(driver.tick().hazards) > 0
        if begun and not running(simulation):
            break
    assert begun
    assert not running(simulation)
    for _ in range(SETTLED):
        snapshot = driver.tick()
    near = snapshot.is_background & snapshot.is_vehicle & (np.hypot(*(snapshot.xy - trigger).T) < NEAR)
    waiting = set(snapshot.ids[near].tolist())
    for _ in range(PATIENCE):
        if not waiting:
            return
        snapshot = driver.tick()
        waiting &= set(snapshot.ids[snapshot.speeds <= MOVES].tolist())
    pytest.fail(f"{sorted(waiting)} stand")
