"""What stands still in a town, as the replay draws it: ground, paint, scenery, lights and signs; kept per town."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lavsim.cache import cache_dir, replace_atomically
from lavsim.map.scenery import SCENERY_VERSION
from lavsim.types import LaneType, Tag
from lavsim.viewer.pack import Pack

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]

VERSION = 4  # of what is drawn; raise it whenever other shapes come out
CELL = 80.0  # [m] large areas are cut into squares of this side, so that a tile draws few of them
OVERLAP = 0.2  # [m] by which the cut pieces overlap: no seams
TOLERANCE = 0.04  # [m] outlines may be thinned by
MARK_TOLERANCE = 0.02
SMALLEST_HOLE = 8.0  # [m²] gaps between the lanes of a junction that are drawn over
UNIT = 100.0  # whole numbers per metre

# What is paved, in the order it is painted; the names are the page's.
_GROUND = (
    ("median", LaneType.MEDIAN | LaneType.BORDER | LaneType.NONE),
    ("walk", LaneType.SIDEWALK),
    ("shoulder", LaneType.SHOULDER | LaneType.RESTRICTED),
    ("parking", LaneType.PARKING),
    ("road", LaneType.DRIVING | LaneType.BIDIRECTIONAL | LaneType.STOP | LaneType.BIKING | LaneType.ENTRY
     | LaneType.EXIT | LaneType.OFF_RAMP | LaneType.ON_RAMP | LaneType.TRAM | LaneType.RAIL | LaneType.ROADWORKS),
)  # fmt: skip
_SOLID = (
    ("building", (Tag.BUILDING,)),
    ("wall", (Tag.WALL, Tag.FENCE, Tag.GUARD_RAIL, Tag.STATIC, Tag.OTHER, Tag.BRIDGE)),
    ("tree", (Tag.VEGETATION,)),
    ("pole", (Tag.POLE, Tag.TRAFFIC_SIGN, Tag.TRAFFIC_LIGHT)),
)
_KINDS = ("solid", "broken", "curb", "stop")


def add_statics(pack: Pack, town: TownMap) -> dict[str, Any]:
    """Adds the town's shapes to `pack`; what is to be said of them beside."""
    for name, (values, order, groups) in _cached(town).items():
        pack.add(name, values, order, groups)
    return {
        "unit": 1.0 / UNIT,
        "bounds": [round(float(v), 2) for v in town.bounds],
        "ground": [name for name, _ in _GROUND],
        "solids": [name for name, _ in _SOLID],
    }


Columns = dict[str, tuple[NDArray[np.int64], int, str | None]]


def _cached(town: TownMap) -> Columns:
    """The columns of `town`, from the cache folder when they were made before."""
    path = cache_dir() / f"replay-{town.digest}-{VERSION}-{SCENERY_VERSION}.npz"
    if not path.exists():
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **_columns(town))
        replace_atomically(path, buffer.getvalue())
    with np.load(path, allow_pickle=False) as kept:
        found = {name: np.asarray(kept[name]) for name in kept.files}
    columns: Columns = {}
    for name, values in found.items():
        shape, _, part = name.rpartition(".")
        if part in ("x", "y"):
            columns[name] = (values, 1, f"{shape}.n")
        else:
            columns[name] = (values, 0, None)
    return columns


def _columns(town: TownMap) -> dict[str, NDArray[np.int64]]:
    """Shapes by name: `NAME.n` corners of each, `NAME.x` and `NAME.y` all of them in order."""
    columns: dict[str, NDArray[np.int64]] = {}
    for name, types in _GROUND:
        _put(columns, f"ground.{name}", _areas(town, int(types)))
    prisms = town.scenery.prisms
    for name, tags in _SOLID:
        rows = np.flatnonzero(np.isin(prisms.tag, np.array([int(t) for t in tags], np.uint8)) & (prisms.lamp < 0))
        rows = rows[np.argsort(prisms.z1[rows], kind="stable")]
        _put(columns, f"solid.{name}", [prisms.vertices[k, : prisms.count[k]] for k in rows])
    _put(columns, "crosswalk", [_middle_line(polygon) for polygon in town.crosswalks])
    columns["crosswalk.width"] = _whole([_extent(polygon)[1] for polygon in town.crosswalks])
    marks = [mark for mark in town.marks if mark.kind not in ("none", "grass") and len(mark.points) > 1]
    _put(columns, "mark", [_thinned(mark.points) for mark in marks])
    columns["mark.width"] = _whole([max(mark.width, 0.12) for mark in marks])
    columns["mark.kind"] = np.array([_kind(mark.kind, mark.colour) for mark in marks], np.int64)
    columns["light.at"] = _whole([v for light in town.lights for v in (light.x, light.y)])
    stops = [(light.index, stop) for light in town.lights for stop in light.stop_lines]
    columns["stop.light"] = np.array([light for light, _ in stops], np.int64)
    at = (
        town.centre([s.lane for _, s in stops], [s.paint_u for _, s in stops])[:, [0, 1, 3]]
        if stops
        else np.zeros((0, 3))
    )
    width = np.array([s.width for _, s in stops])
    columns["stop.at"] = _whole(np.column_stack([at[:, :2], at[:, 2] * 100.0, width]).reshape(-1))
    signs = [sign for sign in town.signs if sign.kind in ("stop", "yield")]
    columns["sign.at"] = _whole([v for sign in signs for v in (sign.x, sign.y)])
    columns["sign.kind"] = np.array([int(sign.kind == "stop") for sign in signs], np.int64)
    return columns


def _areas(town: TownMap, types: int) -> list[Floats]:
    """Outlines of the ground of `types`, cut into squares; holes are cut away with the squares' help."""
    whole = shapely.simplify(town.drivable_area(types), TOLERANCE)
    if whole.is_empty:
        return []
    x0, y0, x1, y1 = whole.bounds
    parts = np.array(list(whole.geoms), dtype=object) if hasattr(whole, "geoms") else np.array([whole], dtype=object)
    tree = shapely.STRtree(parts)
    outlines: list[Floats] = []
    for x in np.arange(x0, x1, CELL):
        for y in np.arange(y0, y1, CELL):
            square = shapely.box(x, y, x + CELL + OVERLAP, y + CELL + OVERLAP)
            for k in tree.query(square):
                outlines += _outlines(shapely.clip_by_rect(parts[k], *square.bounds))
    return outlines


def _outlines(shape: Any) -> list[Floats]:
    """Rings of a shape's polygons, holes joined to their outside by a bridge: one ring each, filled as it stands."""
    rings: list[Floats] = []
    for part in getattr(shape, "geoms", [shape]):
        if not isinstance(part, shapely.Polygon) or part.area < 0.01:
            continue
        turned = shapely.geometry.polygon.orient(part)
        ring = np.asarray(turned.exterior.coords)
        for hole in turned.interiors:
            if shapely.Polygon(hole).area < SMALLEST_HOLE:
                continue
            ring = np.concatenate([ring, np.asarray(hole.coords), ring[:1]])
        rings.append(ring[:-1] if not turned.interiors else ring)
    return rings


def _middle_line(polygon: Floats) -> Floats:
    """The two ends of a crosswalk's longer axis, along which walkers go."""
    (centre, axis), _, (low, high) = _axes(polygon)
    return np.array([centre + low * axis, centre + high * axis])


def _extent(polygon: Floats) -> tuple[float, float]:
    """Length and width of a crosswalk [m]."""
    _, width, (low, high) = _axes(polygon)
    return high - low, width


def _axes(polygon: Floats) -> tuple[tuple[Floats, Floats], float, tuple[float, float]]:
    corners = np.asarray(polygon, np.float64)[:, :2]
    if len(corners) > 1 and np.allclose(corners[0], corners[-1]):
        corners = corners[:-1]
    edges = np.roll(corners, -1, axis=0) - corners
    longest = edges[np.argmax(np.hypot(edges[:, 0], edges[:, 1]))]
    axis = longest / max(float(np.hypot(*longest)), 1e-9)
    across = np.array([-axis[1], axis[0]])
    aside = corners @ across
    centre = across * (float(aside.min()) + float(aside.max())) / 2.0
    along = corners @ axis
    return (centre, axis), float(np.ptp(aside)), (float(along.min()), float(along.max()))


def _thinned(points: Floats) -> Floats:
    return np.asarray(shapely.LineString(points[:, :2]).simplify(MARK_TOLERANCE).coords)


def _kind(kind: str, colour: str) -> int:
    """Number of a mark's look: `_KINDS`, plus 4 for yellow."""
    if kind in ("curb", "stop"):
        return _KINDS.index(kind)
    number = int(kind in ("broken", "broken broken", "botts dots"))
    return number + (4 if colour == "yellow" else 0)


def _put(columns: dict[str, NDArray[np.int64]], name: str, shapes: list[Floats]) -> None:
    points = np.concatenate([np.asarray(s)[:, :2] for s in shapes]) if shapes else np.zeros((0, 2))
    columns[f"{name}.n"] = np.array([len(s) for s in shapes], np.int64)
    columns[f"{name}.x"], columns[f"{name}.y"] = _whole(points[:, 0]), _whole(points[:, 1])


def _whole(values: Any) -> NDArray[np.int64]:
    return np.rint(np.asarray(values, np.float64) * UNIT).astype(np.int64)
