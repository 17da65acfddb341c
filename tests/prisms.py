"""Prisms made by hand, and rays cast into them by plain numpy: the oracle of the sensor kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import box_corners
from lavsim.map.prisms import MAX_VERTICES, Prisms
from lavsim.types import Tag


def prism(
    footprint: NDArray[np.float64],
    z0: float,
    z1: float,
    tag: Tag = Tag.BUILDING,
    colour: tuple[int, int, int] = (150, 140, 130),
    light: int = -1,
    lamp: int = -1,
) -> Prisms:
    """One static prism over a convex `footprint` (n, 2)."""
    vertices = np.repeat(footprint[-1:], MAX_VERTICES, axis=0)
    vertices[: len(footprint)] = footprint
    return Prisms(
        vertices[None].astype(np.float64),
        np.array([len(footprint)], np.int32),
        np.array([z0]),
        np.array([z1]),
        np.array([tag], np.uint8),
        np.array([colour], np.uint8),
        np.zeros(1, np.int32),
        np.ones(1, np.bool_),
        np.array([light], np.int32),
        np.array([lamp], np.int8),
    )


def box(
    x: float, y: float, length: float, width: float, z0: float, z1: float, yaw: float = 0.0, **kw: object
) -> Prisms:
    """One static box."""
    return prism(box_corners([x], [y], [yaw], [length], [width])[0], z0, z1, **kw)  # type: ignore[arg-type]


def random_prisms(seed: int, count: int, extent: float = 60.0) -> Prisms:
    """Polygons with 3 to 8 corners, some turned backward, some above the ground."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(count):
        corners = int(rng.integers(3, MAX_VERTICES + 1))
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners)) + 0.01 * np.arange(corners)
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.5, 5.0, 2)
        if rng.random() < 0.5:
            ring = ring[::-1]
        low = float(rng.choice([0.0, rng.uniform(0.1, 6.0)]))
        parts.append(prism(ring + rng.uniform(-extent, extent, 2), low, low + float(rng.uniform(0.2, 8.0))))
    return Prisms.concatenate(parts)


def cast_ray(origin: NDArray[np.float64], direction: NDArray[np.float64], prisms: Prisms) -> tuple[float, int]:
    """Distance and row of the first prism a ray enters, (inf, -1) if none; prisms around the origin don't count."""
    best, row = np.inf, -1
    for k in range(len(prisms)):
        ring = prisms.vertices[k, : prisms.count[k]]
        inner = ring.mean(axis=0)
        enter, leave = -np.inf, np.inf
        planes = [(np.array([0.0, 0.0, 1.0]), prisms.z1[k]), (np.array([0.0, 0.0, -1.0]), -prisms.z0[k])]
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            normal = np.array([b[1] - a[1], a[0] - b[0], 0.0])
            if normal[:2] @ (inner - a) > 0.0:
                normal = -normal
            planes.append((normal, float(normal[:2] @ a)))
        for normal, limit in planes:
            along, gap = normal @ direction, limit - normal @ origin
            if along < 0.0:
                enter = max(enter, gap / along)
            elif along > 0.0:
                leave = min(leave, gap / along)
            elif gap < 0.0:
                leave = -np.inf
        if 0.0 < enter < leave and enter < best:
            best, row = enter, k
    return best, row
