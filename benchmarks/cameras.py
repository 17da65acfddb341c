"""Milliseconds of processor time of cameras, BEV and the LAV suite, in both looks and by weather, on one core.

    python -m benchmarks.cameras [--town us_large_a] [--vehicles 100] [--walkers 50] [--places 20]

The scene and the medians are those of `benchmarks.sensors`; all vehicles have their lights on.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace

from benchmarks.sensors import bodies_of, median_ms, snapshot_with, snapshots_in
from lavsim.map.town_files import load_town
from lavsim.random import Draws
from lavsim.render.look import LOOKS
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite, make_sensor
from lavsim.sensors.suites import LAV, with_look
from lavsim.types import VehicleLight
from lavsim.world.snapshot import Snapshot
from lavsim.world.weather import Weather
from lavsim.world.weather_presets import WEATHERS_0_9_16, WEATHERS_LAV

WEATHERS = {
    "ClearNoon": WEATHERS_LAV["ClearNoon"],
    "HardRainNoon": WEATHERS_0_9_16["HardRainNoon"],
    "WetSunset": WEATHERS_0_9_16["WetSunset"],
    "HardRainNight": WEATHERS_LAV["HardRainNight"],
}
_EYE = {"x": 1.5, "z": 2.4, "width": 256, "height": 288, "fov": 64}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--town", default="us_large_a")
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--walkers", type=int, default=50)
    parser.add_argument("--places", type=int, default=20)
    args = parser.parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    town, draws = load_town(args.town), Draws.of_seed(0)
    scene = get_scene(town)
    bodies = [
        replace(body, lights=body.lights | int(VehicleLight.POSITION | VehicleLight.LOW_BEAM))
        for body in bodies_of(town, args.vehicles, args.walkers)
    ]
    plain = snapshots_in(town, bodies, args.places)
    plain = [snapshot_with(snapshot, plain[0].table) for snapshot in plain]
    for kind in ("semantic_segmentation", "depth", "instance_segmentation"):
        sensor = make_sensor({"type": f"sensor.camera.{kind}", "id": "eye", **_EYE})
        print(f"{kind:24s} {median_ms(plain, scene, lambda s, x=sensor: x.read([s], scene, draws), True):7.2f} ms")  # type: ignore[misc]
    both = [make_sensor({"type": f"sensor.camera.{k}", "id": k, **_EYE}) for k in ("semantic_segmentation", "depth")]
    pair = median_ms(plain, scene, lambda s: [x.read([s], scene, draws) for x in both], True)
    print(f"{'tags and depth':24s} {pair:7.2f} ms")
    bev = make_sensor({"type": "sensor.lavsim.bev", "id": "bev"})
    print(f"{'BEV, LAV layers':24s} {median_ms(plain, scene, lambda s: bev.read([s], scene, draws), True):7.2f} ms")
    for name, weather in WEATHERS.items():
        snapshots = [under(snapshot, weather) for snapshot in plain]
        for look in LOOKS:
            dicts = with_look(LAV, look)
            camera, telephoto = make_sensor(dicts[1]), make_sensor(dicts[3])
            suite = SensorSuite(scene, dicts, draws)
            times = [
                median_ms(snapshots, scene, lambda s, x=sensor: x.read([s], scene, draws), True)  # type: ignore[misc]
                for sensor in (camera, telephoto)
            ]
            times.append(median_ms(snapshots, scene, lambda s, x=suite: x.read([s]), False))  # type: ignore[misc]
            print(f"{name:16s} {look}: 256x288 {times[0]:6.2f}, telephoto {times[1]:6.2f}, suite {times[2]:6.2f} ms")


def under(snapshot: Snapshot, weather: Weather) -> Snapshot:
    """The same moment under another weather."""
    return replace(snapshot, weather_values=weather.to_array())


if __name__ == "__main__":
    main()
