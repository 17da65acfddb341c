"""Towns and moments from above, for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.geometry import box_corners, forward, right
from lavsim.render.canvas import Canvas
from lavsim.render.palette import EGO_BGR, INK_BGR, LIGHT_BGR, ROUTE_BGR, Bgr
from lavsim.render.scene import Scene, get_scene
from lavsim.render.solids import Solids
from lavsim.types import ActorClass, LightState, Tag
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

_NORTH_UP = -np.pi / 2.0
_FLAT = (Tag.BUILDING, Tag.WALL, Tag.FENCE, Tag.VEGETATION)


def draw_town(
    town: TownMap, width: int = 1200, route: ArrayLike | None = None, lights: Sequence[int] | None = None
) -> Canvas:
    """A whole town, north up.

    Args:
        town: The map.
        width: Of the picture [px].
        route: (R, 2 or 3) points to draw as a line.
        lights: State of each traffic light; none are drawn by default.
    """
    x0, y0, x1, y1 = (float(v) for v in town.bounds)
    margin = 10.0
    scale = width / (x1 - x0 + 2.0 * margin)
    size = (width, max(1, round((y1 - y0 + 2.0 * margin) * scale)))
    canvas = Canvas.facing((x0 + x1) / 2.0, (y0 + y1) / 2.0, _NORTH_UP, size, scale)
    scene = get_scene(town)
    _draw_terrain(canvas, scene)
    draw_solids(canvas, scene.statics)
    if route is not None:
        draw_route(canvas, route)
    if lights is not None:
        draw_lights(canvas, town, lights)
    return canvas


def draw_snapshot(
    scene: Scene,
    snapshot: Snapshot,
    size: tuple[int, int] = (640, 640),
    metres: float = 80.0,
    route: ArrayLike | None = None,
    ahead: float = 0.62,
) -> Canvas:
    """The ego and what is around it, its heading up.

    Args:
        scene: The town.
        snapshot: The moment.
        size: Width, height of the picture [px].
        metres: Width of the piece of world that is shown.
        route: (R, 2 or 3) points to draw as a line.
        ahead: Share of the height that lies ahead of the ego.
    """
    ego = snapshot.ego
    canvas = Canvas.facing(ego.x, ego.y, ego.yaw, size, size[0] / metres, ahead)
    _draw_terrain(canvas, scene)
    if route is not None:
        draw_route(canvas, route)
    draw_actors(canvas, snapshot)
    draw_solids(canvas, scene.statics)
    if scene.has_town:
        draw_lights(canvas, scene.town, snapshot.lights.tolist())
    return canvas


def _draw_terrain(canvas: Canvas, scene: Scene) -> None:
    canvas.draw_ground(scene.ground)
    if scene.terrain.decks is not None:
        canvas.draw_ground(scene.terrain.deck_raster, is_deck=True)


def draw_solids(canvas: Canvas, solids: Solids) -> None:
    """Footprints of what is large; higher ones over lower ones."""
    height, width = canvas.image.shape[:2]
    at = canvas.pixels(solids.centre)
    reach = solids.radius * canvas.scale
    near = (at[:, 0] > -reach) & (at[:, 0] < width + reach) & (at[:, 1] > -reach) & (at[:, 1] < height + reach)
    large = (np.isin(solids.tag, np.array(_FLAT, np.uint8)) | (reach > 1.0)) & (solids.tag != Tag.BRIDGE)
    for k in np.flatnonzero(near & large)[np.argsort(solids.z1[near & large], kind="stable")]:
        red, green, blue = (int(v) for v in solids.colour[k])
        paint: Bgr = (blue, green, red)
        edge: Bgr | None = (blue * 2 // 3, green * 2 // 3, red * 2 // 3) if solids.tag[k] == Tag.BUILDING else None
        canvas.fill(solids.xy[k, : solids.corners[k]], paint, edge)


def draw_route(canvas: Canvas, points: ArrayLike, colour: Bgr = ROUTE_BGR) -> None:
    """A route as a line."""
    canvas.outline(np.asarray(points, np.float64)[:, :2], colour, max(2, round(0.5 * canvas.scale)), closed=False)


def draw_lights(canvas: Canvas, town: TownMap, states: Sequence[int]) -> None:
    """Stop lines in the colour of their light, and a disc at each light."""
    for light in town.lights:
        state = states[light.index] if light.index < len(states) else LightState.UNKNOWN
        colour = LIGHT_BGR[state]
        for stop in light.stop_lines:
            aside = right(stop.yaw) * stop.width / 2.0
            point = np.array([stop.x, stop.y])
            canvas.outline([point - aside, point + aside], colour, max(2, round(0.4 * canvas.scale)), closed=False)
        canvas.disc((light.x, light.y), max(2.5, 0.6 * canvas.scale), colour, INK_BGR)


def draw_actors(canvas: Canvas, snapshot: Snapshot) -> None:
    """Boxes with a mark at the front; the ego in its own colour, walkers as discs."""
    corners = box_outlines(snapshot)
    colours = snapshot.table.colours[snapshot.rows]
    for i in reversed(range(len(corners))):
        red, green, blue = (int(v) for v in colours[i])
        paint: Bgr = EGO_BGR if i == 0 else (blue, green, red)
        if snapshot.classes[i] == ActorClass.WALKER:
            canvas.disc(snapshot.xy[i].tolist(), max(2.5, 0.45 * canvas.scale), paint, INK_BGR)
            continue
        canvas.fill(corners[i], paint, INK_BGR)
        if snapshot.is_vehicle[i]:
            tip = snapshot.xy[i] + forward(snapshot.yaw[i]) * snapshot.sizes[i, 0] * 0.42
            wings = corners[i, :2] * 0.5 + corners[i, 2:][::-1] * 0.5
            canvas.outline([wings[0], tip, wings[1]], INK_BGR, 1, closed=False)


def box_outlines(snapshot: Snapshot) -> NDArray[np.float64]:
    """(N, 4, 2) corners of all actors' boxes [m]: front left, front right, rear right, rear left."""
    sizes = snapshot.sizes.astype(np.float64)
    return box_corners(snapshot.xy[:, 0], snapshot.xy[:, 1], snapshot.yaw, sizes[:, 0], sizes[:, 1])
