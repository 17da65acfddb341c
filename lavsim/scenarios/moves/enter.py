"""A vehicle that appears at the beginning of a line, ready to drive along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios.base import Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.follow import LaneFollower
from lavsim.scenarios.place import at_height
from lavsim.types import Role

_ROOM = 9.0  # [m] around it that background vehicles leave
_EVERY = 10.0  # [m] between places on a line that is cleared


def enter(
    scenario: Scenario,
    stage: Stage,
    model: str,
    line: NDArray[np.float64],
    speed: float,
    keeps_distance: bool = False,
) -> LaneFollower:
    """Puts a vehicle at the first point of `line` (N, 2); it stands until it is launched or stepped.

    Raises:
        ScenarioError: another actor of a hazard stands there.
    """
    ahead = line[1] - line[0]
    stage.traffic.make_room(line[0], _ROOM)
    position = at_height(line[0], ground(stage, line[0]))
    actor = scenario.spawn(stage, model, position, float(np.arctan2(ahead[1], ahead[0])), Role.SCENARIO)
    return LaneFollower(stage, actor, line, speed, keeps_distance)


def drive_through(follower: LaneFollower) -> Script:
    """Drives to the end of the line, at full speed from the first tick, and leaves."""
    follower.actor.launch(follower.speed)
    yield from follower.run()
    follower.actor.remove()


def ground(stage: Stage, xy: NDArray[np.float64]) -> float:
    """Height of the road at `xy` (2,), of the level that the hazard is on [m]."""
    return float(stage.town.nearest(np.array([[xy[0], xy[1], stage.anchor.z]])).points[0, 2])


def clear_line(stage: Stage, line: NDArray[np.float64]) -> None:
    """Takes background vehicles off a line (N, 2)."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    for at in np.arange(0.0, along[-1] + _EVERY, _EVERY):
        stage.traffic.make_room(line[min(int(np.searchsorted(along, at)), len(line) - 1)], _ROOM)


def within(seconds: float, *scripts: Script) -> Script:
    """Runs scripts side by side until the last has ended, or for `seconds`."""
    yield from wait.first_of(wait.seconds(seconds), wait.together(*scripts))
