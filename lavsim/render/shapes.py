"""What actors look like: a few boxes each, in the actor's own frame, by class and blueprint.

Boxes fill the actor's bounding box, so LiDAR returns and image tags agree with the labels. Vehicles leave a gap
between their wheels, as the beams of a real sensor find it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from lavsim.render.solids import Material
from lavsim.types import ActorClass, Tag

Colour = tuple[int, int, int]

GAIT_UNIT = 2.0 * math.pi / 256.0  # [rad] of a snapshot's gait phase

BLACK: Colour = (22, 22, 24)
GREY: Colour = (110, 112, 115)
WHITE: Colour = (225, 225, 222)
ORANGE: Colour = (230, 95, 20)
SKINS: tuple[Colour, ...] = ((226, 184, 152), (198, 146, 108), (141, 93, 62), (94, 62, 44))
TROUSERS: tuple[Colour, ...] = ((38, 45, 70), (52, 50, 48), (96, 84, 66), (28, 30, 34), (70, 78, 92))


@dataclass(frozen=True)
class Part:
    """One box of a shape.

    Attributes:
        x, y: Centre, ahead and right of the actor's origin [m].
        length, width: [m].
        z0, z1: Underside and top above the actor's ground [m].
        colour: Red, green, blue.
        material: How its faces are painted.
        tag: What cameras call it.
        door: Bit of the snapshot's open doors with which it is there; 0 always.
        swing: How far it goes ahead and back with a walker's gait [m].
    """

    x: float
    y: float
    length: float
    width: float
    z0: float
    z1: float
    colour: Colour
    material: Material = Material.PLAIN
    tag: Tag = Tag.VEHICLE
    door: int = 0
    swing: float = 0.0

    def is_there(self, doors: int) -> bool:
        """Whether it shows with these doors open."""
        return not self.door or bool(self.door & doors)

    def ahead(self, gait: int) -> float:
        """Where its centre is ahead of the actor's origin in a phase of the gait (2^-8 step) [m]."""
        return self.x + self.swing * math.sin(gait * GAIT_UNIT)


@dataclass(frozen=True)
class Look:
    """What a shape is made from: box [m], paint, blueprint name, and the actor's id for small differences."""

    length: float
    width: float
    height: float
    colour: Colour
    blueprint: str
    id: int


@lru_cache(maxsize=4096)
def parts_of(actor_class: int, look: Look) -> tuple[Part, ...]:
    """The boxes of an actor."""
    return _BUILDERS[ActorClass(actor_class)](look)


def _axles(a: Look, at: float, diameter: float, clearance: float) -> tuple[Part, Part]:
    """Wheels with the axle between them, at `at` of the length ahead and behind."""
    length = min(diameter, 0.25 * a.length)
    return (
        Part(at * a.length, 0.0, length, 0.96 * a.width, 0.0, clearance, BLACK, Material.TYRE),
        Part(-at * a.length, 0.0, length, 0.96 * a.width, 0.0, clearance, BLACK, Material.TYRE),
    )


DOOR_WIDTH, DOOR_THICKNESS = 0.95, 0.1  # [m] how far an open door stands out


def _doors(a: Look, hinges: tuple[float, float], low: float, high: float) -> tuple[Part, ...]:
    """Front left, front right, rear left, rear right door, wide open; hinges at shares of the length ahead."""
    reach = (a.width + DOOR_WIDTH) / 2.0
    return tuple(
        Part(hinges[k // 2] * a.length, reach * (1 if k % 2 else -1), DOOR_THICKNESS, DOOR_WIDTH, low, high, a.colour,
             door=1 << k)
        for k in range(4)
    )  # fmt: skip


_COMPACT = ("micra", "cooper", "leon", "microlino", "isetta", "a2", "c3")
_HIGH = ("patrol", "cybertruck", "grandtourer", "jeep")


def _car(a: Look) -> tuple[Part, ...]:
    """A body to the waistline and a cabin; hatchbacks' and off-roaders' cabins reach the rear."""
    compact, high = any(n in a.blueprint for n in _COMPACT), any(n in a.blueprint for n in _HIGH)
    clearance = 0.28 if high else 0.2
    waist = (0.6 if high else 0.56) * a.height
    share, shift = (0.66, -0.14) if compact or high else (0.46, -0.03)
    return (
        Part(0.0, 0.0, a.length, a.width, clearance, waist, a.colour, Material.BODY),
        Part(shift * a.length, 0.0, share * a.length, 0.76 * a.width, waist, a.height, a.colour, Material.GLASS),
        *_axles(a, 0.3, 0.65, clearance),
        *_doors(a, (0.16, -0.06), clearance + 0.1, 0.9 * a.height),
    )


def _van(a: Look) -> tuple[Part, ...]:
    """A short bonnet, a glazed cab, and a box behind it."""
    waist = 0.45 * a.height
    glazed = "t2" in a.blueprint
    box = Material.GLASS if glazed else Material.PLAIN
    return (
        Part(0.0, 0.0, a.length, a.width, 0.28, waist, a.colour, Material.BODY),
        Part(0.28 * a.length, 0.0, 0.28 * a.length, 0.92 * a.width, waist, 0.96 * a.height, a.colour, Material.GLASS),
        Part(-0.18 * a.length, 0.0, 0.64 * a.length, 0.96 * a.width, waist, a.height, a.colour, box),
        *_axles(a, 0.31, 0.7, 0.28),
        *_doors(a, (0.3, 0.1), 0.4, 0.9 * a.height),
    )


def _truck(a: Look) -> tuple[Part, ...]:
    cab, load = 0.26 * a.length, 0.70 * a.length
    front = (a.length - cab) / 2.0
    top = 0.82 * a.height
    return (
        Part(0.0, 0.0, a.length, 0.9 * a.width, 0.45, 0.95, GREY, Material.BODY),
        Part(front, 0.0, cab, a.width, 0.4, 0.5 * top, a.colour, Material.BODY),
        Part(front - 0.02, 0.0, cab - 0.04, 0.98 * a.width, 0.5 * top, top, a.colour, Material.GLASS),
        Part(-(a.length - load) / 2.0, 0.0, load, a.width, 0.95, a.height, WHITE),
        *_axles(a, 0.33, 1.0, 0.45),
        *_doors(a, (0.44, 0.26), 0.5, 0.9 * top)[:2],
    )


def _bus(a: Look) -> tuple[Part, ...]:
    return (
        Part(0.0, 0.0, a.length, a.width, 0.35, 0.38 * a.height, a.colour, Material.BODY),
        Part(0.0, 0.0, a.length, 0.98 * a.width, 0.38 * a.height, 0.82 * a.height, a.colour, Material.GLASS),
        Part(0.0, 0.0, a.length, a.width, 0.82 * a.height, a.height, a.colour),
        *_axles(a, 0.3, 1.0, 0.35),
    )


def _rider(a: Look, seat: float, lean: float) -> tuple[Part, ...]:
    """A seated human from `seat` height to the top of the box."""
    span = a.height - seat
    shirt = TROUSERS[(a.id + 2) % len(TROUSERS)]
    return (
        Part(0.0, 0.0, 0.34, 0.36, 0.55 * seat, seat + 0.1, TROUSERS[a.id % len(TROUSERS)], tag=Tag.PEDESTRIAN),
        Part(lean, 0.0, 0.28, 0.44, seat + 0.1, seat + 0.68 * span, shirt, tag=Tag.PEDESTRIAN),
        Part(lean + 0.06, 0.0, 0.22, 0.2, seat + 0.7 * span, a.height, SKINS[a.id % 4], tag=Tag.PEDESTRIAN),
    )


def _motorcycle(a: Look) -> tuple[Part, ...]:
    wheel = 0.28 * a.length
    reach = (a.length - wheel) / 2.0
    return (
        Part(reach, 0.0, wheel, 0.14, 0.0, wheel, BLACK, Material.TYRE),
        Part(-reach, 0.0, wheel, 0.18, 0.0, wheel, BLACK, Material.TYRE),
        Part(0.0, 0.0, 0.9 * a.length, 0.3, 0.3, 0.72, a.colour, Material.BODY),
        Part(0.25 * a.length, 0.0, 0.1, a.width, 0.92, 0.98, GREY),
        *_rider(a, 0.75, 0.0),
    )


def _bicycle(a: Look) -> tuple[Part, ...]:
    wheel = 0.38 * a.length
    reach = (a.length - wheel) / 2.0
    return (
        Part(reach, 0.0, wheel, 0.06, 0.0, wheel, BLACK, Material.TYRE),
        Part(-reach, 0.0, wheel, 0.06, 0.0, wheel, BLACK, Material.TYRE),
        Part(0.0, 0.0, 0.6 * a.length, 0.08, 0.45, 0.8, a.colour),
        Part(0.28 * a.length, 0.0, 0.08, a.width, 0.92, 1.02, GREY),
        *_rider(a, 0.85, 0.08),
    )


STRIDE = 0.2  # [m] how far a foot goes ahead of the hip
LEG_GAP = 0.04  # [m]


def _walker(a: Look) -> tuple[Part, ...]:
    """Two legs that walk, torso and head; the head is narrower, the torso as wide as the box."""
    hip, neck = 0.47 * a.height, 0.84 * a.height
    leg = (0.7 * a.width - LEG_GAP) / 2.0
    side, stride = (leg + LEG_GAP) / 2.0, STRIDE * a.height / 1.8
    trousers = TROUSERS[a.id % len(TROUSERS)]
    return (
        Part(0.0, -side, 0.6 * a.length, leg, 0.0, hip, trousers, tag=Tag.PEDESTRIAN, swing=stride),
        Part(0.0, side, 0.6 * a.length, leg, 0.0, hip, trousers, tag=Tag.PEDESTRIAN, swing=-stride),
        Part(0.0, 0.0, 0.66 * a.length, a.width, hip, neck, a.colour, tag=Tag.PEDESTRIAN),
        Part(0.02, 0.0, 0.5 * a.length, 0.45 * a.width, neck, a.height, SKINS[a.id % 4], tag=Tag.PEDESTRIAN),
    )


def _cone(a: Look) -> tuple[Part, ...]:
    layers = ((1.0, 0.0, 0.08, ORANGE), (0.6, 0.08, 0.38, ORANGE), (0.42, 0.38, 0.6, WHITE), (0.25, 0.6, 1.0, ORANGE))
    return tuple(
        Part(0.0, 0.0, s * a.length, s * a.width, z0 * a.height, z1 * a.height, c, tag=Tag.DYNAMIC)
        for s, z0, z1, c in layers
    )


def _shelter(a: Look) -> tuple[Part, ...]:
    """A bus stop: roof, back wall and two posts."""
    end, back = 0.47 * a.length, 0.46 * a.width
    return (
        Part(0.0, 0.0, a.length, a.width, 0.94 * a.height, a.height, GREY, tag=Tag.DYNAMIC),
        Part(0.0, back, a.length, 0.06 * a.width, 0.2, 0.94 * a.height, (120, 140, 150), tag=Tag.DYNAMIC),
        Part(end, -back, 0.1, 0.1, 0.0, 0.94 * a.height, GREY, tag=Tag.DYNAMIC),
        Part(-end, -back, 0.1, 0.1, 0.0, 0.94 * a.height, GREY, tag=Tag.DYNAMIC),
    )


def _barrier(a: Look) -> tuple[Part, ...]:
    foot = 0.4 * a.length
    return (
        Part(0.0, 0.0, a.length, 0.3 * a.width, 0.55 * a.height, a.height, ORANGE, tag=Tag.DYNAMIC),
        Part(foot, 0.0, 0.1, a.width, 0.0, 0.55 * a.height, WHITE, tag=Tag.DYNAMIC),
        Part(-foot, 0.0, 0.1, a.width, 0.0, 0.55 * a.height, WHITE, tag=Tag.DYNAMIC),
    )


def _panel(a: Look) -> tuple[Part, ...]:
    """An advertisement: a lit panel on a foot."""
    return (
        Part(0.0, 0.0, 0.5 * a.length, 0.6 * a.width, 0.0, 0.25 * a.height, GREY, tag=Tag.DYNAMIC),
        Part(0.0, 0.0, a.length, a.width, 0.25 * a.height, a.height, a.colour, Material.POSTER, Tag.DYNAMIC),
    )


def _crate(a: Look, material: Material = Material.PLAIN) -> tuple[Part, ...]:
    return (Part(0.0, 0.0, a.length, a.width, 0.0, a.height, a.colour, material, Tag.DYNAMIC),)


_PROPS: tuple[tuple[str, Callable[[Look], tuple[Part, ...]]], ...] = (
    ("cone", _cone),
    ("busstop", _shelter),
    ("barrier", _barrier),
    ("advertisement", _panel),
    ("vending", lambda a: _crate(a, Material.POSTER)),
)


def _prop(a: Look) -> tuple[Part, ...]:
    for name, build in _PROPS:
        if name in a.blueprint:
            return build(a)
    return _crate(a)


_BUILDERS: dict[ActorClass, Callable[[Look], tuple[Part, ...]]] = {
    ActorClass.CAR: _car,
    ActorClass.VAN: _van,
    ActorClass.TRUCK: _truck,
    ActorClass.BUS: _bus,
    ActorClass.MOTORCYCLE: _motorcycle,
    ActorClass.BICYCLE: _bicycle,
    ActorClass.WALKER: _walker,
    ActorClass.PROP: _prop,
}
