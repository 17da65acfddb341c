"""Vehicles that come one after the other along a line and vanish at its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ScenarioError
from lavsim.geometry import to_local, wrap_angle
from lavsim.scenarios.base import Scenario, Script, Stage
from lavsim.scenarios.moves.checks import check_positive
from lavsim.scenarios.moves.follow import ACCELERATION, DECELERATION, step_column
from lavsim.scenarios.moves.indicators import INDICATORS, indicators_along
from lavsim.scenarios.moves.pursuit import STEP, line_of, make_column
from lavsim.scenarios.parameters import Interval
from lavsim.types import DT, Role
from lavsim.world.actor import Actor

CARS = (
    "vehicle.tesla.model3", "vehicle.audi.tt", "vehicle.toyota.prius", "vehicle.mini.cooper_s", "vehicle.seat.leon",
    "vehicle.nissan.micra", "vehicle.chevrolet.impala", "vehicle.mercedes.coupe_2020",
)  # fmt: skip
BICYCLES = ("vehicle.bh.crossbike", "vehicle.diamondback.century", "vehicle.gazelle.omafiets")
GAP = Interval(20.0, 50.0)  # [m]
_MOST = 48  # vehicles at once
_STANDING = 0.5  # [m/s] of an ego that is waited for
_ON_LINE, _ALONG = 1.5, 0.9  # [m] of the ego from the line, cosine between their directions: it drives along it
_MERGED = 40  # ticks after which an ego that drives along the line is part of the stream
_SLOWED = 0.8  # of its speed: who is slower has braked for something and goes on minding it
_ROOM, _BESIDE = 7.0, 2.5  # [m] along and across the line: where somebody is nearer nobody appears


@dataclass(frozen=True)
class StreamConfig:
    """Parameters of a stream that a route file sets.

    Attributes:
        flow_speed: [m/s].
        source_dist_interval: Gaps between one vehicle and the next [m].
    """

    flow_speed: float = 10.0
    source_dist_interval: Interval = GAP

    def __post_init__(self) -> None:
        check_positive(self, "flow_speed", "source_dist_interval")


class ActorFlow:
    """Source, way and sink of a stream of vehicles.

    Args:
        scenario: Whose they are.
        stage: Where.
        line: (N, 2) from the source to the sink [m].
        speed: [m/s]
        gap: Distances between one and the next, drawn anew for each [m].
        models: Blueprints, drawn for each.
        prefilled: Whether the whole line is full at once.
        keeps_distance: Whether they brake for what is ahead.
        most: How many come in all; None: without end.
        offset: To the right of the line [m].
        phase: Where the first one is at once [m of the line]; a prefilled line is full from there back. Below 0 the
            first comes when one that drives at `speed` would have come so far from before the line.
    """

    def __init__(
        self,
        scenario: Scenario,
        stage: Stage,
        line: NDArray[np.float64],
        speed: float,
        gap: Interval = GAP,
        models: Sequence[str] = CARS,
        prefilled: bool = False,
        keeps_distance: bool = False,
        most: int | None = None,
        offset: float = 0.0,
        phase: float | None = None,
        braking: float = DECELERATION,
    ) -> None:
        self._scenario, self._stage, self.line = scenario, stage, line_of(line)
        self.speed, self._gap, self._models, self._keeps = speed, gap, models, keeps_distance
        self._most, self._offset, self._braking = most, offset, braking
        self._indicators = indicators_along(stage.town, self.line, stage.anchor.z)
        self._column, self._count = make_column(_MOST), 0
        self._draws = stage.draws.stream("flow", len(scenario.actors))
        self._next_gap = self._draw_gap()
        self.is_open, self._merged = True, 0  # ticks that the ego has been driving along the line
        self._pause = round(max(-(phase or 0.0), 0.0) / (max(speed, 0.1) * DT))  # ticks until the first one comes
        at = self.line.length - 1.0 if phase is None else min(phase, self.line.length - 1.0)
        wanted = prefilled or phase is not None
        while wanted and at > 0.0 and self._may_come():
            self._spawn(at)
            at -= self._next_gap
            self._next_gap = self._draw_gap()
            wanted = prefilled

    def __len__(self) -> int:
        """Vehicles under way."""
        return int(np.count_nonzero(self._column.row >= 0))

    @property
    def actors(self) -> list[Actor]:
        """Those under way."""
        return [Actor(self._stage.world, int(row)) for row in self._column.row[self._column.row >= 0]]

    @property
    def come(self) -> int:
        """How many have come so far."""
        return self._count

    def close(self) -> None:
        """Lets nobody else come; who is under way drives on."""
        self.is_open = False

    def step(self) -> None:
        """Acts for this tick: who is at the sink goes, the next comes, all drive."""
        column, world = self._column, self._stage.world
        here = column.row >= 0
        for slot in np.flatnonzero(here & (column.at >= self.line.length - 0.5)):
            world.remove(Actor(world, int(column.row[slot])))
            column.row[slot] = -1
        column.row[here & ~world.present[column.row]] = -1
        self._keep_clear()
        self._pause -= 1
        last = float(np.min(column.at[column.row >= 0], initial=np.inf))
        if self._pause < 0 and last >= self._next_gap and self._may_come():
            if self._spawn(0.0):
                self._next_gap = self._draw_gap()
            else:  # the lane belongs to the stream: the original takes background traffic off it
                self._stage.traffic.make_room(self.line.xy[0], _ROOM)
        column.wanted[:] = self.speed
        braking = DECELERATION if self._merged > _MERGED else self._braking
        step_column(self._stage, self.line, column, (ACCELERATION, braking))
        self._signal()

    def run(self) -> Script:
        """Acts without end."""
        while True:
            self.step()
            yield

    def _keep_clear(self) -> None:
        """Nobody runs into an ego that stands or has long merged; once one has touched something all keep clear.

        Who has braked for the ego lets it go first when it sets off: else both would set off and stop again for ever.
        """
        here = self._column.row >= 0
        if not self._keeps and (self._stage.world.touched[self._column.row[here]] >= 0).any():
            self._keeps = True
        ego = self._stage.world.ego
        gaps = np.hypot(*(self.line.xy - ego.xy).T)
        nearest = int(np.argmin(gaps))
        is_along = gaps[nearest] < _ON_LINE and np.cos(self.line.yaw[nearest] - ego.yaw) > _ALONG
        self._merged = self._merged + 1 if is_along else 0
        forward = np.hypot(*self._stage.world.velocity[self._column.row, :2].T)
        has_slowed = here & self._column.keeps & (forward < _SLOWED * self.speed)
        self._column.keeps[:] = has_slowed | (self._keeps or ego.speed < _STANDING or self._merged > _MERGED)

    def _signal(self) -> None:
        """Who turns says so."""
        here = self._column.row >= 0
        rows = self._column.row[here]
        points = np.minimum((self._column.at[here] / STEP).astype(np.int64), len(self._indicators) - 1)
        lights = self._stage.world.lights
        lights[rows] = (lights[rows] & ~INDICATORS) | self._indicators[points]

    def _draw_gap(self) -> float:
        return float(self._draws.uniform(self._count, 1, *self._gap)[0])

    def _may_come(self) -> bool:
        return self.is_open and (self._most is None or self._count < self._most) and len(self) < _MOST

    def _spawn(self, at: float) -> bool:
        """A vehicle at `at` metres of the line, at full speed; False where there is no room."""
        world, column = self._stage.world, self._column
        k = min(int(at / STEP), len(self.line.yaw) - 1)
        yaw = float(self.line.yaw[k])
        xy = self.line.xy[k] + self._offset * np.array([-np.sin(yaw), np.cos(yaw)])
        others = world.pose[: world.count, :2][world.present[: world.count] & (world.half_sizes[:, 0] > 0.0)]
        ahead, aside = np.abs(to_local(others, xy, yaw)).T
        if ((ahead < _ROOM) & (aside < _BESIDE)).any():
            return False
        model = self._models[self._draws.stream("model").integer(self._count, len(self._models))]
        try:
            actor = self._scenario.spawn(self._stage, model, self._at_ground(xy), float(wrap_angle(yaw)), Role.SCENARIO)
        except ScenarioError:
            return False
        slot = int(np.flatnonzero(column.row < 0)[0])
        column.row[slot], column.at[slot], column.keeps[slot] = actor.row, at, self._keeps
        column.offset[slot] = column.target[slot] = self._offset
        actor.launch(min(self.speed, float(self.line.pace[k])))
        self._count += 1
        return True

    def _at_ground(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        near = self._stage.anchor.z
        height = float(self._stage.town.nearest(np.array([[xy[0], xy[1], near]])).points[0, 2])
        return np.array([xy[0], xy[1], height])
