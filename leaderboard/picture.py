"""Pictures of drives and routes, drawn by the simulator's own renderers."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lavsim.errors import LogError
from lavsim.log.reader import LogReader
from lavsim.map.town_map import load_town

log = logging.getLogger(__name__)

_STANDING = ("vehicle_blocked", "route_timeout")  # infractions with nothing to see


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
        from lavsim.render.sheet import contact_sheet
    except ModuleNotFoundError:
        return False
    try:
        reader = LogReader(drive)
    except LogError:  # the agent never came to drive
        return False
    if not len(reader):
        return False
    index = picture_index(len(reader), infractions, reader[0].tick)
    town = load_town(reader.town_name, tuple(town_path))
    history = [reader[k] for k in range(max(0, index - 1), index + 1)]  # two ticks: the LiDAR's whole turn
    contact_sheet(town, history, picture)
    return True


def picture_index(ticks: int, infractions: Sequence[dict[str, Any]], first_tick: int) -> int:
    """Which tick of a drive to show, as an index of its log."""
    moments = (int(entry["tick"]) - first_tick for entry in infractions if entry["key"] not in _STANDING)
    return next((m for m in moments if 0 <= m < ticks), ticks // 2)
