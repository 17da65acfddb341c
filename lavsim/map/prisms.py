"""Solids as upright prisms: a convex footprint between two heights. Scenery, actors and lights are lists of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lavsim.portable_math import snapped

MAX_VERTICES = 8


@dataclass(frozen=True)
class Prisms:
    """K upright prisms.

    Attributes:
        vertices: (K, 8, 2) float64, corners of the convex footprint in the world frame [m], in either sense; unused
            slots repeat the last corner.
        count: (K,) int32, corners in use, 3 to 8.
        z0: (K,) float64, bottom [m].
        z1: (K,) float64, top [m].
        tag: (K,) uint8, `Tag`.
        colour: (K, 3) uint8, red, green, blue.
        instance: (K,) int32, 0 for the static world, else the actor's id.
        solid: (K,) bool, vehicles collide with it.
        light: (K,) int32, traffic light the prism belongs to, or -1.
        lamp: (K,) int8, 0 red, 1 yellow, 2 green for a lamp of that light, else -1.
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

    def select(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> Prisms:
        """The prisms of `rows` (indices or mask)."""
        return Prisms(*(getattr(self, f.name)[rows] for f in fields(self)))

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
    def concatenate(parts: Iterable[Prisms]) -> Prisms:
        """All prisms of `parts`, in order."""
        parts = list(parts)
        if not parts:
            return Prisms.empty()
        return Prisms(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Prisms)))


class PrismList:
    """Collects prisms one by one; for scenery, which is made once a town."""

    def __init__(self) -> None:
        self._rows: list[tuple[NDArray[np.float64], int, float, float, int, tuple[int, int, int], bool, int, int]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def add(
        self,
        footprint: Sequence[Sequence[float]] | NDArray[np.float64],
        z0: float,
        z1: float,
        tag: int,
        colour: tuple[int, int, int],
        solid: bool = True,
        light: int = -1,
        lamp: int = -1,
    ) -> None:
        """Adds one prism with a convex `footprint` (M, 2) of 3 to 8 corners [m]."""
        corners = np.asarray(footprint, dtype=np.float64)
        if not 3 <= len(corners) <= MAX_VERTICES:
            raise ValueError(f"a footprint has 3 to {MAX_VERTICES} corners, got {len(corners)}")
        padded = np.concatenate([corners, np.repeat(corners[-1:], MAX_VERTICES - len(corners), axis=0)])
        self._rows.append((padded, len(corners), z0, z1, tag, colour, solid, light, lamp))

    def build(self) -> Prisms:
        """The prisms added so far."""
        if not self._rows:
            return Prisms.empty()
        vertices, count, z0, z1, tag, colour, solid, light, lamp = zip(*self._rows, strict=True)
        return Prisms(
            snapped(np.stack(vertices)),
            np.array(count, np.int32),
            np.array(z0, np.float64),
            np.array(z1, np.float64),
            np.array(tag, np.uint8),
            np.array(colour, np.uint8),
            np.zeros(len(count), np.int32),
            np.array(solid, np.bool_),
            np.array(light, np.int32),
            np.array(lamp, np.int8),
        )
