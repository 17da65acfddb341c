"""A vehicle that appears ahead of the ego in its lane."""

from __future__ import annotations

import numpy as np

from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.base import Scenario, Stage
from lavsim.scenarios.moves.follow import LaneFollower
from lavsim.scenarios.place import aside, line_ahead
from lavsim.types import Role

_ROOM = 7.0  # [m] between the middle of a background vehicle and who appears


def lead(
    scenario: Scenario,
    stage: Stage,
    blueprint: str,
    waypoint: Waypoint,
    speed: float,
    length: float = 300.0,
    keeps_distance: bool = False,
    offset: float = 0.0,
) -> LaneFollower:
    """Puts a vehicle at a lane centre, ready to follow that lane at `speed`; it stands until it is stepped.

    Background vehicles that are in its place are taken out.

    Raises:
        ScenarioError: another actor stands there.
    """
    position = aside(waypoint, offset)
    stage.traffic.make_room(position[:2], _ROOM)
    actor = scenario.spawn(stage, blueprint, position, waypoint.yaw, Role.SCENARIO)
    follower = LaneFollower(stage, actor, line_ahead(waypoint, length), speed, keeps_distance)
    if offset != 0.0:
        follower.start_aside(offset)
    return follower


def distance_to_ego(stage: Stage, follower: LaneFollower) -> float:
    """Straight distance between the ego and a vehicle [m]."""
    return float(np.hypot(*(follower.actor.xy - stage.world.ego.xy)))
