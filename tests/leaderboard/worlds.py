"""Towns of straight strips and routes along them, small enough to draw on paper."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from lavsim.types import DT, LaneType
from lavsim.world.snapshot import CONTACT_DTYPE, HAZARD_DTYPE, Snapshot
from leaderboard.criteria.base import Criterion, Infraction
from leaderboard.rules import RULES
from tests.snapshots import EGO, Body, snapshot_of

V1, V20, V21 = RULES["1.0"], RULES["2.0"], RULES["2.1"]


@dataclass(frozen=True)
class Strip:
    """A lane along x from x0 to x1 at y, driven towards +x (yaw 0) or -x (yaw pi)."""

    road: int = 0
    lane: int = -1
    y: float = 0.0
    x0: float = -1000.0
    x1: float = 1000.0
    width: float = 3.5
    yaw: float = 0.0
    type: int = LaneType.DRIVING
    junction: int = -1
    limit: float = 50.0 / 3.6


class StripTown:
    """What criteria ask of a town, answered from strips."""

    name = "strips"

    def __init__(
        self, strips: Sequence[Strip] = (Strip(),), lights: Sequence[Any] = (), signs: Sequence[Any] = ()
    ) -> None:
        self.strips = list(strips)
        self.lights = tuple(lights)
        self.signs = tuple(signs)
        self.lanes = SimpleNamespace(
            length=np.array([s.x1 - s.x0 for s in strips]),
            successors=lambda lane: np.zeros(0, np.int32),
            road_id=np.array([s.road for s in strips]),
            lane_id=np.array([s.lane for s in strips]),
            type=np.array([int(s.type) for s in strips]),
            junction=np.array([s.junction for s in strips]),
            speed_limit=np.array([s.limit for s in strips]),
        )

    def nearest(self, points: np.ndarray, types: int = LaneType.DRIVING) -> Any:
        rows = [self._nearest(point, types) for point in points]
        strips = [self.strips[lane] for lane, _ in rows]
        return SimpleNamespace(
            lane=np.array([lane for lane, _ in rows]),
            u=np.array([(p[0] - s.x0) * math.cos(s.yaw) for p, s in zip(points, strips, strict=True)]),
            distance=np.array([distance for _, distance in rows]),
            width=np.array([s.width for s in strips]),
            yaw=np.array([s.yaw for s in strips]),
        )

    def centre(self, lane: np.ndarray, u: np.ndarray) -> np.ndarray:
        strips = [self.strips[k] for k in lane]
        return np.array(
            [(s.x0 + along * math.cos(s.yaw), s.y, 0.0, s.yaw, 0.0) for s, along in zip(strips, u, strict=True)]
        )

    def _nearest(self, point: np.ndarray, types: int) -> tuple[int, float]:
        found = [
            (math.hypot(point[0] - min(max(point[0], s.x0), s.x1), point[1] - s.y), index)
            for index, s in enumerate(self.strips)
            if s.type & types
        ]
        distance, index = min(found)
        return index, distance


def straight_route(length: float = 100.0, step: float = 1.0) -> Any:
    """A route along +x from the origin."""
    x = np.arange(0.0, length + step / 2.0, step)
    points = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    return SimpleNamespace(
        points=points,
        yaw=np.zeros(len(x)),
        distance=x.copy(),
        length=float(length),
        keypoint_length=float(length),
        keypoints=points[[0, -1]],
    )


def ego_at(
    x: float,
    y: float = 0.0,
    tick: int = 0,
    speed: float = 8.0,
    yaw: float = 0.0,
    others: Sequence[Body] = (),
    touches: Iterable[int] = (),
    lights: Sequence[int] = (),
    hazards: Sequence[tuple[int, int]] = (),
) -> Snapshot:
    """A snapshot with the ego somewhere, touching the actors with ids `touches`."""
    bodies = [replace(EGO, x=x, y=y, yaw=yaw, speed=speed), *others]
    contacts = np.array([(1, other, 100.0, 0, 0) for other in touches], CONTACT_DTYPE)
    return replace(
        snapshot_of(bodies, tick=tick, lights=lights),
        contacts=contacts,
        hazards=np.array(list(hazards), HAZARD_DTYPE),
    )


def drive(
    criterion: Criterion, snapshots: Iterable[Snapshot], town: Any = None, route: Any = None, finish: bool = True
) -> list[Infraction]:
    """What `criterion` reports over `snapshots`."""
    criterion.start(town or StripTown(), route or straight_route())
    found: list[Infraction] = []
    for snapshot in snapshots:
        found += criterion.update(snapshot)
        if criterion.ending:
            break
    return found + list(criterion.finish() if finish else ())


def along(*xs: float, y: float = 0.0, every: float = DT, speed: float = 8.0, **more: Any) -> list[Snapshot]:
    """The ego at each of `xs`, `every` seconds apart."""
    return [ego_at(x, y, tick=round(k * every / DT), speed=speed, **more) for k, x in enumerate(xs)]
