"""The class ids of CARLA from 0.9.14 on, for agents that were trained with them; `Tag` has those up to 0.9.13."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.render.solids import Solids
from lavsim.types import ActorClass, Tag
from lavsim.world.snapshot import Snapshot

TAG_TABLES = ("old", "new")

# Source: reference `carla.md` 6.1, the right-hand column; a vehicle of no known kind is a car.
_NEW = {
    Tag.NONE: 0, Tag.BUILDING: 3, Tag.FENCE: 5, Tag.OTHER: 22, Tag.PEDESTRIAN: 12, Tag.POLE: 6, Tag.ROAD_LINE: 24,
    Tag.ROAD: 1, Tag.SIDEWALK: 2, Tag.VEGETATION: 9, Tag.VEHICLE: 14, Tag.WALL: 4, Tag.TRAFFIC_SIGN: 8, Tag.SKY: 11,
    Tag.GROUND: 25, Tag.BRIDGE: 26, Tag.RAIL_TRACK: 27, Tag.GUARD_RAIL: 28, Tag.TRAFFIC_LIGHT: 7, Tag.STATIC: 20,
    Tag.DYNAMIC: 21, Tag.WATER: 23, Tag.TERRAIN: 10,
}  # fmt: skip
_RIDER = 13
_VEHICLE = {
    ActorClass.CAR: 14, ActorClass.VAN: 14, ActorClass.TRUCK: 15, ActorClass.BUS: 16, ActorClass.MOTORCYCLE: 18,
    ActorClass.BICYCLE: 19,
}  # fmt: skip

NEW_TAG: NDArray[np.uint8] = np.zeros(256, np.uint8)
for _old, _new in _NEW.items():
    NEW_TAG[_old] = _new

_NEW_OF_CLASS = np.tile(NEW_TAG, (len(ActorClass), 1))
for _kind, _new in _VEHICLE.items():
    _NEW_OF_CLASS[_kind, Tag.VEHICLE], _NEW_OF_CLASS[_kind, Tag.PEDESTRIAN] = _new, _RIDER


def new_tags(actors: Solids, snapshot: Snapshot) -> NDArray[np.uint8]:
    """(K,) ids of the actors' solids by the new table, which tells kinds of vehicles and their riders apart."""
    order = np.argsort(snapshot.ids)
    row = order[np.searchsorted(snapshot.ids, actors.instance, sorter=order)]
    return _NEW_OF_CLASS[snapshot.classes[row], actors.tag]
