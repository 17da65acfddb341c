"""One seed, one drive: in every process, on any number of workers, with and without sensors or a hazard elsewhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.repeats import (
    OTHER_FAMILY,
    Recording,
    apart,
    digest,
    elsewhere,
    first_difference,
    record,
    ticks_digest,
)
from lavsim.executor import make_executor
from lavsim.log.reader import LogReader
from lavsim.simulation import Simulation
from lavsim.types import ActorIds

LOOK_AHEAD = 80.0  # [m] no driver or walker reacts to what is farther away (`lavsim.traffic`)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A short drive with traffic, walkers and contacts, recorded."""
    recording = Recording(tmp_path_factory.mktemp("repeats") / "base.lavlog", "eu_small_a", 400, 3, 30, 20)
    record(recording)
    return recording


def test_a_second_drive_gives_the_same_bytes_and_another_seed_others(base: Recording) -> None:
    again, other = (replace(base, path=base.path.with_name(f"{k}.lavlog")) for k in range(2))
    assert record(again) == digest(base.path)
    assert record(replace(other, seed=4)) != digest(base.path)


def test_another_process_gives_the_same_bytes(base: Recording) -> None:
    assert elsewhere(replace(base, path=base.path.with_name("elsewhere.lavlog"))) == digest(base.path)


def test_workers_give_the_same_bytes(base: Recording) -> None:
    tasks = [replace(base, path=base.path.with_name(f"worker{k}.lavlog"), seed=3 + k, ticks=100) for k in range(2)]
    alone = [record(task) for task in tasks]
    done = {entry.task: entry.result for entry in make_executor(2).run(record, tasks)}
    assert [done[task] for task in tasks] == alone


def test_sensors_leave_the_drive_as_it_was(base: Recording) -> None:
    short = replace(base, path=base.path.with_name("bare.lavlog"), ticks=40)
    seen = replace(short, path=base.path.with_name("seen.lavlog"), has_sensors=True)
    record(short), record(seen)
    assert ticks_digest(seen.path) == ticks_digest(short.path)
    headers = [LogReader(recording.path).header for recording in (short, seen)]
    assert headers[1].pop("suite") == "lav"
    assert headers[0] == headers[1]


def test_a_hazard_changes_nobody_until_somebody_near_sees_it(base: Recording) -> None:
    other = replace(base, path=base.path.with_name("hazard.lavlog"), has_hazard=True)
    record(other)
    assert_nobody_far_noticed(LogReader(base.path), LogReader(other.path))


def test_a_hazard_leaves_spawns_drivers_and_routes(base: Recording) -> None:
    plain, more = (Simulation(replace(base, has_hazard=has_hazard).spec()) for has_hazard in (False, True))
    count = len(plain.snapshot.table.ids)
    assert len(more.snapshot.table.ids) > count
    for name in ("ids", "classes", "roles", "sizes", "colours", "blueprints"):
        assert np.array_equal(getattr(plain.snapshot.table, name), getattr(more.snapshot.table, name)[:count]), name
    for first, second in zip(drawn(plain), drawn(more), strict=True):
        assert first.tobytes() == second.tobytes()


def drawn(simulation: Simulation) -> list[np.ndarray]:
    """What was drawn for drivers and walkers, those with a plan first."""
    fleet = simulation._traffic._fleet
    return [fleet.key, fleet.driver, fleet.path, fleet.lane, fleet.hops, simulation._walkers._walkers]


def assert_nobody_far_noticed(plain: LogReader, more: LogReader) -> None:
    """Up to the first difference all is equal; who differs then had an actor of the hazard within its look-ahead."""
    first = first_difference(plain, more, int(ActorIds.SCENARIOS))
    assert first is not None, "nobody notices the hazard: the test shows nothing"
    before, without = more.at_tick(first.tick - 1), plain.at_tick(first.tick)
    rows = np.flatnonzero(first.ids < ActorIds.SCENARIOS)
    assert np.array_equal(first.ids[rows], without.ids)
    changed = np.any(first.pose[rows] != without.pose, axis=1) | np.any(
        first.velocity[rows] != without.velocity, axis=1
    )
    changed |= np.any(first.state[rows] != without.state, axis=1)
    assert changed.any()
    hazard = before.xy[before.ids >= ActorIds.SCENARIOS]
    for actor in first.ids[rows[changed]]:
        place = before.xy[before.index_of(int(actor))]
        assert np.min(np.hypot(*(hazard - place).T)) < LOOK_AHEAD


@pytest.mark.slow
def test_ten_minutes_repeat(tmp_path: Path) -> None:
    """Two processes, 1 and 4 workers, sensors, a hazard, in us_large_a with 151 actors; the log stays below 2 MB."""
    base = Recording(tmp_path / "base.lavlog")
    own = record(base)
    assert base.path.stat().st_size < 2_000_000
    assert elsewhere(replace(base, path=tmp_path / "elsewhere.lavlog")) == own
    tasks = [replace(base, path=tmp_path / f"worker{k}.lavlog", seed=k) for k in range(4)]
    done = {entry.task: entry.result for entry in make_executor(4).run(record, tasks)}
    assert done[tasks[0]] == own
    assert done[tasks[3]] == record(replace(tasks[3], path=tmp_path / "alone.lavlog"))
    record(replace(base, path=tmp_path / "sensors.lavlog", has_sensors=True))
    assert ticks_digest(tmp_path / "sensors.lavlog") == ticks_digest(base.path)
    record(replace(base, path=tmp_path / "hazard.lavlog", has_hazard=True))
    assert_nobody_far_noticed(LogReader(base.path), LogReader(tmp_path / "hazard.lavlog"))


@pytest.mark.slow
def test_another_family_of_cpus_drives_the_same_for_a_minute(tmp_path: Path) -> None:
    base = Recording(tmp_path / "base.lavlog", ticks=1200)
    other = replace(base, path=tmp_path / "other.lavlog")
    record(base)
    elsewhere(other, {**OTHER_FAMILY, "LAVSIM_CACHE": str(tmp_path / "cache")})
    assert np.max(apart(LogReader(base.path), LogReader(other.path), 1200)) < 0.01
