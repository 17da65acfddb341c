"""An agent's drawings as the page takes them: in the world's frame, a few times a second, thinned to what is seen."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.drawings import Drawing
from lavsim.geometry import to_world
from lavsim.log.drawings import read_drawings
from lavsim.viewer.pack import Pack
from lavsim.viewer.tracks import Tracks

PERIOD = 4  # ticks between drawings that are kept: five a second
TOLERANCE = 0.06  # [m] lines are thinned by
MOST_RASTER_BYTES = 12_000_000  # of all grids of a name; more is kept less often


@dataclass(frozen=True)
class InnerView:
    """The drawings of a drive.

    Attributes:
        frames: (tick, drawings by name), in order, world frame or ego frame as published.
    """

    frames: list[tuple[int, dict[str, Drawing]]]

    @staticmethod
    def read(path: Path) -> InnerView | None:
        """The drawings in a side file; None where there is none.

        Raises:
            LogError: it is damaged.
        """
        return InnerView.of(read_drawings(path)) if path.is_file() else None

    @staticmethod
    def of(frames: Iterable[tuple[int, dict[str, Drawing]]]) -> InnerView:
        """Every `PERIOD`th of `frames`."""
        return InnerView([frame for number, frame in enumerate(frames) if number % PERIOD == 0])

    def at(self, tick: int) -> dict[str, Drawing]:
        """The newest drawings at or before a tick, if they are not older than two periods."""
        ticks = np.array([frame[0] for frame in self.frames], np.int64)
        place = int(np.searchsorted(ticks, tick, side="right")) - 1
        return self.frames[place][1] if place >= 0 and tick - ticks[place] < 2 * PERIOD else {}

    def add(self, pack: Pack, tracks: Tracks) -> list[dict[str, Any]]:
        """Adds all drawings to `pack`; what each array is about."""
        index_of = {int(tick): index for index, tick in enumerate(tracks.ticks)}
        by_name: dict[tuple[str, str], list[tuple[int, Drawing]]] = {}
        for tick, drawings in self.frames:
            if tick in index_of:
                for name, drawing in drawings.items():
                    placed = in_world(drawing, tracks, index_of[tick])
                    by_name.setdefault((name, drawing["kind"]), []).append((index_of[tick], placed))
        entries = []
        for number, ((name, kind), found) in enumerate(by_name.items()):
            key = f"inner.{number}"
            if kind == "raster":
                found = _affordable(found)
            pack.add(f"{key}.at", [index for index, _ in found], 1)
            entries.append({"name": name, "kind": kind} | _ADD[kind](pack, key, [drawing for _, drawing in found]))
        return entries


def in_world(drawing: Drawing, tracks: Tracks, index: int) -> Drawing:
    """The drawing in the world's frame at tick number `index` of the drive."""
    if drawing["kind"] == "scalar" or drawing["frame"] == "world":
        return drawing
    row = tracks.ego[index]
    origin, yaw = tracks.xy[row], float(tracks.yaw[row])
    moved = {**drawing, "frame": "world"}
    if "xy" in drawing:
        moved["xy"] = to_world(drawing["xy"], origin, yaw)
    for key in ("poses", "pose"):
        if key in drawing:
            poses = np.atleast_2d(np.asarray(drawing[key], np.float64)).copy()
            poses[:, :2] = to_world(poses[:, :2], origin, yaw)
            poses[:, 2] += yaw
            moved[key] = poses if key == "poses" else poses[0]
    return moved


def _affordable(found: list[tuple[int, Drawing]]) -> list[tuple[int, Drawing]]:
    total = sum(drawing["values"].size for _, drawing in found)
    return found[:: max(1, -(-total // MOST_RASTER_BYTES))]


def _add_points(pack: Pack, key: str, frames: list[Drawing]) -> dict[str, Any]:
    pack.add(f"{key}.n", [len(f["xy"]) for f in frames])
    _add_places(pack, key, [f["xy"] for f in frames], f"{key}.n")
    _add_likelihood(pack, key, frames)
    return {}


def _add_boxes(pack: Pack, key: str, frames: list[Drawing]) -> dict[str, Any]:
    pack.add(f"{key}.n", [len(f["poses"]) for f in frames])
    poses = np.concatenate([f["poses"] for f in frames]).astype(np.float64).reshape(-1, 5)
    for column, (name, unit) in enumerate((("x", 100), ("y", 100), ("yaw", 1000), ("length", 100), ("width", 100))):
        pack.add(f"{key}.{name}", np.rint(poses[:, column] * unit), 1, f"{key}.n")
    labels = [label for f in frames for label in (f["labels"] or [""] * len(f["poses"]))]
    known = {label: place for place, label in enumerate(dict.fromkeys(label for label in labels if label))}
    pack.add(f"{key}.label", [known.get(label, -1) for label in labels])
    _add_likelihood(pack, key, frames)
    return {"labels": list(known)}


def _add_polylines(pack: Pack, key: str, frames: list[Drawing]) -> dict[str, Any]:
    pack.add(f"{key}.n", [len(f["count"]) for f in frames])
    lines = [
        thinned(line) for f in frames for line in np.split(np.asarray(f["xy"], np.float64), np.cumsum(f["count"])[:-1])
        if len(f["count"])
    ]  # fmt: skip
    pack.add(f"{key}.count", [len(line) for line in lines])
    _add_places(pack, key, lines, f"{key}.count")
    _add_likelihood(pack, key, frames)
    return {}


def _add_raster(pack: Pack, key: str, frames: list[Drawing]) -> dict[str, Any]:
    poses = np.array([f["pose"] for f in frames], np.float64).reshape(-1, 3)
    for column, (name, unit) in enumerate((("x", 100), ("y", 100), ("yaw", 1000))):
        pack.add(f"{key}.{name}", np.rint(poses[:, column] * unit), 1)
    pack.add(f"{key}.shape", [v for f in frames for v in (*f["values"].shape, round(f["resolution"] * 1000))])
    pack.add_bytes(f"{key}.data", b"".join(f["values"].tobytes() for f in frames))
    return {}


def _add_scalar(pack: Pack, key: str, frames: list[Drawing]) -> dict[str, Any]:
    values = np.clip([f["value"] for f in frames], -1e5, 1e5)
    pack.add(f"{key}.value", np.rint(values * 1000.0), 1)
    return {"unit": frames[0]["unit"] if frames else ""}


_ADD = {
    "points": _add_points,
    "boxes": _add_boxes,
    "polylines": _add_polylines,
    "raster": _add_raster,
    "scalar": _add_scalar,
}


def _add_places(pack: Pack, key: str, parts: list[NDArray[np.float64]], groups: str) -> None:
    places = np.concatenate([np.zeros((0, 2)), *parts])
    for column, name in enumerate(("x", "y")):
        pack.add(f"{key}.{name}", np.rint(places[:, column] * 100.0), 1, groups)


def _add_likelihood(pack: Pack, key: str, frames: list[Drawing]) -> None:
    values = np.concatenate([np.zeros(0), *(f["likelihood"] for f in frames)])
    pack.add(f"{key}.likelihood", np.rint(values * 255.0))


def thinned(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """A line (M, 2) with fewer points, nowhere farther off than `TOLERANCE`."""
    if len(line) < 3:
        return line
    kept = cv2.approxPolyDP((line - line[0]).astype(np.float32).reshape(-1, 1, 2), TOLERANCE, False)
    return np.asarray(kept, np.float64).reshape(-1, 2) + line[0]
