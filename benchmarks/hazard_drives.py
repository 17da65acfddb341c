"""Single drives of routes with one hazard, and a file that keeps how they went.

Once kernels are compiled a drive of half a minute without traffic costs half a second; a fresh checkout compiles for
minutes first, so a long table is driven from one that is kept.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.encounters import Encounters
from lavsim.agent import AgentSpec, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.episode import EpisodeResult, run_episode
from lavsim.executor import make_executor
from lavsim.map.route import Route
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import DT, ActorIds
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import Infraction
from leaderboard.hazard_file import THROUGH_TRAFFIC, TRAFFIC
from leaderboard.observer import CriteriaObserver, Verdict
from leaderboard.route_writer import write_routes
from leaderboard.routes import RouteEntry
from leaderboard.rules import get_rules

BLIND, EXPERT = "agents.baselines.blind", "agents.behavior"
RULES = {"1.0": "1.0", "2.x": "2.1"}
MOST_TICKS = 3600  # 180 s
LOOK_EVERY = 5  # ticks between looks at whether a drive has told enough
IGNORED = frozenset({"min_speed_infractions"})
# 1.0 lets nobody off for passing a blocked lane on the other one, which is all that Scenario6 leaves.
IGNORED_FOR = {"Scenario6": frozenset({"outside_route_lanes"})}
SOON = 3.0  # [s]
_HALF_SECOND = 10  # ticks
YIELD = "yield_emergency_vehicle_infractions"
_OTHER = re.compile(r" and id=(-?\d+) ")
FIRST = int(ActorIds.SCENARIOS)


@dataclass(frozen=True)
class Task:
    """One drive.

    Attributes:
        entry: A route with one hazard.
        seed: Of the drive.
        agent: Module of who drives.
        with_hazard: Whether the hazard is there.
        rules: What it is judged by; empty: what the hazard's generation is judged by.
        brief: Whether it may end once the hazard has hurt, or with the first infraction where there is none.
    """

    entry: RouteEntry
    seed: int
    agent: str
    with_hazard: bool = True
    rules: str = ""
    brief: bool = True

    @property
    def judged_by(self) -> str:
        return self.rules or RULES[self.entry.scenarios[0].generation]

    @property
    def key(self) -> str:
        """Names the drive by all that decides it but the code: the route's text, not its number."""
        text = write_routes([replace(self.entry, id="0")], TRAFFIC) + (self.entry.traffic or TRAFFIC).encode()
        digest = hashlib.blake2b(text, digest_size=6).hexdigest()
        hazard = "with" if self.with_hazard else "without"
        # Without hazard and traffic nothing is drawn: one drive stands for those under all seeds.
        is_drawn = self.with_hazard or (self.entry.traffic or TRAFFIC) != "empty"
        return f"{digest}/{self.seed if is_drawn else 0}/{self.agent}/{hazard}/{self.judged_by}"


@dataclass(frozen=True)
class Drive:
    """How one drive went.

    Attributes:
        reached: Whether it came to the end of the route.
        infractions: (key, tick, id of who was touched or -1) of each but min speed.
        begun: Tick at which the hazard was set off; -1: never.
        ticks: How long it was.
        through_traffic: Whether its hazard acts through background traffic.
        encounters: Background vehicles that crossed the ego's way less than `SOON` before or after it; counted where
            the hazard acts through them.
        braking: Hardest braking of the ego, the mean of half a second [m/s²].
        aside: Where the ego was to the right of the route at each metre of it [mm], as far as it came.
    """

    reached: bool
    infractions: tuple[tuple[str, int, int], ...]
    begun: int
    ticks: int
    through_traffic: bool
    encounters: int
    braking: float
    aside: tuple[int, ...]

    @property
    def is_clean(self) -> bool:
        return self.reached and not self.infractions

    @property
    def causes(self) -> list[str]:
        """What the hazard cost: its own infractions, else that the end was not reached."""
        if self.begun < 0:
            return []
        found = [key for key, tick, other in self.infractions if tick >= self.begun and self._is_own(key, other)]
        return found or ([] if self.reached else ["not reached"])

    @property
    def is_hurt(self) -> bool:
        return bool(self.causes)

    def _is_own(self, key: str, other: int) -> bool:
        """Whether an infraction is the hazard's: one of its actors is touched, or traffic through which it acts."""
        return other >= FIRST or key == YIELD or (self.through_traffic and key == "collisions_vehicle")

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @staticmethod
    def from_json(entry: dict[str, Any]) -> Drive:
        infractions = tuple((str(key), int(tick), int(other)) for key, tick, other in entry.pop("infractions"))
        return Drive(infractions=infractions, aside=tuple(entry.pop("aside")), **entry)


class Watch:
    """Notes when the hazard is set off and where the ego goes, and ends a brief drive that has told enough.

    Args:
        criteria: Judges the drive; asked before.
        task: What is driven.
    """

    def __init__(self, criteria: CriteriaObserver, task: Task) -> None:
        self.begun, self.xy = -1, list[NDArray[np.float64]]()
        self._criteria, self._task, self._speeds = criteria, task, list[float]()
        self._acts_through_traffic = task.entry.scenarios[0].type in THROUGH_TRAFFIC
        self._encounters = Encounters()

    def start(self, simulation: Simulation) -> None:
        """Nothing to prepare."""

    def observe(self, snapshot: Snapshot) -> str | None:
        self.xy.append(snapshot.ego.xy)
        self._speeds.append(snapshot.ego.speed)
        if self._acts_through_traffic:
            self._encounters.observe(snapshot)
        if self.begun < 0 and len(snapshot.hazards):
            self.begun = snapshot.tick
        if not self._task.brief or len(self.xy) % LOOK_EVERY:
            return None
        so_far = self._drive(replace(self._criteria.verdict(), reached=True))
        return "told enough" if so_far.is_hurt or (not self._task.with_hazard and so_far.infractions) else None

    def finish(self, result: EpisodeResult) -> None:
        """Nothing to close."""

    def drive(self, route: Route) -> Drive:
        """How it went on `route`."""
        lost = -np.diff(self._speeds, prepend=self._speeds[:1]) / DT
        times = self._encounters.times().values() if self._acts_through_traffic else ()
        return replace(
            self._drive(self._criteria.verdict()),
            encounters=sum(time < SOON for time in times),
            braking=round(float(np.convolve(lost, np.full(_HALF_SECOND, 1.0 / _HALF_SECOND)).max()), 2),
            aside=offsets(np.array(self.xy), route),
        )

    def _drive(self, verdict: Verdict) -> Drive:
        found = tuple((i.key, i.tick, _other(i)) for i in verdict.infractions if i.key not in self._ignored)
        return Drive(verdict.reached, found, self.begun, len(self.xy), self._acts_through_traffic, 0, 0.0, ())

    @property
    def _ignored(self) -> frozenset[str]:
        return IGNORED | IGNORED_FOR.get(self._task.entry.scenarios[0].type, frozenset())


def _other(infraction: Infraction) -> int:
    """Id of the actor that a collision's message names; -1 for other infractions."""
    found = _OTHER.search(infraction.message)
    return -1 if found is None else int(found[1])


def offsets(xy: NDArray[np.float64], route: Route) -> tuple[int, ...]:
    """Where a drive's places (T, 2) were to the right of the route at each whole metre of it [mm]."""
    gaps = np.hypot(*(xy[:, None] - route.xy[None]).transpose(2, 0, 1))
    nearest = np.maximum.accumulate(np.argmin(gaps, axis=1))
    delta, yaw = xy - route.xy[nearest], route.yaw[nearest]
    along = route.distance[nearest] + delta[:, 0] * np.cos(yaw) + delta[:, 1] * np.sin(yaw)
    aside = delta[:, 1] * np.cos(yaw) - delta[:, 0] * np.sin(yaw)
    order = np.maximum.accumulate(along)
    metres = np.arange(0.0, order[-1] if len(order) else 0.0)
    return tuple(np.rint(1e3 * np.interp(metres, order, aside)).astype(int).tolist())


def drive(task: Task, report: object = None) -> Drive:
    """Drives `task`; nothing is reported on the way."""
    entry, judged = task.entry, get_rules(task.judged_by)
    spec = DriveSpec(
        town=entry.town,
        route_id=entry.id,
        keypoints=entry.keypoints,
        weather=entry.weather,
        scenarios=entry.scenarios if task.with_hazard else (),
        seed=task.seed,
        traffic=entry.traffic or TRAFFIC,
        rules=judged.version,
        generation=entry.scenarios[0].generation,
    )
    simulation = Simulation(spec)
    handle = InProcessAgent(AgentSpec(task.agent))
    criteria = CriteriaObserver(judged)
    watch = Watch(criteria, task)
    try:
        handle.start(plan_of(simulation.route, simulation.town), judged.plan_spacing)
        suite = SensorSuite(get_scene(simulation.town), handle.sensors(), simulation.draws)
        run_episode(simulation, handle, [criteria, watch], suite, MOST_TICKS)
    finally:
        handle.close()
    return watch.drive(simulation.route)


class Results:
    """Drives that are known, in a file of JSON lines that grows as they end.

    Args:
        path: The file; None keeps them in memory.
        code: Names the code that drives (a commit): drives of another are not taken from the file.
    """

    def __init__(self, path: Path | None = None, code: str = "") -> None:
        self._path, self._code, self._known = path, code, dict[str, Drive]()
        lines = path.read_text(encoding="utf-8").splitlines() if path is not None and path.exists() else []
        for line in lines:
            entry = json.loads(line)
            if entry["code"] == code:
                self._known[entry["key"]] = Drive.from_json(entry["drive"])

    def __getitem__(self, task: Task) -> Drive:
        return self._known[task.key]

    def __contains__(self, task: Task) -> bool:
        return task.key in self._known

    def add(self, task: Task, drive: Drive) -> None:
        self._known[task.key] = drive
        if self._path is None:
            return
        hazard = task.entry.scenarios[0]
        told = {"type": hazard.type, "generation": hazard.generation, "town": task.entry.town, "route": task.entry.id}
        line = {"key": task.key, "code": self._code, **told, "drive": drive.to_json()}
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")

    def run(self, tasks: Iterable[Task], workers: int = 1) -> Iterator[Task]:
        """Drives what is not known and gives each as it ends."""
        left = list({task.key: task for task in tasks if task not in self}.values())
        for done in make_executor(workers).run(drive, left):
            if done.result is None:
                print(f"lost: {done.task.key}: {done.lost}")
                continue
            self.add(done.task, done.result)
            yield done.task
