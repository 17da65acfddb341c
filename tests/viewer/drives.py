"""A drive made by hand for the viewer: on a straight street, with everything that a replay shows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from lavsim.map.route import Route
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.types import ActorClass, LightState, Role, VehicleLight
from lavsim.viewer.tracks import Tracks, read_tracks
from lavsim.world.snapshot import CONTACT_DTYPE, HAZARD_DTYPE, Snapshot
from tests.drives import TOWN, straight_route
from tests.snapshots import EGO, Body, snapshot_of

TICKS = 200
FIRST = 1  # the first tick's number
CONTACT = 120  # index of the tick at which the ego touches the car ahead
HAZARD = (40, 90)  # indices between which a hazard is active
VISITOR = (30, 80)  # indices between which a bicycle is there
EVIL = '<script>window.evil = 1</script><img src=x onerror="window.evil = 1">'


def town() -> TownMap:
    return load_town(TOWN)


def route() -> Route:
    return straight_route()


def bodies_at(index: int) -> list[Body]:
    """Everybody at a tick; the bicycle comes and goes."""
    points, yaw = route().points, float(route().yaw[10])
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    aside = np.array([-ahead[1], ahead[0]])
    start = points[10, :2]
    time = index * 0.05
    lamp = VehicleLight.BRAKE if index > 100 else VehicleLight.LEFT_BLINKER

    def at(along: float, across: float) -> dict[str, float]:
        x, y = start + along * ahead + across * aside
        return {"x": float(x), "y": float(y), "yaw": yaw}

    return [
        replace(EGO, **at(6.0 * time, 0.0), speed=6.0),
        Body(id=1000, **at(25.0 + 2.0 * time, 0.0), speed=2.0, lights=int(lamp), blueprint=f"vehicle.{EVIL}"),
        Body(id=1001, **at(60.0 - 7.0 * time, -3.5), speed=-7.0, kind=ActorClass.TRUCK, size=(8.0, 2.5, 3.5)),
        Body(id=1002, **at(10.0 + 4.0 * time, 3.0), speed=4.0, kind=ActorClass.BICYCLE, size=(1.8, 0.6, 1.6)),
        Body(id=100000, **at(70.0, -6.0 + 1.2 * time), speed=1.2, kind=ActorClass.WALKER, size=(0.5, 0.5, 1.8)),
        Body(id=200000, **at(18.0, 4.5), role=Role.PARKED, kind=ActorClass.VAN, size=(5.2, 2.0, 2.2)),
        Body(id=1000000, **at(40.0, 2.0), role=Role.SCENARIO, kind=ActorClass.PROP, size=(0.8, 0.8, 1.0)),
    ]


@cache
def snapshots() -> tuple[Snapshot, ...]:
    lights = len(town().lights)
    made = []
    for index in range(TICKS):
        whole = snapshot_of(bodies_at(index), tick=FIRST + index)
        present = np.array([k != 3 or VISITOR[0] <= index < VISITOR[1] for k in range(len(whole.rows))])
        contact = np.zeros(int(CONTACT <= index < CONTACT + 3), CONTACT_DTYPE)
        contact["a"], contact["b"], contact["impulse"] = 1, 1000, 900.0 + index
        contact["x"], contact["y"] = whole.pose[1, 0], whole.pose[1, 1]
        hazard = np.zeros(int(HAZARD[0] <= index < HAZARD[1]), HAZARD_DTYPE)
        state = LightState.GREEN if index < 100 else LightState.RED
        made.append(
            replace(
                whole,
                rows=whole.rows[present],
                pose=whole.pose[present],
                velocity=whole.velocity[present],
                state=whole.state[present],
                control=np.array([0.5, 0.1, 0.8 if index > 110 else 0.0, 0.0, 0.0], np.float32),
                lights=np.full(lights, state, np.uint8),
                contacts=contact,
                hazards=hazard,
            )
        )
    table = made[0].table
    return tuple(replace(snapshot, table=table) for snapshot in made)


@cache
def tracks() -> Tracks:
    return read_tracks(snapshots())


HEADER = {"scenarios": [{"type": "DynamicObjectCrossing"}]}
