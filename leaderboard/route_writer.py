"""Route files out: the 2.x format, hazards and weather keyframes inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from lxml import etree

from lavsim.scenarios.base import ScenarioSpec
from lavsim.world.weather import Weather
from leaderboard.routes import RouteEntry

_UNSAID = Weather()  # what differs from it is written, and what a reader of 2.x would take otherwise
_ALWAYS = ("cloudiness", "sun_altitude_angle")
_WEATHER_NAMES = [f.name for f in fields(Weather)]
_LAST = ("sun_azimuth_angle", "sun_altitude_angle")


def write_routes(entries: Sequence[RouteEntry], traffic: str | None = None) -> bytes:
    """A route file.

    Args:
        entries: The routes; their ids are written as they are.
        traffic: Traffic profile of the file; None leaves it to the rules.
    """
    root = etree.Element("routes", {} if traffic is None else {"traffic": traffic})
    for entry in entries:
        root.append(_route(entry))
        if traffic is not None and entry.traffic not in (None, traffic):
            root[-1].set("traffic", entry.traffic)
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))


def _route(entry: RouteEntry) -> etree._Element:
    element = etree.Element("route", id=entry.id, town=entry.town)
    weathers = etree.SubElement(element, "weathers")
    for frame in entry.weather:
        values = _weather_values(frame.weather)
        etree.SubElement(weathers, "weather", {"route_percentage": number(frame.percentage), **values})
    waypoints = etree.SubElement(element, "waypoints")
    for x, y, z in entry.keypoints:
        etree.SubElement(waypoints, "position", x=number(x), y=number(y), z=number(z))
    scenarios = etree.SubElement(element, "scenarios")
    for spec in entry.scenarios:
        _scenario(scenarios, spec)
    return element


def _weather_values(weather: Weather) -> dict[str, str]:
    """Attributes that give this weather back when read."""
    names = sorted(_WEATHER_NAMES, key=lambda name: (name in _LAST, "fog" in name))
    said = [n for n in names if n in _ALWAYS or getattr(weather, n) != getattr(_UNSAID, n)]
    return {name: f"{getattr(weather, name):g}" for name in said}


def _scenario(parent: etree._Element, spec: ScenarioSpec) -> None:
    element = etree.SubElement(parent, "scenario", name=spec.name, type=spec.type)
    if spec.generation != "2.x":
        element.set("generation", spec.generation)
    etree.SubElement(element, "trigger_point", _place(spec.trigger))
    for name, value in spec.parameters.items():
        if isinstance(value, str):
            etree.SubElement(element, name, value=value)
        elif isinstance(value, Sequence) and len(value) == 2:
            low, high = value
            etree.SubElement(element, name, {"from": f"{low:g}", "to": f"{high:g}"})
        elif isinstance(value, Sequence):
            etree.SubElement(element, name, _place(value))
        else:
            etree.SubElement(element, name, value=f"{value:g}")


def _place(values: Sequence[float]) -> dict[str, str]:
    """x, y, z [m] and, where it is given, yaw [rad] as attributes; yaw in degrees."""
    said = dict(zip(("x", "y", "z"), map(number, values[:3]), strict=True))
    if len(values) > 3 and values[3] is not None:
        said["yaw"] = number(float(np.degrees(values[3])) % 360.0)
    return said


def number(value: float) -> str:
    """To the millimetre, without trailing zeros."""
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
