"""What was seen and foreseen at a tick, carried along to where the ego is a little later.

A turn of the LiDAR takes two ticks, so the networks look every other one; the ego is steered at each.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from agents.lav.driving import Forecasts, Outlook
from agents.lav.frames import planner_from_vehicle, planner_from_world, vehicle_from_planner, world_from_planner
from agents.lav.localise import Pose
from agents.lav.models.detection import Detections
from agents.lav.perceive import Sight

Floats = NDArray[np.float64]


class Look(NamedTuple):
    """A look of the networks.

    Attributes:
        pose: Of the ego, then.
        sight: What was seen, in the planner frame of `pose`.
        outlook: Plan and forecasts, there too.
        others: Who may come into the way, by kind, there too.
    """

    pose: Pose
    sight: Sight
    outlook: Outlook
    others: Mapping[str, Forecasts]


def carried_points(points: Floats, then: Pose, now: Pose) -> Floats:
    """(…, 2) points of the planner frame of `then` in that of `now` [m]."""
    return planner_from_world(world_from_planner(points, *then), *now)


def carried_outlook(outlook: Outlook, then: Pose, now: Pose) -> Outlook:
    """Plan and forecasts in the planner frame of `now`; their times stay those of `then`."""
    plan, paths = (carried_points(part, then, now) for part in (outlook.plan, outlook.paths))
    return Outlook(plan, paths, outlook.likelihood)


def carried_forecasts(others: Mapping[str, Forecasts], then: Pose, now: Pose) -> dict[str, Forecasts]:
    """Forecasts by kind in the planner frame of `now`."""
    turn = np.array([then.yaw - now.yaw, 0.0, 0.0])
    return {
        kind: Forecasts(carried_points(each.paths, then, now), each.likelihood, each.boxes + turn)
        for kind, each in others.items()
    }


def carried_sight(sight: Sight, then: Pose, now: Pose) -> Sight:
    """Who was found, and points, where the ego of `now` has them; features and map are still those of `then`."""
    points = sight.points.copy()
    points[:, :2] = vehicle_from_planner(carried_points(planner_from_vehicle(points[:, :2]), then, now))
    vehicles, walkers = (_carried_boxes(found, then, now) for found in (sight.vehicles, sight.walkers))
    return sight._replace(vehicles=vehicles, walkers=walkers, points=points)


def _carried_boxes(found: Detections, then: Pose, now: Pose) -> Detections:
    boxes = found.boxes.numpy().astype(np.float64)
    boxes[:, :2] = carried_points(boxes[:, :2], then, now)
    boxes[:, 2] += then.yaw - now.yaw
    return Detections(torch.from_numpy(boxes), found.scores)
