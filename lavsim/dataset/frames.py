"""What a kept frame holds, worked out alike from a running drive and from its log."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.ahead import RouteView
from lavsim.dataset.rig import Readings, Rig
from lavsim.dataset.schema import TICKS_PER_FRAME, RecordConfig
from lavsim.guidance import Guide
from lavsim.map.route import Route
from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import Sensor, make_sensor
from lavsim.sensors.gnss import Gnss
from lavsim.sensors.imu import Imu
from lavsim.sensors.speedometer import Speedometer
from lavsim.types import ActorIds, Control
from lavsim.world.snapshot import Snapshot

STANDING = 0.1  # [m/s] slower is standing (reference `lav.md` 3.2)
NO_WISH = np.full(5, np.nan, np.float32)

S = TypeVar("S", bound=Sensor)


class Keeper:
    """Says which ticks are frames: every fifth, but none once the ego has stood for long.

    Args:
        stand_ticks: Ticks of standing after which nothing is kept.
        first: Tick of the first frame, at the earliest.
    """

    def __init__(self, stand_ticks: int, first: int = 0) -> None:
        self._limit, self._first, self._stood = stand_ticks, first, 0

    def keeps(self, snapshot: Snapshot) -> bool:
        """Takes in a tick; whether it is a frame."""
        self._stood = self._stood + 1 if snapshot.ego.speed < STANDING else 0
        return snapshot.tick >= self._first and snapshot.tick % TICKS_PER_FRAME == 0 and self._stood < self._limit


class FrameMaker:
    """Sees every tick of a drive, in order, and makes the frames of those that are kept.

    Args:
        config: What is recorded.
        route: The dense route.
        scene: What there is to see, with its town.
        draws: Root of the drive's draws.
        first: Tick of the first frame, at the earliest.

    Attributes:
        rig: Its sensors.
    """

    def __init__(self, config: RecordConfig, route: Route, scene: Scene, draws: Draws, first: int = 0) -> None:
        self.rig = Rig(config.suite)
        self._config, self._scene, self._draws, self._first = config, scene, draws, first
        self._gnss = _sensor(config, Gnss, {"type": "sensor.other.gnss", "id": "GPS", "z": 2.4})
        self._imu = _sensor(config, Imu, {"type": "sensor.other.imu", "id": "IMU", "z": 2.4})
        self._speedometer = _sensor(config, Speedometer, {"type": "sensor.speedometer", "id": "EGO"})
        kept = route.thinned(config.plan_spacing)
        self._nodes = route.points[kept, :2]
        self._guide = Guide(route.gps(scene.geo_reference)[kept, :2], route.command[kept].tolist())
        self._view = RouteView(route, scene.town)
        self._recent: deque[Snapshot] = deque(maxlen=self.rig.history + 1)
        self._since: list[Snapshot] = []  # seen since the last kept frame, the newest last
        self._fixes: list[NDArray[np.float64]] = []  # GNSS of each of them
        self._keeper = Keeper(config.stand_ticks, first)

    def see(self, snapshot: Snapshot) -> bool:
        """Takes in a tick; whether it is kept."""
        self._recent.append(snapshot)
        if self._config.tables:
            self._since.append(snapshot)
            fix = self._gnss.read([snapshot], self._scene, self._draws)
            self._fixes.append(fix)
            self._guide.update(fix)
            self._view.update(snapshot)
        if snapshot.tick < self._first:  # a frame tells of its own ticks alone
            del self._since[: 1 - TICKS_PER_FRAME], self._fixes[: 1 - TICKS_PER_FRAME]
        return self._keeper.keeps(snapshot)

    def read(self) -> Readings:
        """The sensors at the tick seen last."""
        return self.rig.read(list(self._recent), self._scene, self._draws)

    def row(self, labels: Mapping[str, Any], wish: Control | None, seen: Readings | None) -> dict[str, Any]:
        """The table's row of the tick seen last, which is kept: what follows counts from it.

        Args:
            labels: What the agent says of its driving (`labels()`); may be empty.
            wish: The control that it asked for at this tick; None if not known.
            seen: What the sensors saw; None if they were not read.
        """
        snapshot = self._since[-1]
        ticks = self._tick_columns()
        guidance = self._guide.now(float(ticks["tick_imu"][-1, 6]))
        row = {
            **_ego_columns(snapshot),
            **_label_columns(labels, wish),
            "command": guidance.command,
            "goal": guidance.goal,
            "next_goal": guidance.next_goal,
            "goal_position": self._nodes[guidance.node],
            **self._view.columns(snapshot),
            "weather": snapshot.weather_values,
            "hazards": snapshot.hazards["index"],
            "contacts": _touched(self._since),
            **ticks,
            **_actor_columns(snapshot, self._config.radius, seen),
        }
        self._since, self._fixes = [], []
        return row

    def _tick_columns(self) -> dict[str, Any]:
        scene, draws, since = self._scene, self._draws, self._since
        return {
            "tick_gnss": np.stack(self._fixes),
            "tick_imu": np.stack([self._imu.read([s], scene, draws) for s in since]).astype(np.float32),
            "tick_speed": np.array([self._speedometer.read([s], scene, draws)["speed"] for s in since], np.float32),
            "tick_control": np.stack([s.control for s in since]),
            "tick_pose": np.array([(*s.xyz[0, :2].tolist(), float(s.yaw[0])) for s in since], np.float64),
        }


def _sensor(config: RecordConfig, kind: type[S], default: Mapping[str, Any]) -> S:
    """The suite's sensor of a type, else the default one."""
    values = next((entry for entry in config.suite if entry.get("type") == default["type"]), default)
    sensor = make_sensor(values)
    assert isinstance(sensor, kind)
    return sensor


def _ego_columns(snapshot: Snapshot) -> dict[str, Any]:
    motion = snapshot.ego_motion
    return {
        "tick": snapshot.tick,
        "position": snapshot.xyz[0],
        "yaw": snapshot.yaw[0],
        "pitch": snapshot.pitch[0],
        "velocity": snapshot.velocities[0],
        "speed": snapshot.ego.forward_speed,
        "acceleration": motion[:3],
        "rotation_rate": motion[3:],
        "control": snapshot.control,
    }


def _label_columns(labels: Mapping[str, Any], wish: Control | None) -> dict[str, Any]:
    """Labels of the agent; where it gives none, a full brake is a stop for a reason unknown, as in LAV's recorder."""
    pedals = NO_WISH if wish is None else wish_values(wish)
    brake = int(labels.get("brake", wish is not None and wish.brake >= 1.0))
    return {
        "wish": pedals,
        "brake": brake,
        "brake_cause": labels.get("brake_cause", "unknown" if brake else "none"),
        "brake_actor": labels.get("brake_actor", 0),
        "target_speed": labels.get("target_speed", np.nan),
    }


def wish_values(control: Control) -> NDArray[np.float32]:
    """(5,) a control as tables and snapshots hold it."""
    return np.array(
        [control.throttle, control.steer, control.brake, control.hand_brake, control.reverse], dtype=np.float32
    )


def _touched(since: list[Snapshot]) -> NDArray[np.int32]:
    """Ids of all that the ego touched in these ticks, ascending."""
    ego, found = int(ActorIds.EGO), [np.zeros(0, np.int32)]
    for snapshot in since:
        contacts = snapshot.contacts
        if len(contacts):
            a, b = contacts["a"], contacts["b"]
            found += [b[a == ego], a[b == ego]]
    return np.unique(np.concatenate(found))


def _actor_columns(snapshot: Snapshot, radius: float, seen: Readings | None) -> dict[str, Any]:
    offset = snapshot.xy - snapshot.xy[0]
    near = np.flatnonzero(np.sum(offset * offset, axis=1) <= radius * radius)
    blueprints = snapshot.table.blueprints
    columns = {
        "actor_id": snapshot.ids[near],
        "actor_class": snapshot.classes[near],
        "actor_role": snapshot.roles[near],
        "actor_blueprint": [blueprints[row] for row in snapshot.rows[near].tolist()],
        "actor_position": snapshot.xyz[near],
        "actor_yaw": snapshot.yaw[near],
        "actor_pitch": snapshot.pitch[near],
        "actor_velocity": snapshot.velocities[near],
        "actor_size": snapshot.sizes[near],
        "actor_lights": snapshot.state[near, 0],
    }
    if seen is not None:
        columns |= {
            "lidar_now": seen.lidar_now,
            "actor_lidar_hits": seen.hits[near],
            "actor_pixels": seen.pixels[near],
        }
    return columns
