"""What stands at the road: props, and vehicles that do not move."""

from __future__ import annotations

from collections.abc import Sequence

from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.base import Scenario, Stage
from lavsim.scenarios.place import aside
from lavsim.types import Role
from lavsim.world.actor import Actor


def park(
    scenario: Scenario,
    stage: Stage,
    blueprint: str,
    waypoint: Waypoint,
    offset: float = 0.0,
    turn: float = 0.0,
    moves: bool = False,
) -> Actor:
    """Puts an actor at `offset` metres to the right of a lane centre.

    Args:
        scenario: Whose it is.
        stage: Where.
        blueprint: What.
        waypoint: Lane centre.
        offset: To the right [m].
        turn: Heading against the lane's [rad], clockwise.
        moves: Whether it will be driven later; what stands for good is passed by background drivers at once.

    Raises:
        ScenarioError: another actor stands there.
    """
    role = Role.SCENARIO if moves else Role.PROP
    return scenario.spawn(stage, blueprint, aside(waypoint, offset), waypoint.yaw + turn, role)


def debris(scenario: Scenario, stage: Stage, places: Sequence[Waypoint]) -> list[Actor]:
    """Dirt on the road at lane centres; wheels roll over it."""
    return [park(scenario, stage, "static.prop.dirtdebris01", place) for place in places]
