"""From motions to a control, the same for the teacher's agent and the sensors': plan, forecasts, and what overrules.

Source: reference `lav.md` 6.2 to 6.4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.config import COMMANDS, TIME_STEP, DriveConfig
from agents.lav.controller import (
    ALLOWED_SLACK,
    STOP,
    Caution,
    Controller,
    Impatience,
    StuckCounter,
    creep_path,
    planned_speed,
    touched,
)
from agents.lav.frames import planner_from_vehicle, vehicle_from_planner
from agents.lav.halting import FREE, allowed_speed, room_before
from agents.lav.leaders import leader_paths, same_way
from agents.lav.models.crop import to_planner
from agents.lav.models.teacher import Motions
from lavsim.drawings import Drawing, boxes, polylines, scalar
from lavsim.guidance import Guidance, Guide
from lavsim.types import Control

Floats = NDArray[np.float64]

HALF_SIZE = (2.45, 1.0)  # [m] half length and half width of the ego
WALKER_REACH, STANDING_REACH = 0.7, 0.5  # [m] kept free around a walker, and around one who stands
_WALKS = 0.3  # [m/s]
_RIDER = 1.3  # [m] half length; of two-wheelers no learned forecast is any good
_FARTHEST_GOAL, _NODES_APART = 80.0, 50.0  # [m] no goal of 1.0's plans is farther; what lies between its nodes
_WIDEST = 1.2  # [rad] beside the heading, where a far goal is taken to be at most
_CHANGE = 4  # commands from here on change lanes


class Forecasts(NamedTuple):
    """Where others may go, in the ego's planner frame.

    Attributes:
        paths: (N, B, T, 2) by command, and whatever else they may do [m].
        likelihood: (N, B).
        boxes: (N, 3) heading now [rad], half length and half width [m].
    """

    paths: Floats
    likelihood: Floats
    boxes: Floats


class Outlook(NamedTuple):
    """What the motion networks say of a tick, in the ego's planner frame.

    Attributes:
        plan: (T, 2) the ego's [m].
        paths: (N, 6, T, 2) others' by command [m].
        likelihood: (N, 6).
    """

    plan: Floats
    paths: Floats
    likelihood: Floats


def guide_of(plan: Sequence[tuple[Mapping[str, float], Any]]) -> Guide:
    """What leads along the thinned plan that an agent was given."""
    gps = np.array([[node["lat"], node["lon"]] for node, _ in plan])
    return Guide(gps, [int(option) for _, option in plan])


def goals_of(guidance: Guidance) -> Floats:
    """(2, 2) the next two goal points in the planner frame [m].

    Networks have seen goals up to 75 m away, those of 1.0's plans. A farther one, of a plan of 2.x, is replaced by two
    on the arc that leads there, as if the road bent evenly.
    """
    if np.hypot(*guidance.goal) > _FARTHEST_GOAL:
        return planner_from_vehicle(_on_the_arc(guidance.goal.astype(np.float64)))
    return planner_from_vehicle(np.stack([guidance.goal, guidance.next_goal]))


def _on_the_arc(goal: Floats) -> Floats:
    """(2, 2) points `_NODES_APART` and twice that along the arc from the ego, straight ahead at first, to a goal."""
    chord = float(np.hypot(*goal))
    bearing = float(np.clip(np.arctan2(goal[1], goal[0]), -_WIDEST, _WIDEST))
    arc = chord / np.sinc(bearing / np.pi)
    way = np.minimum(np.array([1.0, 2.0]) * _NODES_APART, arc)
    angle = bearing * way / arc
    reach = way * np.sinc(angle / np.pi)
    return np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)


def outlook_of(motions: Motions, poses: Tensor, command: int, config: DriveConfig) -> Outlook:
    """The plan of the command, refined but for lane changes, and others' coarse paths.

    Args:
        motions: Of one frame.
        poses: (1, 1 + N, 3) of the ego and the others.
        command: 0 to 5.
        config: Which plan changes lanes.
    """
    is_coarse = command >= _CHANGE and not config.refined_lane_change
    refined = motions.refined.shape[1] and not is_coarse
    own = motions.refined[0, -1] if refined else motions.coarse[0, 0]
    others = to_planner(motions.coarse[0, 1:], poses[0, 1:, None])
    likelihood = torch.sigmoid(motions.commands[0, 1:])
    return Outlook(*(part.numpy().astype(np.float64) for part in (own[command], others, likelihood)))


def vehicle_forecasts(
    outlook: Outlook,
    poses: Floats,
    sizes: Floats,
    stands: NDArray[np.bool_],
    velocities: Floats | None = None,
    braking: float = 0.0,
) -> Forecasts:
    """Others' forecasts; those who stand (N,) stay; riders, and who goes the ego's way, may also go on as they go.

    Whoever stands may pull out, but held for it the ego would not pass a parked car.

    Args:
        outlook: Of the tick.
        poses: (N, 3) of the others.
        sizes: (N, 2) half length and half width [m].
        stands: (N,).
        velocities: (N, 2) in the planner frame [m/s], if they are known.
        braking: Of those who go the ego's way, at most, gently [m/s²]; 0: forecasts alone.
    """
    paths, likelihood = outlook.paths.copy(), outlook.likelihood
    paths[stands] = poses[stands, None, None, :2]
    if velocities is not None and braking > 0.0:
        is_known = np.isfinite(velocities).all(axis=1) & ~stands
        leads = is_known & ((sizes[:, 0] < _RIDER) | same_way(outlook.plan, poses[:, :2], velocities))
        known = np.where(leads[:, None], velocities, 0.0)
        ahead = leader_paths(poses[:, :2], known, len(outlook.plan), braking)
        paths = np.concatenate([paths, ahead], axis=1)
        likelihood = np.concatenate([likelihood, np.repeat(leads[:, None].astype(float), ahead.shape[1], 1)], axis=1)
    return Forecasts(paths, likelihood, np.column_stack([poses[:, 2], sizes]))


def straight_forecasts(places: Floats, velocities: Floats, steps: int) -> Forecasts:
    """Walkers at places (N, 2) who go on as they go, with velocities (N, 2) [m/s]."""
    time = TIME_STEP * np.arange(1, steps + 1)[:, None]
    paths = places[:, None] + velocities[:, None] * time
    shape = (len(places), COMMANDS)
    reach = np.where(np.hypot(*velocities.T) < _WALKS, STANDING_REACH, WALKER_REACH)
    boxes = np.stack([np.zeros(len(places)), reach, reach], axis=1)
    return Forecasts(np.broadcast_to(paths[:, None], (*shape, steps, 2)), np.ones(shape), boxes)


class Driver:
    """Drives plans, stops before whoever comes into the way, and creeps on where it is stuck.

    Args:
        config: Gains and limits.
        half_size: (2,) half length and half width of the ego [m].
    """

    def __init__(self, config: DriveConfig, half_size: Sequence[float]) -> None:
        self._config = config
        self._box = np.array([0.0, *half_size])
        self._controller = Controller(config)
        self._stuck, self._impatience, self._caution = StuckCounter(config), Impatience(config), Caution(config)
        self._less = 0.0  # [m] of the margin aside
        self._others: Mapping[str, Forecasts] = {}
        self._in_way: dict[str, NDArray[np.int64]] = {}
        self._is_held = False

    def step(
        self,
        plan: Floats,
        others: Mapping[str, Forecasts],
        speed: float,
        command: int,
        is_held: bool = False,
        allowed: float = FREE,
    ) -> Control:
        """The control: along the plan, no faster than from where it can stop before whoever comes into the way.

        Args:
            plan: (T, 2) in the planner frame [m].
            others: Forecasts by kind of actor.
            speed: Of the ego [m/s].
            command: 0 to 5.
            is_held: Whether a network that may err brakes.
            allowed: Speed that lights and signs ahead allow [m/s].
        """
        self._less = self._impatience.step(speed, self._is_narrow(plan, others))
        hits = {kind: self._hit(plan, each) for kind, each in others.items()}
        self._in_way = {kind: np.flatnonzero(hit.any(axis=1)) for kind, hit in hits.items()}
        rooms = {kind: room_before(plan, np.asarray(hit.any(axis=0))) for kind, hit in hits.items()}
        rooms["walker"] = self._caution.step(rooms.get("walker", math.inf), speed)
        room = min(rooms.values())
        is_told = is_held or allowed < self._config.stop_below + ALLOWED_SLACK  # what it stands for
        self._others, self._is_held = others, is_told
        before = 0.0 if is_held else allowed_speed(room - self._config.room, self._config)
        control = self._controller.follow(plan, speed, command, min(allowed, before))
        is_free = not any(self._hit(creep_path(len(plan)), each, front=0.0).any() for each in others.values())
        return self._stuck.step(control, speed, is_free, is_told)

    def halt(self, plan: Floats, speed: float, command: int) -> Control:
        """Full brakes for what is known for sure: who waits for a light is not stuck."""
        return Control(steer=self._controller.follow(plan, speed, command).steer, brake=STOP.brake)

    def drawings(self) -> dict[str, Drawing]:
        """Whom it braked for last, and whether it was held."""
        poses, labels = [np.zeros((0, 5))], []
        for kind, rows in self._in_way.items():
            places, box = self._others[kind].paths[rows, 0, 0], self._others[kind].boxes[rows]
            poses.append(np.column_stack([vehicle_from_planner(places), box[:, 0], 2.0 * box[:, 1:]]))
            labels += [kind] * len(rows)
        return {
            "in the way": boxes(np.concatenate(poses), labels=labels, frame="ego"),
            "held": scalar(float(self._is_held)),
        }

    def _is_narrow(self, plan: Floats, others: Mapping[str, Forecasts]) -> bool:
        """Whether somebody beside the plan is in the way, and nobody on it."""
        wide, narrow = (
            any(self._hit(plan, each, less).any() for each in others.values())
            for less in (0.0, self._config.most_yield)
        )
        return wide and not narrow

    def _hit(
        self, plan: Floats, others: Forecasts, less: float | None = None, front: float | None = None
    ) -> NDArray[np.bool_]:
        boxes = np.concatenate([self._box[None], others.boxes])
        least = self._less if less is None else less
        before = self._config.front_margin if front is None else front
        return touched(plan, others.paths, others.likelihood, boxes, self._config, least, before)


def drawings_of(outlook: Outlook, config: DriveConfig) -> dict[str, Drawing]:
    """Plan and likely forecasts, for whoever looks."""
    likely = outlook.likelihood >= config.likely
    return {
        "plan": polylines([vehicle_from_planner(outlook.plan)], frame="ego"),
        "forecast": polylines(list(vehicle_from_planner(outlook.paths[likely])), outlook.likelihood[likely], "ego"),
        "planned speed": scalar(planned_speed(outlook.plan) * 3.6, "km/h"),
    }
