"""What command leads through a junction: left, right or straight, as CARLA's planner decides it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.map.lane import DRIVABLE
from lavsim.types import RoadOption

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

TURN_THRESHOLD = np.radians(35.0)  # CARLA's GlobalRoutePlanner: less is "straight"


def turn_decision(current: Floats, chosen: Floats, others: Sequence[Floats]) -> RoadOption:
    """Command at a junction, from unit vectors in the world frame.

    Args:
        current: (2,) direction at the end of the lane before the junction.
        chosen: (2,) direction at the end of the way through it.
        others: (2,) chords of the first lanes of the other ways.

    Source: CARLA's GlobalRoutePlanner._turn_decision (0.9.10 to today), reference `carla.md` 3.5.
    """
    cross = float(current[0] * chosen[1] - current[1] * chosen[0])
    deviation = float(np.arccos(np.clip(current @ chosen, -1.0, 1.0)))
    if deviation < TURN_THRESHOLD:
        return RoadOption.STRAIGHT
    crosses = [float(current[0] * other[1] - current[1] * other[0]) for other in others] or [0.0]
    if cross < min(crosses):
        return RoadOption.LEFT
    if cross > max(crosses):
        return RoadOption.RIGHT
    return RoadOption.LEFT if cross < 0.0 else RoadOption.RIGHT


def turns(
    starts: Floats, ends: Floats, junction: Ints, types: Ints, succ: tuple[Ints, Ints], pred: tuple[Ints, Ints]
) -> NDArray[np.int8]:
    """Command of each junction lane: that of the way in which it leads on."""
    turn = np.full(len(junction), int(RoadOption.LANEFOLLOW), np.int8)
    driving = (types & DRIVABLE) > 0

    def direction(yaw: float) -> Floats:
        return np.array([np.cos(yaw), np.sin(yaw)])

    for lane in np.flatnonzero((junction >= 0) & driving):
        before = [p for p in pred[1][pred[0][lane] : pred[0][lane + 1]] if junction[p] < 0 and driving[p]]
        if not before:
            continue
        siblings = [k for k in succ[1][succ[0][before[0]] : succ[0][before[0] + 1]] if k != lane and driving[k]]
        chords = []
        for other in siblings:
            chord = ends[other, :2] - starts[other, :2]
            chords.append(chord / max(float(np.hypot(*chord)), 1e-9))
        way, tail = [int(lane)], int(lane)
        for _ in range(16):  # junctions whose ways are cut into several roads
            ahead = [k for k in succ[1][succ[0][tail] : succ[0][tail + 1]] if junction[k] >= 0 and driving[k]]
            if not ahead or ahead[0] in way:
                break
            tail = int(ahead[0])
            way.append(tail)
        decision = turn_decision(direction(ends[before[0], 3]), direction(ends[tail, 3]), chords)
        for part in way:
            if part == lane or turn[part] == RoadOption.LANEFOLLOW:
                turn[part] = decision
    return turn
