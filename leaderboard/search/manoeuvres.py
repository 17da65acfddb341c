"""What a privileged driver may do on top of following its route: wait, drive slowly, shift aside, brake for others.

A plan of such steps says where on the route what happens. Looking ahead is replaced by trying, as the world can be
driven again from its start, the same to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from lavsim.agent import AgentPlan
from lavsim.geometry import geolocation
from lavsim.map.route import Route, RouteTracker
from lavsim.map.town_map import TownMap
from lavsim.types import DT, Control
from lavsim.world.snapshot import EgoState, Snapshot
from leaderboard.search.criticality import HORIZON, Nearby, required_deceleration

Floats = NDArray[np.float64]

RAMP = 18.0  # [m] over which a shift comes and goes
BRAKING = 3.5  # [m/s²] that it begins to brake at
FULL = 7.5  # [m/s²] of a brake pressed all the way
RESTS = 0.1  # [m/s]
_WINDOW = 10  # route points ahead in which the ego's nearest is sought
_SAME = 15.0  # [m] between steps that are meant for the same
# [s] in an order that spreads them: a red light of 5 s may swallow the short ones
_FINE = (7.3, 2.0, 8.7, 4.0, 10.3, 6.0, 9.5, 3.0, 11.1, 1.0, 12.4, 5.0, 13.3, 14.2, 16.0, 17.1, 18.3)
_CREEP = 1.5  # [m/s] at least that a guard expects the ego to drive
_ROOM = np.array([3.0, 0.5], dtype=np.float32)  # [m] that a guard adds to the ego's length and width
_GAIN = 0.3  # brake for each m/s too fast
# [m] before the ego's middle where it was hurt, [s]
_WAITS = ((3.0, 6.0), (8.0, 6.0), (3.0, 15.0), (8.0, 15.0), (20.0, 8.0), (20.0, 20.0), (8.0, 30.0))


@dataclass(frozen=True)
class Wait:
    """Stands with its front at `at` metres of the route for `seconds`."""

    at: float
    seconds: float

    def __str__(self) -> str:
        return f"waits {self.seconds:g} s at {self.at:.0f} m"


@dataclass(frozen=True)
class Slow:
    """Drives at most `speed` [m/s] from `begin` to `end` metres of the route."""

    begin: float
    end: float
    speed: float

    def __str__(self) -> str:
        return f"slows to {self.speed:g} m/s from {max(self.begin, 0.0):.0f} to {self.end:.0f} m"


@dataclass(frozen=True)
class Shift:
    """Drives `offset` metres to the right of the route (negative: left) from `begin` to `end` metres of it."""

    begin: float
    end: float
    offset: float

    def __str__(self) -> str:
        side = "right" if self.offset > 0.0 else "left"
        return f"drives {abs(self.offset):.1f} m to the {side} from {max(self.begin, 0.0):.0f} to {self.end:.0f} m"


@dataclass(frozen=True)
class Guard:
    """Brakes whenever `deceleration` [m/s²] or more is needed not to touch anybody who goes straight on."""

    deceleration: float

    def __str__(self) -> str:
        return f"brakes when {self.deceleration:g} m/s² are needed"


Step = Wait | Slow | Shift | Guard
Plan = tuple[Step, ...]


def plan_text(plan: Plan) -> str:
    """What a plan does, for people."""
    return ", ".join(map(str, plan)) or "plain route"


def shifted_plan(plan: AgentPlan, route: Route, town: TownMap, steps: Sequence[Step]) -> AgentPlan:
    """The agent's plan with the shifts of `steps` in its points."""
    offset = np.zeros(len(route))
    for step in steps:
        if isinstance(step, Shift):
            way = route.distance
            ramp = np.minimum(
                np.clip((way - step.begin) / RAMP + 1.0, 0.0, 1.0), np.clip((step.end - way) / RAMP + 1.0, 0.0, 1.0)
            )
            offset = offset + step.offset * ramp * ramp * (3.0 - 2.0 * ramp)
    if not offset.any():
        return plan
    along = np.maximum(np.gradient(route.distance), 1e-3)
    yaw = route.yaw + np.arctan(np.clip(np.gradient(offset) / along, -0.6, 0.6))
    points = plan.points.copy()
    points[:, 0] -= offset * np.sin(route.yaw)
    points[:, 1] += offset * np.cos(route.yaw)
    lat, lon = geolocation(points[:, 0], points[:, 1], *town.geo_reference)
    return replace(plan, points=points, yaw=np.degrees(yaw), geo=np.stack([lat, lon, points[:, 2]], axis=1))


class Pedals:
    """Changes a follower's pedals so that it waits and slows down where its plan says.

    Args:
        route: What it follows.
        steps: Of the plan.

    Attributes:
        metres: How far along the route the ego is [m].
    """

    def __init__(self, route: Route, steps: Sequence[Step]) -> None:
        self._tracker = RouteTracker(route, _WINDOW)
        self._waits = [step for step in steps if isinstance(step, Wait)]
        self._slow = [step for step in steps if isinstance(step, Slow)]
        self._guards = [step for step in steps if isinstance(step, Guard)]
        self._nearby = Nearby()
        self._stood = 0.0  # [s] at the first of the waits left
        self.metres = 0.0

    def apply(self, control: Control, snapshot: Snapshot) -> Control:
        """The follower's `control` with the plan's braking."""
        ego = snapshot.ego
        self._tracker.update(ego.xy)
        self.metres = self._tracker.metres()
        brake = max(self._waiting(ego), self._slowing(ego), self._guarding(snapshot))
        return control if brake <= 0.0 else replace(control, throttle=0.0, brake=max(control.brake, min(brake, 1.0)))

    def _waiting(self, ego: EgoState) -> float:
        """Brake for the first wait that is not over [0 to 1]."""
        while self._waits:
            room = self._waits[0].at - self.metres - 0.5 * ego.length
            if self._stood == 0.0 and room < -2.0:
                self._waits.pop(0)  # behind it already: the follower was too fast, or the place lies before its start
                continue
            if ego.speed < RESTS and room < 3.0:
                self._stood += DT
                if self._stood > self._waits[0].seconds:
                    self._waits.pop(0)
                    self._stood = 0.0
                    continue
                return 1.0
            needed = ego.speed**2 / (2.0 * max(room, 0.1))
            return needed / FULL if needed > BRAKING else 0.0
        return 0.0

    def _guarding(self, snapshot: Snapshot) -> float:
        """Brake against whoever is ahead [0 to 1]."""
        if not self._guards:
            return 0.0
        near = self._nearby.of(snapshot).before()
        if len(near.xy) < 2:
            return 0.0
        velocity, sizes, yaw = near.velocity.copy(), near.sizes.copy(), float(near.yaw[0])
        speed = max(float(np.hypot(*velocity[0])), _CREEP)
        velocity[0] = speed * np.cos(yaw), speed * np.sin(yaw)
        sizes[0] += _ROOM
        needed = required_deceleration(near.xy, near.yaw, velocity, sizes, HORIZON)
        return 1.2 * needed / FULL if needed >= min(guard.deceleration for guard in self._guards) else 0.0

    def _slowing(self, ego: EgoState) -> float:
        """Brake for the stretches to be driven slowly [0 to 1]."""
        brake = 0.0
        for step in self._slow:
            room = step.begin - self.metres
            if self.metres > step.end or room > 80.0:
                continue
            allowed = math.sqrt(step.speed**2 + 2.0 * BRAKING * max(room, 0.0))
            brake = max(brake, _GAIN * (ego.speed - allowed))
        return brake


def children(
    plan: Plan, place: float, lane: float, stands: bool, begun: float = math.inf, waits_only: bool = False
) -> list[Plan]:
    """Plans that differ from `plan` by what may help at `place`, the likeliest first.

    Args:
        plan: What failed there.
        place: Metres of the route.
        lane: Width of a lane [m].
        stands: Whether what was met there stood still.
        begun: Metres of the route where the hazard was set off.
        waits_only: Whether no other way helps, as before a red light.
    """
    aside: list[Plan] = [(Shift(place - 12.0, place + 25.0, side),) for side in (-lane, lane, -0.4 * lane, 0.4 * lane)]
    for seconds in (5.0, 12.0, 25.0):
        aside.append((Wait(place - 12.0 - RAMP, seconds), Shift(place - 12.0, place + 25.0, -lane)))
    aside += [(Shift(place - 12.0, place + 70.0, side),) for side in (-lane, lane)]
    aside += [(Shift(place - 30.0, place + 150.0, side),) for side in (0.25 * lane, -0.25 * lane)]
    if begun < place:
        aside += [(Shift(begun + 5.0 + RAMP, place + 60.0, side),) for side in (lane, -lane)]
    guards: list[Plan] = [] if any(isinstance(step, Guard) for step in plan) else [(Guard(2.0),), (Guard(4.0),)]
    waits: list[Plan] = [(Wait(place - gap, seconds),) for gap, seconds in _WAITS]
    slow: list[Plan] = [(Slow(place - 60.0, place + 15.0, speed),) for speed in (4.0, 2.0)]
    behind = [*guards[:1], *waits[:4], *guards[1:], *waits[4:], *slow]
    if waits_only:
        aside = []
    turns = zip_longest(aside, behind) if stands else zip_longest(behind, aside)
    options = [option for turn in turns for option in turn if option is not None] + _timings(place)
    return [merged(plan, option) for option in options if not _clash(plan, option)]


def _timings(place: float) -> list[Plan]:
    """Plans that come to `place` later by little each, for gaps in a stream: rolling, and from a stop before it."""
    rolling = [Slow(place - 22.0 - metres, place - 22.0, 4.0) for metres in (6.0, 12.0, 18.0, 24.0, 32.0, 40.0)]
    standing = [Wait(place - 20.0, seconds) for seconds in _FINE]  # room to gather speed before the stream
    return [(step,) for pair in zip_longest(standing, rolling) for step in pair if step is not None]


def _clash(plan: Plan, option: Plan) -> bool:
    """Whether both shift somewhere: one shift on top of another is nobody's lane."""
    shifts = [[step for step in steps if isinstance(step, Shift)] for steps in (plan, option)]
    return any(a.begin - RAMP < b.end + RAMP and b.begin - RAMP < a.end + RAMP for a in shifts[0] for b in shifts[1])


def merged(plan: Plan, steps: Plan) -> Plan:
    """`plan` with `steps` in the order of the route, guards first; a new step replaces one like it nearby."""
    kept = [step for step in plan if not any(_replaces(new, step) for new in steps)]
    return tuple(sorted((*kept, *steps), key=_begin))


def _replaces(new: Step, old: Step) -> bool:
    return type(new) is type(old) and (new == old or abs(_begin(new) - _begin(old)) < _SAME)


def _begin(step: Step) -> float:
    if isinstance(step, Guard):
        return -math.inf
    return step.at if isinstance(step, Wait) else step.begin
