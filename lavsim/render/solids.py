"""What the casting kernels read: prisms as plain arrays, statics and actors alike."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.map.prisms import MAX_VERTICES, Prisms
from lavsim.types import Tag


class Material(IntEnum):
    """How a solid's faces are painted; geometry and tags do not depend on it."""

    PLAIN = 0
    WALL = 1  # storeys of windows on the sides
    FOLIAGE = 2
    LAMP = 3  # a traffic light's lamp: bright while lit
    BODY = 4  # a vehicle: lamps and plates at front and rear, by side of the footprint
    GLASS = 5  # a cabin: windows on the sides, paint on the roof
    TYRE = 6
    POSTER = 7  # a lit front, as of a vending machine
    DECK = 8  # of a bridge: its top shows the road on it


class Solids(NamedTuple):
    """Convex upright prisms, one row a prism.

    Footprints turn from +x towards +y (positive shoelace area), so `(ey, -ex)` points out of edge `(ex, ey)`. A
    vehicle's footprint starts at its front left, so edges 0 to 3 are front, right, rear, left.

    Tops and undersides are parallel planes that may slope, as a deck or a car on a ramp does; sides stay upright.

    Attributes:
        xy: (K, 8, 2) float64 world footprints [m]; slots from `corners` on are unused.
        corners: (K,) int32 vertices used.
        z0, z1: (K,) float64 underside and top at `centre` [m].
        centre: (K, 2) float64 of a circle around the footprint [m].
        radius: (K,) float64 of that circle [m].
        tag: (K,) uint8 `Tag`.
        material: (K,) uint8 `Material`.
        colour: (K, 3) float32 red, green, blue, 0 to 255.
        instance: (K,) int32 actor id, 0 static.
        light: (K,) int32 traffic light it belongs to, -1 none.
        state: (K,) int32: a lamp's state in which it is lit (-1 none) on statics, `VehicleLight` bits on vehicles.
        tilt: (K, 2) float64 rise of underside and top along x and y.
    """

    xy: NDArray[np.float64]
    corners: NDArray[np.int32]
    z0: NDArray[np.float64]
    z1: NDArray[np.float64]
    centre: NDArray[np.float64]
    radius: NDArray[np.float64]
    tag: NDArray[np.uint8]
    material: NDArray[np.uint8]
    colour: NDArray[np.float32]
    instance: NDArray[np.int32]
    light: NDArray[np.int32]
    state: NDArray[np.int32]
    tilt: NDArray[np.float64]


_MATERIAL_OF_TAG = np.zeros(256, np.uint8)
_MATERIAL_OF_TAG[Tag.BUILDING] = Material.WALL
_MATERIAL_OF_TAG[Tag.VEGETATION] = Material.FOLIAGE


def solids_of(prisms: Prisms) -> Solids:
    """The statics of a town as the kernels take them."""
    xy, count = _turned(prisms.vertices, prisms.count)
    inside = np.arange(MAX_VERTICES)[None, :] < count[:, None]
    low = np.where(inside[..., None], xy, np.inf).min(axis=1, initial=np.inf)
    high = np.where(inside[..., None], xy, -np.inf).max(axis=1, initial=-np.inf)
    centre = (low + high) / 2.0
    reach = np.where(inside, np.hypot(xy[..., 0] - centre[:, None, 0], xy[..., 1] - centre[:, None, 1]), 0.0)
    material = _MATERIAL_OF_TAG[prisms.tag]
    material[prisms.lamp >= 0] = Material.LAMP
    return Solids(
        xy=np.ascontiguousarray(xy, np.float64),
        corners=count.astype(np.int32),
        z0=prisms.z0.astype(np.float64),
        z1=prisms.z1.astype(np.float64),
        centre=np.ascontiguousarray(centre, np.float64),
        radius=reach.max(axis=1, initial=0.0),
        tag=prisms.tag.astype(np.uint8),
        material=material,
        colour=prisms.colour.astype(np.float32),
        instance=prisms.instance.astype(np.int32),
        light=prisms.light.astype(np.int32),
        state=prisms.lamp.astype(np.int32),
        tilt=np.zeros((len(count), 2)),
    )


def joined(parts: Sequence[Solids]) -> Solids:
    """All solids of `parts`, in order."""
    return Solids(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def slabs(
    quads: NDArray[np.float64],
    depth: float,
    tag: Tag,
    colour: tuple[int, int, int],
    material: Material = Material.DECK,
) -> Solids:
    """Slabs whose tops are the planes through `quads` (N, 4, 3) that fit them best, `depth` [m] thick."""
    count = len(quads)
    vertices = np.concatenate([quads[..., :2], np.repeat(quads[:, -1:, :2], MAX_VERTICES - 4, axis=1)], axis=1)
    xy, corners = _turned(vertices, np.full(count, 4, np.int32))
    centre = (quads[..., :2].min(axis=1) + quads[..., :2].max(axis=1)) / 2.0
    offset = quads[..., :2] - centre[:, None]
    system = np.concatenate([offset, np.ones((count, 4, 1))], axis=2)
    plane = np.linalg.pinv(system) @ quads[..., 2:]
    top, one = plane[:, 2, 0], np.ones(count, np.int32)
    return Solids(
        xy=np.ascontiguousarray(xy),
        corners=corners,
        z0=top - depth,
        z1=top,
        centre=centre,
        radius=np.hypot(offset[..., 0], offset[..., 1]).max(axis=1),
        tag=np.full(count, tag, np.uint8),
        material=np.full(count, material, np.uint8),
        colour=np.tile(np.array(colour, np.float32), (count, 1)),
        instance=0 * one,
        light=-one,
        state=-one,
        tilt=np.ascontiguousarray(plane[:, :2, 0]),
    )


def _turned(vertices: NDArray[np.float64], count: NDArray[np.int32]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Footprints with their vertices in the order of positive area."""
    x, y = vertices[..., 0], vertices[..., 1]  # unused slots repeat the last vertex and add no area
    area = np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)
    slot = np.arange(MAX_VERTICES)[None, :]
    backward = np.where(slot < count[:, None], count[:, None] - 1 - slot, 0)
    order = np.where((area < 0.0)[:, None], backward, np.minimum(slot, count[:, None] - 1))
    return np.take_along_axis(vertices, order[..., None], axis=1), count
