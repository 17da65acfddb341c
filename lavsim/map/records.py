"""OpenDRIVE's elements as plain records.

Frames here are OpenDRIVE's (x east, y north, angles counter-clockwise, `t` positive to the left of the reference
line). `lavsim.map.opendrive` reads them, `lavsim.map.pieces` turns them into the world frame, once, and
`lavsim.map.write` writes them back.
"""

from __future__ import annotations

from dataclasses import dataclass, field

MAX_COORDINATE = 1e6  # [m] a town farther out than this, or a road longer, is a broken file
SPEED_UNITS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "kmh": 1.0 / 3.6, "mph": 0.44704, "": 1.0}  # [m/s] per unit

Validity = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Cubic:
    """u(p) and v(p) as a + b·p + c·p² + d·p³, p from 0 to `end`, in the frame of the piece's start.

    Attributes:
        open_ended: The piece ends after its length, not at `end` (poly3).
    """

    u: tuple[float, float, float, float]
    v: tuple[float, float, float, float]
    end: float
    open_ended: bool = False


@dataclass(frozen=True)
class Geometry:
    """A piece of the reference line: a line (curvature 0), an arc, a spiral or a cubic.

    Attributes:
        s: Where it starts on the road [m].
        x: Start, east [m].
        y: Start, north [m].
        heading: At the start, counter-clockwise from east [rad].
        length: [m].
        curvature: [1/m], positive to the left; of a spiral at its start.
        end_curvature: Of a spiral at its end [1/m]; None for other kinds.
        cubic: Of a poly3 or paramPoly3; None for other kinds.
    """

    s: float
    x: float
    y: float
    heading: float
    length: float
    curvature: float = 0.0
    end_curvature: float | None = None
    cubic: Cubic | None = None


@dataclass(frozen=True)
class Polynomial:
    """`a + b·ds + c·ds² + d·ds³` from `s` on, `ds` counted from there; of widths, offsets and elevations."""

    s: float
    a: float
    b: float = 0.0
    c: float = 0.0
    d: float = 0.0


@dataclass(frozen=True)
class RoadMark:
    """Paint on the outer edge of a lane (of lane 0: on the centre line), from `s` after the section's start on."""

    s: float = 0.0
    kind: str = "none"
    colour: str = "white"
    width: float = 0.0
    lane_change: str = "both"


@dataclass(frozen=True)
class SpeedRecord:
    """Speed limit of a road from `s` on [m/s]."""

    s: float
    limit: float


@dataclass(frozen=True)
class LaneRecord:
    """A lane of one section. Ids are negative right of the reference line, positive left; links are lane ids.

    Attributes:
        borders: Outer edge as t, instead of widths; from the section's start, as widths are.
        heights: (distance from the section's start, inner, outer) above the road [m].
        level: The lane stays horizontal where the road banks.
        speeds: Limits of this lane alone, from the section's start.
    """

    id: int
    kind: str
    widths: tuple[Polynomial, ...] = ()
    marks: tuple[RoadMark, ...] = ()
    predecessor: int | None = None
    successor: int | None = None
    borders: tuple[Polynomial, ...] = ()
    heights: tuple[tuple[float, float, float], ...] = ()
    level: bool = False
    speeds: tuple[SpeedRecord, ...] = ()


@dataclass(frozen=True)
class SectionRecord:
    """A stretch of road with constant lanes, from `s` on; lanes in order of falling id, lane 0 included."""

    s: float
    lanes: tuple[LaneRecord, ...]


@dataclass(frozen=True)
class RoadLink:
    """What lies before or behind a road: another road's "start" or "end" ("" where not said), or a junction."""

    kind: str
    id: int
    contact: str = ""


@dataclass(frozen=True)
class SignalRecord:
    """A signal where it physically stands. Angles [rad], lengths [m]; `validity` as lane id ranges."""

    id: int
    name: str
    s: float
    t: float
    kind: str
    z_offset: float = 0.0
    h_offset: float = 0.0
    orientation: str = "+"
    dynamic: bool = False
    subtype: str = "-1"
    value: float = -1.0
    unit: str = ""
    text: str = ""
    height: float = 0.0
    width: float = 0.0
    validity: Validity = ()
    country: str = "OpenDRIVE"
    pitch: float = 0.0
    roll: float = 0.0


@dataclass(frozen=True)
class SignalReference:
    """A place on a road where a signal standing elsewhere counts."""

    id: int
    s: float
    t: float = 0.0
    orientation: str = "+"
    validity: Validity = ()


@dataclass(frozen=True)
class Repeat:
    """Copies of an object from `s` on, over `length`, every `distance` [m]; t runs from `t_start` to `t_end`."""

    s: float
    length: float
    distance: float
    t_start: float
    t_end: float


@dataclass(frozen=True)
class ObjectRecord:
    """A thing beside or on the road; `outline` holds (u, v, z) corners in its own frame.

    Attributes:
        road_outline: (s, t, dz) corners in the road's frame, of things outlined that way.
        repeats: Rows of the same thing along the road.
        parking: Whether it is a parking space.
    """

    id: int
    name: str
    s: float
    t: float
    kind: str = ""
    z_offset: float = 0.0
    heading: float = 0.0
    orientation: str = "none"
    length: float = 0.0
    width: float = 0.0
    height: float = 0.0
    outline: tuple[tuple[float, float, float], ...] = ()
    road_outline: tuple[tuple[float, float, float], ...] = ()
    repeats: tuple[Repeat, ...] = ()
    parking: bool = False


@dataclass(frozen=True)
class CrossProfile:
    """Height over t at one s of a road: polynomials that begin at rising t."""

    s: float
    pieces: tuple[Polynomial, ...]


@dataclass(frozen=True)
class RoadRecord:
    """A road: reference line, profiles, lanes, and what stands along it. `junction` is -1 outside junctions.

    Attributes:
        superelevation: Bank angle [rad], positive where the left side is higher.
        crossfall: (side, polynomial) of slopes that fall outward [rad]; side "left", "right" or "both".
        shapes: Cross-sections by s.
        left_hand: Traffic keeps left: lanes with positive id run with s.
        line: Where it stands in the file, for messages.
    """

    id: int
    length: float
    geometry: tuple[Geometry, ...]
    sections: tuple[SectionRecord, ...]
    name: str = ""
    junction: int = -1
    predecessor: RoadLink | None = None
    successor: RoadLink | None = None
    speeds: tuple[SpeedRecord, ...] = ()
    elevation: tuple[Polynomial, ...] = ()
    lane_offset: tuple[Polynomial, ...] = ()
    objects: tuple[ObjectRecord, ...] = ()
    signals: tuple[SignalRecord, ...] = ()
    references: tuple[SignalReference, ...] = ()
    superelevation: tuple[Polynomial, ...] = ()
    crossfall: tuple[tuple[str, Polynomial], ...] = ()
    shapes: tuple[CrossProfile, ...] = ()
    left_hand: bool = False
    line: int = field(default=0, compare=False)


@dataclass(frozen=True)
class ConnectionRecord:
    """A way through a junction: from a road outside to a connecting road, with (from, to) lane ids.

    In a direct junction `connecting` is the road on its other side.
    """

    id: int
    incoming: int
    connecting: int
    contact: str
    links: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True)
class JunctionRecord:
    """A junction; `controllers` in file order, which is the order of its phases."""

    id: int
    connections: tuple[ConnectionRecord, ...]
    controllers: tuple[int, ...] = ()
    name: str = ""
    direct: bool = False


@dataclass(frozen=True)
class ControllerRecord:
    """Signals that share a phase."""

    id: int
    signals: tuple[int, ...]
    name: str = ""


@dataclass(frozen=True)
class Network:
    """A whole file.

    Attributes:
        notes: One line for each kind of thing that was left out, with how often.
        repairs: One line for each thing that was wrong and mended.
    """

    roads: tuple[RoadRecord, ...]
    junctions: tuple[JunctionRecord, ...] = ()
    controllers: tuple[ControllerRecord, ...] = ()
    name: str = ""
    geo_reference: str = ""
    notes: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()
