"""Pictures of drives and routes, drawn by the simulator's own renderers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lavsim.errors import LogError
from lavsim.map.planner import get_planner
from lavsim.map.town_map import load_town
from lavsim.render.birdseye import draw_town
from lavsim.render.canvas import Canvas, write_png, write_text
from lavsim.render.palette import INK_BGR, Bgr
from lavsim.render.sheet import contact_sheet
from leaderboard.recorded import RecordedDrive
from leaderboard.routes import read_routes, select_routes

_STANDING = ("vehicle_blocked", "route_timeout")  # infractions with nothing to see
_START: Bgr = (216, 111, 29)
_TARGET: Bgr = (75, 130, 23)
_HAZARD: Bgr = (30, 38, 179)


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
    """Draws routes of a file on their towns, with start, target and the hazards' triggers.

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
        canvas = draw_town(town, route=route.points)
        for hazard in entry.scenarios:
            _label(canvas, hazard.trigger[:2], _HAZARD, hazard.type)
        _label(canvas, route.points[0, :2].tolist(), _START, "start")
        _label(canvas, route.points[-1, :2].tolist(), _TARGET, f"target, {route.length:.0f} m")
        pictures.append(folder / f"{entry.file.removesuffix('.xml')}_{number:03d}.png")
        write_png(canvas.image, pictures[-1])
    return pictures


def _label(canvas: Canvas, point: Sequence[float], colour: Bgr, text: str) -> None:
    canvas.disc(point, 6.0, colour, INK_BGR)
    column, row = canvas.pixels([point])[0]
    write_text(canvas.image, text, (round(column) + 9, round(row) + 4), colour=INK_BGR)
