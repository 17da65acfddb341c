"""LiDAR by ray casting: the leaderboard's by default, any other by its attributes, and its semantic sister."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.hits import describe
from lavsim.render.scene import Scene
from lavsim.render.sweep import LidarModel, Sweep, cast_columns, cast_sweep, collect, new_scratch, send_beams
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorConfig, attribute
from lavsim.world.snapshot import Snapshot

MOST_BEAMS = 4_000_000  # of one tick
MOTION_PARTS = 10  # moments of a tick at which a moving sensor looks
SEMANTIC_DTYPE = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("CosAngle", "<f4"), ("ObjIdx", "<u4"), ("ObjTag", "<u4")]
)


@dataclass(frozen=True)
class LidarConfig(SensorConfig):
    """Attributes by CARLA's names, which the leaderboard fixes; the last three are ours.

    Attributes:
        channels: Beams above each other.
        reach: How far it sees [m] (`range`).
        points_per_second: Over all channels, before drop-off.
        rotation_frequency: [Hz].
        upper_fov, lower_fov: Elevations of the outermost beams [deg].
        horizontal_fov: Sector that is swept, ahead [deg].
        attenuation: Of intensity with distance [1/m] (`atmosphere_attenuation_rate`).
        general_drop: Share of beams never sent (`dropoff_general_rate`).
        kept_intensity: Returns above this intensity are all kept (`dropoff_intensity_limit`).
        zero_drop: Chance that a return of intensity 0 is lost (`dropoff_zero_intensity`).
        noise_std: Of the distance, along the ray [m] (`noise_stddev`).
        full_sweep: A tick gives a whole turn.
        motion: Points of a tick are seen one after the other while ego and actors move on.
        rain: Rain loses and adds returns.
    """

    channels: int = attribute("channels", 64)
    reach: float = attribute("range", 85.0)
    points_per_second: int = attribute("points_per_second", 600_000)
    rotation_frequency: float = attribute("rotation_frequency", 10.0)
    upper_fov: float = attribute("upper_fov", 10.0)
    lower_fov: float = attribute("lower_fov", -30.0)
    horizontal_fov: float = attribute("horizontal_fov", 360.0)
    attenuation: float = attribute("atmosphere_attenuation_rate", 0.004)
    general_drop: float = attribute("dropoff_general_rate", 0.45)
    kept_intensity: float = attribute("dropoff_intensity_limit", 0.8)
    zero_drop: float = attribute("dropoff_zero_intensity", 0.4)
    noise_std: float = attribute("noise_stddev", 0.0)
    full_sweep: bool = attribute("full_sweep", False)
    motion: bool = attribute("motion", False)
    rain: bool = attribute("rain", False)

    def problem(self) -> str | None:
        for key, value, low, high in (
            ("channels", self.channels, 1, 1024),
            ("range", self.reach, 0.1, 1000.0),
            ("rotation_frequency", self.rotation_frequency, 0.01, 1000.0),
            ("horizontal_fov", self.horizontal_fov, 0.1, 360.0),
            ("upper_fov", self.upper_fov, self.lower_fov, 89.0),
            ("lower_fov", self.lower_fov, -89.0, self.upper_fov),
            ("atmosphere_attenuation_rate", self.attenuation, 0.0, 10.0),
            ("dropoff_general_rate", self.general_drop, 0.0, 1.0),
            ("dropoff_intensity_limit", self.kept_intensity, 0.0, 1.0),
            ("dropoff_zero_intensity", self.zero_drop, 0.0, 1.0),
            ("noise_stddev", self.noise_std, 0.0, 100.0),
        ):
            if not low <= value <= high:
                return f"{key!r} must be {low:g} to {high:g}, got {value:g}"
        if not 1 <= self.model.columns * self.channels <= MOST_BEAMS:
            return f"a tick must have 1 to {MOST_BEAMS} beams, got {self.model.columns * self.channels}"
        return None

    @property
    def model(self) -> LidarModel:
        return LidarModel(
            self.channels, self.reach, self.points_per_second, self.rotation_frequency, self.upper_fov, self.lower_fov,
            self.horizontal_fov, self.attenuation, self.general_drop, self.kept_intensity, self.zero_drop,
            self.noise_std, self.full_sweep, self.rain,
        )  # fmt: skip


@SENSORS.register("sensor.lidar.ray_cast")
class Lidar(Sensor):
    """Returns (N, 4) float32: x, y, z [m] in the sensor frame (y right) and intensity, channel by channel.

    At 20 Hz and 10 Hz rotation a tick is half a turn: even ticks sweep the left half, odd ones the right. Agents merge
    two ticks.
    """

    config_type = LidarConfig
    config: LidarConfig

    def __init__(self, config: LidarConfig) -> None:
        super().__init__(config)
        self.model = config.model
        self.history = 1 if config.motion else 0
        self._scratch = new_scratch(self.model)  # written before it is read, so no state

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((None, 4), np.float32, "m, m, m, intensity")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[Any]:
        if self.config.motion and len(history) > 1:
            return self._moving_sweep(history[-2], history[-1], scene, draws).points
        return self.sweep(history[-1], scene, draws).points

    def sweep(self, snapshot: Snapshot, scene: Scene, draws: Draws) -> Sweep:
        """The returns together with what they hit; all beams see one world that stands still."""
        return cast_sweep(
            self.model, self.config.mount.pose(snapshot), snapshot.tick, self.draws(draws), scene.statics,
            scene.actors(snapshot), self._scratch, scene.terrain.heights, snapshot.weather.precipitation / 100.0,
        )  # fmt: skip

    def _moving_sweep(self, before: Snapshot, snapshot: Snapshot, scene: Scene, draws: Draws) -> Sweep:
        """The tick from `before` to `snapshot` in parts; each point is in the sensor's frame of its own moment."""
        room, stream = self._scratch, self.draws(draws)
        send_beams(self.model, snapshot.tick, stream, room)
        marks = np.linspace(0, self.model.columns, min(MOTION_PARTS, self.model.columns) + 1).astype(int).tolist()
        for part in range(len(marks) - 1):
            moment = between(before, snapshot, (part + 0.5) / (len(marks) - 1))
            cast_columns(
                self.model, self.config.mount.pose(moment), snapshot.tick, slice(marks[part], marks[part + 1]),
                scene.statics, scene.place(moment), scene.terrain.heights, room,
            )  # fmt: skip
        return collect(self.model, snapshot.tick, stream, room, snapshot.weather.precipitation / 100.0)


@dataclass(frozen=True)
class SemanticLidarConfig(LidarConfig):
    """A LiDAR whose every beam returns, without noise; what the attributes say of that is ignored, as in CARLA."""

    @property
    def model(self) -> LidarModel:
        return replace(super().model, general_drop=0.0, zero_drop=0.0, noise_std=0.0, feels_rain=False)


@SENSORS.register("sensor.lidar.ray_cast_semantic")
class SemanticLidar(Lidar):
    """Returns (N,) of `SEMANTIC_DTYPE`: x, y, z [m], cosine of incidence, actor id (0 static), `Tag`; 24 bytes each."""

    config_type = SemanticLidarConfig

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((None,), SEMANTIC_DTYPE, "m, m, m, cosine, id, Tag")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[Any]:
        snapshot = history[-1]
        sweep = self.sweep(snapshot, scene, draws)
        pose = self.config.mount.pose(snapshot)
        points = pose.to_world(sweep.points[:, :3].astype(np.float64))
        hits = describe(points, sweep.solids, pose.origin, scene.statics, scene.actors(snapshot), scene.terrain)
        records = np.empty(len(points), SEMANTIC_DTYPE)
        for axis, name in enumerate("xyz"):
            records[name] = sweep.points[:, axis]
        records["CosAngle"], records["ObjIdx"], records["ObjTag"] = hits
        return records


def between(before: Snapshot, after: Snapshot, share: float) -> Snapshot:
    """The world at a share of the tick from `before` to `after`; whoever was not there before stays in place."""
    at = np.searchsorted(before.rows, after.rows)
    known = (at < len(before.rows)) & (before.rows[np.minimum(at, len(before.rows) - 1)] == after.rows)
    back = np.zeros(after.pose.shape, np.int64)
    back[known] = before.pose[at[known]] - after.pose[known].astype(np.int64)
    back[:, 3:] = (back[:, 3:] + 32768) % 65536 - 32768
    return replace(after, pose=(after.pose + np.rint(back * (1.0 - share))).astype(np.int32))
