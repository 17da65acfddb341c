"""How near others are to the ego, in space and in time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel

Floats = NDArray[np.float64]

_STEP = 0.05  # [s] between the moments that are tested
_ROUNDING = 1e-3  # [m] far more than what single precision loses in sizes


@kernel
def nearest_contact(
    xy: Floats, yaw: Floats, velocity: Floats, sizes: NDArray[np.float32], horizon: float
) -> tuple[float, float]:
    """Distance to the nearest box and the time until one is touched if everybody keeps its velocity.

    Args:
        xy: (N, 2) centres [m]; row 0 is the ego.
        yaw: (N,) [rad].
        velocity: (N, 2) [m/s].
        sizes: (N, 2) full length and width [m].
        horizon: How far to look ahead [s].

    Returns:
        Distance [m], 0 when touching, inf without others; time [s], inf when nobody is touched within `horizon`.
    """
    nearest, soonest = np.inf, np.inf
    for k in range(1, len(xy)):
        nearest, soonest = _with_one_more(k, xy, yaw, velocity, sizes, horizon, nearest, soonest)
    return nearest, soonest


@kernel
def nearest_contact_around(
    xyz: Floats, yaw: Floats, velocity: Floats, sizes: NDArray[np.float32], reach: float, level: float, horizon: float
) -> tuple[float, float]:
    """As `nearest_contact`, of those nearer than `reach` to the ego along either axis and than `level` in height.

    Args:
        xyz: (N, 3) places [m]; row 0 is the ego.
        yaw: (N,) [rad].
        velocity: (N, 3) [m/s].
        sizes: (N, 3) full length, width, height [m].
        reach: [m].
        level: [m].
        horizon: How far to look ahead [s].
    """
    nearest, soonest = np.inf, np.inf
    for k in range(1, len(xyz)):
        if (
            abs(xyz[k, 0] - xyz[0, 0]) < reach
            and abs(xyz[k, 1] - xyz[0, 1]) < reach
            and abs(xyz[k, 2] - xyz[0, 2]) < level
        ):
            nearest, soonest = _with_one_more(k, xyz, yaw, velocity, sizes, horizon, nearest, soonest)
    return nearest, soonest


@kernel
def _with_one_more(
    k: int, xy: Floats, yaw: Floats, velocity: Floats, sizes: NDArray[np.float32], horizon: float,
    nearest: float, soonest: float,
) -> tuple[float, float]:  # fmt: skip
    """Distance and time to contact once actor `k` is looked at, too."""
    dx, dy = xy[k, 0] - xy[0, 0], xy[k, 1] - xy[0, 1]
    radii = 0.5 * (math.sqrt(sizes[0, 0] ** 2 + sizes[0, 1] ** 2) + math.sqrt(sizes[k, 0] ** 2 + sizes[k, 1] ** 2))
    least = math.sqrt(dx * dx + dy * dy) - radii
    if least < nearest + _ROUNDING:  # else it is farther than another
        nearest = min(nearest, _gap(dx, dy, yaw[0], yaw[k], sizes[0], sizes[k]))
    vx, vy = velocity[k, 0] - velocity[0, 0], velocity[k, 1] - velocity[0, 1]
    if least > math.sqrt(vx * vx + vy * vy) * horizon:
        return nearest, soonest
    step = 0
    while step * _STEP < min(horizon, soonest):
        time = step * _STEP
        if _gap(dx + vx * time, dy + vy * time, yaw[0], yaw[k], sizes[0], sizes[k]) <= 0.0:
            return nearest, time
        step += 1
    return nearest, soonest


@kernel
def _gap(
    dx: float, dy: float, yaw_a: float, yaw_b: float, size_a: NDArray[np.float32], size_b: NDArray[np.float32]
) -> float:
    """Distance between two boxes whose centres are (dx, dy) apart [m]; 0 when they touch."""
    apart = max(separation(dx, dy, yaw_a, yaw_b, size_a, size_b), separation(-dx, -dy, yaw_b, yaw_a, size_b, size_a))
    if apart <= 0.0:
        return 0.0
    return min(
        _corner_distance(dx, dy, yaw_a, yaw_b, size_a, size_b), _corner_distance(-dx, -dy, yaw_b, yaw_a, size_b, size_a)
    )


@kernel
def separation(
    dx: float, dy: float, yaw_a: float, yaw_b: float, size_a: NDArray[np.float32], size_b: NDArray[np.float32]
) -> float:
    """Largest gap between the boxes along the axes of box a [m]; negative where they overlap on both."""
    cos, sin = math.cos(yaw_a), math.sin(yaw_a)
    c, s = abs(math.cos(yaw_b - yaw_a)), abs(math.sin(yaw_b - yaw_a))
    ahead = abs(dx * cos + dy * sin) - 0.5 * (size_a[0] + c * size_b[0] + s * size_b[1])
    aside = abs(dy * cos - dx * sin) - 0.5 * (size_a[1] + s * size_b[0] + c * size_b[1])
    return max(ahead, aside)


@kernel
def _corner_distance(
    dx: float, dy: float, yaw_a: float, yaw_b: float, size_a: NDArray[np.float32], size_b: NDArray[np.float32]
) -> float:
    """Least distance from a corner of box b to box a [m]; boxes that don't touch are that far apart, either way."""
    cos, sin = math.cos(yaw_a), math.sin(yaw_a)
    x, y = dx * cos + dy * sin, dy * cos - dx * sin
    c, s = math.cos(yaw_b - yaw_a), math.sin(yaw_b - yaw_a)
    least = np.inf
    for along in (-0.5, 0.5):
        for across in (-0.5, 0.5):
            px = x + along * size_b[0] * c - across * size_b[1] * s
            py = y + along * size_b[0] * s + across * size_b[1] * c
            outside_x = max(abs(px) - 0.5 * size_a[0], 0.0)
            outside_y = max(abs(py) - 0.5 * size_a[1], 0.0)
            least = min(least, math.sqrt(outside_x**2 + outside_y**2))
    return least
