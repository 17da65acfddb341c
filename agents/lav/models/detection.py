"""Vehicles and pedestrians as peaks of a heat map: labels, loss, and boxes read back (reference `lav.md` 4.5, 4.6).

Boxes are (x, y, heading, half length, half width) in the planner frame (x right, y backward [m], clockwise [rad]); the
ego is a vehicle at the origin like any other.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from agents.lav.config import BackboneConfig, GridConfig
from agents.lav.models.backbone import Seen

PEDESTRIAN, VEHICLE = 0, 1  # channels of the centre head
MAP_WEIGHT = 2.0  # of the map's loss beside detection
_PEAK_REACH = 3  # cells around a peak in which no other stands
_RING_BUMP = math.exp(-9.0)  # within three cells of an actor in the ring nothing counts


class DetectionLabels(NamedTuple):
    """What the detection heads are held to.

    Attributes:
        heat: (B, 2, H, W) 0 to 1, 1 at centres of pedestrians and vehicles.
        weight: (B, 2, H, W) 0 where nothing is known, else 1.
        size: (B, 2, H, W) half length and half width of the nearest actor [cells].
        heading: (B, 2, H, W) cosine and sine of its heading.
    """

    heat: Tensor
    weight: Tensor
    size: Tensor
    heading: Tensor


def detection_labels(boxes: Tensor, kinds: Tensor, grid: GridConfig, config: BackboneConfig) -> DetectionLabels:
    """Labels of frames.

    Actors beyond their kind's radius (of the ego, which stands at the origin) are neither to be found nor to be
    denied: within a few cells of them nothing counts. The original counted them as background though it saw them.

    Args:
        boxes: (B, A, 5).
        kinds: (B, A) `PEDESTRIAN` or `VEHICLE`; -1 where there is none.
    """
    bumps = _bumps(boxes, grid)
    distance = torch.hypot(boxes[..., 0], boxes[..., 1])
    radius = torch.where(kinds == PEDESTRIAN, config.walker_radius, config.detection_radius)
    known = (kinds >= 0) & (distance <= radius)
    ring = (kinds >= 0) & (distance > radius) & (distance <= radius + config.ring)
    heat = [_highest(bumps, known & (kinds == kind)) for kind in (PEDESTRIAN, VEHICLE)]
    doubt = [_highest(bumps, ring & (kinds == kind)) > _RING_BUMP for kind in (PEDESTRIAN, VEHICLE)]
    # The nearest actor speaks; where two are as near, vehicles, which are drawn last.
    owner = (bumps * (known * (1.0 + 1e-6 * (kinds == VEHICLE)))[..., None, None]).argmax(dim=1)
    values = torch.stack(
        [boxes[..., 3] / grid.cell, boxes[..., 4] / grid.cell, torch.cos(boxes[..., 2]), torch.sin(boxes[..., 2])]
    )
    frame = torch.arange(len(boxes), device=boxes.device)[:, None, None]
    drawn = values[:, frame, owner].transpose(0, 1)
    weight = 1.0 - torch.stack(doubt, dim=1).to(bumps.dtype)
    return DetectionLabels(torch.stack(heat, dim=1), weight, drawn[:, :2], drawn[:, 2:])


def detection_loss(seen: Seen, labels: DetectionLabels) -> Tensor:
    """Centres weighted by how wrong they are, sizes and headings by how near a centre is."""
    heat = labels.heat
    wrong = torch.sigmoid(seen.centre * (1.0 - 2.0 * heat)) * labels.weight
    entropy = functional.binary_cross_entropy_with_logits(seen.centre, heat, reduction="none")
    centre = (entropy * wrong).sum() / wrong.sum().clamp(min=1e-6)
    near = heat.amax(dim=1, keepdim=True)
    near = near / near.mean().clamp(min=1e-6)
    boxes = sum(
        (functional.smooth_l1_loss(found, wanted, reduction="none") * near).mean()
        for found, wanted in ((seen.size, labels.size), (seen.heading, labels.heading))
    )
    total: Tensor = centre + boxes
    return total


def map_loss(logits: Tensor, layers: Tensor) -> Tensor:
    """Binary cross entropy of road, solid and broken marks (B, 3, H, W)."""
    return MAP_WEIGHT * functional.binary_cross_entropy_with_logits(logits, layers)


class Detections(NamedTuple):
    """Actors found in a frame, best first.

    Attributes:
        boxes: (N, 5) in the planner frame.
        scores: (N,) 0 to 1.
    """

    boxes: Tensor
    scores: Tensor


def decode(seen: Seen, grid: GridConfig, kind: int, most: int = 20, least: float = 0.2) -> list[Detections]:
    """The actors of `kind` in each frame: peaks of the heat map.

    Args:
        most: At most so many.
        least: Scores below are left out.
    """
    score = torch.sigmoid(seen.centre[:, kind])
    window = 2 * _PEAK_REACH + 1
    highest = functional.max_pool2d(score[:, None], window, stride=1, padding=_PEAK_REACH)[:, 0]
    flat = torch.where(score >= highest, score, torch.zeros_like(score)).flatten(1)
    scores, index = flat.topk(min(most, flat.shape[1]), dim=1)
    return [
        _boxes_at(seen, frame, index[frame][keep], scores[frame][keep], grid)
        for frame, keep in enumerate(scores >= least)
    ]


def without_ego(found: Detections, reach: float = 1.0) -> Detections:
    """All but what lies within `reach` [m] of the origin: the ego itself."""
    keep = torch.hypot(found.boxes[:, 0], found.boxes[:, 1]) > reach
    return Detections(found.boxes[keep], found.scores[keep])


def _boxes_at(seen: Seen, frame: int, cells: Tensor, scores: Tensor, grid: GridConfig) -> Detections:
    cols = seen.centre.shape[3]
    row, col = cells // cols, cells % cols
    size, heading = seen.size[frame][:, row, col], seen.heading[frame][:, row, col]
    x, y = (col + 0.5) * grid.cell - grid.aside, (row + 0.5) * grid.cell - grid.ahead
    yaw = torch.atan2(heading[1], heading[0])
    return Detections(torch.stack([x, y, yaw, size[0] * grid.cell, size[1] * grid.cell], dim=1), scores)


def _highest(bumps: Tensor, chosen: Tensor) -> Tensor:
    """(B, H, W) largest of the bumps (B, A, H, W) of the chosen actors (B, A)."""
    return (bumps * chosen[..., None, None]).amax(dim=1)


def _bumps(boxes: Tensor, grid: GridConfig) -> Tensor:
    """(B, A, H, W) exp(-d^2) of the distance d [cells] of each cell from each actor's centre."""
    rows = torch.arange(grid.rows, device=boxes.device, dtype=boxes.dtype) + 0.5
    cols = torch.arange(grid.cols, device=boxes.device, dtype=boxes.dtype) + 0.5
    across = torch.exp(-((cols - ((boxes[..., 0] + grid.aside) / grid.cell)[..., None]) ** 2))
    along = torch.exp(-((rows - ((boxes[..., 1] + grid.ahead) / grid.cell)[..., None]) ** 2))
    return along[..., None] * across[..., None, :]
