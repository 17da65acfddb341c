"""What pages are sent: the scene once, then of each tick only what changed since the last one they got."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lavsim.live.history import History
from lavsim.live.session import View
from lavsim.types import DT
from lavsim.viewer.inner import InnerView
from lavsim.viewer.pack import Pack
from lavsim.viewer.statics import add_statics
from lavsim.viewer.tracks import read_tracks
from lavsim.world.snapshot import SPEED_UNIT, ActorTable, Snapshot

if TYPE_CHECKING:
    from lavsim.map.route import Route
    from lavsim.map.town_map import TownMap

TRAIL_STEP = 4  # ticks between the places of the trail that a page gets when it opens
_MARGIN = 30.0  # [m] around the route when the whole of it is shown


def scene_message(town: TownMap, route: Route, title: str, subtitle: str, is_keyboard: bool) -> str:
    """The first message: what stands still, and the route."""
    pack = Pack()
    low, high = route.xy.min(axis=0) - _MARGIN, route.xy.max(axis=0) + _MARGIN
    meta = {
        "title": title,
        "subtitle": subtitle,
        "keyboard": is_keyboard,
        "dt": DT,
        "town": add_statics(pack, town),
        "lights": len(town.lights),
        "start": _place(route.points[0]),
        "target": _place(route.points[-1]),
        "frame": [*_place(low), *_place(high)],
    }
    pack.add("route.x", np.rint(route.points[:, 0] * 100.0), 1)
    pack.add("route.y", np.rint(route.points[:, 1] * 100.0), 1)
    return _json({"scene": pack.encode(meta)})


def _place(point: NDArray[np.float64]) -> list[float]:
    return [round(float(v), 2) for v in point[:2]]


class Stream:
    """What one page knows, and the messages that bring it up to date."""

    def __init__(self) -> None:
        self._forget(0)

    def _forget(self, epoch: int) -> None:
        self._epoch = epoch
        self._values = np.zeros((0, 4), np.int64)
        self._is_there = np.zeros(0, np.bool_)
        self._lights = np.zeros(0, np.uint8)
        self._events = 0
        self._drawn = -1

    def message(self, view: View, frame: int) -> str:
        """What changed up to `view`, as JSON text.

        Args:
            view: What is to be shown.
            frame: Number of the message; pages send it back.
        """
        snapshot, history = view.snapshot, view.history
        told: dict[str, Any] = {"frame": frame, "tick": snapshot.tick, "status": _status(view)}
        if view.epoch != self._epoch:
            self._forget(view.epoch)
            told["reset"] = _trail(history)
        told |= self._actors(snapshot) | self._lamps(snapshot)
        told["ego"] = _ego(snapshot)
        if view.events > self._events:
            told["events"] = [list(vars(event).values()) for event in history.events[self._events : view.events]]
            self._events = view.events
        tick, drawings = view.drawings
        if tick != self._drawn:
            self._drawn = tick
            told["inner"] = [tick, _inner(history.snapshots[history.index_of(tick)], drawings) if drawings else ""]
        return _json(told)

    def _actors(self, snapshot: Snapshot) -> dict[str, Any]:
        known, size = len(self._values), len(snapshot.table.ids)
        told: dict[str, Any] = {}
        if size > known:
            told["actors"] = [_actor(snapshot.table, row) for row in range(known, size)]
            self._values = np.concatenate([self._values, np.zeros((size - known, 4), np.int64)])
            self._is_there = np.concatenate([self._is_there, np.zeros(size - known, np.bool_)])
        rows = snapshot.rows
        now = np.column_stack([snapshot.pose[:, [0, 1, 3]], snapshot.state[:, 0] | snapshot.state[:, 1] << 12])
        changed = ~self._is_there[rows] | np.any(self._values[rows] != now, axis=1)
        self._values[rows] = now
        is_there = np.zeros_like(self._is_there)
        is_there[rows] = True
        gone = np.flatnonzero(self._is_there & ~is_there)
        self._is_there = is_there
        told["rows"] = rows[changed].tolist()
        told |= {name: now[changed, column].tolist() for column, name in enumerate(("x", "y", "yaw", "state"))}
        if len(gone):
            told["gone"] = gone.tolist()
        return told

    def _lamps(self, snapshot: Snapshot) -> dict[str, Any]:
        if len(self._lights) != len(snapshot.lights):
            self._lights = np.full(len(snapshot.lights), 255, np.uint8)
        changed = np.flatnonzero(self._lights != snapshot.lights)
        self._lights = snapshot.lights
        return {"lights": [changed.tolist(), snapshot.lights[changed].tolist()]} if len(changed) else {}


def _status(view: View) -> dict[str, Any]:
    return {**view.status, "metres": round(view.status["metres"], 1)}


def _trail(history: History) -> list[list[int]]:
    """Tick, x and y [mm] of every few ticks of the ego's past."""
    kept = history.snapshots[::TRAIL_STEP]
    return [[s.tick for s in kept], [int(s.pose[0, 0]) for s in kept], [int(s.pose[0, 1]) for s in kept]]


def _ego(snapshot: Snapshot) -> list[int]:
    """Speed ahead [cm/s], throttle, steer, brake [1/1000], reverse."""
    speed = round(snapshot.ego.forward_speed / SPEED_UNIT)
    throttle, steer, brake, _, reverse = (float(v) for v in snapshot.control)
    return [speed, round(1000 * throttle), round(1000 * steer), round(1000 * brake), int(reverse)]


def _actor(table: ActorTable, row: int) -> list[Any]:
    """Id, class, role, size [m], colour, blueprint."""
    size = [round(float(v), 3) for v in table.sizes[row]]
    told = (table.ids[row], table.classes[row], table.roles[row])
    return [*(int(v) for v in told), size, table.colours[row].tolist(), table.blueprints[row]]


def _inner(snapshot: Snapshot, drawings: dict[str, Any]) -> str:
    """The driver's drawings as a pack of their own; they are shown from this tick on."""
    pack = Pack()
    meta = {"drawings": InnerView([(snapshot.tick, drawings)]).add(pack, read_tracks([snapshot]))}
    return pack.encode(meta)


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False)
