"""OpenDRIVE 1.4 text from records: the inverse of `lavsim.map.opendrive`, in the form CARLA's map library reads."""

from __future__ import annotations

from collections.abc import Iterable

from lxml import etree

from lavsim.map.records import (
    ControllerRecord,
    Cubic,
    Geometry,
    JunctionRecord,
    LaneRecord,
    Network,
    ObjectRecord,
    Polynomial,
    RoadLink,
    RoadMark,
    RoadRecord,
    SectionRecord,
    SignalRecord,
    SignalReference,
    Validity,
)

GEO_REFERENCE = (
    "+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +geoidgrids=egm96_15.gtx +vunits=m +no_defs"
)


def write_network(network: Network) -> bytes:
    """The file's bytes; the same for equal records."""
    root = etree.Element("OpenDRIVE")
    xs = [g.x for road in network.roads for g in road.geometry] or [0.0]
    ys = [g.y for road in network.roads for g in road.geometry] or [0.0]
    header = _add(
        root, "header", revMajor=1, revMinor=4, name=network.name, version=1,
        north=max(ys), south=min(ys), east=max(xs), west=min(xs), vendor="lavsim",
    )  # fmt: skip
    reference = etree.SubElement(header, "geoReference")
    reference.text = etree.CDATA(network.geo_reference or GEO_REFERENCE)
    for road in network.roads:
        _road(root, road)
    for controller in network.controllers:
        _controller(root, controller)
    for junction in network.junctions:
        _junction(root, junction)
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))


def _add(parent: etree._Element, tag: str, **attributes: object) -> etree._Element:
    element = etree.SubElement(parent, tag)
    for key, value in attributes.items():
        if isinstance(value, bool):
            value = "yes" if value else "no"
        elif isinstance(value, float):
            value = repr(float(value))
        element.set(key, str(value))
    return element


def _road(root: etree._Element, road: RoadRecord) -> None:
    element = _add(root, "road", name=road.name, length=float(road.length), id=road.id, junction=road.junction)
    if road.left_hand:
        element.set("rule", "LHT")
    link = _add(element, "link")
    _link(link, "predecessor", road.predecessor)
    _link(link, "successor", road.successor)
    for speed in road.speeds:
        kind = _add(element, "type", s=float(speed.s), type="town")
        _add(kind, "speed", max=f"{speed.limit * 3.6:.12g}", unit="km/h")
    plan = _add(element, "planView")
    for geometry in road.geometry:
        _geometry(plan, geometry)
    _polynomials(_add(element, "elevationProfile"), "elevation", road.elevation or (Polynomial(0.0, 0.0),))
    _lateral(_add(element, "lateralProfile"), road)
    lanes = _add(element, "lanes")
    _polynomials(lanes, "laneOffset", road.lane_offset or (Polynomial(0.0, 0.0),))
    for section in road.sections:
        _section(lanes, section)
    objects = _add(element, "objects")
    for thing in road.objects:
        _object(objects, thing)
    signals = _add(element, "signals")
    for signal in road.signals:
        _signal(signals, signal)
    for place in road.references:
        _reference(signals, place)


def _link(parent: etree._Element, tag: str, link: RoadLink | None) -> None:
    if link is not None:
        element = _add(parent, tag, elementType=link.kind, elementId=link.id)
        if link.contact:
            element.set("contactPoint", link.contact)


def _geometry(parent: etree._Element, geometry: Geometry) -> None:
    g = geometry
    element = _add(
        parent, "geometry", s=float(g.s), x=float(g.x), y=float(g.y), hdg=float(g.heading), length=float(g.length)
    )
    if g.cubic is not None:
        _cubic(element, g.cubic)
    elif g.end_curvature is not None:
        _add(element, "spiral", curvStart=float(g.curvature), curvEnd=float(g.end_curvature))
    elif g.curvature == 0.0:
        _add(element, "line")
    else:
        _add(element, "arc", curvature=float(g.curvature))


def _cubic(element: etree._Element, cubic: Cubic) -> None:
    if cubic.open_ended:
        _add(element, "poly3", **{key: float(value) for key, value in zip("abcd", cubic.v, strict=True)})
        return
    values = {f"{key}U": float(value) for key, value in zip("abcd", cubic.u, strict=True)}
    values |= {f"{key}V": float(value) for key, value in zip("abcd", cubic.v, strict=True)}
    _add(element, "paramPoly3", pRange="normalized" if cubic.end == 1.0 else "arcLength", **values)


def _lateral(element: etree._Element, road: RoadRecord) -> None:
    _polynomials(element, "superelevation", road.superelevation)
    for side, p in road.crossfall:
        _add(element, "crossfall", side=side, s=float(p.s), a=float(p.a), b=float(p.b), c=float(p.c), d=float(p.d))
    for profile in road.shapes:
        for p in profile.pieces:
            values = {key: float(value) for key, value in zip("abcd", (p.a, p.b, p.c, p.d), strict=True)}
            _add(element, "shape", s=float(profile.s), t=float(p.s), **values)


def _polynomials(parent: etree._Element, tag: str, records: Iterable[Polynomial], key: str = "s") -> None:
    for p in records:
        _add(parent, tag, **{key: float(p.s)}, a=float(p.a), b=float(p.b), c=float(p.c), d=float(p.d))


def _section(parent: etree._Element, section: SectionRecord) -> None:
    element = _add(parent, "laneSection", s=float(section.s))
    for side, members in (
        ("left", [lane for lane in section.lanes if lane.id > 0]),
        ("center", [lane for lane in section.lanes if lane.id == 0]),
        ("right", [lane for lane in section.lanes if lane.id < 0]),
    ):
        if members:
            box = _add(element, side)
            for lane in members:
                _lane(box, lane)


def _lane(parent: etree._Element, lane: LaneRecord) -> None:
    element = _add(parent, "lane", id=lane.id, type=lane.kind, level="true" if lane.level else "false")
    if lane.id != 0:
        link = _add(element, "link")
        if lane.predecessor is not None:
            _add(link, "predecessor", id=lane.predecessor)
        if lane.successor is not None:
            _add(link, "successor", id=lane.successor)
    _polynomials(element, "width", lane.widths, "sOffset")
    _polynomials(element, "border", lane.borders, "sOffset")
    for s, inner, outer in lane.heights:
        _add(element, "height", sOffset=float(s), inner=float(inner), outer=float(outer))
    for speed in lane.speeds:
        _add(element, "speed", sOffset=float(speed.s), max=f"{speed.limit * 3.6:.12g}", unit="km/h")
    for mark in lane.marks:
        _mark(element, mark)


def _mark(parent: etree._Element, mark: RoadMark) -> None:
    _add(
        parent, "roadMark", sOffset=float(mark.s), type=mark.kind, material="standard", color=mark.colour,
        width=float(mark.width), laneChange=mark.lane_change,
    )  # fmt: skip


def _validity(parent: etree._Element, validity: Validity) -> None:
    for low, high in validity:
        _add(parent, "validity", fromLane=low, toLane=high)


def _signal(parent: etree._Element, signal: SignalRecord) -> None:
    element = _add(
        parent, "signal", name=signal.name, id=signal.id, s=float(signal.s), t=float(signal.t),
        zOffset=float(signal.z_offset), hOffset=float(signal.h_offset),
        roll=float(signal.roll), pitch=float(signal.pitch),
        orientation=signal.orientation, dynamic=signal.dynamic, country=signal.country, type=signal.kind,
        subtype=signal.subtype, value=float(signal.value), text=signal.text, height=float(signal.height),
        width=float(signal.width),
    )  # fmt: skip
    if signal.unit:
        element.set("unit", signal.unit)
    _validity(element, signal.validity)


def _reference(parent: etree._Element, place: SignalReference) -> None:
    element = _add(
        parent, "signalReference", id=place.id, s=float(place.s), t=float(place.t), orientation=place.orientation
    )
    _validity(element, place.validity)


def _object(parent: etree._Element, thing: ObjectRecord) -> None:
    element = _add(
        parent, "object", id=thing.id, name=thing.name, s=float(thing.s), t=float(thing.t),
        zOffset=float(thing.z_offset), hdg=float(thing.heading), roll=0.0, pitch=0.0,
        orientation=thing.orientation, type=thing.kind, width=float(thing.width), length=float(thing.length),
        height=float(thing.height),
    )  # fmt: skip
    if thing.outline:
        outline = _add(element, "outline")
        for u, v, z in thing.outline:
            _add(outline, "cornerLocal", u=float(u), v=float(v), z=float(z))
    elif thing.road_outline:
        outline = _add(element, "outline")
        for s, t, dz in thing.road_outline:
            _add(outline, "cornerRoad", s=float(s), t=float(t), dz=float(dz))
    for row in thing.repeats:
        _add(
            element, "repeat", s=float(row.s), length=float(row.length), distance=float(row.distance),
            tStart=float(row.t_start), tEnd=float(row.t_end),
        )  # fmt: skip
    if thing.parking and thing.kind.lower() != "parkingspace":
        _add(element, "parkingSpace")


def _junction(root: etree._Element, junction: JunctionRecord) -> None:
    element = _add(root, "junction", id=junction.id, name=junction.name)
    if junction.direct:
        element.set("type", "direct")
    for c in junction.connections:
        connection = _add(
            element, "connection", id=c.id, incomingRoad=c.incoming,
            **{"linkedRoad" if junction.direct else "connectingRoad": c.connecting}, contactPoint=c.contact,
        )  # fmt: skip
        for source, target in c.links:
            _add(connection, "laneLink", **{"from": source, "to": target})
    for sequence, controller in enumerate(junction.controllers):
        _add(element, "controller", id=controller, type=0, sequence=sequence)


def _controller(root: etree._Element, controller: ControllerRecord) -> None:
    element = _add(root, "controller", name=controller.name, id=controller.id)
    for signal in controller.signals:
        _add(element, "control", signalId=signal, type="")
