"""Reads OpenDRIVE files into `lavsim.map.records`: what the file says, checked, before any geometry is worked out.

Ids that are no whole numbers ("Kalle") are numbered, and the report says how.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from lxml import etree

from lavsim.errors import MapError
from lavsim.map.elements import MAX_RECORDS, Elements, plain_number
from lavsim.map.records import (
    MAX_COORDINATE,
    SPEED_UNITS,
    ConnectionRecord,
    ControllerRecord,
    CrossProfile,
    Cubic,
    Geometry,
    JunctionRecord,
    LaneRecord,
    Network,
    ObjectRecord,
    Polynomial,
    Repeat,
    RoadLink,
    RoadMark,
    RoadRecord,
    SectionRecord,
    SignalRecord,
    SignalReference,
    SpeedRecord,
    Validity,
)

MAX_CURVATURE = 10.0  # [1/m]
MAX_BYTES = 64_000_000  # of a file; Town04 has 3.4 million


def read_file(path: Path) -> Network:
    """The records of an OpenDRIVE file.

    Raises:
        MapError: the file can't be opened, is no XML, or is no road network; with file and line.
    """
    return read_network(read_bytes(path), str(path))


def read_bytes(path: Path) -> bytes:
    """A map file's bytes.

    Raises:
        MapError: the file can't be opened, or is larger than any town.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise MapError(f"{path}: {error.strerror or error}.") from None
    if len(data) > MAX_BYTES:
        raise MapError(f"{path}: the file is larger than {MAX_BYTES // 1_000_000} MB; that is no town.")
    return data


def read_network(data: bytes | str, source: str = "<text>") -> Network:
    """The records of OpenDRIVE text; `source` names it in messages.

    Raises:
        MapError: the text is no XML or no road network; with `source` and line.
    """
    return _Reader(source).network(data)


_KNOWN_CHILDREN = {
    "road": {"link", "type", "planView", "elevationProfile", "lateralProfile", "lanes", "objects", "signals"},
    "OpenDRIVE": {"header", "road", "junction", "controller"},
    "lane": {"link", "width", "border", "roadMark", "speed", "height"},
    "lateralProfile": {"superelevation", "crossfall", "shape"},
    "junction": {"connection", "controller"},
}
_SHAPES = ("line", "arc", "spiral", "poly3", "paramPoly3")


class _Reader(Elements):
    """Walks the tree."""

    def network(self, data: bytes | str) -> Network:
        raw = data.encode(errors="replace") if isinstance(data, str) else data
        if len(raw) > MAX_BYTES:
            raise MapError(f"{self.source}: the file is larger than {MAX_BYTES // 1_000_000} MB; that is no town.")
        parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False, load_dtd=False)
        try:
            root = etree.fromstring(raw, parser)
        except etree.XMLSyntaxError as error:
            line = error.position[0] if error.position else 0
            words = " ".join(str(error.msg).split())
            raise MapError(f"{self.source}, line {line}: not well-formed XML: {words}.") from None
        except ValueError as error:  # a text with an encoding declaration of its own, NUL bytes …
            raise MapError(f"{self.source}: not readable as XML: {error}.") from None
        if root.getroottree().docinfo.internalDTD is not None:
            raise self.fail(root, "a document type (DTD, entities) is not accepted in a map")
        if root.tag != "OpenDRIVE":
            raise self.fail(root, f"expected the root element OpenDRIVE, got {str(root.tag)[:60]!r}")
        if len(root) > MAX_RECORDS:
            raise self.fail(root, f"<OpenDRIVE> holds {len(root)} elements; that is no town")
        self.number_ids(root)
        header = root.find("header")
        reference = header.findtext("geoReference") if header is not None else None
        roads = tuple(self.road(e) for e in root.iterfind("road"))
        if not roads:
            raise self.fail(root, "the file has no road")
        self.unique(root, "road", [r.id for r in roads])
        junctions = tuple(self.junction(e) for e in root.iterfind("junction") if e.get("type") != "virtual")
        virtual = sum(e.get("type") == "virtual" for e in root.iterfind("junction"))
        if virtual:
            self.skipped["virtual <junction>"] += virtual
        self.unique(root, "junction", [j.id for j in junctions])
        controllers = tuple(self.controller(e) for e in root.iterfind("controller"))
        self.skip(root, _KNOWN_CHILDREN["OpenDRIVE"])
        return Network(
            roads,
            junctions,
            controllers,
            name=(header.get("name") or "") if header is not None else "",
            geo_reference=(reference or "").strip(),
            notes=tuple(f"{count} x {what} not read" for what, count in sorted(self.skipped.items())),
            repairs=tuple(self.repairs),
        )

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
        self.skip(element, _KNOWN_CHILDREN["road"])
        lateral = element.find("lateralProfile")
        if lateral is not None:
            self.skip(lateral, _KNOWN_CHILDREN["lateralProfile"])
        if objects is not None:
            self.skip(objects, {"object"})
        if signals is not None:
            self.skip(signals, {"signal", "signalReference"})
        return RoadRecord(
            id=self.id(element, "id", "road"),
            length=length,
            geometry=geometry,
            sections=sections,
            name=element.get("name") or "",
            junction=self._membership(element),
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
            superelevation=self.polynomials(element.iterfind("lateralProfile/superelevation")),
            crossfall=tuple(
                (e.get("side") or "both", self.polynomial(e)) for e in element.iterfind("lateralProfile/crossfall")
            ),
            shapes=self.shapes(element.iterfind("lateralProfile/shape")),
            left_hand=(element.get("rule") or "RHT").strip().upper() == "LHT",
            line=element.sourceline if isinstance(element.sourceline, int) else 0,
        )

    def _membership(self, element: etree._Element) -> int:
        return -1 if element.get("junction") in (None, "", "-1") else self.id(element, "junction", "junction")

    def shapes(self, elements: Iterator[etree._Element]) -> tuple[CrossProfile, ...]:
        by_s: dict[float, list[Polynomial]] = {}
        for e in elements:
            by_s.setdefault(self.number(e, "s"), []).append(self.polynomial(e, "t"))
        return tuple(CrossProfile(s, tuple(sorted(by_s[s], key=lambda p: p.s))) for s in sorted(by_s))

    def link(self, element: etree._Element | None) -> RoadLink | None:
        if element is None:
            return None
        kind = element.get("elementType") or "road"
        if kind not in ("road", "junction"):
            raise self.fail(element, f"elementType must be 'road' or 'junction', got {kind[:40]!r}")
        contact = element.get("contactPoint") or ""
        if contact not in ("start", "end"):
            contact = ""  # the nearer end is taken
        return RoadLink(kind, self.id(element, "elementId", kind), contact)

    def speeds(self, road: etree._Element) -> Iterator[SpeedRecord]:
        for record in road.iterfind("type"):
            speed = record.find("speed")
            limit = self.limit(speed) if speed is not None else None
            if limit is not None:
                yield SpeedRecord(self.number(record, "s", 0.0), limit)

    def limit(self, speed: etree._Element) -> float | None:
        """[m/s]; None where the record sets none."""
        if speed.get("max") in ("no limit", "undefined", "", None):
            return None
        unit = (speed.get("unit") or "").strip().lower()
        if unit not in SPEED_UNITS:
            raise self.fail(speed, f"speed unit must be one of m/s, km/h, mph, got {unit[:40]!r}")
        value = self.number(speed, "max") * SPEED_UNITS[unit]
        return value if value > 0.0 else None

    def geometry(self, element: etree._Element) -> Geometry:
        shape = next((child for child in element if isinstance(child.tag, str) and child.tag != "userData"), None)
        if shape is None:
            raise self.fail(element, "<geometry> holds no curve")
        if shape.tag not in _SHAPES:
            raise self.fail(shape, f"geometry {str(shape.tag)[:40]!r} is unknown; known are {', '.join(_SHAPES)}")
        x, y = self.number(element, "x"), self.number(element, "y")
        if max(abs(x), abs(y)) > MAX_COORDINATE:
            raise self.fail(element, f"geometry starts at ({x:g}, {y:g}), beyond {MAX_COORDINATE:g} m")
        length = self.number(element, "length")
        if not 0.0 <= length <= MAX_COORDINATE:
            raise self.fail(element, f"geometry length must be 0 to {MAX_COORDINATE:g} m, got {length:g}")
        place = (self.number(element, "s"), x, y, self.number(element, "hdg"), length)
        self.spend(element, "records")
        if length < 1e-9 or shape.tag == "line":  # a curve of no length has no direction but its start's
            return Geometry(*place)
        if shape.tag == "arc":
            return Geometry(*place, self.curvature(shape, "curvature"))
        self.spend(element, "curves")
        if shape.tag == "spiral":
            start, end = self.curvature(shape, "curvStart"), self.curvature(shape, "curvEnd")
            geometry = Geometry(*place, start, end)
        else:
            geometry = Geometry(*place, cubic=self.cubic(shape, length))
        return geometry

    def curvature(self, shape: etree._Element, name: str) -> float:
        value = self.number(shape, name)
        if abs(value) > MAX_CURVATURE:
            raise self.fail(shape, f"{shape.tag} {name} must be within +-{MAX_CURVATURE:g} 1/m, got {value:g}")
        return value

    def cubic(self, shape: etree._Element, length: float) -> Cubic:
        def four(suffix: str) -> tuple[float, float, float, float]:
            a, b, c, d = (self.number(shape, k + suffix) for k in "abcd")
            return a, b, c, d

        if shape.tag == "poly3":
            return Cubic((0.0, 1.0, 0.0, 0.0), four(""), length, open_ended=True)
        kind = shape.get("pRange") or "arcLength"
        if kind not in ("arcLength", "normalized"):
            raise self.fail(shape, f"pRange must be 'arcLength' or 'normalized', got {kind[:40]!r}")
        return Cubic(four("U"), four("V"), 1.0 if kind == "normalized" else length)

    def section(self, element: etree._Element) -> SectionRecord:
        lanes = [self.lane(e) for side in ("left", "center", "right") for e in element.iterfind(f"{side}/lane")]
        self.spend(element, "lanes", len(lanes))
        self.spend(element, "lane sums", len(lanes) ** 2)
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
        self.skip(element, _KNOWN_CHILDREN["lane"])
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
        self.spend(element, "records", len(marks))
        heights = [
            (self.number(e, "sOffset", 0.0), self.number(e, "inner", 0.0), self.number(e, "outer", 0.0))
            for e in element.iterfind("height")
        ]
        limits = [(self.number(e, "sOffset", 0.0), self.limit(e)) for e in element.iterfind("speed")]
        return LaneRecord(
            self.whole(element, "id"),
            element.get("type") or "none",
            self.polynomials(element.iterfind("width"), "sOffset"),
            tuple(sorted(marks, key=lambda m: m.s)),
            self.whole(before, "id") if before is not None else None,
            self.whole(behind, "id") if behind is not None else None,
            self.polynomials(element.iterfind("border"), "sOffset"),
            tuple(sorted(heights)),
            element.get("level") in ("true", "1"),
            tuple(SpeedRecord(s, limit) for s, limit in sorted(limits, key=lambda r: r[0]) if limit is not None),
        )

    def validity(self, element: etree._Element) -> Validity:
        return tuple((self.whole(e, "fromLane"), self.whole(e, "toLane")) for e in element.iterfind("validity"))

    def signal(self, element: etree._Element) -> SignalRecord:
        self.spend(element, "things")
        self.skip(element, {"validity"})
        return SignalRecord(
            id=self.id(element, "id", "signal"),
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
            country=element.get("country") or "",
            pitch=self.number(element, "pitch", 0.0),
            roll=self.number(element, "roll", 0.0),
        )

    def reference(self, element: etree._Element) -> SignalReference:
        self.spend(element, "things")
        return SignalReference(
            self.id(element, "id", "signal"),
            self.number(element, "s"),
            self.number(element, "t", 0.0),
            element.get("orientation") or "none",
            self.validity(element),
        )

    def object(self, element: etree._Element) -> ObjectRecord:
        self.spend(element, "things")
        self.skip(element, {"outline", "outlines", "repeat", "parkingSpace", "validity", "material"})
        outline = element.find("outline")
        if outline is None:
            outline = element.find("outlines/outline")
        local = outline.iterfind("cornerLocal") if outline is not None else ()
        on_road = outline.iterfind("cornerRoad") if outline is not None else ()
        kind = element.get("type") or ""
        text = element.get("id") or ""
        number = plain_number(text, -(2**31))
        return ObjectRecord(
            id=-1 if number is None else number,
            name=element.get("name") or "",
            s=self.number(element, "s"),
            t=self.number(element, "t"),
            kind=kind,
            z_offset=self.number(element, "zOffset", 0.0),
            heading=self.number(element, "hdg", 0.0),
            orientation=element.get("orientation") or "none",
            length=self.number(element, "length", 0.0),
            width=self.number(element, "width", 0.0),
            height=self.number(element, "height", 0.0),
            outline=tuple((self.number(c, "u"), self.number(c, "v"), self.number(c, "z", 0.0)) for c in local),
            road_outline=tuple((self.number(c, "s"), self.number(c, "t"), self.number(c, "dz", 0.0)) for c in on_road),
            repeats=tuple(
                Repeat(
                    self.number(e, "s"),
                    self.number(e, "length"),
                    self.number(e, "distance"),
                    self.number(e, "tStart", 0.0),
                    self.number(e, "tEnd", 0.0),
                )
                for e in element.iterfind("repeat")
            ),
            parking=kind.lower() == "parkingspace" or element.find("parkingSpace") is not None,
        )

    def junction(self, element: etree._Element) -> JunctionRecord:
        kind = element.get("type") or "default"
        if kind not in ("default", "direct"):
            raise self.fail(element, f"junction type must be default, direct or virtual, got {kind[:40]!r}")
        self.skip(element, _KNOWN_CHILDREN["junction"])
        road = "connectingRoad" if kind == "default" else "linkedRoad"
        connections: list[ConnectionRecord] = []
        name = self.id(element, "id", "junction")
        for e in element.iterfind("connection"):
            self.spend(e, "things")
            contact = e.get("contactPoint") or ""
            if e.get("incomingRoad") is None or e.get(road) is None:
                self.repairs.append(f"junction {name}: a connection without incomingRoad or {road} was dropped")
                continue
            links = tuple((self.whole(k, "from"), self.whole(k, "to")) for k in e.iterfind("laneLink"))
            connections.append(
                ConnectionRecord(
                    len(connections) if plain_number(e.get("id") or "", 0) is None else self.whole(e, "id"),
                    self.id(e, "incomingRoad", "road"),
                    self.id(e, road, "road"),
                    contact if contact in ("start", "end") else "",
                    links,
                )
            )
        controllers = tuple(self.id(e, "id", "controller") for e in element.iterfind("controller"))
        return JunctionRecord(name, tuple(connections), controllers, element.get("name") or "", kind == "direct")

    def controller(self, element: etree._Element) -> ControllerRecord:
        ids = [self.id(e, "signalId", "signal") for e in element.iterfind("control")]
        number = self.id(element, "id", "controller")
        return ControllerRecord(number, tuple(dict.fromkeys(ids)), element.get("name") or "")


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
