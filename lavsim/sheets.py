"""Contact sheets of a town in many weathers: what all cameras in both looks, LiDAR and BEV show at one moment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lavsim.bench import bench_drive
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.render.birdseye import draw_snapshot
from lavsim.render.canvas import write_png, write_text
from lavsim.render.look import LOOKS
from lavsim.render.palette import PAPER_BGR
from lavsim.render.scene import Scene, get_scene
from lavsim.render.sheet import CAMERAS, draw_sweep
from lavsim.sensors.base import make_sensor
from lavsim.simulation import Simulation
from lavsim.types import Control
from lavsim.world.snapshot import Snapshot
from lavsim.world.weather import Weather, WeatherKeyframe

_BEFORE = 28.0  # [m] of the ego's place before the stop line
_WARM_UP = 160  # ticks, until traffic moves and lights are on
_GAP, _LABEL, _PANEL = 6, 20, 320  # [px]

# What a BEV picture shows of each layer, later ones over earlier ones; blue, green, red.
_BEV_BGR = {
    "road": (96, 92, 90), "crosswalk": (130, 130, 130), "solid": (240, 240, 240), "broken": (120, 220, 240),
    "stop": (200, 60, 200), "red": (50, 50, 230), "yellow": (40, 190, 250), "green": (70, 200, 60),
    "vehicle": (220, 130, 40), "walker": (80, 160, 255), "pedestrian": (60, 40, 255),
}  # fmt: skip


def weather_sheets(town: TownMap, weathers: Mapping[str, Weather], folder: Path) -> Iterator[Path]:
    """Writes a sheet of each weather, of a moment in busy traffic; yields each file as it is written."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, weather in weathers.items():
        path = folder / f"{town.name}-{name}.png"
        write_png(draw_weather(get_scene(town), moment(town, weather), f"{town.name}, {name}"), path)
        yield path


def moment(town: TownMap, weather: Weather) -> list[Snapshot]:
    """Two ticks of traffic under a weather, the newest last; the ego stands before a light where there is one."""
    drive = replace(bench_drive(town), weather=(WeatherKeyframe(0.0, weather),))
    stops = [stop for light in town.lights for stop in light.stop_lines if stop.u > _BEFORE + 10.0]
    if stops:
        stop = max(stops, key=lambda stop: (round(stop.u), -stop.lane))
        lane = np.array([stop.lane, stop.lane])
        drive = replace(drive, keypoints=town.centre(lane, np.array([stop.u - _BEFORE, stop.u]))[:, :3])
    simulation = Simulation(drive)
    for _ in range(_WARM_UP):
        simulation.tick(Control(brake=1.0))
    return list(simulation.recent(2))


def draw_weather(scene: Scene, history: Sequence[Snapshot], title: str) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 blue, green, red: the cameras in both looks, then the world from above, the LiDAR and BEV."""
    snapshot, draws = history[-1], Draws.of_seed(0).stream("sheet")
    width = sum(view.width for _, view in CAMERAS) + _GAP * (len(CAMERAS) + 1)
    tall = max(view.height for _, view in CAMERAS)
    sheet = np.empty((3 * _LABEL + 2 * (tall + _GAP) + _PANEL + _GAP, width, 3), np.uint8)
    sheet[:] = PAPER_BGR
    top = 0
    for look in LOOKS:
        left = _GAP
        for name, view in CAMERAS:
            write_text(sheet, f"{title}, {look}" if left == _GAP else name, (left, top + 14))
            image = view.colour(snapshot, scene, draws.stream(name), look)
            sheet[top + _LABEL : top + _LABEL + view.height, left : left + view.width] = image[..., :3]
            left += view.width + _GAP
        top += _LABEL + tall + _GAP
    panel = (width - 3 * _GAP - _PANEL) // 2 - _GAP // 2
    pictures = (
        ("from above", draw_snapshot(scene, snapshot, (panel, _PANEL), 80.0).image),
        ("LiDAR, last full turn", draw_sweep(scene, history[-2:], (panel, _PANEL)).image),
        ("BEV", draw_bev(scene, snapshot)),
    )
    left = _GAP
    for name, picture in pictures:
        write_text(sheet, name, (left, top + 14))
        sheet[top + _LABEL : top + _LABEL + _PANEL, left : left + picture.shape[1]] = picture
        left += picture.shape[1] + _GAP
    return sheet


def draw_bev(scene: Scene, snapshot: Snapshot) -> NDArray[np.uint8]:
    """(320, 320, 3) uint8 blue, green, red: the layers of a BEV reading over each other."""
    sensor = make_sensor({"type": "sensor.lavsim.bev", "id": "bev", "attributes": {"layers": ",".join(_BEV_BGR)}})
    picture = np.full((_PANEL, _PANEL, 3), 34, np.uint8)
    for layer, colour in zip(sensor.read([snapshot], scene, Draws.of_seed(0)), _BEV_BGR.values(), strict=True):
        picture[layer > 0] = colour
    return picture
