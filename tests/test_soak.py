"""Many drives in one process: memory stays, nobody is lost, every number is one."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest

from benchmarks.repeats import Recording
from lavsim.random import Draws
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import ActorIds, Control
from lavsim.world.snapshot import Snapshot
from tests.drives import hazard, straight_drive

EXTREMES = (0.0, 1.0, -1.0, 0.3, 1e9, -1e9, float("inf"), float("-inf"), float("nan"))


def busy_drive(seed: int) -> DriveSpec:
    """Traffic, walkers and a hazard in a small town."""
    crossing = hazard("DynamicObjectCrossing", 30, distance="12")
    return straight_drive(traffic="lav", vehicles=40, walkers=20, seed=seed, scenarios=(crossing,))


def any_control(draws: Draws, tick: int) -> Control:
    """What a broken agent might send: extremes, and numbers that are none."""
    throttle, steer, brake = (EXTREMES[draws.integer(tick // 20, len(EXTREMES), k)] for k in range(3))
    return Control(throttle, steer, brake, reverse=draws.integer(tick // 20, 2, 3) == 1)


def soak(spec: DriveSpec, ticks: int) -> Simulation:
    """Drives with random controls and looks at every tick."""
    simulation = Simulation(spec)
    draws, ids = Draws.of_seed(spec.seed), set(simulation.snapshot.ids.tolist())
    x0, y0, x1, y1 = simulation.town.bounds
    for tick in range(ticks):
        snapshot = simulation.tick(any_control(draws, tick))
        assert_whole(snapshot)
        x, y = snapshot.xy[snapshot.ids != ActorIds.EGO].T  # the ego may leave town
        assert x0 - 50.0 < x.min()
        assert x.max() < x1 + 50.0
        assert y0 - 50.0 < y.min()
        assert y.max() < y1 + 50.0
    background = {actor for actor in ids if actor < ActorIds.SCENARIOS}
    assert background <= set(simulation.snapshot.ids.tolist())
    return simulation


def assert_whole(snapshot: Snapshot) -> None:
    """What overflows or is no number becomes the smallest integer when it is quantised."""
    smallest = np.iinfo(np.int32).min
    for values in (snapshot.pose, snapshot.velocity, snapshot.state):
        assert not np.any(values == smallest)
    assert np.abs(snapshot.velocity).max() < 10_000  # 100 m/s
    assert np.isfinite(snapshot.ego_motion).all()
    assert np.isfinite(snapshot.control).all()
    assert np.isfinite(snapshot.contacts["impulse"]).all()


def resident() -> int:
    """Bytes of memory that this process holds."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096


def test_a_drive_with_broken_controls_stays_whole() -> None:
    soak(busy_drive(0), 300)


@pytest.mark.parametrize("town", ["eu_small_a", "eu_small_b"])  # flat, and with levels
def test_a_finished_drive_leaves_nothing_behind(town: str) -> None:
    """Its world, bodies and snapshots are freed at once; nothing else holds them."""
    simulation = Simulation(Recording(Path(), town, ticks=1200, vehicles=20, walkers=10, has_hazard=True).spec())
    for tick in range(5):
        simulation.tick(any_control(Draws.of_seed(0), tick))
    parts = [simulation._world, simulation._traffic, simulation._walkers, simulation._director, simulation.snapshot]
    left = [weakref.ref(part) for part in (simulation, *parts, simulation._world._physics)]
    gc.disable()  # nothing may wait for it: drives that did would pile up
    try:
        del simulation, parts
        assert [part() for part in left] == [None] * len(left)
    finally:
        gc.enable()


def test_resets_keep_memory_flat() -> None:
    for seed in range(5):
        soak(busy_drive(seed), 5)
    before = resident()
    for seed in range(15):
        soak(busy_drive(seed), 5)
    assert resident() < 1.05 * before


def growth_of_drives(warm: int, total: int) -> float:
    """Resident memory after `total` drives of 100 ticks over that after `warm` of them."""
    for seed in range(warm):
        soak(busy_drive(seed), 100)
    before = resident()
    for seed in range(warm, total):
        soak(busy_drive(seed), 100)
    return resident() / before


def growth_of_one_drive(ticks: int) -> float:
    """Resident memory after a drive over that before it, less the controls it keeps to be forked (200 bytes each)."""
    soak(busy_drive(0), 2_000)
    before = resident()
    soak(busy_drive(0), ticks)
    return (resident() - 200 * ticks) / before


def alone(call: str) -> float:
    """What `call` gives in a process of its own: pytest keeps every warning that is logged, for its report."""
    code = f"from tests.test_soak import growth_of_drives, growth_of_one_drive\nprint({call})"
    root = Path(__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


@pytest.mark.slow
def test_a_thousand_drives_keep_memory_flat() -> None:
    """1,000 resets and 100,000 ticks in one process; the first 200 fill the allocator's pools."""
    assert alone("growth_of_drives(200, 1000)") < 1.05


@pytest.mark.slow
def test_one_long_drive_keeps_memory_flat() -> None:
    assert alone("growth_of_one_drive(100_000)") < 1.05
