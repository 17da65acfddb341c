"""A recorded drive as a page that plays it in the browser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lavsim.cache import replace_atomically
from lavsim.errors import OutputError
from lavsim.types import DT
from lavsim.viewer.pack import Pack
from lavsim.viewer.page import page_of
from lavsim.viewer.statics import add_statics
from lavsim.viewer.tracks import Tracks

if TYPE_CHECKING:
    from lavsim.map.route import Route
    from lavsim.map.town_map import TownMap
    from lavsim.viewer.inner import InnerView
    from lavsim.viewer.panes import Panes

_MARGIN = 30.0  # [m] around the route when the whole of it is shown
_MOST_TOUCHES = 2000  # a drive that scrapes along walls has no end of them


@dataclass(frozen=True)
class Event:
    """Something to be marked: an infraction.

    Attributes:
        tick: When.
        name: In a word or two.
        message: In a sentence.
        x, y: Where [m].
    """

    tick: int
    name: str
    message: str
    x: float
    y: float


@dataclass(frozen=True)
class Story:
    """What is told around a drive; all of it plain text.

    Attributes:
        title, subtitle: Above the map.
        badge: How it went, in a word.
        is_good: Whether that is good news.
        note: What one has to know: that the recording is cut short, that the agent crashed.
        infractions: To be marked.
    """

    title: str
    subtitle: str = ""
    badge: str = ""
    is_good: bool = False
    note: str = ""
    infractions: Sequence[Event] = ()


def write_replay(
    path: Path,
    tracks: Tracks,
    header: Mapping[str, Any],
    town: TownMap,
    route: Route,
    story: Story,
    inner: InnerView | None = None,
    panes: Panes | None = None,
) -> None:
    """Writes the page; see `replay_page`.

    Raises:
        OutputError: it can't be written.
    """
    page = replay_page(tracks, header, town, route, story, inner, panes)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_atomically(path, page.encode())
    except OSError as error:
        raise OutputError(f"can't write {path}: {error.strerror}") from None


def replay_page(
    tracks: Tracks,
    header: Mapping[str, Any],
    town: TownMap,
    route: Route,
    story: Story,
    inner: InnerView | None = None,
    panes: Panes | None = None,
) -> str:
    """The page of a drive.

    Args:
        tracks: All of it.
        header: Of its log; names the hazards.
        town: Where.
        route: What was to be driven.
        story: What is told around it.
        inner: What the agent published.
        panes: What the sensors saw.
    """
    pack = Pack()
    meta = {
        "title": story.title,
        "subtitle": story.subtitle,
        "badge": {"text": story.badge, "good": story.is_good} if story.badge else None,
        "note": story.note,
        "dt": DT,
        "ticks": len(tracks),
        "first_tick": int(tracks.ticks[0]) if len(tracks) else 0,
        "town": add_statics(pack, town),
        "actors": _actors(tracks),
        "infractions": [_event(event) for event in story.infractions],
        "touches": _touches(tracks),
        "hazards": _hazards(tracks, header),
        "start": _point(route.points[0]),
        "target": _point(route.points[-1]),
        "frame": _frame(tracks, route),
        "drawings": inner.add(pack, tracks) if inner is not None else [],
        "panes": panes.add(pack, tracks) if panes is not None else None,
    }
    _add_tracks(pack, tracks)
    _add_ego(pack, tracks)
    _add_lights(pack, tracks)
    pack.add("route.x", np.rint(route.points[:, 0] * 100.0), 1)
    pack.add("route.y", np.rint(route.points[:, 1] * 100.0), 1)
    return page_of(story.title, pack.encode(meta))


def _add_tracks(pack: Pack, tracks: Tracks) -> None:
    """Poses in the log's own units; headings go on turning instead of jumping at half a turn."""
    pack.add("track.row", tracks.row)
    pack.add("track.start", tracks.start)
    pack.add("track.n", np.diff(tracks.first))
    pack.add("pose.x", tracks.pose[:, 0], 2, "track.n")
    pack.add("pose.y", tracks.pose[:, 1], 2, "track.n")
    pack.add("pose.yaw", _unwrapped(tracks.pose[:, 2], tracks.first), 1, "track.n")
    pack.add(
        "pose.state", tracks.state[:, 0].astype(np.int64) | (tracks.state[:, 1].astype(np.int64) << 12), 1, "track.n"
    )


def _unwrapped(yaw: NDArray[np.int32], first: NDArray[np.int64]) -> NDArray[np.int64]:
    """Headings [2^-16 turn] without jumps within each track."""
    whole = yaw.astype(np.int64)
    steps = np.diff(whole, prepend=0)
    steps = (steps + 32768) % 65536 - 32768
    begins = first[:-1]
    total = np.cumsum(steps)
    offset = np.repeat(whole[begins] - total[begins], np.diff(first))
    return total + offset


def _add_ego(pack: Pack, tracks: Tracks) -> None:
    pack.add("ego.speed", np.rint(tracks.forward_speed * 100.0), 1)
    for column, name in enumerate(("throttle", "steer", "brake")):
        pack.add(f"ego.{name}", np.rint(tracks.control[:, column] * 1000.0), 1)


def _add_lights(pack: Pack, tracks: Tracks) -> None:
    """States of each light as runs: from which tick on it shows what."""
    count, at, state = [], [], []
    for column in tracks.lights.T:
        changes = np.flatnonzero(np.diff(column.astype(np.int64), prepend=-1))
        count.append(len(changes))
        at.append(changes)
        state.append(column[changes])
    pack.add("lights.n", np.array(count, np.int64))
    pack.add("lights.at", np.concatenate(at) if at else np.zeros(0, np.int64), 1, "lights.n")
    pack.add("lights.state", np.concatenate(state) if state else np.zeros(0, np.int64))


def _actors(tracks: Tracks) -> dict[str, list[Any]]:
    table = tracks.table
    return {
        "id": table.ids.tolist(),
        "class": table.classes.tolist(),
        "role": table.roles.tolist(),
        "size": np.round(table.sizes.astype(np.float64), 3).tolist(),
        "colour": table.colours.tolist(),
        "blueprint": list(table.blueprints),
    }


def _touches(tracks: Tracks) -> list[dict[str, float]]:
    rows = tracks.touches[:_MOST_TOUCHES].tolist()
    return [
        {
            "index": int(index),
            "a": int(a),
            "b": int(b),
            "impulse": round(impulse, 1),
            "x": round(x, 2),
            "y": round(y, 2),
        }
        for index, a, b, impulse, x, y in rows
    ]


def _hazards(tracks: Tracks, header: Mapping[str, Any]) -> list[dict[str, Any]]:
    known = header.get("scenarios", [])
    return [
        {
            "type": str(known[number]["type"]) if number < len(known) else f"hazard {number}",
            "first": first,
            "last": last,
        }
        for number, first, last in tracks.hazards.tolist()
    ]


def _event(event: Event) -> dict[str, Any]:
    return {"tick": event.tick, "name": event.name, "message": event.message, "x": event.x, "y": event.y}


def _point(point: NDArray[np.float64]) -> list[float]:
    return [round(float(v), 2) for v in point[:2]]


def _frame(tracks: Tracks, route: Route) -> list[float]:
    """Box around the route and what was driven [m]."""
    points = np.concatenate([route.points[:, :2], tracks.xy[tracks.ego]]) if len(tracks) else route.points[:, :2]
    return [*_point(points.min(axis=0) - _MARGIN), *_point(points.max(axis=0) + _MARGIN)]
