"""A town as one would sketch it: nodes, the streets between them, and what stands at their ends.

Coordinates are those of a map on paper, and of OpenDRIVE: x east, y north [m]. A street may bend (arcs between straight
pieces) but reaches its nodes straight. Where a street ends is worked out from what it meets there, so that kerbs get
their radius.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from lavsim.map.records import Geometry, Network
from lavsim.towns.pen import Pen, Place, wrap
from lavsim.towns.section import CrossSection

CROSSWALK = (1.5, 4.5)  # [m] before the junction: near and far edge
NO_CORNER = math.radians(150.0)  # streets that meet at more than this leave no corner to round
ON = math.radians(45.0)  # a way that turns less goes straight on
NARROW = 3.8  # [m] from the centre line to the kerb of the street that `corner_radius` is meant for
RAMP_HALF = 35.0  # [m] from the middle of a ramp's junction to its ends
RAMP_ANGLE = math.radians(8.0)  # between a ramp and its motorway
ROUNDABOUT_SPREAD = math.radians(31.0)  # from an arm's axis to where its ways join and leave the circle
ROUNDABOUT_LANE = 4.6  # [m] width of the circulating lane
CONTROLS = ("lights", "stop", "all stop", "yield", "none")


@dataclass
class Street:
    """A road between two nodes; `start` and `end` may be None for a dead end."""

    name: str
    start: Node | None
    end: Node | None
    points: tuple[tuple[float, float], ...]
    radii: tuple[float, ...]
    speed: int
    section: CrossSection
    run: float
    id: int = -1
    geometry: tuple[Geometry, ...] = ()
    length: float = 0.0

    def node(self, at_start: bool) -> Node | None:
        return self.start if at_start else self.end

    def direction(self, at_start: bool) -> float:
        """Heading of the street away from its start or end."""
        a, b = (self.points[0], self.points[1]) if at_start else (self.points[-1], self.points[-2])
        return math.atan2(b[1] - a[1], b[0] - a[0])


@dataclass(frozen=True)
class Arm:
    """A street where it meets a node.

    Attributes:
        street: The street.
        at_start: Whether it starts there.
        heading: Its direction away from the node.
    """

    street: Street
    at_start: bool
    heading: float

    @property
    def section(self) -> CrossSection:
        return self.street.section

    @property
    def inward(self) -> int:
        """Side of the lanes that lead into the node."""
        return 1 if self.at_start else -1

    def lanes(self, side: int) -> int:
        return self.section.count(side)

    @property
    def ways_in(self) -> int:
        return self.lanes(self.inward)

    @property
    def ways_out(self) -> int:
        return self.lanes(-self.inward)

    @property
    def mouth(self) -> Place:
        """Where the street's centre line ends at the node, heading into it."""
        if self.at_start:
            g = self.street.geometry[0]
            return g.x, g.y, g.heading + math.pi
        pen = Pen(0.0, 0.0, 0.0)
        g = self.street.geometry[-1]
        pen.x, pen.y, pen.heading = g.x, g.y, g.heading
        pen.arc(g.length, g.curvature)
        return pen.x, pen.y, pen.heading


@dataclass
class Node:
    """Where streets meet.

    Attributes:
        name: Of the node.
        x, y: Where it is [m].
        control: "lights", or who has to stop: "stop" or "yield" (minor streets), "all stop", "none".
        crosswalks: Whether its arms have crosswalks.
        across: Whether its lights hang beyond the crossing, as in America.
    """

    name: str
    x: float
    y: float
    control: str = "lights"
    crosswalks: bool = True
    across: bool = False
    ends: list[tuple[Street, bool]] = field(default_factory=list)  # street, and whether it starts here

    def arms(self) -> list[Arm]:
        """Counter-clockwise: the next arm is the first street to the right of who drives in."""
        arms = [Arm(street, at_start, street.direction(at_start)) for street, at_start in self.ends]
        return sorted(arms, key=lambda arm: arm.heading)

    def arm(self, street: Street, at_start: bool) -> Arm:
        return Arm(street, at_start, street.direction(at_start))

    def major(self) -> tuple[Arm, Arm] | None:
        """The two arms that go on into each other and have the right of way."""
        best: tuple[tuple[float, ...], tuple[Arm, Arm]] | None = None
        arms = self.arms()
        for i, a in enumerate(arms):
            for b in arms[i + 1 :]:
                bend = abs(wrap(a.heading + math.pi - b.heading))
                if bend < ON:
                    lanes = min(max(a.ways_in, a.ways_out), max(b.ways_in, b.ways_out))
                    rank = (float(min(a.street.speed, b.street.speed)), float(lanes), -round(bend, 6))
                    if best is None or rank > best[0]:
                        best = rank, (a, b)
        return best[1] if best else None

    def halts(self, arm: Arm) -> bool:
        """Whether lights or signs may stop who comes by `arm`."""
        if self.control == "none" or not arm.ways_in or sum(a.ways_in > 0 for a in self.arms()) == 1:
            return False
        if self.control in ("lights", "all stop"):
            return True
        major = self.major()
        return major is None or all(m.street is not arm.street or m.at_start != arm.at_start for m in major)

    def has_line(self, arm: Arm) -> bool:
        """Whether a stop line is painted before the node."""
        return self.halts(arm) and self.control != "yield"

    def setbacks(self, corner_radius: float) -> list[float]:
        """Distance from the node at which each of `arms()` ends.

        Args:
            corner_radius: Smallest radius of the centre line of a narrow street in a right turn [m].
        """
        arms = self.arms()
        if len(arms) < 2:
            raise ValueError(f"junction {self.name} has {len(arms)} streets; it needs two or more")
        headings = [arm.heading for arm in arms]
        gaps = [b - a for a, b in zip(headings, [*headings[1:], headings[0] + 2.0 * math.pi], strict=True)]
        plain = arms[0].section
        if all(a.section.is_plain and (a.section.lane, a.section.gutter) == (plain.lane, plain.gutter) for a in arms):
            needed = corner_radius
            for gap in gaps:
                if gap < NO_CORNER:
                    needed = max(needed, corner_radius / math.tan(gap / 2.0))
            return [math.ceil(needed * 2.0 - 1e-6) / 2.0] * len(arms)
        least = [0.0] * len(arms)
        for i, gap in enumerate(gaps):
            j = (i + 1) % len(arms)
            if gap >= NO_CORNER:
                continue
            # The kerbs of both streets meet at a corner, which is rounded.
            ours, theirs = arms[i].section.edge(arms[i].inward), arms[j].section.edge(-arms[j].inward)
            round_off = (corner_radius - NARROW) / math.tan(gap / 2.0)
            sine, cosine = math.sin(gap), math.cos(gap)
            least[i] = max(least[i], (theirs + ours * cosine) / sine + round_off)
            least[j] = max(least[j], (ours + theirs * cosine) / sine + round_off)
        bare = corner_radius * 0.75
        return [math.ceil(max(value, bare) * 2.0 - 1e-6) / 2.0 for value in least]


@dataclass
class RampNode(Node):
    """Where ramps leave and join a motorway, or its number of lanes changes. Its motorway goes through straight."""

    half: float = RAMP_HALF

    def main(self) -> tuple[Arm, Arm]:
        """The motorway's two arms."""
        arms = [arm for arm in self.arms() if not arm.section.is_one_way]
        if len(arms) != 2:
            raise ValueError(f"ramp junction {self.name} needs the two arms of one motorway, it has {len(arms)}")
        return arms[0], arms[1]

    def setbacks(self, corner_radius: float) -> list[float]:
        return [0.0 if arm.section.is_one_way else self.half for arm in self.arms()]

    def beside(self, street: Street, at_start: bool) -> tuple[Arm, Arm]:
        """The motorway's arms that lead in and out on the side where a ramp lies."""
        a, b = self.main()
        x, y = street.points[1 if at_start else -2]
        left = (x - self.x) * -math.sin(b.heading) + (y - self.y) * math.cos(b.heading)
        return (b, a) if left > 0.0 else (a, b)  # who drives towards b has its ramps to the right of b's direction

    def port(self, street: Street, at_start: bool) -> Place:
        """Where a ramp begins or ends at the motorway, heading away from the node."""
        before, behind = self.beside(street, at_start)
        inside, arm = (before, before) if at_start else (behind, behind)
        side = arm.inward if at_start else -arm.inward
        lanes = arm.lanes(side)
        offset = arm.section.median + (lanes - 1) * arm.section.lane
        length = 2.0 * self.half
        heading = inside.heading + math.pi  # along the motorway, into the node
        x = self.x + self.half * math.cos(inside.heading)
        y = self.y + self.half * math.sin(inside.heading)
        # Right of who drives in by this arm; for an entry the pen runs against traffic, so that it lies to the left.
        left = -offset if at_start else offset
        pen = Pen(x - left * math.sin(heading), y + left * math.cos(heading), heading)
        pen.arc(length, (-RAMP_ANGLE if at_start else RAMP_ANGLE) / length)
        return pen.x, pen.y, pen.heading


@dataclass
class Roundabout(Node):
    """A circle driven counter-clockwise, with one lane; who enters yields."""

    radius: float = 22.0

    @property
    def inner(self) -> float:
        """Radius of the circle's reference line, the left edge of its lane [m]."""
        return self.radius - ROUNDABOUT_LANE / 2.0

    def setbacks(self, corner_radius: float) -> list[float]:
        tangent = self.inner * math.tan(ROUNDABOUT_SPREAD)
        reach = self.inner / math.cos(ROUNDABOUT_SPREAD) + tangent
        return [math.ceil(reach * 2.0 - 1e-6) / 2.0] * len(self.ends)


class Layout:
    """A town being drawn.

    Args:
        name: Of the town.
        section: Cross-section of streets that name none.
        corner_radius: Smallest radius of the centre line of a narrow street in a right turn [m]; the lane itself turns
            half a lane width tighter.
        across: Whether lights hang beyond the crossing, as in America.
        scale: Of the sketch: metres by which a unit of its coordinates stands. Radii and widths are metres.
    """

    def __init__(
        self,
        name: str,
        section: CrossSection | None = None,
        corner_radius: float = 11.0,
        across: bool = False,
        scale: float = 1.0,
    ) -> None:
        self.name = name
        self.section = section or CrossSection()
        self.corner_radius = corner_radius
        self.across = across
        self.scale = scale
        self.nodes: dict[str, Node] = {}
        self.streets: list[Street] = []

    def junction(self, name: str, x: float, y: float, control: str = "lights", crosswalks: bool = True) -> None:
        """Places a junction at (x, y)."""
        if control not in CONTROLS:
            raise ValueError(f"junction {name}: control must be one of {', '.join(CONTROLS)}, got {control!r}")
        self.nodes[name] = Node(name, x * self.scale, y * self.scale, control, crosswalks, self.across)

    def ramps(self, name: str, x: float, y: float, half: float = RAMP_HALF) -> None:
        """Places a junction of a motorway with its ramps, or where a lane begins or ends."""
        self.nodes[name] = RampNode(name, x * self.scale, y * self.scale, "none", False, half=half)

    def roundabout(self, name: str, x: float, y: float, radius: float = 22.0) -> None:
        """Places a roundabout; `radius` is that of its lane's centre [m]."""
        self.nodes[name] = Roundabout(name, x * self.scale, y * self.scale, "yield", True, radius=radius)

    def street(
        self,
        name: str,
        start: str | tuple[float, float],
        end: str | tuple[float, float],
        via: Sequence[tuple[float, float, float]] = (),
        speed: int = 50,
        section: CrossSection | None = None,
        run: float = 40.0,
    ) -> None:
        """Draws a street from one node (or dead end) to another.

        Args:
            name: Of the street.
            start, end: Names of nodes, or points where the street just ends.
            via: Corners (x, y, radius) between them.
            speed: Limit [km/h].
            section: Its strips.
            run: How far a ramp keeps its direction at the motorway before it turns to its first corner [m].
        """
        first, last = (self.nodes[p] if isinstance(p, str) else None for p in (start, end))
        k = self.scale
        points = [(x * k, y * k) for x, y, _ in via]
        for place, at in ((start, 0), (end, len(via) + 1)):
            if isinstance(place, str):
                points.insert(at, (self.nodes[place].x, self.nodes[place].y))
            else:
                points.insert(at, (place[0] * k, place[1] * k))
        radii = tuple(radius for *_, radius in via)
        street = Street(name, first, last, tuple(points), radii, speed, section or self.section, run)
        self.streets.append(street)
        if first is not None:
            first.ends.append((street, True))
        if last is not None:
            last.ends.append((street, False))

    def network(self) -> Network:
        """The town as OpenDRIVE records."""
        from lavsim.towns.network import draw_network

        return draw_network(self)

    def trace(self) -> None:
        """Works out the reference lines of all streets."""
        for street in self.streets:
            for at_start in (True, False):
                node = street.node(at_start)
                if isinstance(node, RampNode) and street.section.is_one_way:
                    _hook(street, at_start, node.port(street, at_start))
        setbacks = {}
        for node in self.nodes.values():
            for arm, setback in zip(node.arms(), node.setbacks(self.corner_radius), strict=True):
                setbacks[id(arm.street), arm.at_start] = setback
        for street in self.streets:
            _trace(street, *(setbacks.get((id(street), at_start), 0.0) for at_start in (True, False)))


def _hook(street: Street, at_start: bool, port: Place) -> None:
    """Ties a ramp's end to its motorway: from the port straight on for a while, then towards its other points."""
    x, y, heading = port
    corner = (x + street.run * math.cos(heading), y + street.run * math.sin(heading))
    radius = 1.4 * street.run
    if at_start:
        street.points, street.radii = ((x, y), corner, *street.points[1:]), (radius, *street.radii)
    else:
        street.points, street.radii = (*street.points[:-1], corner, (x, y)), (*street.radii, radius)


def _trace(street: Street, begin: float, finish: float) -> None:
    """Rounds the corners of a street's polyline and cuts it back to its junctions' edges."""
    points, radii = street.points, street.radii
    legs = [math.dist(a, b) for a, b in pairwise(points)]
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(points)]
    bends = [wrap(b - a) for a, b in pairwise(headings)]
    tangents = [r * math.tan(abs(bend) / 2.0) for r, bend in zip(radii, bends, strict=True)]
    taken = [begin, *tangents, finish]
    pen = Pen(points[0][0] + begin * math.cos(headings[0]), points[0][1] + begin * math.sin(headings[0]), headings[0])
    for k, leg in enumerate(legs):
        straight = leg - taken[k] - taken[k + 1]
        if straight < 0.0:
            raise ValueError(f"street {street.name}: no room for leg {k + 1}, {-straight:.1f} m too short")
        pen.line(straight)
        if k < len(bends):
            pen.arc(radii[k] * abs(bends[k]), math.copysign(1.0 / radii[k], bends[k]))
    street.geometry, street.length = tuple(pen.pieces), pen.s
    street.section = street.section.without(street.length)
