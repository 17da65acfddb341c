"""The leaderboard's LiDAR: 64 beams, 85 m, half a turn a tick."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.render.sweep import LidarModel, Sweep, cast_sweep, new_scratch
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorConfig
from lavsim.world.snapshot import Snapshot


@SENSORS.register("sensor.lidar.ray_cast")
class Lidar(Sensor):
    """Returns (N, 4) float32: x, y, z [m] in the sensor frame (y right) and intensity, channel by channel.

    At 20 Hz and 10 Hz rotation a tick is half a turn: even ticks sweep the left half, odd ones the right. Agents merge
    two ticks.
    """

    model = LidarModel()

    def __init__(self, config: SensorConfig) -> None:
        super().__init__(config)
        self._scratch = new_scratch(self.model)  # written before it is read, so no state

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((None, 4), np.float32, "m, m, m, intensity")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.float32]:
        return self.sweep(history[-1], scene, draws).points

    def sweep(self, snapshot: Snapshot, scene: Scene, draws: Draws) -> Sweep:
        """The returns together with what they hit."""
        pose = self.config.mount.pose(snapshot)
        actors = scene.actors(snapshot)
        return cast_sweep(
            self.model,
            pose,
            snapshot.tick,
            self.draws(draws),
            scene.statics,
            actors,
            self._scratch,
            scene.terrain.heights,
        )
