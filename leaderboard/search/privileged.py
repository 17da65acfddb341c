"""One drive of the blind route follower with a plan on top, judged as it goes: a candidate of the privileged search."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lavsim.agent import AgentShell, AgentSpec, Readings, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.episode import EpisodeResult, run_episode
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import ActorIds, Control
from lavsim.world.snapshot import Snapshot
from leaderboard.observer import CriteriaObserver
from leaderboard.rules import Rules
from leaderboard.search.ground import Ground
from leaderboard.search.manoeuvres import Pedals, Plan, shifted_plan
from leaderboard.search.trial import IGNORED, NOT_REACHED

BLIND = "agents.baselines.blind"
MOST_TICKS = 4800  # 240 s
_EVERY = 4  # ticks between looks at the verdict
_STILL = 0.5  # [m/s]
_PATIENCE = 1400  # ticks of standing, 70 s, after which a plan leads nowhere
_ENDED = "judged"


@dataclass(frozen=True)
class PlanDrive:
    """How a drive with a plan went, up to its first infraction.

    Attributes:
        plan: What was tried.
        infraction: Key of the first infraction, or "not reached"; None: it passed.
        place: Where on the route that was [m]; its length for one that passed.
        stands: Whether what was met there stood still.
        begun: Tick at which the hazard was set off; -1: never.
        begun_at: Where on the route that was [m]; inf: nowhere.
        tick: When it ended.
    """

    plan: Plan
    infraction: str | None
    place: float
    stands: bool
    begun: int
    begun_at: float
    tick: int

    @property
    def passed(self) -> bool:
        return self.infraction is None


class _Planned(AgentShell):
    """A route follower whose pedals a plan changes."""

    def __init__(self, agent: InProcessAgent, pedals: Pedals, simulation: Simulation) -> None:
        super().__init__(agent)
        self._pedals, self._simulation = pedals, simulation

    def step(self, readings: Readings, time: float) -> Control:
        return self._pedals.apply(self._agent.step(readings, time), self._simulation.snapshot)


class _Referee:
    """Ends a drive at its first infraction that counts, and notes what was met there."""

    def __init__(self, criteria: CriteriaObserver, pedals: Pedals, from_hazard: bool) -> None:
        self._criteria, self._pedals, self._from_hazard, self._ticks = criteria, pedals, from_hazard, 0
        self.begun, self.begun_at, self.tick = -1, math.inf, 0
        self._stood = 0
        self.touched_speed = math.inf  # of who was touched first, before it was [m/s]
        self._before: Snapshot | None = None

    def start(self, simulation: Simulation) -> None:
        """Nothing to prepare."""

    def finish(self, result: EpisodeResult) -> None:
        """Nothing to close."""

    def observe(self, snapshot: Snapshot) -> str | None:
        self._ticks, self.tick = self._ticks + 1, snapshot.tick
        if self.begun < 0 and len(snapshot.hazards):
            self.begun, self.begun_at = snapshot.tick, self._pedals.metres
        self._note_contact(snapshot)
        self._before = snapshot
        self._stood = self._stood + 1 if snapshot.ego.speed < _STILL else 0
        if self._stood >= _PATIENCE:
            return _ENDED
        return _ENDED if self._ticks % _EVERY == 0 and self.found() is not None else None

    def found(self) -> str | None:
        """Key of the first infraction that counts."""
        since = 0 if not self._from_hazard else self.begun if self.begun >= 0 else math.inf
        first = [i for i in self._criteria.verdict().infractions if i.key not in IGNORED and i.tick >= since]
        return min(first, key=lambda i: i.tick).key if first else None

    def _note_contact(self, snapshot: Snapshot) -> None:
        before = self._before or snapshot
        for a, b in zip(snapshot.contacts["a"].tolist(), snapshot.contacts["b"].tolist(), strict=True):
            if ActorIds.EGO in (a, b) and math.isinf(self.touched_speed):
                other = before.index_of(b if a == ActorIds.EGO else a)
                self.touched_speed = 0.0 if other is None else float(before.speeds[other])


def drive_plan(
    ground: Ground, seed: int, rules: Rules, plan: Plan = (), agent: str = BLIND, with_hazard: bool = True,
    from_hazard: bool = False, town_path: tuple[Path, ...] = (),
) -> PlanDrive:  # fmt: skip
    """Drives a plan until it has failed or passed.

    Args:
        ground: The route and its hazard.
        seed: Of the drive.
        rules: What it is judged by.
        plan: On top of what the agent does.
        agent: Who follows the route; `BLIND` sees nobody.
        with_hazard: Whether the hazard is there.
        from_hazard: Whether only infractions from its trigger on count.
        town_path: Folders with towns.
    """
    entry = ground.entry
    spec = DriveSpec(
        town=entry.town,
        route_id=entry.id,
        keypoints=entry.keypoints,
        weather=entry.weather,
        scenarios=entry.scenarios if with_hazard else (),
        seed=seed,
        traffic=entry.traffic or "leaderboard",
        rules=rules.version,
        generation=rules.generation,
        town_path=town_path,
    )
    simulation = Simulation(spec)
    handle = InProcessAgent(AgentSpec(agent, generation=rules.generation))
    pedals = Pedals(simulation.route, plan)
    driver = _Planned(handle, pedals, simulation)
    criteria = CriteriaObserver(rules)
    referee = _Referee(criteria, pedals, from_hazard)
    try:
        route_plan = shifted_plan(plan_of(simulation.route, simulation.town), simulation.route, simulation.town, plan)
        driver.start(route_plan, rules.plan_spacing)
        suite = SensorSuite(get_scene(simulation.town), driver.sensors(), simulation.draws)
        run_episode(simulation, driver, [criteria, referee], suite, MOST_TICKS)
    finally:
        driver.close()
    infraction = referee.found() or (None if criteria.verdict().reached else NOT_REACHED)
    return PlanDrive(
        plan=plan,
        infraction=infraction,
        place=simulation.route.length if infraction is None else pedals.metres,
        stands=infraction == NOT_REACHED or referee.touched_speed < _STILL or bool(np.isinf(referee.touched_speed)),
        begun=referee.begun,
        begun_at=referee.begun_at,
        tick=referee.tick,
    )
