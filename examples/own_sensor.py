"""A sensor of one's own: how far away the nearest others are in each of twelve directions, read along a drive."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.scene import Scene, get_scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorConfig, SensorSuite, attribute
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control
from lavsim.world.snapshot import Snapshot
from leaderboard.routes import read_routes


@dataclass(frozen=True)
class RingConfig(SensorConfig):
    """How far it feels [m] and into how many directions."""

    range: float = attribute("range", 50.0)
    sectors: int = attribute("sectors", 12)


@SENSORS.register("sensor.example.ring")
class Ring(Sensor):
    """(sectors,) float32: distance to the nearest other in each [m], clockwise from straight ahead."""

    config_type = RingConfig
    config: RingConfig

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((self.config.sectors,), np.float32, "m")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.float32]:
        now, sectors = history[-1], self.config.sectors
        offset = now.xy[1:] - now.xy[0]
        distance = np.hypot(offset[:, 0], offset[:, 1])
        bearing = np.arctan2(offset[:, 1], offset[:, 0]) - now.yaw[0]
        sector = np.rint(bearing / (2.0 * np.pi) * sectors).astype(np.int64) % sectors
        found = np.full(sectors, self.config.range, np.float32)
        np.minimum.at(found, sector, distance.astype(np.float32))
        return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Reads it for a few seconds while the ego stands among traffic."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/own-sensor"))
    parser.add_argument("--seconds", type=float, default=5.0)
    given = parser.parse_args(arguments)
    entry = read_routes("quick")[0]
    simulation = Simulation(DriveSpec(town=entry.town, route_id=entry.id, keypoints=entry.keypoints, traffic="lav"))
    wanted: list[dict[str, Any]] = [{"type": "sensor.example.ring", "id": "ring", "attributes": {"range": 80}}]
    suite = SensorSuite(get_scene(simulation.town), wanted, simulation.draws)
    rows = []
    for _ in range(round(20 * given.seconds)):
        simulation.tick(Control(brake=1.0))
        frame, ring = suite.read(simulation.recent(suite.history + 1))["ring"]
        rows.append({"tick": frame, "ring": ring.tolist()})
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "ring.json").write_text(json.dumps(rows), encoding="utf-8")
    print(f"{len(rows)} readings, nearest {min(min(row['ring']) for row in rows):.1f} m: {given.out / 'ring.json'}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
