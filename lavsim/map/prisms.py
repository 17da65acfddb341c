"""Static solids of a town: convex prisms, the one shape that sensors and contacts know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

MAX_VERTICES = 8


@dataclass(frozen=True)
class Prisms:
    """Upright prisms over convex footprints, one row a prism.

    Attributes:
        vertices: (K, 8, 2) float64 world x, y [m] around a convex polygon; unused slots repeat the last vertex.
        count: (K,) int32 number of vertices used, 3 to 8.
        z0: (K,) float64 height of the underside [m].
        z1: (K,) float64 height of the top [m].
        tag: (K,) uint8 `lavsim.types.Tag`.
        colour: (K, 3) uint8 red, green, blue.
        instance: (K,) int32; 0 static world, otherwise the actor's id.
        solid: (K,) bool; vehicles collide with it.
        light: (K,) int32 index of the traffic light it belongs to, or -1.
        lamp: (K,) int8 0 red, 1 yellow, 2 green lamp of that light, or -1.
    """

    vertices: NDArray[np.float64]
    count: NDArray[np.int32]
    z0: NDArray[np.float64]
    z1: NDArray[np.float64]
    tag: NDArray[np.uint8]
    colour: NDArray[np.uint8]
    instance: NDArray[np.int32]
    solid: NDArray[np.bool_]
    light: NDArray[np.int32]
    lamp: NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.count)

    @staticmethod
    def empty() -> Prisms:
        return Prisms(
            np.zeros((0, MAX_VERTICES, 2)),
            np.zeros(0, np.int32),
            np.zeros(0),
            np.zeros(0),
            np.zeros(0, np.uint8),
            np.zeros((0, 3), np.uint8),
            np.zeros(0, np.int32),
            np.zeros(0, np.bool_),
            np.zeros(0, np.int32),
            np.zeros(0, np.int8),
        )

    @staticmethod
    def concatenate(parts: Sequence[Prisms]) -> Prisms:
        """The prisms of all `parts`, in order."""
        if not parts:
            return Prisms.empty()
        return Prisms(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Prisms)))
