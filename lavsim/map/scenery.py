"""What stands beside the roads: houses, walls and hedges, trees, posts and rails, and where cars may be parked.

Worked out from the map alone: the same file gives the same scenery, for any town. Nothing stands on a road, and only
posts stand on a sidewalk.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lavsim.geometry import box_corners, right
from lavsim.map.furniture import POST, Colour, bus_stops, guard_rails, light_post, medians, ring, sign_post
from lavsim.map.prisms import PrismList, Prisms
from lavsim.map.roadside import Edge, Floats, Ground, Shapes, edges_of, quads
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.types import LaneType, Tag

SCENERY_VERSION = 2  # raise it whenever the same map gives other scenery
logger = logging.getLogger(__name__)

FACADES: tuple[Colour, ...] = (
    (214, 196, 160), (201, 171, 128), (190, 140, 110), (176, 108, 84), (222, 214, 198), (160, 160, 158),
    (186, 178, 150), (150, 122, 104), (205, 188, 176), (140, 148, 150), (228, 206, 150), (170, 186, 180),
)  # fmt: skip
ROOFS: tuple[Colour, ...] = ((138, 66, 48), (120, 58, 46), (92, 84, 84), (104, 74, 60), (74, 76, 82))
LEAVES: tuple[Colour, ...] = ((70, 104, 52), (86, 118, 60), (58, 92, 50), (98, 124, 66))
STONES: tuple[Colour, ...] = ((168, 160, 148), (150, 132, 112), (188, 180, 168), (142, 98, 82))
BARK: Colour = (92, 74, 58)
HEDGE: Colour = (62, 92, 50)
PALING: Colour = (134, 110, 84)

SIDEWALK_CLEARANCE = 1.0  # [m] least distance of a house from any lane
JUNCTION_CLEARANCE = 5.0  # [m] least distance of a house from the driven part of a junction: one sees round it
TREE_BACK = 1.0  # [m] trunk behind the sidewalk
MOST_HOUSES = 900  # a large town with more candidates keeps every second, third …
FRONT_BACK = 0.45  # [m] walls and hedges behind the sidewalk
FRONT_LENGTH = 9.0  # [m] longest piece of them
FRONT_CORNER = 8.0  # [m] of street before a junction without them: one sees round it
MEDIAN_TREES = 15.0  # [m] between trees on a median
YARD = 22.0  # [m] behind the houses' line where gardens have trees
SLOT = 6.2  # [m] of a parking lane that a car takes
SLOT_WIDTH = 1.9  # [m] least width of a parking lane


@dataclass(frozen=True, eq=False)
class Scenery:
    """Everything that stands still in a town.

    Attributes:
        prisms: All of it; traffic-light housings and lamps carry their light's index.
        parking: (K, 4) x, y, z, yaw [m, rad] of places where a car may be parked, none of them taken.
    """

    prisms: Prisms
    parking: Floats


@dataclass(frozen=True)
class _House:
    """A plot that is built on.

    Attributes:
        footprint: (4, 2) [m].
        z, height: [m].
        edge: Number of its edge.
        begin, end: Along the edge [m].
        units: Left for its looks.
    """

    footprint: Floats
    z: float
    height: float
    edge: int
    begin: float
    end: float
    units: Floats


def build_scenery(town: TownMap) -> Scenery:
    """The scenery of a town."""
    draws = Draws.of_seed(int(town.digest, 16)).stream("scenery", SCENERY_VERSION)
    ground, edges, prisms = Ground(town), edges_of(town), PrismList()
    posts = [light_post(town, light, prisms) for light in town.lights]
    posts += [sign_post(town, sign, prisms) for sign in town.signs]
    taken = guard_rails(town, edges, ground, prisms) + bus_stops(edges, draws, prisms)
    houses = _houses(edges, ground, draws, taken, prisms)
    _fronts(edges, houses, ground, draws, taken, prisms)
    solid = [*taken, *(house.footprint for house in houses)]
    _greenery(town, edges, ground, draws, solid, posts, prisms)
    logger.debug("%s: %d prisms, %d houses", town.name, len(prisms), len(houses))
    return Scenery(prisms.build(), _parking(town))


def _pick(table: tuple[Colour, ...], unit: float) -> Colour:
    return table[min(int(unit * len(table)), len(table) - 1)]


def _hit(shapes: Shapes, others: list[Floats], distance: float = 0.0) -> NDArray[np.bool_]:
    """Whether each of `shapes` comes within `distance` of any footprint (4, 2)."""
    mask = np.zeros(len(shapes), np.bool_)
    if others and len(shapes):
        tree = shapely.STRtree(quads(np.array(others)))
        mask[np.unique(tree.query(shapes, predicate="dwithin", distance=distance)[0])] = True
    return mask


def _houses(edges: list[Edge], ground: Ground, draws: Draws, taken: list[Floats], prisms: PrismList) -> list[_House]:
    """Rows of houses along the edges; taller and closer where a street has several lanes."""
    rows: list[_House] = []
    for number, edge in enumerate(edges):
        length = edge.length
        count = int(length / 8.0) + 4
        units = draws.stream("houses", *edge.key).uniform(0, 10 * count).reshape(count, 10)
        place = 1.0 + 4.0 * units[0, 0]
        # Streets have a character: how high, how deep, how closely built.
        height_of_street, gap_of_street = 5.0 + 6.0 * units[0, 1], 1.0 + 7.0 * units[0, 2] ** 2
        busy = edge.urban and edge.lanes > 1
        if busy:
            height_of_street, gap_of_street = 8.5 + 5.5 * units[0, 1], 0.4 + 4.0 * units[0, 2] ** 2
        for unit in units[1:]:
            front = (11.0 if busy else 8.0) + 12.0 * unit[0]
            if not edge.urban:
                place += 25.0 + 60.0 * unit[9]
            if place + front > length:
                break
            (a, out, z), (b, _, _) = edge.at(place), edge.at(place + front)
            depth = (11.0 if busy else 8.0) + 5.0 * unit[1]
            back = (1.8 + 2.2 * unit[2]) if edge.urban else (8.0 + 10.0 * unit[2])
            if edge.speed > 19.0 and not edge.urban:
                back += 14.0  # nobody lives beside a motorway
            yaw = float(np.arctan2(b[1] - a[1], b[0] - a[0]))
            aside = right(yaw)
            aside = aside if aside @ out > 0.0 else -aside
            # On the inside of a bend the ends of the chord come nearer to the road than its middle.
            centre = (a + b) / 2.0 + aside * (back + depth / 2.0)
            if unit[3] > 0.1:  # the odd plot is a garden
                size = np.array([front - 0.2]), np.array([depth])
                footprint = box_corners(centre[:1], centre[1:], np.array([yaw]), *size)[0]
                height = float(np.clip(height_of_street + 6.0 * (unit[4] - 0.5), 4.0, 15.0))
                rows.append(_House(footprint, z, height, number, place, place + front, unit[5:]))
            place += front + gap_of_street * (0.3 + 1.4 * unit[6])
    if not rows:
        return []
    shapes = quads(np.array([house.footprint for house in rows]))
    free = ~(ground.near_lanes(shapes, SIDEWALK_CLEARANCE) | ground.near_junctions(shapes, JUNCTION_CLEARANCE))
    free &= ~_hit(shapes, taken)
    kept = _spread(shapes, np.flatnonzero(free))
    if len(kept) > MOST_HOUSES:
        kept = kept[np.linspace(0, len(kept) - 1, MOST_HOUSES).astype(int)]
    for k in kept.tolist():
        footprint, z, height, unit = rows[k].footprint, rows[k].z, rows[k].height, rows[k].units
        prisms.add(footprint, z, z + height, Tag.BUILDING, _pick(FACADES, unit[0]))
        if unit[1] > 0.35 and height < 13.5:  # a roof, set in from the eaves
            centre = footprint.mean(axis=0)
            prisms.add(
                centre + 0.78 * (footprint - centre), z + height, z + min(height + 1.2 + 1.2 * unit[2], 15.0),
                Tag.BUILDING, _pick(ROOFS, unit[3]), solid=False,
            )  # fmt: skip
    return [rows[k] for k in kept.tolist()]


def _spread(shapes: Shapes, order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Members of `order` that overlap no earlier kept one."""
    chosen = shapes[order]
    first, second = shapely.STRtree(chosen).query(chosen, predicate="intersects")
    rivals: dict[int, list[int]] = {}
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        if b < a:
            rivals.setdefault(a, []).append(b)
    kept = np.ones(len(chosen), np.bool_)
    for a in sorted(rivals):
        kept[a] = not kept[rivals[a]].any()
    return order[kept]


def _fronts(
    edges: list[Edge], houses: list[_House], ground: Ground, draws: Draws, taken: list[Floats], prisms: PrismList
) -> None:
    """Walls, fences and hedges behind the sidewalk where no house stands; what they cover joins `taken`."""
    built: dict[int, list[tuple[float, float]]] = {}
    for house in houses:
        built.setdefault(house.edge, []).append((house.begin, house.end))
    found: list[tuple[Floats, float, int, Floats]] = []  # footprint, z, kind, units
    for number, edge in enumerate(edges):
        if not edge.urban:
            continue
        spans = sorted(built.get(number, ()))
        units = draws.stream("fronts", *edge.key).uniform(0, 4 * (len(spans) + 2)).reshape(-1, 4)
        kind = int(5.0 * units[0, 0])  # of the street: 0 walls, 1 fences, 2 hedges, 3 some of each, 4 open
        at = FRONT_CORNER
        for (begin, end), unit in zip([*spans, (edge.length - FRONT_CORNER, edge.length)], units[1:], strict=False):
            low, high = at, min(begin, edge.length - FRONT_CORNER)
            at = max(at, end)
            if kind == 4 or high - low < 1.5 or unit[0] < 0.15:
                continue
            what = int(3.0 * unit[1]) if kind == 3 else kind
            for a, b in edge.pieces(low, high, FRONT_LENGTH):
                shape, z = edge.strip(a, b, FRONT_BACK, (0.25, 0.08, 0.7)[what])
                found.append((shape, z, what, unit))
    if not found:
        return
    shapes = quads(np.array([shape for shape, *_ in found]))
    free = ~(ground.near_lanes(shapes, 0.1) | ground.near_junctions(shapes, 4.0) | _hit(shapes, taken, 0.2))
    free &= ~_hit(shapes, [house.footprint for house in houses])
    for k in np.flatnonzero(free).tolist():
        shape, z, what, unit = found[k]
        if what == 0:
            prisms.add(shape, z, z + 0.9 + 0.8 * unit[2], Tag.WALL, _pick(STONES, unit[3]))
        elif what == 1:
            prisms.add(shape, z, z + 0.9 + 0.3 * unit[2], Tag.FENCE, PALING)
        else:
            prisms.add(shape, z, z + 0.9 + 0.7 * unit[2], Tag.VEGETATION, HEDGE)
        taken.append(shape)


def _greenery(
    town: TownMap,
    edges: list[Edge],
    ground: Ground,
    draws: Draws,
    solid: list[Floats],
    posts: list[Floats],
    prisms: PrismList,
) -> None:
    """Trees behind the sidewalks, in gardens and on medians, and lamp posts."""
    trees: list[tuple[Floats, float, float, Floats]] = []  # place, z, radius, units
    lamps: list[tuple[Floats, float]] = []
    for edge in edges:
        spacing = 16.0 if edge.urban else 28.0
        count = int(edge.length / spacing)
        units = draws.stream("trees", *edge.key).uniform(0, 10 * (count + 1)).reshape(-1, 5)
        lush = 0.25 + 0.6 * units[0, 0]  # some streets are avenues
        for k in range(count):
            unit, yard = units[2 * k + 1], units[2 * k + 2]
            point, out, z = edge.at((k + 0.2 + 0.6 * unit[0]) * spacing)
            if unit[1] < lush:
                radius = 1.1 + 0.8 * unit[2]
                place = point + out * ((TREE_BACK if edge.urban else 4.0) + radius * 0.4 + 0.6 * unit[3])
                trees.append((place, z, radius, unit))
            if edge.urban and yard[1] < 0.4:
                radius = 1.3 + 1.2 * yard[2]
                trees.append((point + out * (YARD + 16.0 * yard[3]), z, radius, yard))
        if edge.urban:
            for k in range(int(edge.length / 35.0)):
                point, out, z = edge.at(35.0 * k + 17.0)
                lamps.append((point + out * 0.3, z))
    middle: list[tuple[Floats, float, float, Floats]] = []
    for line in medians(town, fast=False):
        units = draws.stream("median", *line.key).uniform(0, 5 * (int(line.length / MEDIAN_TREES) + 1)).reshape(-1, 5)
        for k, unit in enumerate(units[:-1]):
            point, _, z = line.at((k + 0.5) * MEDIAN_TREES)
            middle.append((point, z, 1.1 + 0.4 * unit[2], unit))
    for place, z, radius, unit in middle:
        _tree(place, z, radius, unit, prisms)
    if lamps:
        spots = quads(np.array([ring(place, 0.1) for place, _ in lamps]))
        free = ~(ground.near_lanes(spots, 0.1) | ground.near_junctions(spots, 1.0) | _hit(spots, solid, 0.1))
        for k in np.flatnonzero(free).tolist():
            prisms.add(ring(lamps[k][0], 0.08), lamps[k][1], lamps[k][1] + 6.0, Tag.POLE, POST)
            posts.append(lamps[k][0])
    if not trees:
        return
    crowns = quads(np.array([ring(place, radius) for place, _, radius, _ in trees]))
    trunks = quads(np.array([ring(place, 0.2) for place, *_ in trees]))
    free = ~(ground.near_lanes(trunks, 0.1) | ground.near_junctions(crowns, 1.0) | _hit(trunks, solid, 0.15))
    houses = [shape for shape in solid if np.ptp(shape, axis=0).min() > 3.0]
    free &= ~_hit(crowns, houses)
    if posts:
        free &= ~_hit(crowns, [ring(post, 1.0, 4) for post in posts])
    for k in _spread(crowns, np.flatnonzero(free)).tolist():
        place, z, radius, unit = trees[k]
        _tree(place, z, radius, unit, prisms)


def _tree(place: Floats, z: float, crown: float, unit: Floats, prisms: PrismList) -> None:
    """A trunk and a crown of two steps."""
    low = 2.4 + 0.5 * float(unit[3])
    colour = _pick(LEAVES, float(unit[4]))
    darker: Colour = (int(0.85 * colour[0]), int(0.85 * colour[1]), int(0.85 * colour[2]))
    prisms.add(ring(place, 0.16), z, z + low, Tag.VEGETATION, BARK)
    prisms.add(ring(place, crown), z + low, z + low + 1.3 * crown, Tag.VEGETATION, darker, solid=False)
    top = z + low + 2.2 * crown
    prisms.add(ring(place, 0.65 * crown), z + low + 1.3 * crown, top, Tag.VEGETATION, colour, solid=False)


def _parking(town: TownMap) -> Floats:
    """Places of parked cars: along parking lanes, and on spaces drawn as objects."""
    lanes, found = town.lanes, []
    for lane in lanes.where(int(LaneType.PARKING)).tolist():
        rows = lanes.rows(lane)
        wide = np.flatnonzero(lanes.width[rows] >= SLOT_WIDTH)
        if not len(wide):
            continue
        begin, end = wide[0] * lanes.step[lane], wide[-1] * lanes.step[lane]
        count = int((end - begin) / SLOT)
        u = begin + ((end - begin) - count * SLOT) / 2.0 + SLOT * (np.arange(count) + 0.5)
        found.append(town.centre(np.full(count, lane), u)[:, :4])
    if town.parking:
        places = np.array([(slot.x, slot.y, 0.0, slot.yaw) for slot in town.parking])
        hits = town.nearest(places[:, :2])
        places[:, 2] = hits.points[:, 2]
        found.append(places)
    return np.concatenate(found) if found else np.zeros((0, 4))
