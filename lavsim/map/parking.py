"""Parking spaces drawn as objects beside the road."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lavsim.map.records import Network, ObjectRecord
from lavsim.map.section import RoadShape
from lavsim.map.stop_lines import outline_in_world

MOST_SLOTS = 20_000
MOST_COPIES = 1_000  # of one object


@dataclass(frozen=True, eq=False)
class ParkingSlot:
    """A place to park.

    Attributes:
        polygon: (M, 2) corners [m].
        x, y: Its middle [m].
        yaw: Along its longer side [rad].
        length, width: [m].
    """

    polygon: NDArray[np.float64]
    x: float
    y: float
    yaw: float
    length: float
    width: float


def build_parking(network: Network, shapes: dict[int, RoadShape]) -> tuple[ParkingSlot, ...]:
    """All parking spaces, rows of them told apart."""
    slots: list[ParkingSlot] = []
    for road in network.roads:
        for thing in road.objects:
            if thing.parking:
                for copy in _copies(thing):
                    slot = _slot(outline_in_world(copy, shapes[road.id]))
                    if slot is not None and len(slots) < MOST_SLOTS:
                        slots.append(slot)
    return tuple(slots)


def _copies(thing: ObjectRecord) -> Iterator[ObjectRecord]:
    """The object itself, or what its repeat records make of it."""
    if not thing.repeats:
        yield thing
    for repeat in thing.repeats:
        count = 1
        if repeat.distance > 0.0:
            count += int(min(max(repeat.length, 0.0) / repeat.distance + 1e-6, MOST_COPIES))
        for k in range(count):
            share = min(k * repeat.distance / repeat.length, 1.0) if repeat.length > 0.0 else 0.0
            s, t = repeat.s + k * repeat.distance, repeat.t_start + share * (repeat.t_end - repeat.t_start)
            moved = tuple((a + s - thing.s, b, z) for a, b, z in thing.road_outline)
            yield replace(thing, s=s, t=t, road_outline=moved, repeats=())


def _slot(corners: NDArray[np.float64]) -> ParkingSlot | None:
    """None where the corners span nothing or too much."""
    if len(corners) < 3 or not np.isfinite(corners).all():
        return None
    sides = np.roll(corners, -1, axis=0) - corners
    longest = sides[int(np.argmax(np.hypot(*sides.T)))]
    yaw = float(np.arctan2(longest[1], longest[0]))
    axes = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    local = corners @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    length, width = (high - low).tolist()
    if not (0.1 < width <= length < 100.0):
        return None
    x, y = ((low + high) / 2.0 @ axes).tolist()
    return ParkingSlot(corners, x, y, yaw, length, width)
