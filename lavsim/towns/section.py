"""Cross-sections: which strips a street is made of, from its centre line outward, and how its lanes are marked."""

from __future__ import annotations

from dataclasses import dataclass, replace

from lavsim.map.records import LaneRecord, Polynomial, RoadMark

NO_MARK = RoadMark(0.0, "none", "white", 0.0, "none")
CURB = RoadMark(0.0, "curb", "white", 0.15, "none")
LINE = 0.12  # [m] width of painted lines
SOLID_BEFORE_JUNCTION = 15.0  # [m] of unbroken lines
PARKING_FROM_END = (15.0, 24.0)  # [m] from a junction: where a parking lane begins to open, and where it is open
SHORTEST_PARKING = 25.0  # [m] of open parking lane; a shorter one is not drawn


@dataclass(frozen=True)
class CrossSection:
    """Strips of a street [m], from the centre line outward; both sides are alike but for the number of lanes.

    Attributes:
        lane: Width of a driving lane.
        gutter: Strip between the last lane and the kerb; on a motorway the hard shoulder.
        sidewalk: 0 for none.
        lanes: Driving lanes in the direction in which the street is drawn.
        back: Driving lanes in the other direction; as many by default, 0 for a one-way street.
        median: Half of the strip between the directions.
        parking: Width of the parking lanes, which end before junctions.
        kerb: Whether a kerb bounds the road; without one there is an edge line.
        centre: Colour of the line between the directions.
        passing: Whether a single lane a side may cross the centre line in the open.
    """

    lane: float = 3.5
    gutter: float = 0.3
    sidewalk: float = 2.5
    lanes: int = 1
    back: int | None = None
    median: float = 0.0
    parking: float = 0.0
    kerb: bool = True
    centre: str = "white"
    passing: bool = True

    @property
    def is_one_way(self) -> bool:
        return self.back == 0

    @property
    def is_plain(self) -> bool:
        """One lane a side and nothing between them."""
        return self.lanes == 1 and self.back in (None, 1) and self.median == 0.0

    def count(self, side: int) -> int:
        """Driving lanes right (-1) or left (+1) of the centre line."""
        return self.lanes if side < 0 or self.back is None else self.back

    def edge(self, side: int) -> float:
        """Centre line to kerb, where no cars are parked [m]."""
        count = self.count(side)
        return (self.median + count * self.lane if count else 0.0) + self.gutter

    def strips(self, side: int) -> tuple[str, ...]:
        """Lane types of a side, from the centre line outward."""
        count = self.count(side)
        inner = ("median",) * (self.median > 0.0 and count > 0) + ("driving",) * count
        outer = ("shoulder",) + ("sidewalk",) * (self.sidewalk > 0.0)
        return inner + ("parking",) * (self.parking > 0.0 and count > 0) + outer

    def lane_id(self, side: int, kind: str, number: int = 0) -> int | None:
        """Id of the `number`-th strip of a kind, None where the side has none."""
        places = [k for k, strip in enumerate(self.strips(side)) if strip == kind]
        return side * (places[number] + 1) if number < len(places) else None

    def width(self, kind: str) -> float:
        """Width of a strip [m]; of an open one, for parking."""
        return {
            "median": self.median,
            "driving": self.lane,
            "parking": self.parking,
            "shoulder": self.gutter,
            "sidewalk": self.sidewalk,
        }[kind]

    def without(self, length: float) -> CrossSection:
        """The same, without parking lanes if a street of this length has no room for them."""
        fits = length >= 2.0 * PARKING_FROM_END[1] + SHORTEST_PARKING
        return self if fits or not self.parking else replace(self, parking=0.0)


def eased(first: float, last: float, length: float) -> tuple[Polynomial, ...]:
    """A width that goes from one value to another, level at both ends."""
    if first == last:
        return (Polynomial(0.0, first),)
    change = last - first
    return (Polynomial(0.0, first, 0.0, 3.0 * change / length**2, -2.0 * change / length**3),)


def _parking(width: float, length: float) -> tuple[Polynomial, ...]:
    low, high = PARKING_FROM_END
    ease = eased(0.0, width, high - low)[0], eased(width, 0.0, high - low)[0]
    return (
        Polynomial(0.0, 0.0),
        replace(ease[0], s=low),
        Polynomial(high, width),
        replace(ease[1], s=length - high),
        Polynomial(length - low, 0.0),
    )


def lane_lines(side: int, length: float, joins: tuple[bool, bool], bare: tuple[float, float]) -> tuple[RoadMark, ...]:
    """The line between two lanes of a direction: broken, solid where they come to a junction, none past the stop line.

    Args:
        side: Of the lanes.
        length: Of the street [m].
        joins: Whether there is a junction at the street's start and end.
        bare: How far no line is drawn at its start and end [m].
    """
    broken, solid = RoadMark(0.0, "broken", "white", LINE, "both"), RoadMark(0.0, "solid", "white", LINE, "none")
    marks = [NO_MARK] if bare[0] else []
    at_junction = joins[1] if side < 0 else joins[0]
    if not at_junction:
        marks.append(replace(broken, s=bare[0]))
    elif length < 2.0 * SOLID_BEFORE_JUNCTION + 10.0:
        marks.append(replace(solid, s=bare[0]))
    elif side < 0:
        marks += [replace(broken, s=bare[0]), replace(solid, s=length - SOLID_BEFORE_JUNCTION)]
    else:
        marks += [replace(solid, s=bare[0]), replace(broken, s=SOLID_BEFORE_JUNCTION)]
    if bare[1]:
        marks.append(replace(NO_MARK, s=length - bare[1]))
    return tuple(marks)


def side_lanes(
    section: CrossSection,
    side: int,
    length: float,
    joins: tuple[bool, bool],
    bare: tuple[float, float] = (0.0, 0.0),
) -> tuple[LaneRecord, ...]:
    """Lanes of one side of a street, from the centre line outward; `joins` and `bare` as in `lane_lines`."""
    count, driven = section.count(side), 0
    lanes = []
    for number, kind in enumerate(section.strips(side)):
        widths: tuple[Polynomial, ...] = (Polynomial(0.0, section.width(kind)),)
        marks: tuple[RoadMark, ...] = (NO_MARK,)
        if kind == "driving":
            driven += 1
            if driven < count:
                marks = lane_lines(side, length, joins, bare)
            elif not section.kerb:
                marks = (RoadMark(0.0, "solid", "white", LINE, "none"),)
        elif kind == "shoulder" and section.kerb:
            marks = (CURB,)
        elif kind == "median":
            marks = (CURB,) if section.kerb else (RoadMark(0.0, "solid", section.centre, LINE, "none"),)
        elif kind == "parking":
            widths = _parking(section.parking, length)
        lanes.append(LaneRecord(side * (number + 1), kind, widths, marks))
    return tuple(lanes)


def centre_marks(
    section: CrossSection, length: float, joins: tuple[bool, bool], bare: tuple[float, float]
) -> tuple[RoadMark, ...]:
    """The line between the directions: broken in the open, unbroken before junctions, none past the stop line.

    Args:
        section: Of the street.
        length: Of the street [m].
        joins: Whether there is a junction at its start and end.
        bare: How far no line is drawn at its start and end [m].
    """
    if section.is_one_way:
        return (NO_MARK,) if section.kerb else (RoadMark(0.0, "solid", section.centre, LINE, "none"),)
    if section.median:
        return (NO_MARK,)
    double = section.centre == "yellow"
    solid = RoadMark(0.0, "solid solid" if double else "solid", section.centre, LINE, "none")
    broken = RoadMark(0.0, "broken", section.centre, LINE, "none")
    marks = []
    if bare[0]:
        marks.append(NO_MARK)
    before, behind = (SOLID_BEFORE_JUNCTION if join else 0.0 for join in joins)
    is_short = length < before + behind + 10.0 or not section.passing or section.lanes > 1
    if is_short or joins[0]:
        marks.append(replace(solid, s=bare[0]))
    if not is_short:
        marks.append(replace(broken, s=before))
        if joins[1]:
            marks.append(replace(solid, s=length - behind))
    if bare[1]:
        marks.append(replace(NO_MARK, s=length - bare[1]))
    return tuple(marks)
