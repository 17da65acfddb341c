"""The ground of a town with its heights: slopes as a grid of heights, bridges as decks above it.

Lanes say how high the road lies. Beside the roads the ground keeps the height of the nearest lane and is smoothed where
neighbours differ. Where a road passes over another, the grid holds the lower one; the upper one is a row of slabs with
a raster of their own for what is painted on them. A town without heights gets a plane and no decks.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree

from lavsim.cache import replace_atomically
from lavsim.map.lane import CLEAR_HEIGHT
from lavsim.map.rise import rise_along
from lavsim.render.ground import GroundRaster, Level, cached_array, ground_raster, whole_bounds
from lavsim.render.heights import CELL, LEVEL_GROUND, Heights, heights_at, heights_of, level_ground
from lavsim.render.kerbs import kerb_quads, kerb_solids
from lavsim.render.solids import Solids, slabs
from lavsim.types import Tag

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]

VERSION = 4  # of heights, decks and kerbs; raise it whenever others come out
LEVEL = 0.005  # [m] a town whose lanes differ by less is level
DECK_REACH = 15.0  # [m] of road before and after what it passes over that is deck too
DECK_STEP = 4.0  # [m] length of a slab at most
DECK_DEPTH = 1.0  # [m] thickness of a slab
ABUTMENT = 2.0  # [m] at a deck's ends where road lies on ground and deck alike
PAINTED = 6.0  # [m] of road under a deck's ends that is painted on the ground: as far as the ground may come up there
CLEARANCE = 1.0  # [m] the ground stays so far below the underside of a deck
SMOOTHINGS = 24  # passes over the ground beside the roads
CONCRETE = (150, 150, 148)
_STANDING = (Tag.BUILDING, Tag.WALL, Tag.FENCE, Tag.VEGETATION)  # what the ground beside the roads comes up to

_NO_DECK_RASTER = GroundRaster(np.zeros((1, 1), np.uint8), np.zeros(2))


@dataclass(frozen=True, eq=False)
class Terrain:
    """The ground of a town.

    Attributes:
        raster: What lies on it.
        heights: How high it lies.
        decks: Slabs of bridges, `Material.DECK`; None without bridges.
        deck_raster: What lies on them; one empty cell without bridges.
        kerbs: Stones along the sidewalks; None without sidewalks.
    """

    raster: GroundRaster
    heights: Heights
    decks: Solids | None
    deck_raster: GroundRaster
    kerbs: Solids | None = None


def level_terrain(raster: GroundRaster) -> Terrain:
    """A plane at z = 0."""
    return Terrain(raster, LEVEL_GROUND, None, _NO_DECK_RASTER)


class Decks:
    """Which stretches of which roads are bridges.

    Attributes:
        spans: Road id, s of begin and end [m].
    """

    def __init__(self, town: TownMap) -> None:
        self.town = town
        self.spans = _spans_over_others(town)

    def covers(self, margin: float = 0.0) -> NDArray[np.bool_]:
        """(P,) which centre points of lanes lie on a deck, `margin` metres or more from its ends."""
        lanes = self.town.lanes
        road = lanes.road_id[_owners(self.town)]
        found = np.zeros(len(road), np.bool_)
        for number, begin, end in self.spans:
            found |= (road == number) & (lanes.point_s > begin + margin) & (lanes.point_s < end - margin)
        return found

    @cached_property
    def slabs(self) -> Solids | None:
        """The decks, cut across the road into pieces that are plane to millimetres."""
        quads = []
        for road, begin, end in self.spans:
            shape = self.town.shapes[road]
            for index in range(len(shape.road.sections)):
                section = self.town.section(road, index)
                low, high = max(begin, section.start), min(end, section.end - 1e-6)
                ids = sorted(section.lanes)
                if high - low < 0.1:
                    continue
                s = np.linspace(low, high, int(np.ceil((high - low) / DECK_STEP)) + 1)
                left, right = (section.polyline(section.edge(lane, s), s) for lane in (ids[-1], ids[0]))
                for k in range(len(s) - 1):
                    quads.append(np.stack([left[k], left[k + 1], right[k + 1], right[k]]))
        return slabs(np.array(quads), DECK_DEPTH, Tag.BRIDGE, CONCRETE) if quads else None

    @property
    def bounds(self) -> Floats:
        """x0, y0, x1, y1 of all slabs [m], whole metres."""
        slabs = self.slabs
        assert slabs is not None
        low, high = slabs.centre - slabs.radius[:, None], slabs.centre + slabs.radius[:, None]
        return np.concatenate([np.floor(low.min(axis=0)), np.ceil(high.max(axis=0))])

    def carry(self, points: Floats, z: Floats) -> NDArray[np.bool_]:
        """(N,) whether `points` (N, 2) with heights `z` (N,) lie on a deck."""
        found = np.zeros(len(points), np.bool_)
        slabs = self.slabs
        if slabs is None:
            return found
        for k in range(len(slabs.corners)):
            near = np.flatnonzero(np.hypot(*(points - slabs.centre[k]).T) <= slabs.radius[k])
            if len(near):
                top = slabs.z1[k] + (points[near] - slabs.centre[k]) @ slabs.tilt[k]
                inside = _depth_inside(slabs, k, points[near]) > -0.2
                found[near] |= inside & (np.abs(z[near] - top) < DECK_DEPTH)
        return found


def _depth_inside(slabs: Solids, k: int, points: Floats) -> Floats:
    """How far `points` (..., 2) lie within a slab's footprint [m], negative outside."""
    ring = slabs.xy[k, : slabs.corners[k]]
    edge = np.roll(ring, -1, axis=0) - ring
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.hypot(*edge.T)[:, None]
    inside: Floats = -(points @ normal.T - np.sum(normal * ring, axis=1)).max(axis=-1)
    return inside


def terrain_of(town: TownMap) -> Terrain:
    """The terrain of `town`, from the cache folder where it was worked out before."""
    z = town.lanes.points[:, 2]
    if len(z) == 0 or np.ptp(z) < LEVEL:
        height = float(np.median(z)) if len(z) else 0.0
        return Terrain(ground_raster(town), level_ground(height), None, _NO_DECK_RASTER, _kerbs(town))
    decks, bounds = Decks(town), whole_bounds(town)
    nodes = _kept("heights", town, lambda: _nodes(town, decks))
    heights = heights_of(nodes, float(bounds[0]), float(bounds[1]))

    def on_ground(points: Floats, z: Floats) -> NDArray[np.bool_]:
        return ~(np.abs(heights_at(heights, points) - z) > DECK_DEPTH / 2.0)

    below = ground_raster(town, Level("ground", bounds, ~decks.covers(PAINTED), on_ground))
    if decks.slabs is None:
        return Terrain(below, heights, None, _NO_DECK_RASTER, _kerbs(town))
    above = Level(f"decks{VERSION}", decks.bounds, decks.covers(-CELL), decks.carry)  # no gap at its ends
    return Terrain(below, heights, decks.slabs, ground_raster(town, above), _kerbs(town))


def _kept(name: str, town: TownMap, make: Callable[[], NDArray[Any]]) -> NDArray[Any]:
    """An array from the cache folder, made when it is not there."""
    path = cached_array(name, town, VERSION, whole_bounds(town))
    if not path.exists():
        buffer = io.BytesIO()
        np.save(buffer, make())
        replace_atomically(path, buffer.getvalue())
    kept: NDArray[Any] = np.load(path, allow_pickle=False)
    return kept


def _kerbs(town: TownMap) -> Solids | None:
    quads = _kept("kerbs", town, lambda: kerb_quads(town))
    return kerb_solids(quads) if len(quads) else None


def _owners(town: TownMap) -> NDArray[np.int64]:
    """(P,) lane of each centre point."""
    return np.repeat(np.arange(len(town.lanes)), np.diff(town.lanes.first))


def _spans_over_others(town: TownMap) -> tuple[tuple[int, float, float], ...]:
    """Roads that pass over others, with the stretch of each that is a bridge."""
    lanes, owner = town.lanes, _owners(town)
    tree = cKDTree(lanes.points[:, :2])
    pairs = tree.query_pairs(1.0, output_type="ndarray")
    first, second = pairs.T
    higher = np.where(lanes.points[first, 2] > lanes.points[second, 2], first, second)
    apart = np.abs(lanes.points[first, 2] - lanes.points[second, 2]) > CLEAR_HEIGHT
    over = np.unique(higher[apart])
    spans = []
    for road in np.unique(lanes.road_id[owner[over]]):
        s = np.sort(lanes.point_s[over[lanes.road_id[owner[over]] == road]])
        length = float(town.shapes[int(road)].section_s[-1])
        for piece in np.split(s, np.flatnonzero(np.diff(s) > 2.0 * DECK_REACH) + 1):
            begin, end = max(0.0, piece[0] - DECK_REACH), min(length, piece[-1] + DECK_REACH)
            spans.append((int(road), float(begin), float(end)))
    return tuple(spans)


def _nodes(town: TownMap, decks: Decks) -> NDArray[np.float32]:
    """Heights of the grid's corners: the lanes' where there are lanes, smooth between them."""
    low, high = np.split(whole_bounds(town), 2)
    columns, rows = (np.rint((high - low) / CELL).astype(int) + 1).tolist()
    x, y = np.meshgrid(low[0] + CELL * np.arange(columns), low[1] + CELL * np.arange(rows))
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    found = _nearest_heights(town, ~decks.covers(ABUTMENT), places)
    nodes, fixed = found[0].reshape(rows, columns), found[1].reshape(rows, columns)
    known = nodes.copy()
    for width in np.linspace(9, 3, SMOOTHINGS).astype(int).tolist():
        nodes = np.where(fixed, known, uniform_filter(nodes, width | 1, mode="nearest"))
    if decks.slabs is not None:
        _sink_below(nodes, decks.slabs, low)
    return np.round(nodes, 3).astype(np.float32)  # what is level but for rounding errors becomes so


def _nearest_heights(town: TownMap, used: NDArray[np.bool_], places: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Height of what is nearest of the lane points `used` and of what stands beside the roads, at each place (N, 2);
    and whether the place lies on it."""
    lanes = town.lanes
    used = used & (lanes.width > 0.05)
    feet = _feet(town)
    on_lane, at_foot = cKDTree(lanes.points[used, :2]), cKDTree(feet[:, :2])
    distance, row = on_lane.query(places)
    points, width = lanes.points[used][row], lanes.width[used][row]
    ahead = (places[:, 0] - points[:, 0]) * np.cos(points[:, 3]) + (places[:, 1] - points[:, 1]) * np.sin(points[:, 3])
    height = points[:, 2] + rise_along(town)[used][row] * np.clip(ahead, -CELL, CELL)
    fixed = distance <= width / 2.0 + CELL
    if len(feet):
        nearest, foot = at_foot.query(places)
        stands = ~fixed & (nearest < distance)
        height = np.where(stands, feet[foot, 2], height)
        fixed |= nearest <= CELL
    return height, fixed


def _feet(town: TownMap) -> Floats:
    """(N, 3) places where houses, walls and trees touch the ground, about a metre apart."""
    prisms = town.scenery.prisms
    found = [np.zeros((0, 3))]
    for k in np.flatnonzero(prisms.solid & np.isin(prisms.tag, _STANDING)):
        ring = prisms.vertices[k, : prisms.count[k]]
        sides = np.roll(ring, -1, axis=0) - ring
        count = max(1, int(np.ceil(np.hypot(*sides.T).max() / CELL)))
        along = np.arange(count) / count
        rim = (ring[:, None] + sides[:, None] * along[None, :, None]).reshape(-1, 2)
        inner = ring.mean(axis=0)
        spokes = max(1, int(np.ceil(np.hypot(*(ring - inner).T).max() / CELL)))
        share = np.linspace(0.0, 1.0, spokes + 1)
        places = (inner + share[:, None, None] * (rim - inner)[None]).reshape(-1, 2)
        found.append(np.column_stack([places, np.full(len(places), prisms.z0[k])]))
    return np.concatenate(found)


def _sink_below(nodes: Floats, slabs: Solids, low: Floats) -> None:
    """Keeps the ground clear of what hangs above it."""
    for k in range(len(slabs.corners)):
        ring = slabs.xy[k, : slabs.corners[k]]
        first = np.maximum(np.floor((ring.min(axis=0) - low) / CELL).astype(int), 0)
        last = np.ceil((ring.max(axis=0) - low) / CELL).astype(int) + 1
        part = nodes[first[1] : last[1], first[0] : last[0]]
        y, x = np.mgrid[first[1] : first[1] + part.shape[0], first[0] : first[0] + part.shape[1]]
        place = np.stack([x, y], axis=-1) * CELL + low
        inside = _depth_inside(slabs, k, place) > 0.0
        rest = place - slabs.centre[k]
        ceiling = slabs.z0[k] + rest @ slabs.tilt[k] - CLEARANCE
        # At the abutments the ground carries the road itself.
        sunk = inside & (np.abs(part - ceiling - DECK_DEPTH - CLEARANCE) > 0.05)
        part[sunk] = np.minimum(part, ceiling)[sunk]
