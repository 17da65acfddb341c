"""The leaderboard's pseudo sensor that delivers the road network, for MAP tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor
from lavsim.world.snapshot import Snapshot


@SENSORS.register("sensor.opendrive_map")
class OpenDriveMap(Sensor):
    """{"opendrive": OpenDRIVE XML text}, every tick."""

    @property
    def spec(self) -> Mapping[str, ArraySpec]:
        return {"opendrive": ArraySpec((), str, "XML", "text")}

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> dict[str, str]:
        return {"opendrive": scene.town.xodr}
