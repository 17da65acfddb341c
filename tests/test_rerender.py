"""Sensors rendered from a log are those that were rendered live, in any order."""

from pathlib import Path
from typing import Any

import numpy as np

from lavsim.log.reader import LogReader
from lavsim.log.replay import draws_of, recent_of, town_of
from lavsim.log.writer import LogWriter
from lavsim.render.scene import Scene
from lavsim.sensors.base import SensorSuite
from lavsim.sensors.suites import SUITES
from lavsim.simulation import Simulation
from tests.drives import follow, hazard, straight_drive

EYE = {"x": 1.5, "z": 2.4, "width": 64, "height": 48, "fov": 80}
SUITE = (
    *SUITES["lav"],
    {"type": "sensor.lavsim.truth", "id": "truth"},
    {"type": "sensor.camera.rgb", "id": "full", **EYE, "attributes": {"look": "full"}},
    {"type": "sensor.camera.instance_segmentation", "id": "instance", **EYE, "attributes": {"tags": "new"}},
    {"type": "sensor.lavsim.bev", "id": "bev", "attributes": {"past": 2, "layers": "road,vehicle,walker,red,limit"}},
)


class Result:
    def summary(self) -> dict[str, str]:
        return {"ending": "tick limit"}


def as_bytes(value: Any) -> bytes:
    if isinstance(value, dict):
        return b"".join(key.encode() + as_bytes(value[key]) for key in sorted(value))
    return value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()


def test_a_log_renders_to_the_bytes_seen_live(tmp_path: Path) -> None:
    spec = straight_drive(traffic="lav", scenarios=(hazard("DynamicObjectCrossing", 40, distance="20"),))
    simulation = Simulation(spec)
    live = SensorSuite(Scene(simulation.town), SUITE, simulation.draws)
    writer = LogWriter(tmp_path / "a.lavlog")
    writer.start(simulation)
    seen = []
    for _ in range(120):
        snapshot = simulation.snapshot
        readings = live.read(simulation.recent(live.history + 1))
        seen.append({key: as_bytes(data) for key, (_, data) in readings.items()})
        assert {frame for frame, _ in readings.values()} == {snapshot.tick}
        writer.observe(snapshot)
        simulation.tick(follow(simulation.route, snapshot))
    writer.finish(Result())  # type: ignore[arg-type]

    reader = LogReader(tmp_path / "a.lavlog")
    again = SensorSuite(Scene(town_of(reader)), SUITE, draws_of(reader))
    for index in (119, 0, 1, 60, 59, 118, 100):
        readings = again.read(recent_of(reader, index, again.history + 1))
        for key, (_, data) in readings.items():
            assert as_bytes(data) == seen[index][key], (index, key)
