"""Lane pieces, one for each lane of each section, with their centre lines sampled at equal travelled lengths.

Here OpenDRIVE's frame (y north, counter-clockwise) becomes the world's (y south, clockwise).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import MapError
from lavsim.map.records import MAX_COORDINATE, LaneRecord, Network, RoadRecord
from lavsim.map.section import SHORTEST, RoadShape, SectionShape, change_bits
from lavsim.portable_math import snapped

Floats = NDArray[np.float64]

STEP = 0.5  # [m] largest spacing of centre points; a chord over it on a 2.7 m radius lies 1.2 cm off the arc
MOST_POINTS = 2_000_000  # centre points of a town, 1,000 lane-km; more is a broken file
TOO_LONG = f"the map has more than {MOST_POINTS * STEP / 1000.0:.0f} km of lanes; that is no town."
LONGEST_FINE = 20_000.0  # [m] longer sections are no roads, and measured less finely
FARTHEST = 2.0 * MAX_COORDINATE


@dataclass
class LanePiece:
    """A lane piece on its way into the table."""

    road: RoadRecord
    section: int
    lane: LaneRecord
    shape: SectionShape
    points: Floats
    s: Floats
    width: Floats
    length: float
    change: NDArray[np.uint8]

    @property
    def forward(self) -> bool:
        return self.shape.forward(self.lane.id)


def _measure(
    section: SectionShape, index: int, lane: LaneRecord, nodes: Floats, heading: Floats, stretch: Floats
) -> LanePiece:
    """Samples the centre line of one lane at equal travelled lengths."""
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    t, slope, _ = section.centre(lane.id, middle)
    speed = np.hypot(stretch - heading * t, slope)  # du/ds; within a piece of line or arc exact at any point
    u = np.concatenate([[0.0], np.cumsum(speed * np.diff(nodes))])
    length = float(u[-1])
    if not length <= MOST_POINTS * STEP:
        road = section.shape.road
        raise MapError(
            f"line {road.line}: lane {lane.id} of road {road.id} would be {length / 1000.0:.3g} km long; "
            "check its widths."
        )
    count = max(1, int(np.ceil(length / STEP - 1e-9)))
    s = np.interp(np.linspace(0.0, length, count + 1), u, nodes)
    forward = section.forward(lane.id)
    if not forward:
        s = s[::-1].copy()
    # Records that begin exactly where the section ends belong to the next one.
    inside = np.minimum(s, section.end - 1e-7)
    t, slope, width = section.centre(lane.id, inside)
    x, y, phi, curvature, stretch = section.shape.line.pose(inside)
    bend = stretch - curvature * t
    yaw = -(phi + np.arctan2(slope, bend))
    turned = -curvature * bend / np.maximum(bend * bend + slope * slope, 1e-9)
    if not forward:
        yaw, turned = yaw + np.pi, -turned
    points = np.empty((count + 1, 5))
    points[:, 0] = x - t * np.sin(phi)
    points[:, 1] = -(y + t * np.cos(phi))
    points[:, 2] = section.height(lane.id, inside, t)
    farthest = float(np.abs(points[:, :3]).max())
    if farthest > FARTHEST:
        road = section.shape.road
        raise MapError(
            f"line {road.line}: lane {lane.id} of road {road.id} lies {farthest / 1000.0:.3g} km off; "
            "check its widths and curves."
        )
    points[:, 3] = np.unwrap(yaw)
    points[:, 4] = turned
    points = snapped(points)
    change = change_bits(section.record, lane.id, inside - section.start, section.shape.road.left_hand)
    return LanePiece(section.shape.road, index, lane, section, points, s, np.maximum(width, 0.0), length, change)


def lane_pieces(network: Network, shapes: dict[int, RoadShape]) -> list[LanePiece]:
    """The pieces of all roads, in the file's order.

    Raises:
        MapError: lanes of more length, or farther out, than any town has.
    """
    pieces = []
    planned = sum(road.length * max(len(section.lanes) for section in road.sections) for road in network.roads) / STEP
    if planned > MOST_POINTS:
        raise MapError(TOO_LONG)
    total = 0
    for road in network.roads:
        shape = shapes[road.id]
        for index in range(len(road.sections)):
            section = SectionShape(shape, index)
            if section.end - section.start < SHORTEST:
                continue
            # On spirals and cubics du/ds varies between nodes.
            is_fine = shape.line.curves and section.end - section.start < LONGEST_FINE
            spacing = STEP / 2.0 if is_fine else 2.0 * STEP
            count = int(np.ceil((section.end - section.start) / spacing))
            nodes = np.linspace(section.start, section.end, count + 1)
            nodes = np.unique(np.concatenate([nodes, section.breakpoints()]))
            nodes = nodes[np.concatenate([[True], np.diff(nodes) > 1e-9])]
            curvature, stretch = shape.line.pose(0.5 * (nodes[1:] + nodes[:-1]))[3:]
            for lane in section.record.lanes:
                if lane.id != 0:
                    piece = _measure(section, index, lane, nodes, curvature, stretch)
                    if piece.length > SHORTEST and np.isfinite(piece.points).all():
                        pieces.append(piece)
                        total += len(piece.points)
                        if total > MOST_POINTS:
                            raise MapError(f"line {road.line}: {TOO_LONG}")
    return pieces
