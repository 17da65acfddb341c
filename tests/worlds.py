"""Towns small enough to draw on paper, made as OpenDRIVE text and read back.

World frame: y grows to the south. Every street has one 3.5 m lane a side, so lanes lie 1.75 m off the drawn line.
"""

from __future__ import annotations

import math
from functools import cache

from lavsim.map.records import Geometry, LaneRecord, Network, Polynomial, RoadMark, RoadRecord, SectionRecord
from lavsim.map.town_files import build_town
from lavsim.map.town_map import TownMap
from lavsim.map.write import write_network
from lavsim.towns.layout import Layout
from lavsim.towns.section import CrossSection


def _town(layout: Layout) -> TownMap:
    return build_town(layout.name, write_network(layout.network()))


@cache
def straight(length: float = 200.0, speed: int = 50) -> TownMap:
    """One road along y = 0 from x = 0 to `length`; both ends are dead."""
    layout = Layout("straight")
    layout.street("Main Street", (0.0, 0.0), (length, 0.0), speed=speed)
    return _town(layout)


@cache
def tee(arm: float = 80.0, lights: bool = True) -> TownMap:
    """A T around (0, 0): arms to the west, east and south, their outer ends dead."""
    layout = Layout("tee")
    layout.junction("tee", 0.0, 0.0, control="lights" if lights else "none")
    layout.street("West Street", (-arm, 0.0), "tee", speed=50)
    layout.street("East Street", "tee", (arm, 0.0), speed=50)
    layout.street("South Street", (0.0, -arm), "tee", speed=30)
    return _town(layout)


@cache
def crossing(arm: float = 80.0, lights: bool = True) -> TownMap:
    """A crossing of four arms around (0, 0), their outer ends dead."""
    layout = Layout("crossing")
    layout.junction("crossing", 0.0, 0.0, control="lights" if lights else "none")
    layout.street("West Street", (-arm, 0.0), "crossing", speed=50)
    layout.street("East Street", "crossing", (arm, 0.0), speed=50)
    layout.street("South Street", (0.0, -arm), "crossing", speed=30)
    layout.street("North Street", "crossing", (0.0, arm), speed=30)
    return _town(layout)


@cache
def arc(radius: float = 30.0, length: float = 80.0, left: bool = True) -> TownMap:
    """One road that starts at (0, 0) towards the east and bends with `radius`, seen from above to the `left`."""
    sign = 1.0 if left else -1.0
    lanes = tuple(
        LaneRecord(k, "driving" if k else "none", (Polynomial(0.0, 3.5),) if k else (), (RoadMark(),))
        for k in (1, 0, -1)
    )
    road = RoadRecord(
        1, length, (Geometry(0.0, 0.0, 0.0, 0.0, length, sign / radius),), (SectionRecord(0.0, lanes),), name="Bend"
    )
    return build_town("arc", write_network(Network((road,), name="arc")))


@cache
def two_lanes(
    length: float = 300.0, lane_change: str = "both", bend: float = 0.0, sections: tuple[float, ...] = (0.0,)
) -> TownMap:
    """One road along y = 0 with two lanes towards the east (ids -1, -2) and none back; the mark between is broken.

    Its last `bend` metres turn left with a radius of 20 m; lane sections begin at `sections` [m].
    """
    mark = RoadMark(0.0, "broken", "white", 0.12, lane_change)
    shut = RoadMark(0.0, "solid", "white", 0.12, "none")
    width = (Polynomial(0.0, 3.5),)
    lanes = (
        LaneRecord(0, "none", (), (shut,)),
        LaneRecord(-1, "driving", width, (mark,), -1, -1),
        LaneRecord(-2, "driving", width, (shut,), -2, -2),
    )
    line: tuple[Geometry, ...] = (Geometry(0.0, 0.0, 0.0, 0.0, length - bend),)
    if bend > 0.0:
        line += (Geometry(length - bend, length - bend, 0.0, 0.0, bend, 1.0 / 20.0),)
    road = RoadRecord(1, length, line, tuple(SectionRecord(s, lanes) for s in sections), name="Two Lanes")
    return build_town("two_lanes", write_network(Network((road,), name="two_lanes")))


def ring(radius: float = 60.0) -> TownMap:
    """A closed circle of two half roads, driven both ways, without a junction."""
    return _ring(radius)


@cache
def _ring(radius: float) -> TownMap:
    from lavsim.map.records import RoadLink

    half = math.pi * radius
    lanes = tuple(
        LaneRecord(k, "driving" if k else "none", (Polynomial(0.0, 3.5),) if k else (), (RoadMark(),), k, k)
        for k in (1, 0, -1)
    )
    roads = tuple(
        RoadRecord(
            number,
            half,
            (Geometry(0.0, x, 0.0, heading, half, 1.0 / radius),),
            (SectionRecord(0.0, lanes),),
            predecessor=RoadLink("road", other, "end"),
            successor=RoadLink("road", other, "start"),
        )
        for number, other, x, heading in ((1, 2, radius, math.pi / 2.0), (2, 1, -radius, -math.pi / 2.0))
    )
    return build_town("ring", write_network(Network(roads, name="ring")))


NARROW = CrossSection(lane=3.0, gutter=0.3, sidewalk=2.0)
