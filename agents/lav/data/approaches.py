"""Moments of recorded drives with the ego put before a traffic light or stop sign, the light in any state.

Experts wait at red lights for minutes and leave at the first green, so what they recorded tells "a junction ahead" from
"red" hardly at all: of frames that stand before a light one in a hundred is green. Here place and colour are drawn each
by itself, at all lights of a town instead of the few on the routes. Traffic and weather are the moment's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.map.lane import LaneTable
from lavsim.map.stop_lines import StopLine
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.types import LightState
from lavsim.world.snapshot import Snapshot, quantise_poses

Floats = NDArray[np.float64]

BEFORE, AFTER = 45.0, 14.0  # [m] from the ego's front to the line
_NEAR = 12.0  # [m] in which egos stand
_SPREAD, _ASKEW = 0.25, 0.035  # [m], [rad]: standard deviations of place and heading in the lane
_SIGNS = 0.25  # share of frames before stop signs, where a town has any
_ROOM = 5.0  # [m] between the ego's middle and others': who is nearer is taken away
_GREEN, _YELLOW = 0.36, 0.66  # of frames before lights: so many are green, the rest up to here yellow, others red


class Approach(NamedTuple):
    """A lane that ends at a line.

    Attributes:
        light: Index of the light that governs it; -1 before a stop sign.
        along: (P,) distance from the line [m], ascending, negative before it.
        path: (P, 4) x, y, z [m], yaw [rad, unwrapped].
    """

    light: int
    along: Floats
    path: Floats


class Posed(NamedTuple):
    """A moment as it might have been.

    Attributes:
        snapshot: The world.
        state: `LightState` of the light that governs the ego; UNKNOWN where none does.
        light_distance, sign_distance: From the ego's front to the line [m]; NaN where there is none.
    """

    snapshot: Snapshot
    state: int
    light_distance: float
    sign_distance: float


def approaches_of(town: TownMap) -> tuple[list[Approach], list[Approach]]:
    """The approaches to a town's lights, and to its stop signs."""
    lights = [_approach(town.lanes, light.index, line) for light in town.lights for line in light.stop_lines]
    signs = [_approach(town.lanes, -1, line) for sign in town.signs if sign.kind == "stop" for line in sign.stop_lines]
    return lights, signs


def posed(moment: Snapshot, town: TownMap, to: tuple[Sequence[Approach], Sequence[Approach]], draws: Draws) -> Posed:
    """A moment with the ego on a drawn approach (of `approaches_of`) and its light in a drawn state.

    Where there is neither light nor sign in a town, the moment as it was.
    """
    unit, spread = draws.uniform(0, 8), draws.normal(1, 2)
    lights, signs = to
    if not lights and not signs:
        return Posed(moment, LightState.UNKNOWN, np.nan, np.nan)
    group = signs if signs and (unit[0] < _SIGNS or not lights) else lights
    approach = group[draws.integer(2, len(group))]
    distance = min(_distance(unit[1], unit[2]), -float(approach.along[0]) - moment.sizes[0, 0])
    placed = _placed(moment, approach, distance, spread)
    if approach.light < 0:
        return Posed(placed, LightState.UNKNOWN, np.nan, distance if distance > 0.0 else np.nan)
    state = LightState.GREEN if unit[3] < _GREEN else LightState.YELLOW if unit[3] < _YELLOW else LightState.RED
    shown = replace(placed, lights=relit(moment.lights, town, approach.light, state, unit[4]))
    if distance <= 0.0:
        return Posed(shown, LightState.UNKNOWN, np.nan, np.nan)
    return Posed(shown, int(state), distance, np.nan)


def relit(lights: NDArray[np.uint8], town: TownMap, light: int, state: LightState, choice: float) -> NDArray[np.uint8]:
    """States (L,) in which a light has another one, and those that take turns with it have what goes with that.

    Args:
        lights: As they are.
        town: Whose.
        light: Index of the light.
        state: Its new one.
        choice: 0 to 1: which of the others' phases is green while this one is red; above 0.75 none is.
    """
    found = lights.copy()
    group = next((g for g in town.light_groups if any(light in phase for phase in g.phases)), None)
    own = next((phase for phase in group.phases if light in phase), (light,)) if group else (light,)
    others = [phase for phase in group.phases if light not in phase] if group else []
    for phase in others:
        found[list(phase)] = LightState.RED
    if state == LightState.RED and others and choice < 0.75:
        found[list(others[int(choice / 0.75 * len(others))])] = LightState.GREEN
    found[list(own)] = state
    return found


def _distance(kind: float, share: float) -> float:
    """Metres from the front to the line: where egos stand, farther, or past it."""
    if kind < 0.45:
        return 1.5 + share * (_NEAR - 1.5)
    return _NEAR + share * (BEFORE - _NEAR) if kind < 0.85 else -share * AFTER


def _placed(moment: Snapshot, approach: Approach, distance: float, spread: Floats) -> Snapshot:
    """The ego with its front before the line by `distance` [m], off and askew by `spread` (2,) standard deviations."""
    middle = -distance - float(moment.sizes[0, 0]) / 2.0
    x, y, z, yaw = (float(np.interp(middle, approach.along, column)) for column in approach.path.T)
    slope = np.gradient(approach.path[:, 2], approach.along)
    aside = _SPREAD * float(spread[0])
    place = np.array([[x - aside * np.sin(yaw), y + aside * np.cos(yaw), z]])
    pitch = np.arctan(np.interp(middle, approach.along, slope))
    pose = moment.pose.copy()
    pose[0] = quantise_poses(place, np.array([yaw + _ASKEW * float(spread[1])]), np.array([pitch]))[0]
    kept = np.hypot(*(moment.xy - place[0, :2]).T) > _ROOM
    kept[0] = True
    return replace(
        moment,
        rows=moment.rows[kept],
        pose=pose[kept],
        velocity=moment.velocity[kept],
        state=moment.state[kept],
    )


def _approach(lanes: LaneTable, light: int, line: StopLine) -> Approach:
    """The way to a line and past it, by the first lanes that lead there and on."""
    row = lanes.centre_line(line.lane)[:, :4]
    pieces, before = [row], line.u
    lane = line.lane
    while before < BEFORE and len(lanes.predecessors(lane)):
        lane = int(lanes.predecessors(lane)[0])
        if lanes.junction[lane] >= 0:
            break
        pieces.insert(0, lanes.centre_line(lane)[:-1, :4])
        before += float(lanes.length[lane])
    lane, after = line.lane, float(lanes.length[line.lane]) - line.u
    while after < AFTER + 5.0 and len(lanes.successors(lane)):
        lane = int(lanes.successors(lane)[0])
        pieces.append(lanes.centre_line(lane)[1:, :4])
        after += float(lanes.length[lane])
    path = np.concatenate(pieces)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))])
    path[:, 3] = np.unwrap(path[:, 3])
    return Approach(light, along - before, path)
