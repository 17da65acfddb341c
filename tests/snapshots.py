"""Snapshots made by hand, for tests that need a world and no traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lavsim.types import ActorClass, Role
from lavsim.world.snapshot import (
    CONTACT_DTYPE,
    ActorTable,
    Snapshot,
    quantise_poses,
    quantise_velocities,
)
from lavsim.world.weather import Weather


@dataclass(frozen=True)
class Body:
    """One actor of a hand-made snapshot; angles in rad, lights as `VehicleLight` bits, gait in 2^-8 step."""

    id: int
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    yaw: float = 0.0
    pitch: float = 0.0
    speed: float = 0.0
    kind: ActorClass = ActorClass.CAR
    role: Role = Role.TRAFFIC
    size: tuple[float, float, float] = (4.5, 1.9, 1.5)
    colour: tuple[int, int, int] = (180, 30, 30)
    blueprint: str = "vehicle.seat.leon"
    lights: int = 0
    doors: int = 0
    gait: int = 0


EGO = Body(id=1, role=Role.EGO, size=(4.902, 2.128, 1.511), colour=(40, 60, 120), blueprint="vehicle.lincoln.mkz_2017")


def snapshot_of(
    bodies: Sequence[Body] = (EGO,),
    tick: int = 0,
    weather: Weather | None = None,
    lights: Sequence[int] = (),
    ego_motion: Sequence[float] = (0.0,) * 6,
) -> Snapshot:
    """A snapshot with `bodies` present, the ego first."""
    rows = [
        {"id": b.id, "class": b.kind, "role": b.role, "size": b.size, "colour": b.colour, "blueprint": b.blueprint}
        for b in bodies
    ]
    yaw = np.array([b.yaw for b in bodies])
    speed = np.array([b.speed for b in bodies])
    velocity = np.stack([speed * np.cos(yaw), speed * np.sin(yaw), 0.0 * speed], axis=1)
    state = np.zeros((len(bodies), 3), np.int32)
    state[:] = [(b.lights, b.doors, b.gait) for b in bodies]
    return Snapshot(
        tick=tick,
        table=ActorTable.empty().extended(rows),
        rows=np.arange(len(bodies), dtype=np.int32),
        pose=quantise_poses(np.array([[b.x, b.y, b.z] for b in bodies]), yaw, np.array([b.pitch for b in bodies])),
        velocity=quantise_velocities(velocity),
        state=state,
        ego_motion=np.array(ego_motion, np.float32),
        control=np.zeros(5, np.float32),
        lights=np.array(lights, np.uint8),
        contacts=np.zeros(0, CONTACT_DTYPE),
        weather_values=(weather or Weather()).to_array(),
    )
