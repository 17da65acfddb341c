"""Makes the table of lanes from the records of an OpenDRIVE file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import MapError
from lavsim.map.conflicts import conflicts_of
from lavsim.map.lane import CHANGE_LEFT, CHANGE_RIGHT, DRIVABLE, LaneTable, compressed
from lavsim.map.links import LaneLinks, Report
from lavsim.map.pieces import LanePiece, lane_pieces
from lavsim.map.records import JunctionRecord, Network
from lavsim.map.section import RoadShape
from lavsim.map.speed_limits import speed_limits
from lavsim.map.turns import turns
from lavsim.types import LaneType

Ints = NDArray[np.int32]

MAX_GAP = 1.0  # [m] between linked lanes that nobody drives on

LANE_TYPES = {
    "none": LaneType.NONE,
    "driving": LaneType.DRIVING,
    "stop": LaneType.STOP,
    "shoulder": LaneType.SHOULDER,
    "biking": LaneType.BIKING,
    "sidewalk": LaneType.SIDEWALK,
    "border": LaneType.BORDER,
    "restricted": LaneType.RESTRICTED,
    "parking": LaneType.PARKING,
    "bidirectional": LaneType.BIDIRECTIONAL,
    "median": LaneType.MEDIAN,
    "special1": LaneType.SPECIAL1,
    "special2": LaneType.SPECIAL2,
    "special3": LaneType.SPECIAL3,
    "roadworks": LaneType.ROADWORKS,
    "roadWorks": LaneType.ROADWORKS,
    "tram": LaneType.TRAM,
    "rail": LaneType.RAIL,
    "entry": LaneType.ENTRY,
    "exit": LaneType.EXIT,
    "offRamp": LaneType.OFF_RAMP,
    "onRamp": LaneType.ON_RAMP,
}


def _neighbours(
    pieces: list[LanePiece], index: dict[tuple[int, int, int], int], types: Ints
) -> tuple[Ints, Ints, NDArray[np.bool_], NDArray[np.bool_]]:
    left, right = np.full(len(pieces), -1, np.int32), np.full(len(pieces), -1, np.int32)
    change_left, change_right = np.zeros(len(pieces), np.bool_), np.zeros(len(pieces), np.bool_)
    for number, piece in enumerate(pieces):
        lane_id = piece.lane.id
        outward = -1 if lane_id < 0 else 1
        outer, inner = (left, right) if piece.road.left_hand else (right, left)
        for side, other_id in ((outer, lane_id + outward), (inner, lane_id - outward)):
            other = index.get((piece.road.id, piece.section, other_id)) if other_id != 0 else None
            if other is not None and types[other] == types[number]:
                side[number] = other
        change_right[number] = right[number] >= 0 and np.mean(piece.change & CHANGE_RIGHT > 0) >= 0.5
        change_left[number] = left[number] >= 0 and np.mean(piece.change & CHANGE_LEFT > 0) >= 0.5
    return left, right, change_left, change_right


def build_lanes(
    network: Network,
    shapes: dict[int, RoadShape],
    junctions: Sequence[JunctionRecord],
    limits: dict[int, list[tuple[float, tuple[tuple[int, int], ...], float]]],
    report: Report,
) -> LaneTable:
    """The lanes of a town.

    Args:
        network: The file's records.
        shapes: Road shapes by road id.
        junctions: Junctions in the order in which the table numbers them.
        limits: Speed signs by road id: (s, lane id ranges, limit [m/s]); empty when the town has none.
        report: Takes up what was wrong with links.

    Raises:
        MapError: no lane has a length.
    """
    pieces = lane_pieces(network, shapes)
    if not pieces:
        raise MapError("the map has no lane of any length.")
    count = len(pieces)
    index = {(p.road.id, p.section, p.lane.id): k for k, p in enumerate(pieces)}
    number_of = {junction.id: k for k, junction in enumerate(junctions)}
    types = np.array([int(LANE_TYPES.get(p.lane.kind, LaneType.NONE)) for p in pieces], np.int32)
    junction = np.array([number_of.get(p.road.junction, -1) for p in pieces], np.int32)
    sizes = np.array([len(p.points) for p in pieces])
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    points = np.concatenate([p.points for p in pieces])
    length = np.array([p.length for p in pieces])
    step = length / (sizes - 1)
    road_id = np.array([p.road.id for p in pieces], np.int32)
    reach = {i: np.stack(s.pose(np.array([0.0, s.road.length]))[:2], axis=1) for i, s in shapes.items()}
    pairs = [
        (a, b)
        for a, b in LaneLinks(network, pieces, index, reach, report).pairs()
        if (types[a] & DRIVABLE and types[b] & DRIVABLE)
        # Sidewalks and shoulders have no direction of travel; a link that only fits the other way is no link.
        or (types[a] == types[b] and np.hypot(*(pieces[a].points[-1, :2] - pieces[b].points[0, :2])) < MAX_GAP)
    ]
    succ = compressed(pairs, count)
    pred = compressed([(b, a) for a, b in pairs], count)
    left, right, change_left, change_right = _neighbours(pieces, index, types)
    starts, ends = points[first[:-1]], points[first[1:] - 1]
    speed_limit, limit_first, limit_u, limit = speed_limits(pieces, pred, length, limits)
    conflict_first, conflict, conflict_u = conflicts_of(first, step, points, junction, types, road_id, pairs)
    forward = np.array([p.forward for p in pieces])
    low, high = np.array([p.shape.start for p in pieces]), np.array([p.shape.end for p in pieces])
    return LaneTable(
        road_id=road_id,
        section=np.array([p.section for p in pieces], np.int32),
        lane_id=np.array([p.lane.id for p in pieces], np.int32),
        type=types,
        junction=junction,
        length=length,
        s_start=np.where(forward, low, high),
        s_end=np.where(forward, high, low),
        first=first,
        step=step,
        points=points,
        point_s=np.concatenate([p.s for p in pieces]),
        width=np.concatenate([p.width for p in pieces]),
        change=np.concatenate([p.change for p in pieces]),
        succ_first=succ[0],
        succ=succ[1],
        pred_first=pred[0],
        pred=pred[1],
        left=left,
        right=right,
        change_left=change_left,
        change_right=change_right,
        speed_limit=speed_limit,
        limit_first=limit_first,
        limit_u=limit_u,
        limit=limit,
        light=np.full(count, -1, np.int32),  # filled in once the lights are known
        sign=np.full(count, -1, np.int32),
        conflict_first=conflict_first,
        conflict=conflict,
        conflict_u=conflict_u,
        turn=turns(starts, ends, junction, types, succ, pred),
    )
