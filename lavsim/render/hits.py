"""What a sweep's returns lie on: the class and the actor, and how squarely the beam met the surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.render.ground import TAG_OF_SURFACE, surface_at
from lavsim.render.heights import rise_at
from lavsim.render.solids import Material, Solids
from lavsim.render.terrain import Terrain
from lavsim.types import Tag

_DECK = int(Material.DECK)
_NONE = int(Tag.NONE)
_ON_TOP = 0.02  # [m] a return so close to a deck's top lies on its road


class Hits(NamedTuple):
    """One row a return.

    Attributes:
        cosine: (N,) float32, of the angle between the beam and the surface's normal, 0 to 1.
        instance: (N,) int32 actor id, 0 for the static world.
        tag: (N,) uint8 `Tag`.
    """

    cosine: NDArray[np.float32]
    instance: NDArray[np.int32]
    tag: NDArray[np.uint8]


def describe(
    points: NDArray[np.float64],
    solids: NDArray[np.int32],
    origin: NDArray[np.float64],
    statics: Solids,
    actors: Solids,
    terrain: Terrain,
) -> Hits:
    """What returns at world `points` (N, 3) of beams from `origin` lie on; `solids` (N,) are their `Sweep.solids`."""
    raster, deck = terrain.raster, terrain.deck_raster
    return Hits(
        *_describe(
            points, solids, origin, statics, actors, terrain.heights, raster.classes, raster.origin, deck.classes,
            deck.origin, 1.0 / raster.resolution, TAG_OF_SURFACE,
        )
    )  # fmt: skip


@kernel
def _describe(  # type: ignore[no-untyped-def]
    points, solids, origin, statics, actors, heights, classes, corner, deck, deck_corner, per_metre, tags
):
    count = len(points)
    cosine, instance, tag = np.empty(count, np.float32), np.zeros(count, np.int32), np.empty(count, np.uint8)
    normal = np.empty(3)
    for n in range(count):
        x, y, row = points[n, 0], points[n, 1], solids[n]
        if row < -1:
            cosine[n], tag[n] = 1.0, _NONE
            continue
        on_deck = False
        if row < 0:
            rise_x, rise_y = rise_at(heights, x, y)
            normal[0], normal[1], normal[2] = -rise_x, -rise_y, 1.0
            tag[n] = tags[surface_at(classes, (x - corner[0]) * per_metre, (y - corner[1]) * per_metre)]
        elif row < len(statics.corners):
            on_deck = _face_normal(statics, row, points[n], normal) and statics.material[row] == _DECK
            instance[n], tag[n] = statics.instance[row], statics.tag[row]
        else:
            row -= len(statics.corners)
            _face_normal(actors, row, points[n], normal)
            instance[n], tag[n] = actors.instance[row], actors.tag[row]
        if on_deck:
            tag[n] = tags[surface_at(deck, (x - deck_corner[0]) * per_metre, (y - deck_corner[1]) * per_metre)]
        along, square, size = 0.0, 0.0, 0.0
        for axis in range(3):
            step = points[n, axis] - origin[axis]
            along += step * normal[axis]
            square += step * step
            size += normal[axis] * normal[axis]
        cosine[n] = min(abs(along) / np.sqrt(max(square * size, 1e-18)), 1.0)
    return cosine, instance, tag


@kernel
def _face_normal(solids, k, point, normal):  # type: ignore[no-untyped-def]
    """Fills in the normal of the face of a solid nearest to `point`; True on its top."""
    tilt_x, tilt_y = solids.tilt[k, 0], solids.tilt[k, 1]
    lift = tilt_x * (point[0] - solids.centre[k, 0]) + tilt_y * (point[1] - solids.centre[k, 1])
    top, under = abs(solids.z1[k] + lift - point[2]), abs(solids.z0[k] + lift - point[2])
    nearest = min(top, under)
    normal[0], normal[1], normal[2] = -tilt_x, -tilt_y, 1.0
    is_top = top <= under and top < _ON_TOP
    for e in range(solids.corners[k]):
        f = e + 1 if e + 1 < solids.corners[k] else 0
        ax, ay = solids.xy[k, e, 0], solids.xy[k, e, 1]
        tx, ty = solids.xy[k, f, 0] - ax, solids.xy[k, f, 1] - ay
        length = max(np.sqrt(tx * tx + ty * ty), 1e-12)
        away = abs((point[0] - ax) * ty - (point[1] - ay) * tx) / length
        if away < nearest:
            nearest, is_top = away, False
            normal[0], normal[1], normal[2] = ty / length, -tx / length, 0.0
    return is_top
