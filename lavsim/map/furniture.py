"""Street furniture: lights on posts and mast arms, signs, guard rails, bus stops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import forward, right
from lavsim.map.prisms import PrismList
from lavsim.map.roadside import Edge, Ground, quads
from lavsim.map.signal import Sign, TrafficLight
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.types import LaneType, Tag

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

POST: Colour = (96, 98, 100)
HOUSING: Colour = (32, 34, 34)
LAMPS: tuple[Colour, ...] = ((200, 30, 24), (220, 170, 30), (30, 180, 70))  # red, yellow, green, as `Prisms.lamp`
RED: Colour = (178, 28, 34)
PLATE: Colour = (226, 226, 222)
FIGURES: Colour = (40, 42, 44)
STEEL: Colour = (158, 162, 164)
CONCRETE: Colour = (172, 170, 164)
GLASS: Colour = (150, 176, 184)
BLUE: Colour = (36, 84, 160)

# A head on a post of its own, as in Europe; one across the junction hangs higher to be seen over the traffic.
HEAD_NEAR, HEAD_FAR = 2.6, 4.85  # [m] underside of the housing
FAR = 12.0  # [m] a pole farther than this from its stop line stands across the junction
HEAD_SIZE = (0.24, 0.36, 1.1)  # [m] depth, width, height
LAMP_SIZE, LAMP_DEPTH, LAMP_PITCH = 0.26, 0.05, 0.35  # [m]
POLE_RADIUS = 0.07  # [m]
MAST_RADIUS, ARM_HEIGHT, ARM_SIZE = 0.12, 6.0, 0.14  # [m] of a mast: its post, the arm's underside and thickness
KERB_GAP = 0.3  # [m] from a driven lane's edge to the middle of a post
LONGEST_ARM = 16.0  # [m]
MOST_HEADS = 3  # on one arm

MOTORWAY = 70.0 / 3.6  # [m/s] at which a road without sidewalks gets rails
RAIL_BACK, RAIL_LENGTH, RAIL_HEIGHT = 0.5, 24.0, (0.45, 0.78)  # [m]
BARRIER_WIDTH, BARRIER_HEIGHT = 0.5, 0.85  # [m]
BUS_SPEED = 38.0 / 3.6  # [m/s] limit of streets with buses
STOP_LENGTH, STOP_DEPTH = 4.2, 1.5  # [m]


def ring(centre: Floats, radius: float, corners: int = 8) -> Floats:
    """A regular polygon (corners, 2)."""
    turn = np.arange(corners) * (2.0 * np.pi / corners) + np.pi / corners
    return np.asarray(centre) + radius * forward(turn)


class _Board:
    """Boxes in front of a post, in its own directions: `d` towards who looks at it, `w` to its right."""

    def __init__(self, place: Floats, facing: float) -> None:
        self.place, self.look, self.beside = place, forward(facing), right(facing)

    def box(self, near: float, far: float, low: float, high: float) -> Floats:
        corners = ((near, low), (far, low), (far, high), (near, high))
        return np.array([self.place + self.look * d + self.beside * w for d, w in corners])


def beside_road(town: TownMap, place: Floats) -> Floats:
    """`place`, or where it is on a driven lane the nearest free place to the left or right of that lane."""
    hits = town.nearest(place[None])
    if hits.lane[0] < 0 or hits.distance[0] >= hits.width[0] / 2.0 + KERB_GAP:
        return place
    steps = np.arange(1, 60) * 0.4
    ways = np.concatenate([steps, -steps])[np.argsort(np.concatenate([steps, steps + 0.1]), kind="stable")]
    tries = place + ways[:, None] * right(hits.yaw[0])
    found = town.nearest(tries)
    free = np.flatnonzero(found.distance >= found.width / 2.0 + KERB_GAP)
    return tries[free[0]] if len(free) else place


def light_post(town: TownMap, light: TrafficLight, prisms: PrismList) -> Floats:
    """A light: its post, housings and lamps. Beyond a crossing it hangs from an arm over the lanes it governs."""
    place = beside_road(town, np.array([light.x, light.y]))
    ground = float(town.lanes.points[town.lanes.first[light.approach[0] + 1] - 1, 2]) if light.approach else light.z
    stops = np.array([(s.x, s.y) for s in light.stop_lines]).reshape(-1, 2)
    board = _Board(place, light.yaw)
    if not (len(stops) and float(np.hypot(*(stops - place).T).min()) > FAR):
        top = ground + HEAD_NEAR + HEAD_SIZE[2] + 0.1
        prisms.add(ring(place, POLE_RADIUS), ground, top, Tag.POLE, POST, light=light.index)
        _head(board, 0.0, ground + HEAD_NEAR, light.index, prisms)
        return place
    heads = np.clip(np.unique(np.round((stops - place) @ board.beside, 1)), -LONGEST_ARM, LONGEST_ARM)[:MOST_HEADS]
    heads = heads if np.abs(heads).max() > 1.0 else np.zeros(1)
    top = ground + ARM_HEIGHT + ARM_SIZE
    prisms.add(ring(place, MAST_RADIUS), ground, top + 0.1, Tag.POLE, POST, light=light.index)
    reach = float(heads[np.argmax(np.abs(heads))])
    if reach:
        low, high = min(reach, 0.0) - 0.2, max(reach, 0.0) + 0.2
        arm = board.box(-ARM_SIZE / 2.0, ARM_SIZE / 2.0, low, high)
        prisms.add(arm, ground + ARM_HEIGHT, top, Tag.POLE, POST, solid=False, light=light.index)
    for aside in np.unique(heads).tolist():
        _head(board, aside, ground + HEAD_FAR, light.index, prisms)
    return place


def _head(board: _Board, aside: float, low: float, light: int, prisms: PrismList) -> None:
    """A housing with three lamps on the side that it looks to."""
    depth, width, height = HEAD_SIZE
    front = POLE_RADIUS + depth
    prisms.add(
        board.box(POLE_RADIUS, front, aside - width / 2.0, aside + width / 2.0), low, low + height,
        Tag.TRAFFIC_LIGHT, HOUSING, solid=False, light=light,
    )  # fmt: skip
    half = LAMP_SIZE / 2.0
    for lamp, colour in enumerate(LAMPS):
        middle = low + height / 2.0 + (1 - lamp) * LAMP_PITCH
        prisms.add(
            board.box(front, front + LAMP_DEPTH, aside - half, aside + half), middle - half, middle + half,
            Tag.TRAFFIC_LIGHT, colour, solid=False, light=light, lamp=lamp,
        )  # fmt: skip


def sign_post(town: TownMap, sign: Sign, prisms: PrismList) -> Floats:
    """A post with the plate of a stop, yield or speed sign."""
    place = beside_road(town, np.array([sign.x, sign.y]))
    ground = float(town.lanes.points[town.lanes.first[sign.lanes[0]], 2]) if sign.lanes else min(sign.z, 0.0)
    board = _Board(place, sign.yaw)

    def plate(half: float, low: float, high: float, colour: Colour, front: float = 0.09) -> None:
        shape = board.box(front - 0.04, front, -half, half)
        prisms.add(shape, ground + low, ground + high, Tag.TRAFFIC_SIGN, colour, solid=False)

    if sign.kind == "stop":  # an octagon: a wide box between two narrower ones, and a white word
        plate(0.27, 2.0, 2.12, RED)
        plate(0.38, 2.12, 2.63, RED)
        plate(0.27, 2.63, 2.75, RED)
        plate(0.27, 2.29, 2.46, PLATE, 0.1)
    elif sign.kind == "yield":  # a triangle on its tip
        plate(0.14, 2.0, 2.25, RED)
        plate(0.28, 2.25, 2.5, RED)
        plate(0.42, 2.5, 2.75, RED)
        plate(0.18, 2.4, 2.64, PLATE, 0.1)
    else:
        plate(0.3, 2.0, 2.75, PLATE)
        plate(0.18, 2.15, 2.45, FIGURES, 0.1)
    prisms.add(ring(place, 0.04), ground, ground + 2.7, Tag.POLE, POST)
    return place


def guard_rails(town: TownMap, edges: Sequence[Edge], ground: Ground, prisms: PrismList) -> list[Floats]:
    """Rails along fast roads, and a barrier in the middle where a median parts the directions; footprints."""
    rails: list[tuple[Floats, float, Floats]] = []  # footprint, height, place of a post
    for edge in edges:
        if not edge.urban and edge.speed >= MOTORWAY:
            for begin, end in edge.pieces(0.0, edge.length, RAIL_LENGTH):
                point, out, z = edge.at(begin)
                rails.append((edge.strip(begin, end, RAIL_BACK, 0.2)[0], z, point + out * (RAIL_BACK + 0.1)))
    made = []
    shapes = quads(np.array([rail[0] for rail in rails]))
    for k in np.flatnonzero(~ground.near_lanes(shapes, 0.1)).tolist():
        shape, z, post = rails[k]
        prisms.add(shape, z + RAIL_HEIGHT[0], z + RAIL_HEIGHT[1], Tag.GUARD_RAIL, STEEL)
        prisms.add(ring(post, 0.07, 4), z, z + RAIL_HEIGHT[1], Tag.GUARD_RAIL, STEEL)
        made.append(shape)
    for line in medians(town, fast=True):
        for begin, end in line.pieces(0.0, line.length, RAIL_LENGTH):
            shape, z = line.strip(begin, end, -BARRIER_WIDTH / 2.0, BARRIER_WIDTH)
            prisms.add(shape, z, z + BARRIER_HEIGHT, Tag.GUARD_RAIL, CONCRETE)
            made.append(shape)
    return made


def medians(town: TownMap, fast: bool) -> list[Edge]:
    """Middle lines of wide medians between two directions; of motorways or of streets."""
    lanes = town.lanes
    index = {(int(lanes.road_id[k]), int(lanes.section[k]), int(lanes.lane_id[k])): k for k in range(len(lanes))}
    found = []
    for lane in np.flatnonzero((lanes.type == LaneType.MEDIAN) & (lanes.junction < 0) & (lanes.lane_id == -1)).tolist():
        road, section = int(lanes.road_id[lane]), int(lanes.section[lane])
        across, driven = index.get((road, section, 1)), index.get((road, section, -2))
        if across is None or driven is None or lanes.type[across] != LaneType.MEDIAN:
            continue
        width = float(lanes.width[lanes.rows(lane)].min() + lanes.width[lanes.rows(across)].min())
        speed = float(lanes.speed_limit[driven])
        if width < 2.0 or (speed >= MOTORWAY) != fast:
            continue
        points, half = lanes.centre_line(lane), lanes.width[lanes.rows(lane), None] / 2.0
        away = right(points[:, 3])
        middle = points[:, :2] - away * half
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(middle, axis=0).T))])
        found.append(Edge(middle, away, points[:, 2], along, not fast, speed, 0, (road, 0)))
    return found


def _rectangle(left: float, right: float, near: float, far: float) -> Floats:
    return np.array([(left, near), (right, near), (right, far), (left, far)])


def bus_stops(edges: Sequence[Edge], draws: Draws, prisms: PrismList) -> list[Floats]:
    """Shelters behind the sidewalks of main streets; footprints."""
    made = []
    for edge in edges:
        unit = draws.stream("bus stop", *edge.key).uniform(0, 2)
        if not edge.urban or edge.speed < BUS_SPEED or edge.length < 90.0 or unit[0] > 0.45:
            continue
        begin = (0.35 + 0.3 * unit[1]) * edge.length
        end = begin + STOP_LENGTH
        (a, out, z), (b, _, _) = edge.at(begin), edge.at(end)
        ahead = (b - a) / max(float(np.hypot(*(b - a))), 1e-6)

        frame = np.array([ahead, out])
        back = 0.2 + STOP_DEPTH
        prisms.add(a + _rectangle(0.0, STOP_LENGTH, back - 0.08, back) @ frame, z + 0.1, z + 2.2, Tag.STATIC, GLASS)
        prisms.add(a + _rectangle(0.0, 0.08, 0.5, back - 0.1) @ frame, z + 0.1, z + 2.2, Tag.STATIC, GLASS)
        prisms.add(
            a + _rectangle(0.6, STOP_LENGTH - 0.6, back - 0.55, back - 0.15) @ frame, z, z + 0.5, Tag.STATIC, POST
        )
        prisms.add(
            a + _rectangle(-0.1, STOP_LENGTH + 0.1, 0.2, back + 0.1) @ frame,
            z + 2.2,
            z + 2.34,
            Tag.STATIC,
            POST,
            solid=False,
        )
        flag = a - ahead * 1.5 + out * 0.35
        prisms.add(ring(flag, 0.04), z, z + 2.9, Tag.POLE, POST)
        prisms.add(
            a + _rectangle(-1.55, -1.45, 0.4, 0.9) @ frame, z + 2.3, z + 2.8, Tag.TRAFFIC_SIGN, BLUE, solid=False
        )
        made.append(a + _rectangle(-1.8, STOP_LENGTH + 0.3, 0.1, back + 0.3) @ frame)
    return made
