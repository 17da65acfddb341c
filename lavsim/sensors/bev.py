"""The world from above in the ego's frame, layer by layer: LAV's labels, and more for datasets and RL."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.errors import SensorError, UnknownName
from lavsim.geometry import box_corners
from lavsim.random import Draws
from lavsim.render.plan import LINE_WIDTH, RESOLUTION, Plan, PlanBit, plan_of, stop_quad, warp_plan
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorConfig, attribute
from lavsim.types import LightState
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

cv2.setNumThreads(1)

Floats = NDArray[np.float64]
Layer = NDArray[np.uint8]

LAV_LAYERS = ("road", "vehicle", "pedestrian", "solid", "broken")
REACH = 40.0  # [m] vehicles farther away are left out, as LAV does
HAZARD_REACH = 20.0  # [m] of pedestrians
_SAME_LEVEL = 2.5  # [m] actors higher or lower lie on another road
_FRACTION = 4  # bits of sub-pixel positions
_LARGEST = 4096  # [px]
_MOST_PAST = 40
_LONGEST = 100  # [ticks] that a drive keeps


@dataclass(frozen=True)
class BevConfig(SensorConfig):
    """A picture from above with the ego's heading up. All fields are keys of the dict's "attributes".

    Attributes:
        layers: Names of `LAYERS`, parted by commas, in the order of the channels.
        width, height: [px].
        pixels_per_metre: Scale.
        ahead, right: Where the middle of the picture lies ahead and right of the ego [m].
        past: How many earlier moments of vehicles and pedestrians follow as channels, newest first.
        every: Ticks between them.
        route: Points (x, y) of the route [m] for the layer "route".
    """

    layers: str = attribute("layers", ",".join(LAV_LAYERS))
    width: int = attribute("width", 320)
    height: int = attribute("height", 320)
    pixels_per_metre: float = attribute("pixels_per_metre", 4.0)
    ahead: float = attribute("ahead", 30.0)
    right: float = attribute("right", 0.0)
    past: int = attribute("past", 0)
    every: int = attribute("every", 5)
    route: tuple[tuple[float, float], ...] = attribute("route", ())

    @classmethod
    def parse(cls, values: Mapping[str, Any]) -> Self:
        given = values.get("attributes", {})
        if not isinstance(given, Mapping) or "route" not in given:
            return super().parse(values)
        rest = {key: value for key, value in given.items() if key != "route"}
        return replace(super().parse({**values, "attributes": rest}), route=_route(values.get("id"), given["route"]))

    @property
    def names(self) -> tuple[str, ...]:
        """The layers asked for."""
        return tuple(name.strip() for name in self.layers.split(","))

    def problem(self) -> str | None:
        for key, value in (("width", self.width), ("height", self.height)):
            if not 1 <= value <= _LARGEST:
                return f"'{key}' must be 1 to {_LARGEST} pixels, got {value}"
        if not 0.1 <= self.pixels_per_metre <= 100.0:
            return f"'pixels_per_metre' must be 0.1 to 100, got {self.pixels_per_metre:g}"
        if not 0 <= self.past <= _MOST_PAST:
            return f"'past' must be 0 to {_MOST_PAST}, got {self.past}"
        if self.every < 1:
            return f"'every' must be at least 1 tick, got {self.every}"
        if self.past * self.every > _LONGEST:
            return f"'past' x 'every' must be at most {_LONGEST} ticks, got {self.past * self.every}"
        for name in self.names:
            if name not in LAYERS:
                return str(UnknownName("layer", name, LAYERS)).rstrip(".")
        return None


def _route(sensor: Any, points: Any) -> tuple[tuple[float, float], ...]:
    array = np.asarray(points, np.float64)
    if array.ndim != 2 or array.shape[1] < 2 or not np.isfinite(array).all():
        raise SensorError(f"sensor {sensor!r}: 'route' must be points (x, y), got an array of shape {array.shape}.")
    return tuple((float(x), float(y)) for x, y in array[:, :2])


@dataclass(frozen=True)
class _View:
    """One picture being drawn: its config, the plan under it, and the newest snapshot, whose ego gives the frame."""

    config: BevConfig
    town: TownMap
    plan: Plan
    cells: Layer
    now: Snapshot

    def pixels(self, points: Floats) -> Floats:
        """Column, row `(N, 2)` of world points `(N, 2)`; a pixel's corner is a whole number."""
        ego, c = self.now.ego, self.config
        offset = points - ego.xy
        ahead = offset @ np.array([math.cos(ego.yaw), math.sin(ego.yaw)])
        aside = offset @ np.array([-math.sin(ego.yaw), math.cos(ego.yaw)])
        return np.stack([ego_column(c) + aside * c.pixels_per_metre, ego_row(c) - ahead * c.pixels_per_metre], axis=1)

    def fixed(self, points: Floats) -> NDArray[np.int32]:
        """OpenCV's fixed-point coordinates of world points `(..., 2)`, which has whole numbers in pixels' middles."""
        at = np.rint((self.pixels(points.reshape(-1, 2)) - 0.5) * 2**_FRACTION)
        return np.clip(at, -(2**24), 2**24).astype(np.int32).reshape(points.shape)

    def blank(self) -> Layer:
        return np.zeros((self.config.height, self.config.width), np.uint8)


def ego_column(config: BevConfig) -> float:
    """Column of the ego's origin, the left edge of the picture being 0; 160 with LAV's values."""
    return config.width / 2.0 - config.right * config.pixels_per_metre


def ego_row(config: BevConfig) -> float:
    """Row of the ego's origin, the upper edge being 0; 280 with LAV's values."""
    return config.height / 2.0 + config.ahead * config.pixels_per_metre


def _bit(bit: PlanBit) -> Callable[[_View, Snapshot], Layer]:
    # A comparison is a byte of 0 or 1; its negative is 0 or 255.
    return lambda view, snapshot: -((view.cells & np.uint8(bit)) != 0).view(np.uint8)


def _limit(view: _View, snapshot: Snapshot) -> Layer:
    return view.plan.limits[view.cells >> 5]


def _boxes(view: _View, snapshot: Snapshot, chosen: NDArray[np.bool_]) -> Layer:
    layer = view.blank()
    sizes = snapshot.sizes[chosen].astype(np.float64)
    corners = box_corners(
        snapshot.xy[chosen, 0], snapshot.xy[chosen, 1], snapshot.yaw[chosen], sizes[:, 0], sizes[:, 1]
    )
    for polygon in view.fixed(corners):
        cv2.fillConvexPoly(layer, polygon, 255, cv2.LINE_8, _FRACTION)
    return layer


def _near(view: _View, snapshot: Snapshot, reach: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Offsets from the newest ego (N, 2) [m], and who is within `reach` of it and on its level."""
    offset = snapshot.xy - view.now.xy[0]
    level = np.abs(snapshot.xyz[:, 2] - view.now.xyz[0, 2]) < _SAME_LEVEL
    return offset, level & (np.sum(offset * offset, axis=1) <= reach * reach)


def _vehicles(view: _View, snapshot: Snapshot) -> Layer:
    return _boxes(view, snapshot, snapshot.is_vehicle & _near(view, snapshot, max(REACH, _span(view.config)))[1])


def _walkers(view: _View, snapshot: Snapshot) -> Layer:
    return _boxes(view, snapshot, snapshot.is_walker & _near(view, snapshot, max(REACH, _span(view.config)))[1])


def _span(config: BevConfig) -> float:
    """How far the picture's farthest corner is from the ego [m]."""
    return math.hypot(
        config.width / 2.0 / config.pixels_per_metre + abs(config.right),
        config.height / 2.0 / config.pixels_per_metre + abs(config.ahead),
    )


def _hazards(view: _View, snapshot: Snapshot) -> Layer:
    """Pedestrians on the road, near, and in a cone ahead that is wide close by; as discs a metre too wide.

    Source: LAV's recorder (reference `lav.md` 3.1).
    """
    layer = view.blank()
    offset, near = _near(view, snapshot, HAZARD_REACH)
    rows = np.flatnonzero(near & snapshot.is_walker)
    yaw = view.now.ego.yaw
    for k in rows.tolist():
        x, y = offset[k].tolist()
        distance = math.hypot(x, y)
        angle = abs(math.atan2(y * math.cos(yaw) - x * math.sin(yaw), x * math.cos(yaw) + y * math.sin(yaw)))
        widest = math.radians(162.0 / (min(max(distance, 1.5), 10.5) + 0.3))
        if angle > widest or not _on_road(view.plan, snapshot.xy[k]):
            continue
        radius = (float(snapshot.sizes[k, 0]) / 2.0 + 1.0) * view.config.pixels_per_metre
        centre = view.fixed(snapshot.xy[k]).tolist()
        cv2.circle(layer, centre, round(radius * 2**_FRACTION), 255, -1, cv2.LINE_8, _FRACTION)
    return layer


def _on_road(plan: Plan, point: Floats) -> bool:
    column, row = np.floor((point - plan.origin) / RESOLUTION).astype(int).tolist()
    inside = 0 <= row < plan.cells.shape[0] and 0 <= column < plan.cells.shape[1]
    return inside and bool(plan.cells[row, column] & PlanBit.ROAD)


def _lights(state: LightState) -> Callable[[_View, Snapshot], Layer]:
    def draw(view: _View, snapshot: Snapshot) -> Layer:
        layer = view.blank()
        light, quads = _stop_lines(view.town)
        if len(light):
            near = np.sum((quads[:, 0] - view.now.xy[0]) ** 2, axis=1) <= (_span(view.config) + 10.0) ** 2
            for polygon in view.fixed(quads[near & (snapshot.lights[light] == state)]):
                cv2.fillConvexPoly(layer, polygon, 255, cv2.LINE_8, _FRACTION)
        return layer

    return draw


@lru_cache(maxsize=4)
def _stop_lines(town: TownMap) -> tuple[NDArray[np.int64], Floats]:
    """Light (N,) and corners (N, 4, 2) of each stop line."""
    pairs = [(light.index, stop) for light in town.lights for stop in light.stop_lines]
    quads = [stop_quad(stop.x, stop.y, stop.yaw, stop.width) for _, stop in pairs]
    return np.array([index for index, _ in pairs], np.int64), np.array(quads, np.float64).reshape(-1, 4, 2)


def _draw_route(view: _View, snapshot: Snapshot) -> Layer:
    layer = view.blank()
    if len(view.config.route) > 1:
        width = max(1, round(2.0 * LINE_WIDTH * view.config.pixels_per_metre))
        line = view.fixed(np.array(view.config.route)).reshape(-1, 1, 2)
        cv2.polylines(layer, [line], False, 255, width, cv2.LINE_8, _FRACTION)
    return layer


LAYERS: dict[str, Callable[[_View, Snapshot], Layer]] = {
    "road": _bit(PlanBit.ROAD),
    "vehicle": _vehicles,
    "pedestrian": _hazards,
    "solid": _bit(PlanBit.SOLID),
    "broken": _bit(PlanBit.BROKEN),
    "walker": _walkers,
    "crosswalk": _bit(PlanBit.CROSSWALK),
    "stop": _bit(PlanBit.STOP),
    "red": _lights(LightState.RED),
    "yellow": _lights(LightState.YELLOW),
    "green": _lights(LightState.GREEN),
    "route": _draw_route,
    "limit": _limit,
}
_MOVING = ("vehicle", "pedestrian", "walker")


@SENSORS.register("sensor.lavsim.bev")
class Bev(Sensor):
    """(C, H, W) uint8: 255 where a layer is set; "limit" holds the road's speed limit [km/h].

    Row 0 is ahead and columns run to the right. The ego's origin lies at column `ego_column` and row `ego_row`, where
    0 is the outer edge of the first pixel: (160, 280) with the values of LAV's recorder, which are the defaults: 70 m
    ahead, 10 m behind, 40 m to each side. Mount keys are ignored.

    Channels are the layers, then for each of `past` earlier moments its moving layers (vehicle, pedestrian, walker as
    asked for) in today's frame; before the drive began they are empty.
    """

    config_type = BevConfig
    config: BevConfig
    privileged = True

    def __init__(self, config: BevConfig) -> None:
        super().__init__(config)
        self.history = config.past * config.every

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels; those of the past end in -1, -2, …"""
        names = self.config.names
        moving = [name for name in names if name in _MOVING]
        return (*names, *(f"{name}-{k}" for k in range(1, self.config.past + 1) for name in moving))

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((len(self.channels), self.config.height, self.config.width), np.uint8, "set, km/h", "npy")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> Layer:
        now, c = history[-1], self.config
        plan = _plan(scene.town)
        ego = now.ego
        cells = warp_plan(
            plan.cells, plan.origin[0], plan.origin[1], ego.x, ego.y, ego.yaw, c.pixels_per_metre, ego_column(c),
            ego_row(c), c.width, c.height,
        )  # fmt: skip
        view = _View(c, scene.town, plan, cells, now)
        out = np.zeros((len(self.channels), c.height, c.width), np.uint8)
        for channel, name in enumerate(c.names):
            out[channel] = LAYERS[name](view, now)
        channel = len(c.names)
        for k in range(1, c.past + 1):
            for name in (name for name in c.names if name in _MOVING):
                if k * c.every < len(history):
                    out[channel] = LAYERS[name](view, history[-1 - k * c.every])
                channel += 1
        return out


@lru_cache(maxsize=4)
def _plan(town: TownMap) -> Plan:
    return plan_of(town)
