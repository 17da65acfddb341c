"""What stands beside the roads: houses, trees, posts, and the traffic lights' poles with their lamps.

Worked out from the map alone: the same file gives the same scenery, for any town. Nothing stands on a road, and only
posts stand on a sidewalk.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lavsim.geometry import box_corners, forward, right
from lavsim.map.lane import DRIVABLE, RoadShape
from lavsim.map.prisms import PrismList, Prisms
from lavsim.map.signal import TrafficLight
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.types import LaneType, Tag

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

SCENERY_VERSION = 1  # raise it whenever the same map gives other scenery
logger = logging.getLogger(__name__)

FACADES: tuple[Colour, ...] = (
    (214, 196, 160), (201, 171, 128), (190, 140, 110), (176, 108, 84), (222, 214, 198), (160, 160, 158),
    (186, 178, 150), (150, 122, 104), (205, 188, 176), (140, 148, 150), (228, 206, 150), (170, 186, 180),
)  # fmt: skip
ROOFS: tuple[Colour, ...] = ((138, 66, 48), (120, 58, 46), (92, 84, 84), (104, 74, 60), (74, 76, 82))
LEAVES: tuple[Colour, ...] = ((70, 104, 52), (86, 118, 60), (58, 92, 50), (98, 124, 66))
BARK: Colour = (92, 74, 58)
HEDGE: Colour = (62, 92, 50)
POST: Colour = (96, 98, 100)
HOUSING: Colour = (32, 34, 34)
LAMPS: tuple[Colour, ...] = ((200, 30, 24), (220, 170, 30), (30, 180, 70))  # red, yellow, green, as `Prisms.lamp`

# A head on a post of its own, as in Europe; one across the junction hangs higher to be seen over the traffic.
HEAD_NEAR, HEAD_FAR = 2.6, 4.6  # [m] underside of the housing
FAR = 12.0  # [m] a pole farther than this from its stop line stands across the junction
HEAD_SIZE = (0.24, 0.36, 1.1)  # [m] depth, width, height
LAMP_SIZE, LAMP_DEPTH, LAMP_PITCH = 0.26, 0.05, 0.35  # [m]
POLE_RADIUS = 0.07  # [m]

SIDEWALK_CLEARANCE = 1.0  # [m] least distance of a house from any lane
JUNCTION_CLEARANCE = 5.0  # [m] least distance of a house from the driven part of a junction: one sees round it
TREE_BACK = 1.0  # [m] trunk behind the sidewalk
MOST_HOUSES = 700  # a large town with more candidates keeps every second, third …


@dataclass(frozen=True, eq=False)
class Scenery:
    """Everything that stands still in a town.

    Attributes:
        prisms: All of it; traffic-light housings and lamps carry their light's index.
    """

    prisms: Prisms


@dataclass(frozen=True)
class _Edge:
    """The outer edge of a road, from which everything is set back.

    Attributes:
        points: (n, 2) along the edge [m].
        outward: (n, 2) unit vectors away from the road.
        z: (n,) height [m].
        along: (n,) length along the edge [m].
        urban: Whether the edge is a sidewalk's.
        key: Road id and side, which name its draws.
    """

    points: Floats
    outward: Floats
    z: Floats
    along: Floats
    urban: bool
    key: tuple[int, int]

    def at(self, where: float) -> tuple[Floats, Floats, float]:
        """Point, outward normal and height at a length along the edge."""
        row = int(np.clip(np.searchsorted(self.along, where), 0, len(self.along) - 1))
        return self.points[row], self.outward[row], float(self.z[row])


def build_scenery(town: TownMap) -> Scenery:
    """The scenery of a town."""
    draws = Draws.of_seed(int(town.digest, 16)).stream("scenery", SCENERY_VERSION)
    ground = _Ground(town)
    prisms = PrismList()
    poles = [_light_pole(town, light, prisms) for light in town.lights]
    poles += _sign_posts(town, prisms)
    edges = _edges(town)
    footprints = _houses(edges, ground, draws, prisms)
    _greenery(edges, ground, draws, footprints, poles, prisms)
    logger.debug("%s: %d prisms, %d houses", town.name, len(prisms), len(footprints))
    return Scenery(prisms.build())


class _Ground:
    """Where nothing may stand."""

    def __init__(self, town: TownMap) -> None:
        lanes, pieces, driven = town.lanes, [], []
        for lane in range(len(lanes)):
            points, half = lanes.centre_line(lane), lanes.width[lanes.rows(lane), None] / 2.0
            if half.max() < 0.05:
                continue
            aside = right(points[:, 3]) * half
            left_edge, right_edge = points[:, :2] - aside, points[:, :2] + aside
            for k in range(0, len(points) - 1, 40):  # short pieces: their boxes stay small for the search tree
                end = min(k + 41, len(points))
                pieces.append(np.concatenate([left_edge[k:end], right_edge[k:end][::-1]]))
                driven.append(lanes.junction[lane] >= 0 and bool(lanes.type[lane] & DRIVABLE))
        shapes = np.array([shapely.Polygon(p) for p in pieces])
        crossed = ~shapely.is_valid(shapes)  # the inner edge of a bend tighter than the lane is wide
        shapes[crossed] = shapely.make_valid(shapes[crossed])
        self.lanes = shapely.STRtree(shapes)
        self.junctions = shapely.STRtree(shapes[np.array(driven, np.bool_)])

    def near_lanes(self, shapes: NDArray[np.object_], distance: float) -> NDArray[np.bool_]:
        """Whether each of `shapes` comes within `distance` of a lane of any kind."""
        return self._near(self.lanes, shapes, distance)

    def near_junctions(self, shapes: NDArray[np.object_], distance: float) -> NDArray[np.bool_]:
        """Whether each of `shapes` comes within `distance` of a driven junction lane."""
        return self._near(self.junctions, shapes, distance)

    @staticmethod
    def _near(tree: shapely.STRtree, shapes: NDArray[np.object_], distance: float) -> NDArray[np.bool_]:
        mask = np.zeros(len(shapes), np.bool_)
        if len(shapes) and len(tree.geometries):
            mask[np.unique(tree.query(shapes, predicate="dwithin", distance=distance)[0])] = True
        return mask


def _edges(town: TownMap) -> list[_Edge]:
    """Outer edges of all roads outside junctions, where traffic passes."""
    lanes = town.lanes
    groups: dict[tuple[int, int], list[int]] = {}
    for lane in np.flatnonzero(lanes.junction < 0).tolist():
        groups.setdefault((int(lanes.road_id[lane]), int(lanes.section[lane])), []).append(lane)
    edges = []
    for (road, _), members in groups.items():
        if not (lanes.type[members] & DRIVABLE).any():
            continue
        for side in (-1, 1):
            outer = [k for k in members if np.sign(lanes.lane_id[k]) == side]
            while outer and lanes.width[lanes.rows(max(outer, key=lambda k: abs(lanes.lane_id[k])))].max() < 0.05:
                outer.remove(max(outer, key=lambda k: abs(lanes.lane_id[k])))
            if not outer:
                continue
            lane = max(outer, key=lambda k: abs(int(lanes.lane_id[k])))
            points, half = lanes.centre_line(lane), lanes.width[lanes.rows(lane), None] / 2.0
            away = right(points[:, 3])  # travel has its outer edge to the right, on either side of the road
            border = points[:, :2] + away * half
            along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(border, axis=0).T))])
            urban = bool(lanes.type[lane] & LaneType.SIDEWALK)
            edges.append(_Edge(border, away, points[:, 2], along, urban, (road, side)))
    return edges


def _pick(table: tuple[Colour, ...], unit: float) -> Colour:
    return table[min(int(unit * len(table)), len(table) - 1)]


def _houses(edges: list[_Edge], ground: _Ground, draws: Draws, prisms: PrismList) -> list[Floats]:
    """Rows of houses along the edges; their footprints."""
    rows: list[tuple[Floats, float, float, Floats]] = []  # footprint, z, height, units left for its looks
    for edge in edges:
        length = float(edge.along[-1])
        count = int(length / 8.0) + 4
        units = draws.stream("houses", *edge.key).uniform(0, 10 * count).reshape(count, 10)
        place = 1.0 + 4.0 * units[0, 0]
        # Streets have a character: how high, how deep, how closely built.
        height_of_street, gap_of_street = 5.0 + 6.0 * units[0, 1], 1.0 + 7.0 * units[0, 2] ** 2
        for unit in units[1:]:
            front = 8.0 + 12.0 * unit[0]
            if not edge.urban:
                place += 25.0 + 60.0 * unit[9]
            if place + front > length:
                break
            (a, out, z), (b, _, _) = edge.at(place), edge.at(place + front)
            depth = 8.0 + 5.0 * unit[1]
            back = (1.8 + 2.2 * unit[2]) if edge.urban else (8.0 + 10.0 * unit[2])
            yaw = float(np.arctan2(b[1] - a[1], b[0] - a[0]))
            aside = right(yaw)
            aside = aside if aside @ out > 0.0 else -aside
            # On the inside of a bend the ends of the chord come nearer to the road than its middle.
            centre = (a + b) / 2.0 + aside * (back + depth / 2.0)
            if unit[3] > 0.1:  # the odd plot is a garden
                size = np.array([front - 0.2]), np.array([depth])
                footprint = box_corners(centre[:1], centre[1:], np.array([yaw]), *size)[0]
                height = float(np.clip(height_of_street + 6.0 * (unit[4] - 0.5), 4.0, 15.0))
                rows.append((footprint, z, height, unit[5:]))
            place += front + gap_of_street * (0.3 + 1.4 * unit[6])
    if not rows:
        return []
    shapes = np.array([shapely.Polygon(r[0]) for r in rows])
    free = ~(ground.near_lanes(shapes, SIDEWALK_CLEARANCE) | ground.near_junctions(shapes, JUNCTION_CLEARANCE))
    kept = _spread(shapes, np.flatnonzero(free))
    if len(kept) > MOST_HOUSES:
        kept = kept[np.linspace(0, len(kept) - 1, MOST_HOUSES).astype(int)]
    footprints = []
    for k in kept:
        footprint, z, height, unit = rows[k]
        colour = _pick(FACADES, unit[0])
        prisms.add(footprint, z, z + height, Tag.BUILDING, colour)
        if unit[1] > 0.35 and height < 13.5:  # a roof, set in from the eaves
            centre = footprint.mean(axis=0)
            prisms.add(
                centre + 0.78 * (footprint - centre), z + height, z + min(height + 1.2 + 1.2 * unit[2], 15.0),
                Tag.BUILDING, _pick(ROOFS, unit[3]), solid=False,
            )  # fmt: skip
        footprints.append(footprint)
    return footprints


def _spread(shapes: NDArray[np.object_], order: NDArray[np.int64]) -> NDArray[np.int64]:
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


def _ring(centre: Floats, radius: float, corners: int = 8) -> Floats:
    turn = np.arange(corners) * (2.0 * np.pi / corners) + np.pi / corners
    return np.asarray(centre) + radius * forward(turn)


def _greenery(
    edges: list[_Edge], ground: _Ground, draws: Draws, houses: list[Floats], poles: list[Floats], prisms: PrismList
) -> None:
    """Trees behind the sidewalks, lamp posts, and hedges where no house stands."""
    taken = [shapely.Polygon(h) for h in houses] + [shapely.Point(p).buffer(1.0) for p in poles]
    items: list[tuple[str, Floats, float, Floats]] = []  # kind, place or footprint, z, units
    shapes: list[shapely.Polygon] = []
    for edge in edges:
        length = float(edge.along[-1])
        spacing = 16.0 if edge.urban else 28.0
        count = int(length / spacing)
        units = draws.stream("trees", *edge.key).uniform(0, 5 * (count + 1)).reshape(-1, 5)
        lush = 0.25 + 0.6 * units[0, 0]  # some streets are avenues
        for k in range(count):
            unit = units[k + 1]
            point, out, z = edge.at((k + 0.2 + 0.6 * unit[0]) * spacing)
            if unit[1] < lush:
                radius = 1.1 + 0.8 * unit[2]
                place = point + out * ((TREE_BACK if edge.urban else 4.0) + radius * 0.4 + 0.6 * unit[3])
                items.append(("tree", place, z, unit))
                shapes.append(shapely.Polygon(_ring(place, radius)))
            elif edge.urban and unit[1] > 0.93:
                ahead = np.array([-out[1], out[0]])
                middle, half = point + out * 1.4, 1.5 + 2.5 * unit[2]
                corners = np.array(
                    [middle + sx * half * ahead + sy * 0.35 * out for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
                )
                items.append(("hedge", corners, z, unit))
                shapes.append(shapely.Polygon(corners))
        if edge.urban:
            for k in range(int(length / 35.0)):
                point, out, z = edge.at(35.0 * k + 17.0)
                place = point + out * 0.3
                items.append(("lamp post", place, z, np.zeros(5)))
                shapes.append(shapely.Polygon(_ring(place, 0.1)))
    if not items:
        return
    outlines = np.array(shapes)
    trunks = np.array(
        [s.centroid.buffer(0.2) if item[0] == "tree" else s for s, item in zip(shapes, items, strict=True)]
    )
    free = ~(ground.near_lanes(trunks, 0.1) | ground.near_junctions(outlines, 1.0))
    if taken:
        free[np.unique(shapely.STRtree(taken).query(outlines, predicate="intersects")[0])] = False
    for k in _spread(outlines, np.flatnonzero(free)):
        kind, place, z, unit = items[k]
        if kind == "tree":
            crown, low = 1.1 + 0.8 * unit[2], 2.4 + 0.5 * unit[3]
            colour = _pick(LEAVES, unit[4])
            darker: Colour = (int(0.85 * colour[0]), int(0.85 * colour[1]), int(0.85 * colour[2]))
            prisms.add(_ring(place, 0.16), z, z + low, Tag.VEGETATION, BARK)
            prisms.add(_ring(place, crown), z + low, z + low + 1.3 * crown, Tag.VEGETATION, darker, solid=False)
            top = z + low + 2.2 * crown
            prisms.add(_ring(place, 0.65 * crown), z + low + 1.3 * crown, top, Tag.VEGETATION, colour, solid=False)
        elif kind == "hedge":
            prisms.add(place, z, z + 0.9 + 0.7 * unit[3], Tag.VEGETATION, HEDGE)
        else:
            prisms.add(_ring(place, 0.08), z, z + 6.0, Tag.POLE, POST)


def _beside_road(town: TownMap, place: Floats) -> Floats:
    """`place` moved off any driven lane that it stands on, to 0.6 m from its edge."""
    hits = town.nearest(place[None])
    if hits.lane[0] < 0 or hits.distance[0] >= hits.width[0] / 2.0 + 0.2:
        return place
    side = 1.0 if hits.offset[0] >= 0.0 else -1.0
    return hits.points[0, :2] + side * (hits.width[0] / 2.0 + 0.6) * right(hits.yaw[0])


def _light_pole(town: TownMap, light: TrafficLight, prisms: PrismList) -> Floats:
    """A pole, the housing in front of it, and three lamps on the side that the light looks to."""
    place = _beside_road(town, np.array([light.x, light.y]))
    ground = float(town.lanes.points[town.lanes.first[light.approach[0] + 1] - 1, 2]) if light.approach else light.z
    stops = np.array([(s.x, s.y) for s in light.stop_lines]).reshape(-1, 2)
    across = len(stops) > 0 and float(np.hypot(*(stops - place).T).min()) > FAR
    low = ground + (HEAD_FAR if across else HEAD_NEAR)
    look, beside = forward(light.yaw), right(light.yaw)
    prisms.add(_ring(place, POLE_RADIUS), ground, low + HEAD_SIZE[2] + 0.1, Tag.POLE, POST, light=light.index)

    def box(near: float, far: float, half: float) -> Floats:
        return np.array(
            [place + look * d + beside * w for d, w in ((near, -half), (far, -half), (far, half), (near, half))]
        )

    front = POLE_RADIUS + HEAD_SIZE[0]
    prisms.add(
        box(POLE_RADIUS, front, HEAD_SIZE[1] / 2.0), low, low + HEAD_SIZE[2], Tag.TRAFFIC_LIGHT, HOUSING,
        solid=False, light=light.index,
    )  # fmt: skip
    for lamp, colour in enumerate(LAMPS):
        middle = low + HEAD_SIZE[2] / 2.0 + (1 - lamp) * LAMP_PITCH
        prisms.add(
            box(front, front + LAMP_DEPTH, LAMP_SIZE / 2.0), middle - LAMP_SIZE / 2.0, middle + LAMP_SIZE / 2.0,
            Tag.TRAFFIC_LIGHT, colour, solid=False, light=light.index, lamp=lamp,
        )  # fmt: skip
    return place


def _sign_posts(town: TownMap, prisms: PrismList) -> list[Floats]:
    """Posts with a plate for speed signs."""
    places = []
    for road in town.network.roads:
        shape: RoadShape = town.shapes[road.id]
        for thing in road.objects:
            if thing.name.lower().startswith("speed_"):
                x, y, z, yaw = shape.place(thing.s, thing.t)
                place = _beside_road(town, np.array([x, y]))
                facing = yaw + (np.pi if thing.t * (-1.0 if thing.orientation == "+" else 1.0) <= 0.0 else 0.0)
                look, beside = forward(facing), right(facing)
                prisms.add(_ring(place, 0.04), z, z + 2.7, Tag.POLE, POST)
                plate = [
                    place + look * d + beside * w for d, w in ((0.05, -0.3), (0.09, -0.3), (0.09, 0.3), (0.05, 0.3))
                ]
                prisms.add(np.array(plate), z + 2.0, z + 2.6, Tag.TRAFFIC_SIGN, (226, 226, 222), solid=False)
                places.append(place)
    return places
