"""OpenDRIVE files as plain records: what the file says, checked, before any geometry is worked out.

Frames here are OpenDRIVE's (x east, y north, angles counter-clockwise, `t` positive to the left of the reference
line). `lavsim.map.lane` turns them into the world frame, once. `lavsim.map.write` writes these records back.

Read so far: lines and arcs. A curve of another kind is refused by name rather than drawn wrong.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from lxml import etree

from lavsim.errors import MapError

SPEED_UNITS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "kmh": 1.0 / 3.6, "mph": 0.44704, "": 1.0}  # [m/s] per unit
MAX_COORDINATE = 1e6  # [m] a town farther out than this, or a road longer, is a broken file
MAX_CURVATURE = 10.0  # [1/m]

Validity = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Geometry:
    """A piece of the reference line: a line (curvature 0) or an arc.

    Attributes:
        s: Where it starts on the road [m].
        x: Start, east [m].
        y: Start, north [m].
        heading: At the start, counter-clockwise from east [rad].
        length: [m].
        curvature: [1/m], positive to the left.
    """

    s: float
    x: float
    y: float
    heading: float
    length: float
    curvature: float = 0.0


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
class LaneRecord:
    """A lane of one section. Ids are negative right of the reference line, positive left; links are lane ids."""

    id: int
    kind: str
    widths: tuple[Polynomial, ...] = ()
    marks: tuple[RoadMark, ...] = ()
    predecessor: int | None = None
    successor: int | None = None


@dataclass(frozen=True)
class SectionRecord:
    """A stretch of road with constant lanes, from `s` on; lanes in order of falling id, lane 0 included."""

    s: float
    lanes: tuple[LaneRecord, ...]


@dataclass(frozen=True)
class RoadLink:
    """What lies before or behind a road: another road's "start" or "end", or a junction."""

    kind: str
    id: int
    contact: str = ""


@dataclass(frozen=True)
class SpeedRecord:
    """Speed limit of a road from `s` on [m/s]."""

    s: float
    limit: float


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


@dataclass(frozen=True)
class SignalReference:
    """A place on a road where a signal standing elsewhere counts."""

    id: int
    s: float
    t: float = 0.0
    orientation: str = "+"
    validity: Validity = ()


@dataclass(frozen=True)
class ObjectRecord:
    """A thing beside or on the road; `outline` holds (u, v, z) corners in its own frame."""

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


@dataclass(frozen=True)
class RoadRecord:
    """A road: reference line, profiles, lanes, and what stands along it. `junction` is -1 outside junctions."""

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


@dataclass(frozen=True)
class ConnectionRecord:
    """A way through a junction: from a road outside to a connecting road, with (from, to) lane ids."""

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
    """

    roads: tuple[RoadRecord, ...]
    junctions: tuple[JunctionRecord, ...] = ()
    controllers: tuple[ControllerRecord, ...] = ()
    name: str = ""
    geo_reference: str = ""
    notes: tuple[str, ...] = ()


def read_file(path: Path) -> Network:
    """The records of an OpenDRIVE file.

    Raises:
        MapError: the file can't be opened, is no XML, or is no road network; with file and line.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MapError(f"{path}: {error.strerror or error}.") from None
    return read_network(data, str(path))


def read_network(data: bytes | str, source: str = "<text>") -> Network:
    """The records of OpenDRIVE text; `source` names it in messages.

    Raises:
        MapError: the text is no XML or no road network; with `source` and line.
    """
    return _Reader(source).network(data)


_KNOWN_CHILDREN = {
    "road": {"link", "type", "planView", "elevationProfile", "lateralProfile", "lanes", "objects", "signals"},
    "OpenDRIVE": {"header", "road", "junction", "controller"},
    "lane": {"link", "width", "roadMark", "speed"},
}
_QUIET = {"userData", "include", "surface", "lateralProfile"}  # carry nothing for a flat cross-section


class _Reader:
    """Walks the tree and says where a mistake is."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.skipped: Counter[str] = Counter()

    def fail(self, element: etree._Element | None, message: str) -> MapError:
        line = f", line {element.sourceline}" if element is not None and element.sourceline else ""
        return MapError(f"{self.source}{line}: {message}.")

    def network(self, data: bytes | str) -> Network:
        raw = data.encode() if isinstance(data, str) else data
        parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False, load_dtd=False)
        try:
            root = etree.fromstring(raw, parser)
        except etree.XMLSyntaxError as error:
            line = error.position[0] if error.position else 0
            raise MapError(f"{self.source}, line {line}: not well-formed XML: {error.msg}.") from None
        except ValueError as error:  # a text with an encoding declaration of its own, NUL bytes …
            raise MapError(f"{self.source}: not readable as XML: {error}.") from None
        if root.getroottree().docinfo.internalDTD is not None:
            raise self.fail(root, "a document type (DTD, entities) is not accepted in a map")
        if root.tag != "OpenDRIVE":
            raise self.fail(root, f"expected the root element OpenDRIVE, got {str(root.tag)[:60]!r}")
        header = root.find("header")
        reference = header.findtext("geoReference") if header is not None else None
        roads = tuple(self.road(e) for e in root.iterfind("road"))
        if not roads:
            raise self.fail(root, "the file has no road")
        self._unique(root, "road", [r.id for r in roads])
        junctions = tuple(self.junction(e) for e in root.iterfind("junction"))
        self._unique(root, "junction", [j.id for j in junctions])
        controllers = tuple(self.controller(e) for e in root.iterfind("controller"))
        self._skip(root, _KNOWN_CHILDREN["OpenDRIVE"])
        return Network(
            roads,
            junctions,
            controllers,
            name=(header.get("name") or "") if header is not None else "",
            geo_reference=(reference or "").strip(),
            notes=tuple(f"{count} x {what} not read" for what, count in sorted(self.skipped.items())),
        )

    def _unique(self, root: etree._Element, kind: str, ids: list[int]) -> None:
        twice = [i for i, count in Counter(ids).items() if count > 1]
        if twice:
            raise self.fail(root, f"{kind} id {twice[0]} is used {Counter(ids)[twice[0]]} times")

    def _skip(self, element: etree._Element, known: set[str]) -> None:
        for child in element:
            if isinstance(child.tag, str) and child.tag not in known and child.tag not in _QUIET:
                self.skipped[f"<{child.tag[:60]}> in <{element.tag}>"] += 1

    def number(self, element: etree._Element, name: str, default: float | None = None) -> float:
        text = element.get(name)
        if text is None or text == "":
            if default is None:
                raise self.fail(element, f"<{element.tag}> lacks {name!r}")
            return default
        try:
            value = float(text)
        except ValueError:
            raise self.fail(element, f"<{element.tag}> {name} must be a number, got {text[:40]!r}") from None
        if not math.isfinite(value) or abs(value) > 1e9:
            raise self.fail(element, f"<{element.tag}> {name} must be a finite number, got {text[:40]!r}")
        return value

    def whole(self, element: etree._Element, name: str, default: int | None = None) -> int:
        text = element.get(name)
        if text is None:
            if default is None:
                raise self.fail(element, f"<{element.tag}> lacks {name!r}")
            return default
        try:
            value = int(text)
        except ValueError:
            raise self.fail(element, f"<{element.tag}> {name} must be a whole number, got {text[:40]!r}") from None
        if abs(value) >= 2**31:
            raise self.fail(element, f"<{element.tag}> {name} is out of range: {text[:40]}")
        return value

    def polynomials(self, elements: Iterator[etree._Element], key: str = "s") -> tuple[Polynomial, ...]:
        records = [
            Polynomial(
                self.number(e, key),
                self.number(e, "a"),
                self.number(e, "b", 0.0),
                self.number(e, "c", 0.0),
                self.number(e, "d", 0.0),
            )
            for e in elements
        ]
        return tuple(sorted(records, key=lambda r: r.s))

    def road(self, element: etree._Element) -> RoadRecord:
        length = self.number(element, "length")
        if not 0.0 < length <= MAX_COORDINATE:
            raise self.fail(element, f"road length must be positive and at most {MAX_COORDINATE:g} m, got {length:g}")
        lanes = element.find("lanes")
        sections = tuple(self.section(e) for e in lanes.iterfind("laneSection")) if lanes is not None else ()
        if not sections:
            raise self.fail(element, f"road {element.get('id')} has no lane section")
        if any(b.s < a.s for a, b in pairwise(sections)):
            raise self.fail(lanes, f"road {element.get('id')}: lane sections must come in order of s")
        plan = element.find("planView")
        geometry = tuple(self.geometry(e) for e in plan.iterfind("geometry")) if plan is not None else ()
        if not geometry:
            raise self.fail(element, f"road {element.get('id')} has no geometry")
        if any(b.s < a.s for a, b in pairwise(geometry)):
            raise self.fail(plan, f"road {element.get('id')}: geometries must come in order of s")
        link, objects, signals = element.find("link"), element.find("objects"), element.find("signals")
        self._skip(element, _KNOWN_CHILDREN["road"])
        if objects is not None:
            self._skip(objects, {"object"})
        if signals is not None:
            self._skip(signals, {"signal", "signalReference"})
        return RoadRecord(
            id=self.whole(element, "id"),
            length=length,
            geometry=geometry,
            sections=sections,
            name=element.get("name") or "",
            junction=self.whole(element, "junction", -1),
            predecessor=self.link(link.find("predecessor")) if link is not None else None,
            successor=self.link(link.find("successor")) if link is not None else None,
            speeds=tuple(self.speeds(element)),
            elevation=self.polynomials(element.iterfind("elevationProfile/elevation")),
            lane_offset=self.polynomials(element.iterfind("lanes/laneOffset")),
            objects=tuple(self.object(e) for e in objects.iterfind("object")) if objects is not None else (),
            signals=tuple(self.signal(e) for e in signals.iterfind("signal")) if signals is not None else (),
            references=tuple(self.reference(e) for e in signals.iterfind("signalReference"))
            if signals is not None
            else (),
        )

    def link(self, element: etree._Element | None) -> RoadLink | None:
        if element is None:
            return None
        kind = element.get("elementType") or "road"
        if kind not in ("road", "junction"):
            raise self.fail(element, f"elementType must be 'road' or 'junction', got {kind[:40]!r}")
        contact = element.get("contactPoint") or ""
        if kind == "road" and contact not in ("start", "end"):
            raise self.fail(element, f"contactPoint must be 'start' or 'end', got {contact[:40]!r}")
        return RoadLink(kind, self.whole(element, "elementId"), contact)

    def speeds(self, road: etree._Element) -> Iterator[SpeedRecord]:
        for record in road.iterfind("type"):
            speed = record.find("speed")
            if speed is None or speed.get("max") in ("no limit", "undefined", None):
                continue
            unit = speed.get("unit") or ""
            if unit not in SPEED_UNITS:
                raise self.fail(speed, f"speed unit must be one of m/s, km/h, mph, got {unit[:40]!r}")
            yield SpeedRecord(self.number(record, "s", 0.0), self.number(speed, "max") * SPEED_UNITS[unit])

    def geometry(self, element: etree._Element) -> Geometry:
        shape = next((child for child in element if isinstance(child.tag, str) and child.tag != "userData"), None)
        if shape is None:
            raise self.fail(element, "<geometry> holds no line or arc")
        if shape.tag not in ("line", "arc"):
            raise self.fail(shape, f"geometry {shape.tag[:40]!r} is not supported yet; known are line and arc")
        x, y = self.number(element, "x"), self.number(element, "y")
        if max(abs(x), abs(y)) > MAX_COORDINATE:
            raise self.fail(element, f"geometry starts at ({x:g}, {y:g}), beyond {MAX_COORDINATE:g} m")
        length = self.number(element, "length")
        if not 0.0 <= length <= MAX_COORDINATE:
            raise self.fail(element, f"geometry length must be 0 to {MAX_COORDINATE:g} m, got {length:g}")
        curvature = self.number(shape, "curvature") if shape.tag == "arc" else 0.0
        if abs(curvature) > MAX_CURVATURE:
            raise self.fail(shape, f"arc curvature must be within +-{MAX_CURVATURE:g} 1/m, got {curvature:g}")
        return Geometry(self.number(element, "s"), x, y, self.number(element, "hdg"), length, curvature)

    def section(self, element: etree._Element) -> SectionRecord:
        lanes = [self.lane(e) for side in ("left", "center", "right") for e in element.iterfind(f"{side}/lane")]
        ids = [lane.id for lane in lanes]
        if len(set(ids)) != len(ids):
            raise self.fail(element, "a lane section holds a lane id twice")
        if 0 not in ids:
            lanes.append(LaneRecord(0, "none"))
        left, right = max([*ids, 0]), min([*ids, 0])
        if len(lanes) != left - right + 1:
            raise self.fail(element, f"lane ids must run from {left} to {right} without a gap")
        return SectionRecord(self.number(element, "s"), tuple(sorted(lanes, key=lambda lane: -lane.id)))

    def lane(self, element: etree._Element) -> LaneRecord:
        link = element.find("link")
        before = link.find("predecessor") if link is not None else None
        behind = link.find("successor") if link is not None else None
        self._skip(element, _KNOWN_CHILDREN["lane"])
        marks = tuple(
            RoadMark(
                self.number(e, "sOffset", 0.0),
                e.get("type") or "none",
                e.get("color") or "standard",
                self.number(e, "width", 0.0),
                (e.get("laneChange") or "both").strip().lower(),
            )
            for e in element.iterfind("roadMark")
        )
        return LaneRecord(
            self.whole(element, "id"),
            element.get("type") or "none",
            self.polynomials(element.iterfind("width"), "sOffset"),
            tuple(sorted(marks, key=lambda m: m.s)),
            self.whole(before, "id") if before is not None else None,
            self.whole(behind, "id") if behind is not None else None,
        )

    def validity(self, element: etree._Element) -> Validity:
        return tuple((self.whole(e, "fromLane"), self.whole(e, "toLane")) for e in element.iterfind("validity"))

    def signal(self, element: etree._Element) -> SignalRecord:
        return SignalRecord(
            id=self.whole(element, "id"),
            name=element.get("name") or "",
            s=self.number(element, "s"),
            t=self.number(element, "t"),
            kind=element.get("type") or "",
            z_offset=self.number(element, "zOffset", 0.0),
            h_offset=self.number(element, "hOffset", 0.0),
            orientation=element.get("orientation") or "none",
            dynamic=element.get("dynamic") == "yes",
            subtype=element.get("subtype") or "-1",
            value=self.number(element, "value", -1.0),
            unit=element.get("unit") or "",
            text=element.get("text") or "",
            height=self.number(element, "height", 0.0),
            width=self.number(element, "width", 0.0),
            validity=self.validity(element),
        )

    def reference(self, element: etree._Element) -> SignalReference:
        return SignalReference(
            self.whole(element, "id"),
            self.number(element, "s"),
            self.number(element, "t", 0.0),
            element.get("orientation") or "none",
            self.validity(element),
        )

    def object(self, element: etree._Element) -> ObjectRecord:
        corners = element.iterfind("outline/cornerLocal")
        return ObjectRecord(
            id=self.whole(element, "id"),
            name=element.get("name") or "",
            s=self.number(element, "s"),
            t=self.number(element, "t"),
            kind=element.get("type") or "",
            z_offset=self.number(element, "zOffset", 0.0),
            heading=self.number(element, "hdg", 0.0),
            orientation=element.get("orientation") or "none",
            length=self.number(element, "length", 0.0),
            width=self.number(element, "width", 0.0),
            height=self.number(element, "height", 0.0),
            outline=tuple((self.number(c, "u"), self.number(c, "v"), self.number(c, "z", 0.0)) for c in corners),
        )

    def junction(self, element: etree._Element) -> JunctionRecord:
        kind = element.get("type") or "default"
        if kind != "default":
            raise self.fail(element, f"junction type {kind[:40]!r} is not supported yet")
        connections: list[ConnectionRecord] = []
        for e in element.iterfind("connection"):
            contact = e.get("contactPoint") or ""
            if contact not in ("start", "end"):
                raise self.fail(e, f"contactPoint must be 'start' or 'end', got {contact[:40]!r}")
            links = tuple((self.whole(k, "from"), self.whole(k, "to")) for k in e.iterfind("laneLink"))
            connections.append(
                ConnectionRecord(
                    self.whole(e, "id", len(connections)),
                    self.whole(e, "incomingRoad"),
                    self.whole(e, "connectingRoad"),
                    contact,
                    links,
                )
            )
        controllers = tuple(self.whole(e, "id") for e in element.iterfind("controller"))
        return JunctionRecord(self.whole(element, "id"), tuple(connections), controllers, element.get("name") or "")

    def controller(self, element: etree._Element) -> ControllerRecord:
        ids = [self.whole(e, "signalId") for e in element.iterfind("control")]
        return ControllerRecord(self.whole(element, "id"), tuple(dict.fromkeys(ids)), element.get("name") or "")


def reference_origin(geo_reference: str) -> tuple[float, float]:
    """Latitude and longitude [deg] of the map's origin in a PROJ string; CARLA's (42, 2) where it names none.

    Source: the leaderboard's `route_manipulation._get_latlon_ref`.
    """

    def find(key: str, default: float) -> float:
        match = re.search(rf"\+{key}=([-+0-9.eE]+)", geo_reference)
        try:
            value = float(match.group(1)) if match else default
        except ValueError:
            return default
        return value if math.isfinite(value) else default

    return find("lat_0", 42.0), find("lon_0", 2.0)
