"""The world as a structure of arrays, one row an actor, and the step that moves it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ScenarioError
from lavsim.types import DT, ActorClass, Control, Role, VehicleLight
from lavsim.world.blueprints import Blueprint
from lavsim.world.dynamics import DRIVEN, GONE, REAR_LENGTH, RESTING, WALKING, integrate, speed_after, steer_curvature
from lavsim.world.physics import NO_CONTACTS, Physics
from lavsim.world.proximity import box_distance, boxes_overlap
from lavsim.world.snapshot import (
    CONTACT_DTYPE,
    LENGTH_UNIT,
    ActorTable,
    Snapshot,
    quantise_poses,
    quantise_velocities,
)
from lavsim.world.weather import Weather

_KNOCK_DOWN_IMPULSE = 100.0  # [N s] 1.3 m/s of an adult's mass: more than that and a walker stays down
_SLIDE_THRESHOLD = 0.3  # [m/s] sideways motion below which tyres hold again after a contact
_AXLE_SHARE = 0.29  # rear axle behind the box centre, as a share of the length: the ego's fit has 1.42 of 4.9 m
_STRIDE = 0.75  # [m] of a walker; sets its gait


@dataclass(frozen=True)
class Actor:
    """A thin view of one row for authors of hazards."""

    world: World
    row: int

    @property
    def id(self) -> int:
        return int(self.world.table.ids[self.row])

    @property
    def xy(self) -> NDArray[np.float64]:
        return self.world.pose[self.row, :2].copy()

    @property
    def yaw(self) -> float:
        return float(self.world.pose[self.row, 2])

    @property
    def speed(self) -> float:
        """Speed over ground [m/s]."""
        return float(np.hypot(*self.world.velocity[self.row, :2]))

    @property
    def size(self) -> NDArray[np.float32]:
        return self.world.table.sizes[self.row]

    @property
    def is_present(self) -> bool:
        return bool(self.world.present[self.row])

    @property
    def box_pose(self) -> tuple[float, float, float, float]:
        """x, y, z [m] and yaw [rad] as `lavsim.world.proximity` takes them."""
        x, y, yaw = self.world.pose[self.row]
        return float(x), float(y), float(self.world.height[self.row]), float(yaw)

    def walk(self, velocity: NDArray[np.float64]) -> None:
        """Walks with `velocity` (x, y) [m/s] until told otherwise; whoever was knocked down stays down."""
        if self.world.motion[self.row] == WALKING:
            self.world.command[self.row] = velocity

    def remove(self) -> None:
        self.world.remove(self)


class World:
    """State of all actors in float64 and the step that moves it; Snapshots publish it quantised.

    Args:
        walls: Convex footprints `(M, 2)` of what vehicles collide with.
        has_levels: Whether roads pass over each other.

    Attributes:
        table: What does not change about each row.
        present: (capacity,) whether the row's actor is in the world.
        motion: (capacity,) `DRIVEN`, `WALKING`, `RESTING` or `GONE`.
        pose: (capacity, 3) x, y [m], yaw [rad].
        height: (capacity,) z of the ground below [m].
        velocity: (capacity, 3) vx, vy [m/s], yaw rate [rad/s] in the world frame.
        body: (capacity, 3) speed ahead, slide to the right [m/s], yaw rate.
        command: (capacity, 2) see `lavsim.world.dynamics.integrate`.
        lights: (capacity,) `VehicleLight` bits.
        touched: (capacity,) tick of the last contact, -1 for none.
    """

    def __init__(self, walls: Sequence[NDArray[np.float64]] = (), has_levels: bool = False) -> None:
        self.table = ActorTable.empty()
        self.count = 0
        self.tick = 0
        self._physics = Physics(walls, has_levels)
        self._contacts = NO_CONTACTS
        self._rear = np.zeros(0)
        self._gait = np.zeros(0)
        self.present = np.zeros(0, dtype=bool)
        self.motion = np.zeros(0, dtype=np.uint8)
        self.pose = np.zeros((0, 3))
        self.height = np.zeros(0)
        self.velocity = np.zeros((0, 3))
        self.body = np.zeros((0, 3))
        self.command = np.zeros((0, 2))
        self.lights = np.zeros(0, dtype=np.int32)
        self.touched = np.zeros(0, dtype=np.int64)
        self._move = np.zeros((0, 5))
        self._control = Control()
        self._ego_motion = np.zeros(6)

    @property
    def ego(self) -> Actor:
        return Actor(self, 0)

    def spawn(
        self,
        actor_id: int,
        blueprint: Blueprint,
        position: NDArray[np.float64],
        yaw: float,
        role: Role,
        colour: tuple[int, int, int] = (120, 120, 120),
    ) -> Actor:
        """Adds an actor standing at `position` (x, y, z) [m].

        Raises:
            ScenarioError: an actor of a hazard would overlap one that is there.
        """
        if role in (Role.SCENARIO, Role.PROP):
            self._check_room(blueprint, position, yaw)
        row = self.count
        self._grow()
        self.table = self.table.extended(
            [{"id": actor_id, "class": blueprint.actor_class, "role": role, "size": blueprint.size,
              "colour": colour, "blueprint": blueprint.name}]
        )  # fmt: skip
        length, width, _ = blueprint.size
        self.present[row] = True
        self.motion[row] = _motion_of(blueprint.actor_class, role)
        self.pose[row] = (position[0], position[1], yaw)
        self.height[row] = position[2]
        self._rear[row] = REAR_LENGTH if role == Role.EGO else _AXLE_SHARE * length
        self._physics.add(row, position[0], position[1], yaw, length, width, blueprint.mass)
        return Actor(self, row)

    def remove(self, actor: Actor) -> None:
        """Takes an actor out; its id is not used again."""
        if self.present[actor.row]:
            self.present[actor.row] = False
            self.motion[actor.row] = GONE
            self._physics.remove(actor.row)

    def drive_ego(self, control: Control) -> None:
        """Sets what the ego does in the next step; the values are those of the log (float32)."""
        self._control = control
        brake = 1.0 if control.hand_brake else control.brake
        self.command[0] = (
            speed_after(self.body[0, 0], control.throttle, brake, control.reverse),
            steer_curvature(control.steer),
        )
        lights = VehicleLight.BRAKE if brake > 0.0 else VehicleLight.NONE
        self.lights[0] = lights | (VehicleLight.REVERSE if control.reverse else VehicleLight.NONE)

    def step(self) -> None:
        """Moves everything by one tick."""
        n = self.count
        before = self.velocity[0, :2].copy()
        move = self._move[:n]
        integrate(self.motion[:n], self.pose[:n], self.body[:n], self.command[:n], self._rear[:n], move)
        self.velocity[:n, :2] = move[:, 3:]
        self.velocity[:n, 2] = move[:, 2] / DT
        decided, self._contacts = self._physics.step(self.pose[:n], move[:, :3], self.velocity[:n], self.height[:n])
        self.tick += 1
        if len(decided):
            self._take_over(decided)
        walking = self.motion[:n] == WALKING
        self._gait[:n][walking] += np.abs(self.body[:n, 0][walking]) * DT / _STRIDE
        self._measure_ego(before)

    def distance(self, first: Actor, second: Actor) -> float:
        """Shortest distance between the boxes of two actors [m]."""
        return box_distance(first.box_pose, first.size, second.box_pose, second.size)

    def publish(
        self,
        lights: NDArray[np.uint8],
        weather: Weather,
        hazards: NDArray[np.void],
    ) -> Snapshot:
        """The state of this tick, quantised."""
        rows = np.flatnonzero(self.present[: self.count]).astype(np.int32)
        pose = self.pose[rows]
        xyz = np.column_stack([pose[:, :2], self.height[rows]])
        velocity = np.column_stack([self.velocity[rows, :2], np.zeros(len(rows))])
        gait = np.floor(np.mod(self._gait[rows], 1.0) * 256.0).astype(np.int32)
        control = self._control
        return Snapshot(
            tick=self.tick,
            table=self.table,
            rows=rows,
            pose=quantise_poses(xyz, pose[:, 2], np.zeros(len(rows))),
            velocity=quantise_velocities(velocity),
            state=np.column_stack([self.lights[rows], np.zeros(len(rows), np.int32), gait]).astype(np.int32),
            ego_motion=self._ego_motion.astype(np.float32),
            control=np.array(
                [control.throttle, control.steer, control.brake, control.hand_brake, control.reverse], np.float32
            ),
            lights=lights,
            contacts=self._contact_events(),
            weather_values=weather.to_array(),
            hazards=hazards,
        )

    def _take_over(self, rows: NDArray[np.int64]) -> None:
        """After a contact the engine's velocities hold; tyres then bring the bodies back to rolling."""
        touching = np.zeros(self.count, dtype=bool)
        touching[self._contacts.rows[self._contacts.rows >= 0]] = True
        yaw = self.pose[rows, 2]
        cos, sin = np.cos(yaw), np.sin(yaw)
        vx, vy = self.velocity[rows, 0], self.velocity[rows, 1]
        aside = -vx * sin + vy * cos
        self.body[rows, 0] = vx * cos + vy * sin
        self.body[rows, 1] = np.where(np.abs(aside) > _SLIDE_THRESHOLD, aside, 0.0)
        self.body[rows, 2] = self.velocity[rows, 2]
        self.touched[: self.count][touching] = self.tick
        for (first, second), impulse in zip(self._contacts.rows, self._contacts.impulse, strict=True):
            for row in (first, second):
                if row >= 0 and self.motion[row] == WALKING and impulse > _KNOCK_DOWN_IMPULSE:
                    self.motion[row] = RESTING

    def _measure_ego(self, before: NDArray[np.float64]) -> None:
        """Acceleration and rotation rates in the ego's frame, from this tick and the last."""
        acceleration = (self.velocity[0, :2] - before) / DT
        cos, sin = np.cos(self.pose[0, 2]), np.sin(self.pose[0, 2])
        self._ego_motion[0] = acceleration[0] * cos + acceleration[1] * sin
        self._ego_motion[1] = -acceleration[0] * sin + acceleration[1] * cos
        self._ego_motion[5] = self.velocity[0, 2]

    def _contact_events(self) -> NDArray[np.void]:
        events = np.zeros(len(self._contacts), dtype=CONTACT_DTYPE)
        if len(events):
            ids = np.append(self.table.ids, 0)  # row -1: the static world has id 0
            events["a"], events["b"] = ids[self._contacts.rows[:, 0]], ids[self._contacts.rows[:, 1]]
            events["impulse"] = self._contacts.impulse
            events["x"], events["y"] = np.rint(self._contacts.point / LENGTH_UNIT).T
        return events

    def _check_room(self, blueprint: Blueprint, position: NDArray[np.float64], yaw: float) -> None:
        size = np.array(blueprint.size)
        pose = (float(position[0]), float(position[1]), float(position[2]), yaw)
        n = self.count
        near = np.hypot(self.pose[:n, 0] - pose[0], self.pose[:n, 1] - pose[1]) < 20.0
        for row in np.flatnonzero(near & self.present[:n]):
            other = Actor(self, int(row))
            if boxes_overlap(pose, size, other.box_pose, other.size):
                raise ScenarioError(
                    f"{blueprint.name} at ({pose[0]:.1f}, {pose[1]:.1f}) would overlap actor {other.id} "
                    f"({self.table.blueprints[other.row]})."
                )

    def _grow(self) -> None:
        self.count += 1
        if self.count <= len(self.present):
            return
        capacity = max(64, 2 * len(self.present))
        for name in ("present", "motion", "pose", "height", "velocity", "body", "command", "lights", "touched",
                     "_rear", "_gait", "_move"):  # fmt: skip
            old: NDArray[Any] = getattr(self, name)
            new = np.zeros((capacity, *old.shape[1:]), dtype=old.dtype)
            new[: len(old)] = old
            if name == "touched":
                new[len(old) :] = -1
            setattr(self, name, new)


def _motion_of(actor_class: ActorClass, role: Role) -> int:
    if actor_class == ActorClass.WALKER:
        return WALKING
    if role in (Role.EGO, Role.TRAFFIC) or (role == Role.SCENARIO and actor_class.is_vehicle):
        return DRIVEN
    return RESTING
