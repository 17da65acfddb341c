"""The frames of LAV's networks against the vehicle frame of everything else. The only place that converts.

Convention:
    Vehicle frame: x ahead, y right [m]; headings clockwise seen from above [rad]; a point is (ahead, right).
    Planner frame: x right, y backward [m] (an image's: forward is negative y). Plans, goals and poses of networks.
    Stored goals of LAV's dataset: (left, forward) [m], the negative of a planner point.
    Relative headings are the same number in both frames; in the planner frame R(a) = [[cos a, -sin a], [sin a, cos a]]
    takes a vehicle's own points to the ego's.

Source: reference `lav.md` 1.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.types import RoadOption

Floats = NDArray[np.float64]

FOLLOW = int(RoadOption.LANEFOLLOW) - 1  # what LAV makes of a node without a command


def planner_from_vehicle(points: ArrayLike) -> Floats:
    """(…, 2) right, backward of points (ahead, right)."""
    ahead, right = np.moveaxis(np.asarray(points, np.float64), -1, 0)
    return np.stack([right, -ahead], axis=-1)


def vehicle_from_planner(points: ArrayLike) -> Floats:
    """(…, 2) ahead, right of points (right, backward)."""
    right, backward = np.moveaxis(np.asarray(points, np.float64), -1, 0)
    return np.stack([-backward, right], axis=-1)


def planner_from_stored(goal: ArrayLike) -> Floats:
    """(…, 2) right, backward of a goal as LAV's dataset has it (left, forward)."""
    return -np.asarray(goal, np.float64)


def planner_from_world(points: ArrayLike, origin: ArrayLike, yaw: float) -> Floats:
    """(…, 2) planner points of an ego at world `origin` with heading `yaw` [rad], of world points."""
    dx, dy = np.moveaxis(np.asarray(points, np.float64) - np.asarray(origin, np.float64), -1, 0)
    return np.stack([dy * np.cos(yaw) - dx * np.sin(yaw), -(dx * np.cos(yaw) + dy * np.sin(yaw))], axis=-1)


def world_from_planner(points: ArrayLike, origin: ArrayLike, yaw: float) -> Floats:
    """The inverse of `planner_from_world`."""
    right, backward = np.moveaxis(np.asarray(points, np.float64), -1, 0)
    x = -backward * np.cos(yaw) - right * np.sin(yaw)
    y = -backward * np.sin(yaw) + right * np.cos(yaw)
    return np.stack([x, y], axis=-1) + np.asarray(origin, np.float64)


def forward_of(heading: ArrayLike) -> Floats:
    """(…, 2) planner directions of headings (…) [rad]."""
    yaw = np.asarray(heading, np.float64)
    return np.stack([np.sin(yaw), -np.cos(yaw)], axis=-1)


def ego_from_own(points: ArrayLike, place: ArrayLike, heading: float) -> Floats:
    """(…, 2) planner points of the ego, of points in the own planner frame of a vehicle at `place` with `heading`."""
    x, y = np.moveaxis(np.asarray(points, np.float64), -1, 0)
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * x - s * y, s * x + c * y], axis=-1) + np.asarray(place, np.float64)


def own_from_ego(points: ArrayLike, place: ArrayLike, heading: float) -> Floats:
    """The inverse of `ego_from_own`: R(-heading) (p - place)."""
    x, y = np.moveaxis(np.asarray(points, np.float64) - np.asarray(place, np.float64), -1, 0)
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)


def command_of(option: int) -> int:
    """LAV's command, 0 left … 5 change right, of a `RoadOption`; 3 (follow) without one."""
    return option - 1 if option >= 1 else FOLLOW


def option_of(command: int) -> RoadOption:
    """The inverse of `command_of`."""
    return RoadOption(command + 1)
