"""Pictures of drives and routes, drawn by the simulator's own renderers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.errors import LogError
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_files import load_town
from lavsim.render.birdseye import draw_route, draw_town
from lavsim.render.canvas import Canvas, write_png, write_text
from lavsim.render.palette import INK_BGR, Bgr
from lavsim.render.sheet import contact_sheet
from lavsim.types import RoadOption
from leaderboard.recorded import RecordedDrive
from leaderboard.routes import read_routes, select_routes

_STANDING = ("vehicle_blocked", "route_timeout")  # infractions with nothing to see
_START: Bgr = (216, 111, 29)
_TARGET: Bgr = (75, 130, 23)
_HAZARD: Bgr = (30, 38, 179)
# Blue to the left, red to the right, lane changes in the paler of the two.
_COMMAND_BGR: dict[RoadOption, Bgr] = {
    RoadOption.LANEFOLLOW: (180, 60, 140),
    RoadOption.STRAIGHT: (40, 150, 30),
    RoadOption.LEFT: (200, 80, 20),
    RoadOption.RIGHT: (30, 30, 210),
    RoadOption.CHANGELANELEFT: (240, 190, 60),
    RoadOption.CHANGELANERIGHT: (90, 140, 255),
    RoadOption.VOID: (200, 0, 200),
}


def draw_drive(
    drive: Path, picture: Path, infractions: Sequence[dict[str, Any]], town_path: Sequence[Path] = ()
) -> bool:
    """Draws a contact sheet of one moment of a recorded drive; False if the drive holds no tick.

    Args:
        drive: The log.
        picture: The PNG to write.
        infractions: Of the drive, as the run file has them; the first in motion is shown, else the middle of the drive.
        town_path: Folders with towns.
    """
    try:
        recorded = RecordedDrive.open(drive, town_path)
    except LogError:  # the agent never came to drive
        return False
    log = recorded.log
    if not len(log):
        return False
    index = picture_index(len(log), infractions, log[0].tick)
    moments = [log[k] for k in range(max(0, index - 1), index + 1)]  # two ticks: a whole turn of the LiDAR
    contact_sheet(recorded.town, moments, picture, recorded.route.points)
    return True


def picture_index(ticks: int, infractions: Sequence[dict[str, Any]], first_tick: int) -> int:
    """Which tick of a drive to show, as an index of its log."""
    moments = (int(entry["tick"]) - first_tick for entry in infractions if entry["key"] not in _STANDING)
    return next((m for m in moments if 0 <= m < ticks), ticks // 2)


def draw_routes(source: str | Path, folder: Path, ids: str | None = None, town_path: Sequence[Path] = ()) -> list[Path]:
    """Draws routes of a file on their towns: commands in colours, start, target and the hazards' triggers.

    Args:
        source: Name of a packaged route file, or a path.
        folder: Where the PNG files go; made if missing.
        ids: Some routes of the file; None: all.
        town_path: Folders with towns.

    Returns:
        The pictures, in file order.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures = []
    for number, entry in enumerate(select_routes(read_routes(source), ids)):
        town = load_town(entry.town, tuple(town_path))
        route = get_planner(town).trace(entry.keypoints)
        canvas = draw_town(town)
        _draw_commands(canvas, route)
        for hazard in entry.scenarios:
            _label(canvas, hazard.trigger[:2], _HAZARD, hazard.type)
        _label(canvas, route.points[0, :2].tolist(), _START, "start")
        _label(canvas, route.points[-1, :2].tolist(), _TARGET, f"target, {route.length:.0f} m")
        pictures.append(folder / f"{entry.file.removesuffix('.xml')}_{number:03d}.png")
        write_png(canvas.image, pictures[-1])
    return pictures


def _draw_commands(canvas: Canvas, route: Route) -> None:
    """The route, each run of a command in its colour, with a key in the corner."""
    draw_route(canvas, route.points, (255, 255, 255))
    borders = [0, *(np.flatnonzero(np.diff(route.command)) + 1).tolist(), len(route)]
    for first, last in pairwise(borders):
        command = RoadOption(int(route.command[first]))
        draw_route(canvas, route.points[first : last + 1], _COMMAND_BGR[command])
        if command.is_lane_change:
            canvas.disc(route.points[first, :2].tolist(), 4.0, _COMMAND_BGR[command], INK_BGR)
    told = sorted({int(value) for value in route.command})
    canvas.image[: 16 * len(told) + 14, :130] = 255
    for row, value in enumerate(told):
        command = RoadOption(value)
        write_text(canvas.image, command.name.lower(), (10, 20 + 16 * row), colour=_COMMAND_BGR[command])


def _label(canvas: Canvas, point: Sequence[float], colour: Bgr, text: str) -> None:
    canvas.disc(point, 6.0, colour, INK_BGR)
    column, row = canvas.pixels([point])[0]
    write_text(canvas.image, text, (round(column) + 9, round(row) + 4), colour=INK_BGR)
