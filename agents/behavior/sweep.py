"""Which places of the ego's way meet others' forecast boxes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel

Floats = NDArray[np.float64]


@kernel
def sweep(
    xy: Floats, heading: Floats, half_length: float, half_width: float, poses: Floats, half: Floats, margin: Floats
) -> tuple[Floats, Floats]:
    """Samples of the ego's path at which its box meets each forecast box.

    Args:
        xy: (S, 2) the ego's places ahead, `STEP` apart.
        heading: (S,) its headings there.
        half_length: Of the ego [m].
        half_width: Of the ego [m].
        poses: (H, K, 3) forecasts.
        half: (H, 2) half boxes.
        margin: (H,) by which the ego is made wider [m].

    Returns:
        (H, K) first sample that meets, refined to a sixteenth, and last sample; -1 where none does.
    """
    count, steps, samples = len(poses), poses.shape[1], len(xy)
    x0, x1, y0, y1 = math.inf, -math.inf, math.inf, -math.inf
    for i in range(samples):
        x0, x1, y0, y1 = min(x0, xy[i, 0]), max(x1, xy[i, 0]), min(y0, xy[i, 1]), max(y1, xy[i, 1])
    first, last = np.full((count, steps), -1.0), np.full((count, steps), -1.0)
    ego_radius = math.sqrt(half_length**2 + half_width**2)
    for h in range(count):
        width = half_width + margin[h]
        radius = ego_radius + margin[h] + math.sqrt(half[h, 0] ** 2 + half[h, 1] ** 2)
        for k in range(steps):
            if k > 0 and poses[h, k, 0] == poses[h, k - 1, 0] and poses[h, k, 1] == poses[h, k - 1, 1]:
                first[h, k], last[h, k] = first[h, k - 1], last[h, k - 1]
                continue
            x, y, yaw = poses[h, k]
            if x < x0 - radius or x > x1 + radius or y < y0 - radius or y > y1 + radius:
                continue
            i = 0
            while i < samples:
                distance = math.sqrt((x - xy[i, 0]) ** 2 + (y - xy[i, 1]) ** 2)
                if distance > radius:
                    i += max(1, int((distance - radius) / 0.6))  # samples are at most 0.6 m apart
                    continue
                if _overlap(xy[i, 0], xy[i, 1], heading[i], half_length, width, x, y, yaw, half[h, 0], half[h, 1]):
                    if first[h, k] < 0.0:
                        first[h, k] = i
                        if i > 0:
                            low, high = 0.0, 1.0
                            for _ in range(4):
                                t = 0.5 * (low + high)
                                mx = xy[i - 1, 0] + (xy[i, 0] - xy[i - 1, 0]) * t
                                my = xy[i - 1, 1] + (xy[i, 1] - xy[i - 1, 1]) * t
                                turn = heading[i - 1] + (heading[i] - heading[i - 1]) * t
                                if _overlap(mx, my, turn, half_length, width, x, y, yaw, half[h, 0], half[h, 1]):
                                    high = t
                                else:
                                    low = t
                            first[h, k] = i - 1 + high
                    last[h, k] = i
                elif first[h, k] >= 0.0:
                    break
                i += 1
    return first, last


@kernel
def _overlap(
    ax: float, ay: float, a_yaw: float, a_length: float, a_width: float,
    bx: float, by: float, b_yaw: float, b_length: float, b_width: float,
) -> bool:  # fmt: skip
    """Whether two boxes, given by centre, heading and half sizes, meet (separating axes)."""
    ac, as_, bc, bs = math.cos(a_yaw), math.sin(a_yaw), math.cos(b_yaw), math.sin(b_yaw)
    dx, dy = bx - ax, by - ay
    cos, sin = abs(ac * bc + as_ * bs), abs(ac * bs - as_ * bc)
    if abs(dx * ac + dy * as_) > a_length + b_length * cos + b_width * sin:
        return False
    if abs(dy * ac - dx * as_) > a_width + b_length * sin + b_width * cos:
        return False
    if abs(dx * bc + dy * bs) > b_length + a_length * cos + a_width * sin:
        return False
    return abs(dy * bc - dx * bs) <= b_width + a_length * sin + a_width * cos
