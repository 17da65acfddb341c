"""The world as a structure of arrays, one row an actor, and the step that moves it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ScenarioError
from lavsim.portable_math import snapped
from lavsim.types import ActorClass, Control, Role, VehicleLight
from lavsim.world.actor import Actor
from lavsim.world.blueprints import Blueprint
from lavsim.world.broadphase import build_walls, find_candidates, make_scratch, spread
from lavsim.world.controls import ControlFilter
from lavsim.world.dynamics import (
    FULL_STEER_CURVATURE,
    HANDLING,
    MOST_ACCELERATION,
    REAR_LENGTH,
    STILL,
    speed_after,
    steer_curvature,
)
from lavsim.world.motion import DRIVEN, GONE, RESTING, WALKING, finish, integrate, take_over
from lavsim.world.physics import NO_CONTACTS, Bodies, Physics
from lavsim.world.proximity import box_distance, boxes_overlap
from lavsim.world.publish import quantise
from lavsim.world.snapshot import ANGLE_UNIT, CONTACT_DTYPE, LENGTH_UNIT, ActorTable, Snapshot
from lavsim.world.weather import Weather

_KNOCK_DOWN_IMPULSE = 100.0  # [N s] 1.3 m/s of an adult's mass: more than that and a walker stays down
_AXLE_SHARE = 0.29  # rear axle behind the box centre, as a share of the length: the ego's fit has 1.42 of 4.9 m
_NO_EVENTS = np.zeros(0, dtype=CONTACT_DTYPE)
_PUSH_MARGIN = 1.5  # [m] what a body pushed at 30 m/s may reach in a tick
_GREY = (120, 120, 120)
_CONTROL_LIGHTS = int(VehicleLight.BRAKE | VehicleLight.REVERSE)


class World:
    """State of all actors in float64 and the step that moves it; Snapshots publish it quantised.

    Args:
        walls: Convex footprints `(M, 2)` of what vehicles collide with.
        has_levels: Whether roads have slopes or pass over each other.
        wall_z: (W, 2) bottom and top of each wall [m]; any height if not given.

    Attributes:
        table: What does not change about each row.
        present: (capacity,) whether the row's actor is in the world.
        motion: (capacity,) `DRIVEN`, `WALKING`, `RESTING` or `GONE`.
        pose: (capacity, 3) x, y [m], yaw [rad].
        height: (capacity,) z of the ground below [m].
        pitch: (capacity,) of the ground below along the heading, nose up [rad].
        velocity: (capacity, 3) vx, vy [m/s], yaw rate [rad/s] in the world frame.
        body: (capacity, 3) speed ahead, slide to the right [m/s], yaw rate.
        command: (capacity, 2) see `lavsim.world.motion.integrate`.
        lights: (capacity,) `VehicleLight` bits.
        doors: (capacity,) `VehicleDoor` bits of doors that stand open.
        touched: (capacity,) tick of the last contact, -1 for none.
        grip: Share of a dry road's grip, see `lavsim.world.dynamics.road_grip`.
    """

    def __init__(
        self,
        walls: Sequence[NDArray[np.float64]] = (),
        has_levels: bool = False,
        wall_z: NDArray[np.float64] | None = None,
    ) -> None:
        self.count = 0
        self.tick = 0
        self.grip = 1.0
        self.present = np.zeros(0, dtype=bool)
        self.motion = np.zeros(0, dtype=np.uint8)
        self.pose = np.zeros((0, 3))
        self.height = np.zeros(0)
        self.pitch = np.zeros(0)
        self.velocity = np.zeros((0, 3))
        self.body = np.zeros((0, 3))
        self.command = np.zeros((0, 2))
        self.lights = np.zeros(0, dtype=np.int32)
        self.doors = np.zeros(0, dtype=np.int32)
        self.touched = np.zeros(0, dtype=np.int64)
        self._loose = np.zeros(0, dtype=bool)
        self._limits = np.zeros((0, 3))
        self._half = np.zeros((0, 2))
        self._mass = np.zeros(0)
        self._rear = np.zeros(0)
        self._gait = np.zeros(0)
        self._move = np.zeros((0, 3))
        self._found = np.zeros(0, dtype=bool)
        self._walls = build_walls(walls, wall_z)
        self._scratch = make_scratch(0)
        self._physics = Physics(self._walls, has_levels)
        self._has_levels = has_levels
        self._contacts = NO_CONTACTS
        self._unsettled = np.zeros(0, dtype=np.int64)
        self._table, self._new_rows = ActorTable.empty(), list[dict[str, Any]]()
        self._rows: NDArray[np.int32] | None = None
        self._weather = Weather()
        self._weather_values = self._weather.to_array()
        self._filter = ControlFilter()
        self._control_values = np.zeros(5, np.float32)
        self._ego_motion = np.zeros(6)

    @property
    def table(self) -> ActorTable:
        if self._new_rows:
            self._table, self._new_rows = self._table.extended(self._new_rows), []
        return self._table

    @property
    def half_sizes(self) -> NDArray[np.float64]:
        """(N, 2) half length and half width of each row's box [m]; 0 for what nothing can touch."""
        return self._half[: self.count]

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
        colour: tuple[int, int, int] = _GREY,
    ) -> Actor:
        """Adds an actor standing at `position` (x, y, z) [m].

        Raises:
            ScenarioError: an actor of a hazard would overlap one that is there.
        """
        if role in (Role.SCENARIO, Role.PROP) and blueprint.is_solid:
            self._check_room(blueprint, position, yaw)
        rows = self.spawn_many([actor_id], [blueprint], np.asarray(position)[None], np.array([yaw]), role, [colour])
        return Actor(self, int(rows[0]))

    def spawn_many(
        self,
        actor_ids: Sequence[int],
        blueprints: Sequence[Blueprint],
        positions: NDArray[np.float64],
        yaws: NDArray[np.float64],
        role: Role,
        colours: Sequence[tuple[int, int, int]],
    ) -> NDArray[np.int64]:
        """Adds actors standing at `positions` (K, 3) [m] with headings `yaws` (K,) [rad]; the caller sees to room.

        Returns:
            Their rows (K,).
        """
        rows = np.arange(self.count, self.count + len(actor_ids))
        self._grow(len(rows))
        self._new_rows += [
            {"id": actor_id, "class": kind.actor_class, "role": role, "size": kind.size, "colour": colour,
             "blueprint": kind.name}
            for actor_id, kind, colour in zip(actor_ids, blueprints, colours, strict=True)
        ]  # fmt: skip
        self.present[rows] = True
        self.motion[rows] = [_motion_of(kind.actor_class, role) for kind in blueprints]
        # Some library worked out where they stand: the last bits, in which libraries differ, are dropped.
        positions, yaws = snapped(positions), snapped(yaws)
        self.pose[rows, :2], self.pose[rows, 2], self.height[rows] = positions[:, :2], yaws, positions[:, 2]
        sizes = np.array([kind.size for kind in blueprints]).reshape(-1, 3)
        solid = np.array([kind.is_solid for kind in blueprints])
        self._half[rows] = np.where(solid[:, None], sizes[:, :2] / 2.0, 0.0)  # a row without a box meets nobody
        self._mass[rows] = [kind.mass for kind in blueprints]
        self._rear[rows] = REAR_LENGTH if role == Role.EGO else _AXLE_SHARE * sizes[:, 0]
        handling = [HANDLING.get(kind.actor_class, STILL) for kind in blueprints]
        # The ego's pedals have their own fit, whose brake is stronger than what other drivers may ask for.
        change = np.inf if role == Role.EGO else MOST_ACCELERATION
        self._limits[rows] = np.array([(change, h.curvature, h.lateral) for h in handling]).reshape(-1, 3)
        self._rows = None
        return rows

    def remove(self, actor: Actor) -> None:
        """Takes an actor out; its id is not used again."""
        if self.present[actor.row]:
            self.present[actor.row] = False
            self.motion[actor.row] = GONE
            self._unsettled = self._unsettled[self._unsettled != actor.row]
            self._rows = None

    def drive_ego(self, control: Control, disturbance: tuple[float, float] = (0.0, 0.0)) -> None:
        """Sets what the ego does in the next step; the values are those of the log (float32).

        Args:
            control: What its agent asks for; snapshots and logs show this.
            disturbance: What a hazard adds to throttle and steer.
        """
        control = self._filter.clean(control)
        brake = 1.0 if control.hand_brake else control.brake
        self._control_values = np.array(
            [control.throttle, control.steer, control.brake, control.hand_brake, control.reverse], np.float32
        )
        throttle, steer = control.throttle, control.steer
        if disturbance != (0.0, 0.0):
            throttle = min(max(throttle + disturbance[0], 0.0), 1.0)
            steer = min(max(steer + disturbance[1], -1.0), 1.0)
        kind = HANDLING[self._ego_class]
        self.command[0, 0] = speed_after(
            self.body[0, 0], throttle, brake, control.reverse,
            kind.acceleration * self.grip, kind.braking * self.grip, kind.top_speed,
        )  # fmt: skip
        self.command[0, 1] = steer_curvature(steer) * (kind.curvature / FULL_STEER_CURVATURE)
        lights = int(VehicleLight.BRAKE if brake > 0.0 else 0) | int(VehicleLight.REVERSE if control.reverse else 0)
        self.lights[0] = (self.lights[0] & ~_CONTROL_LIGHTS) | lights

    def step(self) -> None:
        """Moves everything by one tick."""
        n = self.count
        motion, pose, velocity, move = self.motion[:n], self.pose[:n], self.velocity[:n], self._move[:n]
        before = velocity[0, :2].copy()
        integrate(
            motion, pose, self.body[:n], self._loose[:n], self.command[:n], self._limits[:n], self._rear[:n],
            self.grip, move, velocity,
        )  # fmt: skip
        near = find_candidates(
            motion, pose, move, self._half[:n], self.height[:n], self._walls, self._scratch, self._found[:n]
        )
        self.tick += 1
        self._contacts = NO_CONTACTS
        pose += move
        if near or len(self._unsettled):
            self._resolve()
        finish(motion, self.body[:n], self._gait[:n], pose, velocity, before, self._ego_motion)

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
        if weather is not self._weather:
            self._weather, self._weather_values = weather, weather.to_array()
        if self._rows is None:
            self._rows = np.flatnonzero(self.present[: self.count]).astype(np.int32)
        pose, velocity, state = quantise(
            self._rows, self.pose, self.height, self.velocity, self.motion, self.lights, self.doors, self._gait,
            weather.calls_for_lights,
        )  # fmt: skip
        if self._has_levels:
            pose[:, 4] = np.rint(snapped(self.pitch[self._rows]) / ANGLE_UNIT)
        return Snapshot(
            tick=self.tick,
            table=self.table,
            rows=self._rows,
            pose=pose,
            velocity=velocity,
            state=state,
            ego_motion=self._ego_motion.astype(np.float32),
            control=self._control_values,
            lights=lights,
            contacts=self._contact_events(),
            weather_values=self._weather_values,
            hazards=hazards,
        )

    @property
    def _ego_class(self) -> ActorClass:
        return ActorClass(int(self.table.classes[0]))

    def _resolve(self) -> None:
        """Lets the engine move whoever may touch something; its poses and velocities hold for those that did."""
        n = self.count
        found = self._found[:n]
        found[self._unsettled] = True
        spread(self.pose[:n], self._scratch.reach[:n], _PUSH_MARGIN, found)
        bodies = Bodies(
            self.motion[:n], self.pose[:n], self._move[:n], self.velocity[:n], self._half[:n], self._mass[:n],
            self.height[:n],
        )  # fmt: skip
        decided, self._unsettled, self._contacts = self._physics.step(np.flatnonzero(found), self._unsettled, bodies)
        if len(decided):
            self._take_over(decided)

    def _take_over(self, rows: NDArray[np.int64]) -> None:
        """What the engine decided about `rows` becomes their state."""
        n, touching = self.count, self._contacts.rows
        take_over(rows, self.pose[:n], self.velocity[:n], self.command[:n], self.body[:n], self._loose[:n])
        self.touched[touching[touching >= 0]] = self.tick
        self._knock_down()

    def _knock_down(self) -> None:
        """Walkers hit by more than their own momentum fall; who merely runs into something stays up."""
        for side in self._contacts.rows.T:
            hit = (side >= 0) & (self.motion[side] == WALKING)
            rows = side[hit]
            own = self._mass[rows] * np.sqrt(self.command[rows, 0] ** 2 + self.command[rows, 1] ** 2)
            self.motion[rows[self._contacts.impulse[hit] > _KNOCK_DOWN_IMPULSE + own]] = RESTING

    def _contact_events(self) -> NDArray[np.void]:
        if not len(self._contacts.rows):
            return _NO_EVENTS
        events = np.zeros(len(self._contacts.rows), dtype=CONTACT_DTYPE)
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
        for row in np.flatnonzero(near & self.present[:n] & (self._half[:n, 0] > 0.0)):
            other = Actor(self, int(row))
            if boxes_overlap(pose, size, other.box_pose, other.size):
                raise ScenarioError(
                    f"{blueprint.name} at ({pose[0]:.1f}, {pose[1]:.1f}) would overlap actor {other.id} "
                    f"({self.table.blueprints[other.row]})."
                )

    def _grow(self, more: int) -> None:
        self.count += more
        if self.count <= len(self.present):
            return
        capacity = max(64, 2 * len(self.present), self.count)
        for name in ("present", "motion", "pose", "height", "pitch", "velocity", "body", "command", "lights", "doors",
                     "touched", "_loose", "_limits", "_half", "_mass", "_rear", "_gait", "_move",
                     "_found"):  # fmt: skip
            old: NDArray[Any] = getattr(self, name)
            new = np.zeros((capacity, *old.shape[1:]), dtype=old.dtype)
            new[: len(old)] = old
            if name == "touched":
                new[len(old) :] = -1
            setattr(self, name, new)
        self._scratch = make_scratch(capacity)


def _motion_of(actor_class: ActorClass, role: Role) -> int:
    if actor_class == ActorClass.WALKER:
        return WALKING
    if role in (Role.EGO, Role.TRAFFIC, Role.SCENARIO) and actor_class.is_vehicle:
        return DRIVEN
    return RESTING
