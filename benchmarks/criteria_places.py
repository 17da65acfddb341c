"""Streets on which moments are staged for criteria, and what a criterion says of them.

The ego is put where it is wanted, tick by tick; what happens then is what the criterion itself says of these
snapshots. `criteria_stages.py` has the moments, `criteria_pictures.py` draws them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import forward, right
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.signal import Sign, TrafficLight
from lavsim.map.stop_lines import StopLine
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.types import DT, ActorClass, ActorIds, LightState, Role
from lavsim.world.snapshot import (
    CONTACT_DTYPE,
    HAZARD_DTYPE,
    Snapshot,
)
from leaderboard.criteria.base import CRITERIA, Criterion
from leaderboard.rules import RULES
from tests.drives import straight_route
from tests.snapshots import EGO, Body, snapshot_of

BEFORE, AFTER = 45.0, 60.0  # [m] of route before and behind a stop line
SPEED = 8.0  # [m/s]
NOSE = EGO.size[0] / 2.0  # [m] from the ego's centre
VAN = Body(ActorIds.TRAFFIC, kind=ActorClass.VAN, size=(5.2, 2.0, 2.0), colour=(200, 190, 120))
CAR = Body(ActorIds.TRAFFIC)
AMBULANCE = Body(
    ActorIds.of_scenario(0), role=Role.SCENARIO, kind=ActorClass.VAN, size=(6.37, 2.35, 2.43), colour=(250, 250, 250)
)
WRECK = Body(ActorIds.of_scenario(0), role=Role.SCENARIO, colour=(60, 60, 60))

# Something to draw over a picture, in the world: a colour's name, points (N, 2) [m], and whether they close.
Mark = tuple[str, NDArray[np.float64], bool]


@dataclass(frozen=True, eq=False)
class Street:
    """A route in a town, and places along it.

    Attributes:
        town, route: Where.
        light: The light that governs the route `BEFORE` metres from its start, if any, with its stop line.
        sign: The stop sign there.
    """

    town: TownMap
    route: Route
    light: tuple[TrafficLight, StopLine] | None = None
    sign: Sign | None = None

    def place(self, ahead: float, aside: float = 0.0) -> tuple[NDArray[np.float64], float]:
        """x, y, z [m] and yaw [rad] `ahead` metres along the route, `aside` metres to its right."""
        route = self.route
        yaw = float(route.yaw[np.abs(route.distance - ahead).argmin()])
        at = np.array([np.interp(ahead, route.distance, route.points[:, k]) for k in range(3)])
        at[:2] += right(yaw) * aside + forward(yaw) * (ahead - np.clip(ahead, 0.0, route.distance[-1]))
        return at, yaw

    def body(self, like: Body, ahead: float, aside: float = 0.0, turn: float = 0.0, **more: Any) -> Body:
        (x, y, z), yaw = self.place(ahead, aside)
        return replace(like, x=x, y=y, z=z, yaw=yaw + turn, **more)

    def moment(
        self,
        ahead: float,
        aside: float = 0.0,
        speed: float = SPEED,
        others: Sequence[Body] = (),
        touches: Iterable[Body] = (),
        hazard: int | None = None,
        state: LightState = LightState.GREEN,
    ) -> Snapshot:
        """The ego at a place, and who is around; `hazard` are the flags of the one that is active."""
        contacts = [(ActorIds.EGO, b.id, 100.0, round(b.x * 1000.0), round(b.y * 1000.0)) for b in touches]
        made = snapshot_of([self.body(EGO, ahead, aside, speed=speed), *others], lights=self.lights(state))
        hazards = np.array([] if hazard is None else [(0, hazard)], HAZARD_DTYPE)
        return replace(made, contacts=np.array(contacts, CONTACT_DTYPE), hazards=hazards)

    def lights(self, state: LightState) -> NDArray[np.uint8]:
        """States of all lights: `state` along the route, red across it, and green there while it is red."""
        if self.light is None:
            return np.full(len(self.town.lights), LightState.GREEN, np.uint8)
        across = LightState.GREEN if state == LightState.RED else LightState.RED
        turns = np.array([math.cos(light.yaw - self.light[0].yaw) for light in self.town.lights])
        return np.where(np.abs(turns) > 0.7, state, across).astype(np.uint8)

    def drive(self, first: float, last: float, speed: float = SPEED, **more: Any) -> list[Snapshot]:
        """The ego from one place to another."""
        return [self.moment(ahead, speed=speed, **more) for ahead in np.arange(first, last, speed * DT)]


@dataclass(frozen=True, eq=False)
class Panel:
    """Snapshots that a criterion is shown, and what it should say.

    Attributes:
        says: Some words about them.
        street: Where.
        snapshots: Ticks in a row; numbers are given to them when they are judged.
        fires: Whether the criterion does, at the moment that is drawn; else it spares.
        earlier: How often it has fired before.
        marks: What is drawn over the picture.
        shown: Which of the snapshots is drawn where the criterion spares; the last by default.
    """

    says: str
    street: Street
    snapshots: Sequence[Snapshot]
    fires: bool
    earlier: int = 0
    marks: Callable[[Snapshot], list[Mark]] = lambda _: []
    shown: int = -1


@dataclass(frozen=True, eq=False)
class Stage:
    """A criterion between two panels: spared, fired.

    Attributes:
        rules: Version by which it judges.
        panels: One that it spares, one at which it fires.
        metres: Of the world in the width of a picture.
        ahead: Share of a picture's height that lies ahead of the ego.
    """

    rules: str
    panels: tuple[Panel, Panel]
    metres: float = 34.0
    ahead: float = 0.62


def judge(name: str, rules: str, panel: Panel) -> tuple[int, Snapshot]:
    """How often a criterion fires in a panel, and the moment to draw: the last at which it does, if it should."""
    criterion: Criterion = CRITERIA[name](RULES[rules])
    criterion.start(panel.street.town, panel.street.route)
    fired: list[int] = []
    for tick, snapshot in enumerate(panel.snapshots):
        found = criterion.update(replace(snapshot, tick=tick))
        fired += [tick] * (len(found) or int(criterion.ending is not None))
        if criterion.ending:
            break
    fired += [infraction.tick for infraction in criterion.finish()]
    return len(fired), panel.snapshots[fired[-1] if panel.fires and fired else panel.shown]


# ---- places


@cache
def street() -> Street:
    """A street with one lane a side."""
    return Street(load_town("eu_small_a"), straight_route())


@cache
def at_light() -> Street:
    """Over a crossing with lights; its stop line lies `BEFORE` metres from the start."""
    town = load_town("us_large_a")
    light = town.lights[10]  # of a crossing with four arms; the outer lane leads on and to the right
    stop = next(stop for stop in light.stop_lines if len(town.waypoint_at(stop.lane, stop.u).next(AFTER)) > 1)
    return Street(town, _route_over(town, stop.lane, stop.u, 0.0), light=(light, stop))


@cache
def turning() -> Street:
    """As `at_light`, but to the right there."""
    here = at_light()
    assert here.light is not None
    return Street(here.town, _route_over(here.town, here.light[1].lane, here.light[1].u, math.pi / 2.0))


@cache
def at_stop_sign() -> Street:
    """Past a stop sign, whose box lies `BEFORE` metres from the start."""
    town = load_town("us_rural")
    boxes = [(sign, box) for sign in town.signs if sign.kind == "stop" for box in sign.boxes if box.u > BEFORE + 5.0]
    sign, box = max(boxes, key=lambda pair: (round(pair[1].u), -pair[1].lane))
    return Street(town, _route_over(town, box.lane, box.u, 0.0), sign=sign)


def _route_over(town: TownMap, lane: int, u: float, turn: float) -> Route:
    """From `BEFORE` metres before a place on a lane to `AFTER` behind it, turning by about `turn` [rad] on the way."""
    start = town.centre(np.array([lane]), np.array([u - BEFORE]))[0]
    place = town.waypoint_at(lane, u)
    ends = place.next(AFTER)
    end = max(ends, key=lambda way: math.cos(way.yaw - place.yaw - turn))
    return get_planner(town).trace(np.array([start[:3], end.xyz]))
