"""Contacts of the ego, as events of a tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor
from lavsim.types import ActorClass, Tag
from lavsim.world.snapshot import LENGTH_UNIT, Snapshot

COLLISION_DTYPE = np.dtype(
    [("other_actor", "<i4"), ("tag", "u1"), ("normal_impulse", "<f4", (3,)), ("x", "<f4"), ("y", "<f4")]
)


@SENSORS.register("sensor.other.collision")
class Collision(Sensor):
    """(N,) of `COLLISION_DTYPE`, one row for each actor that the ego touched in the tick; empty in most.

    `other_actor` is its id (0 the static world), `tag` its class, `normal_impulse` what the ego was given, in the world
    frame [N s], x and y the point [m]. The event comes again at each tick of contact, as in CARLA.
    """

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((None,), COLLISION_DTYPE, "id, Tag, N s, m")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[Any]:
        snapshot = history[-1]
        ego = snapshot.ids[0]
        contacts = snapshot.contacts[(snapshot.contacts["a"] == ego) | (snapshot.contacts["b"] == ego)]
        events = np.zeros(len(contacts), COLLISION_DTYPE)
        for event, contact in zip(events, contacts, strict=True):
            other = int(contact["b"] if contact["a"] == ego else contact["a"])
            point = np.array([contact["x"], contact["y"]]) * LENGTH_UNIT
            away = snapshot.xy[0] - point
            event["other_actor"], event["tag"] = other, _tag(snapshot, scene, other, point)
            event["normal_impulse"][:2] = contact["impulse"] * away / max(float(np.hypot(*away)), 1e-6)
            event["x"], event["y"] = point
        return events


def _tag(snapshot: Snapshot, scene: Scene, other: int, point: NDArray[np.float64]) -> Tag:
    if other:
        kind = ActorClass(snapshot.table.classes[snapshot.table.row_of[other]])
        if kind == ActorClass.WALKER:
            return Tag.PEDESTRIAN
        return Tag.VEHICLE if kind.is_vehicle else Tag.DYNAMIC
    statics = scene.statics
    if not len(statics.corners):
        return Tag.NONE
    distance = np.hypot(*(statics.centre - point).T) - statics.radius
    distance[statics.z0 > snapshot.xyz[0, 2] + 3.0] = np.inf
    return Tag(int(statics.tag[np.argmin(distance)]))
