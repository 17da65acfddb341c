"""Pictures of the reference: a reading of each sensor, and each bundled route file on its towns.

python -m benchmarks.reference_pictures [sensors] [routes] [--out docs/pictures]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import box_corners, to_local
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.random import Draws
from lavsim.render.birdseye import draw_route, draw_town
from lavsim.render.canvas import Canvas, height_colours, write_text
from lavsim.render.palette import PAPER_BGR, TAG_BGR
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SENSORS, make_sensor
from lavsim.sheets import draw_bev
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control, LaneType
from leaderboard.routes import read_routes, route_files

Image = NDArray[np.uint8]

SIDE, GAP, LABEL = 240, 8, 20  # [px]
REACH = 20.0  # [m] from the ego to the edge of a panel from above
QUALITY = 80
TICKS = 140  # until traffic moves
COLOURS = ((200, 80, 20), (30, 30, 210), (40, 150, 30), (180, 60, 140), (20, 120, 220), (160, 150, 20))
CAMERA = {"x": 1.5, "z": 2.4, "width": 288, "height": 288, "fov": 75.0}
OPTIONS: dict[str, dict[str, Any]] = {  # keys of their dicts, beside type, id and mount
    "sensor.lavsim.lidar_raster": {"z": 2.4, "ahead": 20.0, "behind": 20.0, "side": 20.0, "pixels_per_metre": 6.0},
    "sensor.lidar.ray_cast": {"z": 2.4, "attributes": {"full_sweep": True}},
    "sensor.lidar.ray_cast_semantic": {"z": 2.4, "attributes": {"full_sweep": True}},
    "sensor.other.radar": {"x": 2.0, "z": 1.0, "fov": 60.0},
    "sensor.other.obstacle": {"z": 1.0, "attributes": {"distance": 100.0, "hit_radius": 1.0}},
}


def ego_drive() -> Simulation:
    """A drive in traffic, stopped where something is to be seen."""
    town = load_town("eu_small_a")
    lanes = town.lanes
    lane = int(np.flatnonzero((lanes.junction < 0) & (lanes.type == LaneType.DRIVING) & (lanes.length > 60.0))[0])
    ends = town.centre(np.array([lane, lane]), np.array([10.0, 50.0]))[:, :3]
    simulation = Simulation(
        DriveSpec(town.name, "picture", ends, traffic="lav", vehicles=160, walkers=120, parked=0.5, seed=5)
    )
    for tick in range(TICKS):
        simulation.tick(Control(throttle=0.6 if tick < 70 else 0.0, steer=-0.02 if tick > 100 else 0.0))
    return simulation


def above(points: NDArray[Any], colours: NDArray[Any]) -> Image:
    """(SIDE, SIDE, 3) points (N, 2) in the ego's frame (x ahead, y right) [m] from above, ahead up."""
    canvas = Canvas.facing(0.0, 0.0, 0.0, (SIDE, SIDE), SIDE / (2.0 * REACH), 0.5, (24, 22, 20))
    canvas.dots(points[:, :2], colours)
    return np.asarray(cv2.dilate(canvas.image, np.ones((2, 2), np.uint8)))


PARTS = {  # of readings that are vectors
    "sensor.other.gnss": ("latitude", "longitude", "altitude"),
    "sensor.other.imu": (
        "accelerates ahead",
        "to the right",
        "upward",
        "rolls",
        "pitches",
        "turns",
        "compass",
    ),
}


def words(name: str, reading: Any) -> Image:
    """A reading in words."""
    image = np.full((SIDE, SIDE, 3), 255, np.uint8)
    if isinstance(reading, dict):
        lines = [f"{key}: {str(value)[:400]}" for key, value in reading.items()]
    elif getattr(reading, "dtype", None) is not None and reading.dtype.names:
        names = reading.dtype.names
        lines = [f"{len(reading)} rows of", *(f"  {name}" for name in names)]
        lines += [line for row in reading[:2] for line in ("", *(f"{n} = {row[n]:.6g}" for n in names))]
    else:
        lines = [f"{part}: {value:.6g}" for part, value in zip(PARTS[name], reading, strict=True)]
    broken = [
        part[k : k + 33] for line in lines for part in line.splitlines() or [""] for k in range(0, len(part) or 1, 33)
    ]
    for k, line in enumerate(broken[:14]):
        write_text(image, line, (6, 18 + 16 * k), 0.38)
    return image


def square(image: Image) -> Image:
    """Cut and scaled to a panel."""
    side = min(image.shape[:2])
    top, left = (image.shape[0] - side) // 2, (image.shape[1] - side) // 2
    return np.asarray(
        cv2.resize(image[top : top + side, left : left + side], (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    )


def depth(image: Image) -> Image:
    """Depth as grey, by its logarithm."""
    metres = 1000.0 * (image[..., :3].astype(float) @ [65536.0, 256.0, 1.0]) / (2**24 - 1)
    grey = 255.0 * np.clip(np.log(np.maximum(metres, 2.0) / 2.0) / np.log(75.0), 0.0, 1.0)
    return np.repeat(grey[..., None], 3, axis=2).astype(np.uint8)


def truth(reading: dict[str, Any]) -> Image:
    """Boxes of all actors around."""
    canvas = Canvas.facing(0.0, 0.0, 0.0, (SIDE, SIDE), SIDE / (2.0 * REACH), 0.5, (24, 22, 20))
    xy, yaw = reading["xyz"][:, :2], reading["yaw"]
    local = to_local(xy, xy[0], yaw[0])
    length, width = reading["sizes"][:, 0], reading["sizes"][:, 1]
    for k, corners in enumerate(box_corners(local[:, 0], local[:, 1], yaw - yaw[0], length, width)):
        canvas.outline(corners, (216, 111, 29) if k == 0 else (255, 255, 255))
    return canvas.image


def raster(reading: dict[str, NDArray[np.uint8]]) -> Image:
    """The fullest bin of each pixel; brighter holds more returns."""
    most = reading["histogram"].max(axis=0)
    return square(np.repeat((255.0 * (most / max(most.max(), 1)) ** 0.4)[..., None], 3, axis=2).astype(np.uint8))


def radar(reading: NDArray[np.float32]) -> Image:
    """Detections from above; red comes nearer, blue goes away."""
    distance, azimuth, speed = reading[:, 0], reading[:, 2], reading[:, 3]
    colours = np.where(speed[:, None] < 0.0, (60, 60, 255), (255, 150, 60)).astype(np.uint8)
    return above(np.column_stack([distance * np.cos(azimuth), distance * np.sin(azimuth)]), colours)


PICTURES: dict[str, Callable[[Any], Image]] = {
    "sensor.camera.rgb": lambda image: square(image[..., :3]),
    "sensor.camera.depth": lambda image: square(depth(image)),
    "sensor.camera.semantic_segmentation": lambda image: square(TAG_BGR[image[..., 2]]),
    "sensor.camera.instance_segmentation": lambda image: square(
        ((image[..., :3].astype(int) @ [7919, 104729, 1299709])[..., None] // (1, 61, 3721) % 256).astype(np.uint8)
    ),
    "sensor.lidar.ray_cast": lambda cloud: above(cloud, height_colours(cloud[:, 2].astype(float), -2.4, 4.0)),
    "sensor.lidar.ray_cast_semantic": lambda cloud: above(
        np.column_stack([cloud["x"], cloud["y"]]), TAG_BGR[cloud["ObjTag"]]
    ),
    "sensor.lavsim.lidar_raster": raster,
    "sensor.lavsim.truth": truth,
    "sensor.other.radar": radar,
}


def sensor_panels(simulation: Simulation) -> Iterator[tuple[str, Image]]:
    """Name and picture of a reading of each sensor."""
    scene = get_scene(simulation.town)
    for name in map(str, SENSORS):
        keys = CAMERA if name.startswith("sensor.camera") else OPTIONS.get(name, {})
        sensor = make_sensor({"type": name, "id": "s", **keys})
        history = simulation.recent(sensor.history + 1)
        if name == "sensor.lavsim.bev":
            yield name, square(draw_bev(scene, history[-1]))
        else:
            reading = sensor.read(history, scene, Draws.of_seed(0))
            yield name, PICTURES[name](reading) if name in PICTURES else words(name, reading)


def sheet(panels: list[tuple[str, Image]], columns: int) -> Image:
    """Pictures of any size in rows, each below its name."""
    rows = []
    width = max(
        sum(image.shape[1] + GAP for _, image in panels[k : k + columns]) + GAP for k in range(0, len(panels), columns)
    )
    for k in range(0, len(panels), columns):
        row = panels[k : k + columns]
        strip = np.empty((max(image.shape[0] for _, image in row) + LABEL + GAP, width, 3), np.uint8)
        strip[:] = PAPER_BGR
        left = GAP
        for name, image in row:
            write_text(strip, name, (left, 15), 0.4)
            strip[LABEL : LABEL + image.shape[0], left : left + image.shape[1]] = image
            left += image.shape[1] + GAP
        rows.append(strip)
    return np.concatenate(rows)


def route_panels(file: str, width: int) -> Iterator[tuple[str, Image]]:
    """Each town of a route file with its routes."""
    entries = read_routes(file)
    for name in dict.fromkeys(entry.town for entry in entries):
        town = load_town(name)
        canvas = draw_town(town, width)
        routes = [get_planner(town).trace(entry.keypoints).points for entry in entries if entry.town == name]
        for k, points in enumerate(routes):
            draw_route(canvas, points, COLOURS[k % len(COLOURS)])
        yield f"{file}: {name}, {len(routes)} routes", canvas.image


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", choices=["sensors", "routes", []], help="all by default")
    parser.add_argument("--out", type=Path, default=Path("docs/pictures"))
    given = parser.parse_args()
    made: dict[str, Image] = {}
    if not given.what or "sensors" in given.what:
        made["sensors"] = sheet(list(sensor_panels(ego_drive())), 6)
    if not given.what or "routes" in given.what:
        for file in route_files():
            towns = len({entry.town for entry in read_routes(file)})
            columns = min(towns, 4)
            made[f"routes-{file}"] = sheet(list(route_panels(file, 900 // columns)), columns)
    for name, image in made.items():
        path = given.out / f"{name}.jpg"
        cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        print(f"{path}  {image.shape[1]} x {image.shape[0]}  {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
