"""Route files of both generations: 1.0 (waypoints in the route) and 2.x (hazards and weather keyframes inside).

Stray text, comments and unknown elements between the known ones are ignored. A mistake is a `RouteError` that names
file and line.
"""

from __future__ import annotations

import importlib.resources
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from lavsim.errors import RouteError, UnknownName
from lavsim.scenarios.base import GENERATIONS, ScenarioSpec
from lavsim.traffic.profiles import TRAFFIC_PROFILES
from lavsim.world.weather import Weather, WeatherKeyframe

log = logging.getLogger(__name__)


_WEATHER_1 = Weather(sun_altitude_angle=70.0, cloudiness=30.0)
_WEATHER_2 = Weather(sun_altitude_angle=70.0, cloudiness=50.0)
_WEATHER_NAMES = tuple(f.name for f in fields(Weather))


@dataclass(frozen=True)
class RouteEntry:
    """One route of a file.

    Attributes:
        id: As the file has it.
        town: Name of its town.
        keypoints: (K, 3) float64 waypoints [m].
        weather: Keyframes by share of the route, at least one.
        scenarios: Hazards in file order.
        generation: Shape of its element, "1.0" or "2.x".
        traffic: Its own or the file's traffic profile; None: the rules' own.
        file: Name of the file, without folders.
        line: Where the route starts in it.
    """

    id: str
    town: str
    keypoints: NDArray[np.float64]
    weather: tuple[WeatherKeyframe, ...]
    scenarios: tuple[ScenarioSpec, ...]
    generation: Literal["1.0", "2.x"]
    traffic: str | None
    file: str
    line: int

    @property
    def source(self) -> str:
        """For messages: "devtest.xml, route 3"."""
        return f"{self.file}, route {self.id}"

    @property
    def length(self) -> float:
        """Length of the straight lines through the waypoints, in 3D [m]."""
        return float(np.linalg.norm(np.diff(self.keypoints, axis=0), axis=1).sum())

    def to_json(self) -> dict[str, Any]:
        """The route's content in JSON types: what a digest of it is made of."""
        return {
            "id": self.id,
            "town": self.town,
            "keypoints": self.keypoints.tolist(),
            "weather": [[frame.percentage, *frame.weather.to_array().tolist()] for frame in self.weather],
            "scenarios": [[s.name, s.type, s.generation, list(s.trigger), dict(s.parameters)] for s in self.scenarios],
        }


def route_files() -> list[str]:
    """Names of the packaged route files."""
    names = (entry.name for entry in importlib.resources.files("routes").iterdir())
    return sorted(name.removesuffix(".xml") for name in names if name.endswith(".xml"))


def read_routes(source: str | Path) -> list[RouteEntry]:
    """The routes of a packaged file ("devtest") or of the file at a path, in file order.

    Args:
        source: Name or path. What has a folder or the ending .xml is a path.

    Raises:
        UnknownName: no packaged route file has this name.
        RouteError: the file can't be read, or is not a route file.
    """
    name, shown, data = _load(source)
    root = _parse(data, shown)
    if root.tag != "routes":
        raise RouteError(f"{shown}, line {root.sourceline}: expected <routes>, got <{root.tag}>")
    traffic = root.get("traffic")
    entries = [_RouteReader(element, name, shown).read(traffic) for element in _children(root, "route")]
    if not entries:
        raise RouteError(f"{shown}: no <route> in it")
    seen: dict[str, int] = {}
    for entry in entries:
        if entry.id in seen:
            raise RouteError(f"{shown}, line {entry.line}: route id {entry.id!r} stands on line {seen[entry.id]} too")
        seen[entry.id] = entry.line
    return entries


def select_routes(entries: Sequence[RouteEntry], ids: str | None) -> list[RouteEntry]:
    """The entries named by `ids`: ids and ranges with commas ("0,3-5"), ranges by file order; None: all.

    Raises:
        RouteError: an id that no route has, or that is named twice.
    """
    if ids is None:
        return list(entries)
    position = {entry.id: index for index, entry in enumerate(entries)}

    def find(name: str) -> int:
        if name not in position:
            known = ", ".join(list(position)[:40]) + (", …" if len(position) > 40 else "")
            raise RouteError(f"no route {name!r} in {entries[0].file}: it has {known}")
        return position[name]

    chosen: list[int] = []
    for part in (p.strip() for p in ids.split(",")):
        first, dash, last = part.partition("-")
        if part in position or not dash:
            picked = [find(part)]
        else:
            picked = list(range(find(first.strip()), find(last.strip()) + 1))
            if not picked:
                raise RouteError(f"routes {part!r}: {last.strip()} comes before {first.strip()} in {entries[0].file}")
        for index in picked:
            if index in chosen:
                raise RouteError(f"route {entries[index].id!r} is named twice in {ids!r}")
            chosen.append(index)
    return [entries[index] for index in sorted(chosen)]


def _load(source: str | Path) -> tuple[str, str, bytes]:
    """File name, name for messages, content."""
    text = str(source)
    path = Path(text)
    is_path = isinstance(source, Path) or path.suffix == ".xml" or path.name != text
    if not is_path:
        if text not in route_files():
            raise UnknownName("route file", text, route_files())
        return f"{text}.xml", f"{text}.xml", (importlib.resources.files("routes") / f"{text}.xml").read_bytes()
    try:
        return path.name, text, path.read_bytes()
    except FileNotFoundError:
        raise RouteError(f"no route file {text}") from None
    except OSError as error:
        raise RouteError(f"can't read route file {text}: {error.strerror}") from None


def _parse(data: bytes, shown: str) -> etree._Element:
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    try:
        return etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise RouteError(f"{shown}, line {error.lineno or 1}: not well-formed XML: {error.msg}") from None


def _children(element: etree._Element, *tags: str) -> Iterator[etree._Element]:
    return (child for child in element if isinstance(child.tag, str) and (not tags or child.tag in tags))


def _first(element: etree._Element, tag: str) -> etree._Element | None:
    return next(_children(element, tag), None)


class _RouteReader:
    """Reads one <route>, with messages that say where."""

    def __init__(self, element: etree._Element, name: str, shown: str) -> None:
        self.element, self.name, self.shown = element, name, shown

    def read(self, traffic: str | None) -> RouteEntry:
        route_id, town = self._text(self.element, "id"), self._text(self.element, "town")
        traffic = self.element.get("traffic", traffic)
        if traffic is not None and traffic not in TRAFFIC_PROFILES:
            raise UnknownName("traffic profile", traffic, TRAFFIC_PROFILES)
        group = _first(self.element, "waypoints")
        generation: Literal["1.0", "2.x"] = "1.0" if group is None else "2.x"
        points = _children(self.element, "waypoint") if group is None else _children(group, "position")
        keypoints = np.array([self._point(p) for p in points], np.float64).reshape(-1, 3)
        if len(keypoints) < 2:
            raise self._error(self.element, f"route {route_id}: two waypoints or more expected, got {len(keypoints)}")
        return RouteEntry(
            id=route_id,
            town=town,
            keypoints=keypoints,
            weather=self._keyframes(),
            scenarios=tuple(self._scenarios()),
            generation=generation,
            traffic=traffic,
            file=self.name,
            line=self._line(self.element),
        )

    def _keyframes(self) -> tuple[WeatherKeyframe, ...]:
        group, single = _first(self.element, "weathers"), _first(self.element, "weather")
        if group is None:
            weather = _WEATHER_1 if single is None else self._weather(single, _WEATHER_1)
            if single is None and _first(self.element, "waypoints") is not None:
                weather = _WEATHER_2
            return (WeatherKeyframe(0.0, weather),)
        frames = [
            WeatherKeyframe(self._number(w, "route_percentage", 0.0), self._weather(w, _WEATHER_2))
            for w in _children(group, "weather")
        ]
        return tuple(sorted(frames, key=lambda f: f.percentage)) or (WeatherKeyframe(0.0, _WEATHER_2),)

    def _weather(self, element: etree._Element, base: Weather) -> Weather:
        values = {}
        for key in map(str, element.attrib):
            if key in _WEATHER_NAMES:
                values[key] = self._number(element, key)
            elif key != "route_percentage":
                log.warning("%s, line %d: unknown weather attribute %r", self.shown, self._line(element), key)
        return replace(base, **values)

    def _scenarios(self) -> Iterator[ScenarioSpec]:
        group = _first(self.element, "scenarios")
        for element in _children(group, "scenario") if group is not None else ():
            trigger = _first(element, "trigger_point")
            if trigger is None:
                raise self._error(element, f"scenario {element.get('name')!r} has no <trigger_point>")
            kind, generation = self._text(element, "type"), element.get("generation", "2.x")
            if generation not in GENERATIONS:
                known = " or ".join(GENERATIONS)
                raise self._error(element, f"generation of a scenario must be {known}, got {generation!r}")
            yield ScenarioSpec(
                name=element.get("name") or kind,
                type=kind,
                generation=generation,
                trigger=(*self._point(trigger), math.radians(self._number(trigger, "yaw", 0.0))),
                parameters=self._parameters(element),
            )

    def _parameters(self, element: etree._Element) -> dict[str, Any]:
        """Element name to what it holds: a number or text (value), an interval (from, to), a place (x, y, z[, yaw])."""
        parameters: dict[str, Any] = {}
        for child in _children(element):
            name = str(child.tag)
            if name == "trigger_point":
                continue
            if name == "other_actor":
                actor: dict[str, Any] = {"position": self._point(child), "model": child.get("model")}
                actor["yaw"] = math.radians(self._number(child, "yaw", 0.0))
                parameters.setdefault("other_actors", []).append(actor)
            elif "value" in child.attrib:
                parameters[name] = _number_or_text(str(child.get("value")))
            elif "from" in child.attrib:
                parameters[name] = (self._number(child, "from"), self._number(child, "to"))
            elif "x" in child.attrib:
                yaw = (math.radians(self._number(child, "yaw")),) if "yaw" in child.attrib else ()
                parameters[name] = (*self._point(child), *yaw)
            else:
                log.warning("%s, line %d: <%s> says nothing", self.shown, self._line(child), name)
        return parameters

    def _point(self, element: etree._Element) -> tuple[float, float, float]:
        return self._number(element, "x"), self._number(element, "y"), self._number(element, "z", 0.0)

    def _number(self, element: etree._Element, key: str, default: float | None = None) -> float:
        text = element.get(key)
        if text is None and default is not None:
            return default
        try:
            value = float(self._text(element, key))
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self._error(element, f"<{element.tag}> {key}={text!r} is not a number")
        return value

    def _text(self, element: etree._Element, key: str) -> str:
        text = element.get(key)
        if not text:
            raise self._error(element, f"<{element.tag}> has no {key}")
        return str(text)

    def _error(self, element: etree._Element, message: str) -> RouteError:
        return RouteError(f"{self.shown}, line {self._line(element)}: {message}")

    @staticmethod
    def _line(element: etree._Element) -> int:
        line = element.sourceline
        return line if isinstance(line, int) else 0


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
