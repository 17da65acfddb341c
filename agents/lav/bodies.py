"""Detections near the ego must have a body: points of the scan above the ground.

The networks know the ego as a vehicle at the origin, and sometimes find it once more, a lane beside itself, on bare
ground. Such a ghost drives along and brakes the ego for itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.lav.models.detection import Detections

Floats = NDArray[np.float32]

_REACH = 12.0  # [m] farther away slopes hide what is low, and few points hit
_ABOVE = 0.4  # [m] over the ground
_AROUND = 0.4  # [m] that boxes are found off


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
