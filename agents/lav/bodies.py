"""What near detections must be like in the scan: with a body, and walkers no taller than people are.

The networks know the ego as a vehicle at the origin, and sometimes find it once more, a lane beside itself, on bare
ground. Such a ghost drives along and brakes the ego for itself. And they take poles beside the road for walkers, who
appear within braking distance: the ego then stops below a light that it can't see any more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.lav.models.detection import Detections

Floats = NDArray[np.float32]

_REACH = 12.0  # [m] farther away slopes hide what is low, and few points hit
_ABOVE = 0.4  # [m] over the ground
_AROUND = 0.4  # [m] that boxes are found off
_POLE = 0.5  # [m] around its middle
_TALL, _SLOPE = 2.25, 0.05  # [m] over the ground, and [m] more for each metre away: nobody's head
_LEAST_TALL, _TALL_SHARE = 2, 0.1  # points above, and for each below; a walker beside a pole has fewer


def body_points(scan: Floats, height: float) -> Floats:
    """(N, 2) points ahead, right [m] near the ego and above the ground.

    Args:
        scan: (P, F) points ahead, right, up of the LiDAR [m].
        height: Of the LiDAR over the ground [m].
    """
    return scan[(scan[:, 2] > _ABOVE - height) & (np.abs(scan[:, :2]) < _REACH + 3.0).all(axis=1), :2]


def with_body(found: Detections, body: Floats) -> Detections:
    """Those with a point of `body_points` within their box, and those farther away; boxes in the planner frame."""
    boxes = found.boxes.numpy().astype(np.float64)
    is_near = np.hypot(boxes[:, 0], boxes[:, 1]) < _REACH
    dx, dy = body[:, 1] - boxes[is_near, :1], -body[:, 0] - boxes[is_near, 1:2]
    cos, sin = np.cos(boxes[is_near, 2:3]), np.sin(boxes[is_near, 2:3])
    along, aside = np.abs(dx * sin - dy * cos), np.abs(dx * cos + dy * sin)
    has_body = (along < boxes[is_near, 3:4] + _AROUND) & (aside < boxes[is_near, 4:] + _AROUND)
    keep = ~is_near
    keep[is_near] = has_body.any(axis=1)
    return Detections(found.boxes[keep], found.scores[keep])


def without_poles(walkers: Detections, scan: Floats, height: float) -> Detections:
    """Walkers but for those near the ego that reach higher than people; boxes in the planner frame.

    Args:
        walkers: Found.
        scan: (P, F) points ahead, right, up of the LiDAR [m].
        height: Of the LiDAR over the ground [m].
    """
    places = walkers.boxes[:, :2].numpy().astype(np.float64)
    away = np.hypot(places[:, 0], places[:, 1])
    near = scan[(np.abs(scan[:, :2]) < _REACH + _POLE).all(axis=1), :3]
    up = near[:, 2] + height
    there = np.hypot(near[:, 1] - places[:, :1], -near[:, 0] - places[:, 1:]) < _POLE
    is_tall = up > _TALL + _SLOPE * away[:, None]
    above = (there & is_tall).sum(axis=1)
    below = (there & ~is_tall & (up > _ABOVE)).sum(axis=1)
    keep = (away > _REACH) | (above < _LEAST_TALL) | (above <= _TALL_SHARE * below)
    return Detections(walkers.boxes[keep], walkers.scores[keep])
