"""Parked cars: on parking lanes beside the road and in spaces drawn as objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from lavsim.geometry import box_corners
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.types import ActorClass, ActorIds, LaneType, Role
from lavsim.world.blueprints import BLUEPRINTS, Blueprint
from lavsim.world.broadphase import LEVEL_GAP
from lavsim.world.world import World

BAY_LENGTH = 6.0  # [m] of a parking lane for one car
_GAP = 0.8  # [m] of a bay's length that stays free
_SIDE = 0.2  # [m] of its width, so that wide traffic beside it passes
_OVER_LINE = 0.05  # [m] that a car may stand on a driving lane
_CLEAR_OF_ACTORS = 0.5  # [m] beyond a bay's width
_PARKED_CLASSES = (ActorClass.CAR, ActorClass.VAN)
_REVERSED = 0.2  # share of cars that were backed into a drawn space


@dataclass(frozen=True)
class Bay:
    """A place for one car.

    Attributes:
        number: Counts all bays of a town; names the actor that parks there.
        position: x, y, z of its middle [m].
        yaw: The way a car looks that drove into it [rad].
        length, width: [m].
        is_slot: Whether it is drawn as an object, to be entered either way round.
    """

    number: int
    position: tuple[float, float, float]
    yaw: float
    length: float
    width: float
    is_slot: bool


def _outlines(bays: Sequence[Bay], longer: float, wider: float) -> NDArray[np.float64]:
    """Corners (B, 4, 2) of all bays, made longer and wider by so much [m]."""
    x, y, yaw, length, width = np.array([(*b.position[:2], b.yaw, b.length, b.width) for b in bays]).T
    return box_corners(x, y, yaw, length + longer, width + wider)


@lru_cache(maxsize=16)
def parking_bays(town: TownMap) -> tuple[Bay, ...]:
    """All bays that keep off driving lanes, crosswalks and each other."""
    candidates = [*_lane_bays(town), *_slot_bays(town)]
    if not candidates:
        return ()
    outlines = np.asarray(shapely.polygons(_outlines(candidates, -_GAP, 0.0)))
    free = ~_on_driving_lane(town, candidates)
    if town.crosswalks:
        walks = shapely.union_all([shapely.Polygon(polygon).buffer(1.0) for polygon in town.crosswalks])
        free &= ~shapely.intersects(outlines, walks)
    tree = shapely.STRtree(outlines)
    for k in np.flatnonzero(free):
        rivals = tree.query(outlines[k], predicate="intersects")
        free[rivals[rivals > k]] = False  # the first in the town's order stays
    return tuple(bay for bay, is_free in zip(candidates, free, strict=True) if is_free)


def park_cars(town: TownMap, world: World, draws: Draws, share: float) -> NDArray[np.int64]:
    """Puts parked cars into a share of the bays; whether a bay is taken, and by what, depends on the bay alone.

    Args:
        town: Where.
        world: What they are spawned into; bays too near to somebody already there stay free.
        draws: Root of the drive's draws.
        share: Of bays taken, 0 to 1.

    Returns:
        Their rows in the world.
    """
    draws = draws.stream("parked")
    if share <= 0.0:
        return np.zeros(0, np.int64)
    bays = parking_bays(town)
    last = max((bay.number for bay in bays), default=-1)
    taken, model, backed = (draws.stream(name).uniform(0, last + 1) for name in ("taken", "blueprint", "backed"))
    wanted = [bay for bay in bays if taken[bay.number] < share]
    cars = [(bay, kind) for bay in _free(wanted, world) if (kind := _choose(bay, model[bay.number])) is not None]
    if not cars:
        return np.zeros(0, np.int64)
    ids = [int(ActorIds.PARKED) + bay.number for bay, _ in cars]
    return world.spawn_many(
        ids,
        [kind for _, kind in cars],
        np.array([bay.position for bay, _ in cars]),
        np.array([bay.yaw + np.pi * (bay.is_slot and backed[bay.number] < _REVERSED) for bay, _ in cars]),
        Role.PARKED,
        [kind.colour(draws, number) for number, (_, kind) in zip(ids, cars, strict=True)],
    )


def _lane_bays(town: TownMap) -> Iterator[Bay]:
    """Bays one behind the other along parking lanes, in their middle, as wide as the lane is all along."""
    lanes, number = town.lanes, 0
    for lane in np.flatnonzero(lanes.type == LaneType.PARKING):
        count = int(lanes.length[lane] // BAY_LENGTH)
        first = (lanes.length[lane] - count * BAY_LENGTH) / 2.0
        rows = slice(lanes.first[lane], lanes.first[lane + 1])
        along = np.arange(rows.stop - rows.start) * lanes.step[lane]
        for k in range(count):
            middle = first + (k + 0.5) * BAY_LENGTH
            near = np.abs(along - middle) <= BAY_LENGTH / 2.0
            x, y, z, yaw = (float(v) for v in town.centre(np.array([lane]), np.array([middle]))[0, :4])
            aside = (lanes.points[rows][near, :2] - (x, y)) @ np.array([-np.sin(yaw), np.cos(yaw)])
            # In a bend the lane runs aside of a straight car: what is left between its edges.
            left, right = (aside - lanes.width[rows][near] / 2.0).max(), (aside + lanes.width[rows][near] / 2.0).min()
            shift = (left + right) / 2.0
            position = (x - shift * np.sin(yaw), y + shift * np.cos(yaw), z)
            yield Bay(number, position, yaw, BAY_LENGTH, float(right - left), is_slot=False)
            number += 1


def _slot_bays(town: TownMap) -> Iterator[Bay]:
    """Spaces drawn as objects; the ground is that of the nearest lane."""
    if not town.parking:
        return
    start = int(np.sum(town.lanes.length[town.lanes.type == LaneType.PARKING] // BAY_LENGTH))
    places = np.array([(slot.x, slot.y) for slot in town.parking])
    heights = town.nearest(places).points[:, 2]
    for k, slot in enumerate(town.parking):
        z = float(heights[k]) if np.isfinite(heights[k]) else 0.0
        # A slot has no line of kerb: its length is taken to the full, so the gap at the ends is added here.
        yield Bay(start + k, (slot.x, slot.y, z), slot.yaw, slot.length + _GAP / 2.0, slot.width, is_slot=True)


def _on_driving_lane(town: TownMap, bays: list[Bay]) -> NDArray[np.bool_]:
    """(B,) whether a car as large as the bay would stand on a driving lane."""
    inset = 2.0 * _OVER_LINE
    corners = _outlines(bays, -_GAP - inset, -_SIDE - inset)
    sides = np.linspace(corners, np.roll(corners, -1, axis=1), 5, axis=2)[:, :, :-1].reshape(len(bays), -1, 2)
    inside = town.nearest(sides.reshape(-1, 2)).inside.reshape(len(bays), -1)
    below = np.any(inside, axis=1)
    return below if not below.any() else below & _same_level(town, bays)


def _same_level(town: TownMap, bays: list[Bay]) -> NDArray[np.bool_]:
    """(B,) whether the nearest driving lane lies at the bay's height: a bridge above does not matter."""
    positions = np.array([bay.position for bay in bays])
    return np.abs(town.nearest(positions).points[:, 2] - positions[:, 2]) < LEVEL_GAP


@lru_cache(maxsize=1024)
def _fitting(length: float, width: float) -> tuple[Blueprint, ...]:
    """Cars of background traffic that a space of that size takes."""
    return tuple(
        kind
        for kind in BLUEPRINTS.values()
        if kind.weight > 0.0 and not kind.is_emergency and kind.actor_class in _PARKED_CLASSES
        and kind.size[0] <= length and kind.size[1] <= width
    )  # fmt: skip


def _choose(bay: Bay, unit: float) -> Blueprint | None:
    """A car that fits, by the weights of background traffic and a draw in [0, 1); None where none does."""
    fitting = _fitting(round(bay.length - _GAP, 2), round(bay.width - _SIDE, 2))
    if not fitting:
        return None
    ends = np.cumsum([kind.weight for kind in fitting])
    return fitting[int(np.searchsorted(ends, unit * ends[-1], side="right"))]


def _free(bays: list[Bay], world: World) -> list[Bay]:
    """Those bays where nobody stands."""
    if not bays:
        return []
    rows = np.flatnonzero(world.present[: world.count])
    pose, sizes = world.pose[rows], world.table.sizes[rows]
    others = box_corners(pose[:, 0], pose[:, 1], pose[:, 2], sizes[:, 0], sizes[:, 1])
    spaces = np.asarray(shapely.polygons(_outlines(bays, 0.0, _CLEAR_OF_ACTORS)))
    bodies = np.asarray(shapely.polygons(others))
    bay_of, row_of = shapely.STRtree(bodies).query(spaces, predicate="intersects")
    heights = np.array([bay.position[2] for bay in bays])
    meets = np.abs(world.height[rows][row_of] - heights[bay_of]) < LEVEL_GAP
    taken = set(bay_of[meets].tolist())
    return [bay for k, bay in enumerate(bays) if k not in taken]
