"""One tick of the world as frozen arrays: all that sensors, criteria, expert, recorder and video ever see.

Values are quantised when published (x, y, z to 1 mm, angles to 2^-16 turn, speeds to 1 cm/s), while the World keeps
float64. So a log that stores the integers is exactly what was seen live, and everything derived from a Snapshot is the
same bytes live and from the log (DESIGN section 4, "Snapshot").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.types import DT, ActorClass, Role
from lavsim.world.weather import Weather

LENGTH_UNIT = np.float64(1e-3)  # [m]
ANGLE_UNIT = np.float64(2.0 * np.pi / 65536.0)  # [rad]
SPEED_UNIT = np.float64(1e-2)  # [m/s]

CONTACT_DTYPE = np.dtype(
    [("a", "<i4"), ("b", "<i4"), ("impulse", "<f4"), ("x", "<i4"), ("y", "<i4")]  # ids; [N s]; [mm]
)
HAZARD_DTYPE = np.dtype([("index", "<i2"), ("flags", "<u2")])

# Flags of an active hazard.
HAZARD_OWNS_TIMER = 1  # suspends the blocked test and can time out
HAZARD_WRONG_LANE_OFF = 2
HAZARD_EMERGENCY_TEST = 4


@dataclass(frozen=True)
class ActorTable:
    """What does not change about the actors of a drive, one row an actor in order of appearance.

    Attributes:
        ids: (M,) int32; never reused, 0 (the static world) has no row.
        classes: (M,) uint8, `ActorClass`.
        roles: (M,) uint8, `Role`.
        sizes: (M, 3) float32, full length, width, height of the box [m].
        colours: (M, 3) uint8, red, green, blue.
        blueprints: Blueprint name of each row ("vehicle.lincoln.mkz_2017").
    """

    ids: NDArray[np.int32]
    classes: NDArray[np.uint8]
    roles: NDArray[np.uint8]
    sizes: NDArray[np.float32]
    colours: NDArray[np.uint8]
    blueprints: tuple[str, ...]

    @staticmethod
    def empty() -> ActorTable:
        return ActorTable(
            np.zeros(0, np.int32),
            np.zeros(0, np.uint8),
            np.zeros(0, np.uint8),
            np.zeros((0, 3), np.float32),
            np.zeros((0, 3), np.uint8),
            (),
        )

    def extended(self, rows: Sequence[Mapping[str, Any]]) -> ActorTable:
        """This table with `rows` (keys id, class, role, size, colour, blueprint) below; rows keep their numbers."""
        if not rows:
            return self
        return ActorTable(
            np.append(self.ids, [r["id"] for r in rows]).astype(np.int32),
            np.append(self.classes, [r["class"] for r in rows]).astype(np.uint8),
            np.append(self.roles, [r["role"] for r in rows]).astype(np.uint8),
            np.concatenate([self.sizes, np.array([r["size"] for r in rows], np.float32).reshape(-1, 3)]),
            np.concatenate([self.colours, np.array([r["colour"] for r in rows], np.uint8).reshape(-1, 3)]),
            self.blueprints + tuple(r["blueprint"] for r in rows),
        )

    def row(self, number: int) -> dict[str, Any]:
        """Row `number` as `extended` takes it, in JSON types."""
        return {
            "id": int(self.ids[number]),
            "class": int(self.classes[number]),
            "role": int(self.roles[number]),
            "size": [float(v) for v in self.sizes[number]],
            "colour": [int(v) for v in self.colours[number]],
            "blueprint": self.blueprints[number],
        }

    @cached_property
    def row_of(self) -> dict[int, int]:
        """Row number by actor id."""
        return {int(actor): row for row, actor in enumerate(self.ids)}


@dataclass(frozen=True)
class Snapshot:
    """The world at one tick. Actors present are rows 0 … N-1, the ego always row 0.

    Attributes:
        tick: Number of the tick; time is `tick * 0.05 s`.
        table: Actors of the drive so far.
        rows: (N,) int32, row of each present actor in `table`; ascending, ego first.
        pose: (N, 5) int32: x, y, z [mm] (box centre in plan, ground level), yaw, pitch [2^-16 turn].
        velocity: (N, 3) int32: vx, vy, vz in the world frame [cm/s].
        state: (N, 3) int32: vehicle lights (`VehicleLight`), open doors (bit field), a walker's gait phase [2^-8 step].
        ego_motion: (6,) float32: acceleration ahead, right, up [m/s²] without gravity; rotation rate about the
            same axes [rad/s].
        control: (5,) float32: throttle, steer, brake, hand brake, reverse that the agent asked for in the tick that led
            here; what a hazard adds to them is not in it.
        lights: (L,) uint8, `LightState` of each of the town's traffic lights.
        contacts: (C,) of `CONTACT_DTYPE`: pairs that touched in the tick that led here; id 0 is the static world.
        weather_values: (10,) float32, `Weather.to_array`.
        hazards: (H,) of `HAZARD_DTYPE`: active hazards by their index in the route.
        agent_status: 0 driving; other values are the agent failures of `lavsim.agent`.
    """

    tick: int
    table: ActorTable
    rows: NDArray[np.int32]
    pose: NDArray[np.int32]
    velocity: NDArray[np.int32]
    state: NDArray[np.int32]
    ego_motion: NDArray[np.float32]
    control: NDArray[np.float32]
    lights: NDArray[np.uint8]
    contacts: NDArray[np.void]
    weather_values: NDArray[np.float32]
    hazards: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, HAZARD_DTYPE))
    agent_status: int = 0

    def __post_init__(self) -> None:
        for array in (self.rows, self.pose, self.velocity, self.state, self.ego_motion, self.control, self.lights,
                      self.contacts, self.weather_values, self.hazards):  # fmt: skip
            array.flags.writeable = False

    @staticmethod
    def of_parts(parts: dict[str, Any]) -> Snapshot:
        """A snapshot of arrays that are read-only already: for many at a time, four times as fast.

        Args:
            parts: All attributes, and any of the properties below that are known: those aren't computed again.
        """
        snapshot = object.__new__(Snapshot)
        snapshot.__dict__.update(parts)
        return snapshot

    @property
    def time(self) -> float:
        """Simulation time [s]."""
        return self.tick * DT

    @cached_property
    def weather(self) -> Weather:
        return Weather.from_array(self.weather_values)

    @cached_property
    def ids(self) -> NDArray[np.int32]:
        """(N,) actor ids."""
        return self.table.ids[self.rows]

    @cached_property
    def classes(self) -> NDArray[np.uint8]:
        """(N,) `ActorClass`."""
        return self.table.classes[self.rows]

    @cached_property
    def roles(self) -> NDArray[np.uint8]:
        """(N,) `Role`."""
        return self.table.roles[self.rows]

    @cached_property
    def sizes(self) -> NDArray[np.float32]:
        """(N, 3) full length, width, height [m]."""
        return self.table.sizes[self.rows]

    @cached_property
    def xyz(self) -> NDArray[np.float64]:
        """(N, 3) positions [m]: box centre in plan, ground level."""
        return self.pose[:, :3] * LENGTH_UNIT

    @property
    def xy(self) -> NDArray[np.float64]:
        """(N, 2) positions [m]."""
        return self.xyz[:, :2]

    @cached_property
    def yaw(self) -> NDArray[np.float64]:
        """(N,) headings [rad], in [-pi, pi)."""
        return self.pose[:, 3] * ANGLE_UNIT

    @cached_property
    def pitch(self) -> NDArray[np.float64]:
        """(N,) pitch [rad], positive nose up."""
        return self.pose[:, 4] * ANGLE_UNIT

    @cached_property
    def velocities(self) -> NDArray[np.float64]:
        """(N, 3) world velocities [m/s]."""
        return self.velocity * SPEED_UNIT

    @cached_property
    def speeds(self) -> NDArray[np.float64]:
        """(N,) norms of the velocities [m/s]."""
        return np.sqrt(np.sum(self.velocities**2, axis=1))

    @cached_property
    def ego(self) -> EgoState:
        """The ego as plain numbers."""
        x, y, z = self.xyz[0].tolist()
        yaw = float(self.yaw[0])
        vx, vy, _ = self.velocities[0].tolist()
        length, width, height = self.sizes[0].tolist()
        ahead = float(vx * np.cos(yaw) + vy * np.sin(yaw))
        return EgoState(x, y, z, yaw, float(self.speeds[0]), ahead, length, width, height)

    @cached_property
    def traffic_speed(self) -> float | None:
        """Mean speed of background traffic's vehicles [m/s]; None without any."""
        speeds = self.speeds[self.is_background & self.is_vehicle]
        return float(speeds.sum()) / len(speeds) if len(speeds) else None

    def index_of(self, actor: int) -> int | None:
        """Row in this snapshot of the actor with id `actor`; None while it is absent."""
        found = np.flatnonzero(self.ids == actor)
        return int(found[0]) if len(found) else None

    @cached_property
    def is_vehicle(self) -> NDArray[np.bool_]:
        """(N,) whether each actor is a vehicle (two-wheelers included)."""
        return self.classes <= ActorClass.BICYCLE

    @cached_property
    def is_walker(self) -> NDArray[np.bool_]:
        """(N,) whether each actor is a walker."""
        return self.classes == ActorClass.WALKER

    @cached_property
    def is_background(self) -> NDArray[np.bool_]:
        """(N,) whether each actor is background traffic."""
        return self.roles == Role.TRAFFIC


@dataclass(frozen=True)
class EgoState:
    """The ego's part of a snapshot: x, y, z [m] (ground level, box centre), yaw [rad], speeds [m/s], box [m]."""

    x: float
    y: float
    z: float
    yaw: float
    speed: float
    forward_speed: float
    length: float
    width: float
    height: float

    @property
    def xy(self) -> NDArray[np.float64]:
        return np.array([self.x, self.y])

    @property
    def xyz(self) -> NDArray[np.float64]:
        return np.array([self.x, self.y, self.z])


def quantise_poses(xyz: NDArray[np.float64], yaw: NDArray[np.float64], pitch: NDArray[np.float64]) -> NDArray[np.int32]:
    """Pose integers `(N, 5)` of positions [m] and angles [rad]; angles are wrapped to [-2^15, 2^15)."""
    angles = np.rint(np.stack([yaw, pitch], axis=1) / ANGLE_UNIT).astype(np.int64)
    angles = (angles + 32768) % 65536 - 32768
    return np.concatenate([np.rint(xyz / LENGTH_UNIT).astype(np.int64), angles], axis=1).astype(np.int32)


def quantise_velocities(velocity: NDArray[np.float64]) -> NDArray[np.int32]:
    """Velocity integers `(N, 3)` of velocities [m/s]."""
    return np.rint(velocity / SPEED_UNIT).astype(np.int32)
