"""Whether drives repeat: the same bytes in two processes, on any number of workers, with and without sensors.

`python benchmarks/repeats.py --minutes 10` prints one line a check. `families` compares with a run that imitates a CPU
without AVX2 and FMA: glibc, numpy, OpenBLAS and numba then take other paths (docs/determinism.md).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.executor import make_executor
from lavsim.log.reader import LogReader
from lavsim.log.writer import LogWriter
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.render.scene import get_scene
from lavsim.scenarios.base import ScenarioSpec
from lavsim.sensors.base import SensorSuite
from lavsim.sensors.suites import SUITES
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import ActorIds, Control, LaneType
from lavsim.world.snapshot import Snapshot

TICKS_PER_MINUTE = 1200
OTHER_FAMILY = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
    "NUMBA_CPU_NAME": "generic",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3,X86_V4,AVX512_ICL,AVX512_SPR",
    "OPENBLAS_CORETYPE": "Nehalem",
}
_STUCK_TICKS = 60  # at rest for so long, the blind driver backs off
_BACK_OFF_TICKS = 50


@dataclass(frozen=True)
class Recording:
    """A drive to record.

    Attributes:
        path: Its log.
        town: Name of the town.
        ticks: How long.
        seed: Of all draws.
        vehicles: In the background.
        walkers: Likewise.
        has_sensors: Whether the suite `lav` is read every tick.
        has_hazard: Whether a walker steps out behind a blocker beside a lane with traffic, far from the ego.
    """

    path: Path
    town: str = "us_large_a"
    ticks: int = 10 * TICKS_PER_MINUTE
    seed: int = 0
    vehicles: int = 100
    walkers: int = 50
    has_sensors: bool = False
    has_hazard: bool = False

    def spec(self) -> DriveSpec:
        """What is driven."""
        town = load_town(self.town)
        keypoints = long_way(town, self.ticks * 0.05 * 8.0)
        return DriveSpec(
            town=self.town, route_id="repeats", keypoints=keypoints, scenarios=self._scenarios(town, keypoints),
            seed=self.seed, traffic="lav", vehicles=self.vehicles, walkers=self.walkers, generation="2.x",
        )  # fmt: skip

    def _scenarios(self, town: TownMap, keypoints: np.ndarray) -> tuple[ScenarioSpec, ...]:
        if not self.has_hazard:
            return ()
        route = get_planner(town).trace(keypoints)
        at = int(np.searchsorted(route.distance, 60.0))
        x, y, z = (float(v) for v in route.points[at])
        trigger = (x, y, z, float(route.yaw[at]))
        return (ScenarioSpec("hazard", "DynamicObjectCrossing", "2.x", trigger, {"distance": "15"}),)


class BlindDriver:
    """Follows the route whatever stands there, backs off when stuck: contacts of all kinds, no sensors."""

    def __init__(self, simulation: Simulation) -> None:
        self._route = simulation.route
        self._still = 0

    def control(self, snapshot: Snapshot) -> Control:
        """What it does after `snapshot`."""
        ego = snapshot.ego
        self._still = self._still + 1 if ego.speed < 0.1 or self._still > _STUCK_TICKS else 0
        if self._still > _STUCK_TICKS + _BACK_OFF_TICKS:
            self._still = 0
        if self._still > _STUCK_TICKS:
            return Control(throttle=0.5, steer=0.4, reverse=True)
        nearest = int(np.argmin(np.sum((self._route.xy - ego.xy) ** 2, axis=1)))
        aim = self._route.xy[min(nearest + 5, len(self._route) - 1)] - ego.xy
        angle = (np.arctan2(aim[1], aim[0]) - ego.yaw + np.pi) % (2.0 * np.pi) - np.pi
        return Control(throttle=0.75 if ego.speed < 8.0 else 0.0, steer=float(np.clip(1.5 * angle, -1.0, 1.0)))


class _Ended:
    """How these drives end."""

    def summary(self) -> dict[str, Any]:
        return {"ending": "tick limit"}


def long_way(town: TownMap, length: float) -> np.ndarray:
    """Key points (K, 3) of a way of about `length` [m] that takes lanes it has not had while there are any."""
    lanes = town.lanes
    outside = (lanes.type == LaneType.DRIVING) & (lanes.junction < 0)
    lane = int(np.argmax(np.where(outside, lanes.length, 0.0)))
    way, done, taken = [lane], float(lanes.length[lane]), np.zeros(len(lanes), dtype=int)
    while done < length:
        options = lanes.succ[lanes.succ_first[lane] : lanes.succ_first[lane + 1]]
        if not len(options):
            break
        taken[lane] += 1
        lane = int(options[np.argmin(taken[options])])
        way.append(lane)
        done += float(lanes.length[lane])
    kept = np.array([lane for lane in way if outside[lane] and lanes.length[lane] > 8.0])
    at = np.append(0.3 * lanes.length[kept], 0.7 * lanes.length[kept[-1]])
    return town.centre(np.append(kept, kept[-1]), at)[:, :3]


def record(recording: Recording, report: Callable[[Any], None] | None = None) -> str:
    """Drives and writes the log; returns its digest."""
    simulation = Simulation(recording.spec())
    driver = BlindDriver(simulation)
    suite = SensorSuite(get_scene(simulation.town), SUITES["lav"], simulation.draws) if recording.has_sensors else None
    writer = LogWriter(recording.path, {"suite": "lav"} if suite else None)
    writer.start(simulation)
    for _ in range(recording.ticks):
        snapshot = simulation.snapshot
        if suite is not None:
            suite.read(simulation.recent(suite.history + 1))
        writer.observe(snapshot)
        simulation.tick(driver.control(snapshot))
    writer.finish(_Ended())  # type: ignore[arg-type]
    return digest(recording.path)


def digest(path: Path) -> str:
    """Digest of a log as a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def ticks_digest(path: Path) -> str:
    """Digest of all ticks and actors of a log, its header left out."""
    data = path.read_bytes()
    return hashlib.sha256(data[data.index(b"ACTR") :]).hexdigest()


def elsewhere(recording: Recording, environment: Mapping[str, str] | None = None) -> str:
    """`record` in a fresh process."""
    code = (
        "import json, pathlib, sys; from benchmarks.repeats import Recording, record; fields = json.loads(sys.argv[1]);"
        "print(record(Recording(**{**fields, 'path': pathlib.Path(fields['path'])})))"
    )
    fields = json.dumps({**asdict(recording), "path": str(recording.path)})
    done = subprocess.run(
        [sys.executable, "-c", code, fields],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[1],
        env={**os.environ, **(environment or {})},
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    return done.stdout.strip()


def first_difference(first: LogReader, second: LogReader, ids_below: int = 2**31) -> Snapshot | None:
    """The first snapshot of `second` that differs from `first` in actors with ids below `ids_below`."""
    for a, b in zip(first, second, strict=True):
        mine, yours = a.ids < ids_below, b.ids < ids_below
        for name in ("pose", "velocity", "state"):
            if not np.array_equal(getattr(a, name)[mine], getattr(b, name)[yours]):
                return b
    return None


def apart(first: LogReader, second: LogReader, tick: int) -> np.ndarray:
    """(N,) how far each actor that both logs have at `tick` is from where the other has it [m]."""
    a, b = first.at_tick(tick), second.at_tick(tick)
    _, mine, yours = np.intersect1d(a.ids, b.ids, return_indices=True)
    return np.hypot(*(a.xy[mine] - b.xy[yours]).T)


def main() -> None:
    """Runs the checks that are named, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checks", nargs="*", metavar="CHECK", help=", ".join(_CHECKS))
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--town", default="us_large_a")
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--walkers", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        base = Recording(
            Path(folder) / "base.lavlog", arguments.town, int(arguments.minutes * TICKS_PER_MINUTE), arguments.seed,
            arguments.vehicles, arguments.walkers,
        )  # fmt: skip
        print(f"{base.town}, {base.ticks} ticks, {base.vehicles} vehicles, {base.walkers} walkers, seed {base.seed}")
        own = record(base)
        log = LogReader(base.path)
        contacts = sum(len(snapshot.contacts) for snapshot in log)
        print(f"log: {base.path.stat().st_size} bytes, {base.path.stat().st_size / base.ticks:.0f} a tick, "
              f"{len(log.table.ids)} actors, {contacts} contacts")  # fmt: skip
        for check in arguments.checks or _CHECKS:
            print(f"{check}: {_CHECKS[check](base, own, Path(folder))}", flush=True)


def _processes(base: Recording, own: str, folder: Path) -> str:
    other = elsewhere(replace(base, path=folder / "other.lavlog"))
    return "the same bytes" if other == own else "DIFFERENT"


def _workers(base: Recording, own: str, folder: Path) -> str:
    tasks = [
        replace(base, path=folder / f"{workers}_{k}.lavlog", seed=base.seed + k) for workers in (1, 4) for k in range(4)
    ]
    for workers in (1, 4):
        mine = tasks[:4] if workers == 1 else tasks[4:]
        list(make_executor(workers).run(record, mine))
    pairs = [(digest(a.path), digest(b.path)) for a, b in zip(tasks[:4], tasks[4:], strict=True)]
    same = all(a == b for a, b in pairs) and pairs[0][0] == own
    return "four seeds, the same bytes with 1 and 4 workers" if same else "DIFFERENT"


def _sensors(base: Recording, own: str, folder: Path) -> str:
    other = replace(base, path=folder / "sensors.lavlog", has_sensors=True)
    record(other)
    return (
        "the same ticks with the suite read every tick"
        if ticks_digest(other.path) == ticks_digest(base.path)
        else "DIFFERENT"
    )


def _hazard(base: Recording, own: str, folder: Path) -> str:
    other = replace(base, path=folder / "hazard.lavlog", has_hazard=True)
    record(other)
    first = first_difference(LogReader(base.path), LogReader(other.path), int(ActorIds.SCENARIOS))
    return "nobody noticed the hazard" if first is None else f"the same states up to tick {first.tick}"


def _families(base: Recording, own: str, folder: Path) -> str:
    other = replace(base, path=folder / "family.lavlog")
    elsewhere(other, {**OTHER_FAMILY, "LAVSIM_CACHE": str(folder / "cache")})
    logs = LogReader(base.path), LogReader(other.path)
    first = first_difference(*logs)
    if first is None:
        return "the same ticks" + (", the same bytes" if digest(other.path) == own else "")
    lines = [f"the same up to tick {first.tick}"]
    for minutes in (1, 2, 5, 10):
        if minutes * TICKS_PER_MINUTE <= base.ticks:
            gaps = apart(*logs, minutes * TICKS_PER_MINUTE)
            shares = f"{np.mean(gaps > 0.001):.0%} of actors > 1 mm apart, {np.mean(gaps > 1.0):.0%} > 1 m"
            lines.append(f"after {minutes} min {shares}")
    return "; ".join(lines)


_CHECKS = {
    "processes": _processes,
    "workers": _workers,
    "sensors": _sensors,
    "hazard": _hazard,
    "families": _families,
}

if __name__ == "__main__":
    main()
