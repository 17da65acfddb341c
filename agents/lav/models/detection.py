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
NOBODY = -1  # padding among the kinds
MAP_WEIGHT = 2.0  # of the map's loss beside detection
MARK_WEIGHTS = (1.0, 4.0, 4.0)  # of a cell with road, a solid or a broken mark, where layers are balanced
NARROW, NARROW_WEIGHT = 0.45, 4.0  # [m] half width of two-wheelers; what their peaks weigh where kinds are balanced
_NEAR = 0.05  # height of a bump that belongs to its actor
_PEAK_REACH = 3  # cells around a peak in which no other stands
_DOUBT = math.exp(-9.0)  # within three cells of an actor that is not to be judged nothing counts
_BUMP_REACH = 4  # cells beyond which a bump is below the precision of its height


class DetectionLabels(NamedTuple):
    """What the detection heads are held to.

    Attributes:
        heat: (B, 2, H, W) 0 to 1, 1 at centres of pedestrians and vehicles.
        weight: (B, 2, H, W) 0 where nothing is known, else 1.
        size: (B, 2, H, W) half length and half width of the nearest actor [cells].
        heading: (B, 2, H, W) cosine and sine of its heading.
        narrow: (B, 2, H, W) bool, whether a two-wheeler is there.
    """

    heat: Tensor
    weight: Tensor
    size: Tensor
    heading: Tensor
    narrow: Tensor | None = None


def detection_labels(
    boxes: Tensor, kinds: Tensor, grid: GridConfig, config: BackboneConfig, hits: Tensor | None = None
) -> DetectionLabels:
    """Labels of frames.

    Actors beyond their kind's radius (of the ego, which stands at the origin) are neither to be found nor to be
    denied: within a few cells of them nothing counts. The original counted them as background though it saw them. The
    same holds of actors with fewer than `config.least_hits` points.

    Args:
        boxes: (B, A, 5).
        kinds: (B, A) `PEDESTRIAN` or `VEHICLE`; `NOBODY` where there is none.
        grid: Where they are drawn.
        config: Radii.
        hits: (B, A) LiDAR points on each, if it matters.
    """
    frames, most = kinds.shape
    distance = torch.hypot(boxes[..., 0], boxes[..., 1])
    radius = torch.where(kinds == PEDESTRIAN, config.walker_radius, config.detection_radius)
    sure = distance <= radius
    if hits is not None:
        sure = sure & (hits >= config.least_hits)
    known, doubted = (kinds >= 0) & sure, (kinds >= 0) & ~sure & (distance <= radius + config.ring)
    cells, bumps = _bumps(boxes, grid)
    # One canvas a frame and kind, and one of both kinds that says who speaks: the nearest, of equals the last vehicle.
    heat = _highest(cells, bumps * known[..., None], kinds, frames, grid)
    doubt = _highest(cells, bumps * doubted[..., None], kinds, frames, grid) > _DOUBT
    strength = bumps * known[..., None]
    either = heat.amax(dim=1).flatten(1)
    is_owner = (strength > 0.0) & (strength >= either.gather(1, cells.flatten(1)).view_as(strength))
    rank = torch.arange(1, most + 1, device=boxes.device) + most * (kinds == VEHICLE)
    ranks = torch.zeros_like(either, dtype=torch.long).scatter_reduce(
        1, cells.flatten(1), (rank[..., None] * is_owner).flatten(1), "amax"
    )
    owner = (ranks - 1).clamp(min=0) % most
    values = torch.stack(
        [boxes[..., 3] / grid.cell, boxes[..., 4] / grid.cell, torch.cos(boxes[..., 2]), torch.sin(boxes[..., 2])],
        dim=1,
    )
    drawn = values.gather(2, owner[:, None].expand(-1, 4, -1)).view(frames, 4, grid.rows, grid.cols)
    narrow = (heat > _NEAR) & (drawn[:, 1:2] < NARROW / grid.cell)
    narrow[:, PEDESTRIAN] = False
    return DetectionLabels(heat, 1.0 - doubt.to(bumps.dtype), drawn[:, :2], drawn[:, 2:], narrow)


def detection_loss(seen: Seen, labels: DetectionLabels, balanced: bool = False) -> Tensor:
    """Centres weighted by how wrong they are, sizes and headings by how near a centre is.

    Args:
        seen: What the network says.
        labels: What is true.
        balanced: Centres by `balanced_centre_loss` instead of the original's.
    """
    heat = labels.heat
    centre = balanced_centre_loss(seen.centre, labels) if balanced else _centre_loss(seen.centre, labels)
    near = heat.amax(dim=1, keepdim=True)
    near = near / near.mean().clamp(min=1e-6)
    boxes = sum(
        (functional.smooth_l1_loss(found, wanted, reduction="none") * near).mean()
        for found, wanted in ((seen.size, labels.size), (seen.heading, labels.heading))
    )
    total: Tensor = centre + boxes
    return total


def _centre_loss(logits: Tensor, labels: DetectionLabels) -> Tensor:
    """The original's: one mean over all cells of both kinds, weighted by the probability of being wrong."""
    wrong = torch.sigmoid(logits * (1.0 - 2.0 * labels.heat)) * labels.weight
    entropy = functional.binary_cross_entropy_with_logits(logits, labels.heat, reduction="none")
    return (entropy * wrong).sum() / wrong.sum().clamp(min=1e-6)


def balanced_centre_loss(logits: Tensor, labels: DetectionLabels) -> Tensor:
    """Each kind by itself, per actor of it: in the original's mean the many empty cells outweigh actors, so that scores
    stay low for long, and walkers, who are few, are not learnt at all. Two-wheelers are few among vehicles.

    Source: the quality focal loss (Li et al. 2020, NeurIPS), exponent 2.
    """
    distance = (torch.sigmoid(logits) - labels.heat).detach() ** 2 * labels.weight
    if labels.narrow is not None:
        distance = distance * (1.0 + (NARROW_WEIGHT - 1.0) * labels.narrow)
    entropy = functional.binary_cross_entropy_with_logits(logits, labels.heat, reduction="none")
    actors = (labels.heat * labels.weight).sum(dim=(0, 2, 3))
    return ((entropy * distance).sum(dim=(0, 2, 3)) / actors.clamp(min=1.0)).sum()


def map_loss(logits: Tensor, layers: Tensor, known: Tensor | None = None, balanced: bool = False) -> Tensor:
    """Binary cross entropy of road, solid and broken marks (B, 3, H, W).

    Args:
        logits: What the network says.
        layers: 0 or 1.
        known: (B, H, W) 1 where the truth is known, else 0; everywhere if None.
        balanced: Whether the few cells with marks weigh more.
    """
    weight = logits.new_tensor(MARK_WEIGHTS if balanced else (1.0, 1.0, 1.0))[:, None, None]
    each = functional.binary_cross_entropy_with_logits(logits, layers, reduction="none", pos_weight=weight)
    if known is None:
        return MAP_WEIGHT * each.mean()
    return MAP_WEIGHT * (each * known[:, None]).sum() / (known.sum().clamp(min=1.0) * layers.shape[1])


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
    highest = _highest_near(score)
    flat = torch.where(score >= highest, score, torch.zeros_like(score)).flatten(1)
    scores, index = flat.topk(min(most, flat.shape[1]), dim=1)
    return [
        _boxes_at(seen, frame, kind, index[frame][keep], scores[frame][keep], grid)
        for frame, keep in enumerate(scores >= least)
    ]


def _highest_near(score: Tensor) -> Tensor:
    """(B, H, W) the largest value in the square around each cell: along rows, then columns, which is faster."""
    window, reach = 2 * _PEAK_REACH + 1, _PEAK_REACH
    rows = functional.max_pool2d(score[:, None], (1, window), stride=1, padding=(0, reach))
    return functional.max_pool2d(rows, (window, 1), stride=1, padding=(reach, 0))[:, 0]


def without_ego(found: Detections, reach: float = 1.0) -> Detections:
    """All but what lies within `reach` [m] of the origin: the ego itself."""
    keep = torch.hypot(found.boxes[:, 0], found.boxes[:, 1]) > reach
    return Detections(found.boxes[keep], found.scores[keep])


def _boxes_at(seen: Seen, frame: int, kind: int, cells: Tensor, scores: Tensor, grid: GridConfig) -> Detections:
    cols = seen.centre.shape[3]
    row, col = cells // cols, cells % cols
    down, right = _within_cell(seen.centre[frame, kind], row, col)
    size, heading = seen.size[frame][:, row, col], seen.heading[frame][:, row, col]
    x = (col + 0.5 + right) * grid.cell - grid.aside
    y = (row + 0.5 + down) * grid.cell - grid.ahead
    yaw = torch.atan2(heading[1], heading[0])
    return Detections(torch.stack([x, y, yaw, size[0] * grid.cell, size[1] * grid.cell], dim=1), scores)


def _within_cell(logits: Tensor, row: Tensor, col: Tensor) -> tuple[Tensor, Tensor]:
    """Where in its cell a peak (N,) of logits (H, W) lies, down and right of the middle [cells].

    Of bumps exp(-d^2) the neighbours on both sides tell: the difference of their logarithms is four times the offset.
    """
    heat = functional.logsigmoid(functional.pad(logits[None, None], (1, 1, 1, 1), mode="replicate")[0, 0])
    down = (heat[row + 2, col + 1] - heat[row, col + 1]) / 4.0
    right = (heat[row + 1, col + 2] - heat[row + 1, col]) / 4.0
    return down.clamp(-0.5, 0.5), right.clamp(-0.5, 0.5)


def _highest(cells: Tensor, bumps: Tensor, kinds: Tensor, frames: int, grid: GridConfig) -> Tensor:
    """(B, 2, H, W) largest of the bumps (B, A, N) at cells (B, A, N) of actors of each kind."""
    area = grid.rows * grid.cols
    canvas = bumps.new_zeros(frames, 2 * area)
    where = cells + (kinds.clamp(min=0) * area)[..., None]
    canvas = canvas.scatter_reduce(1, where.flatten(1), bumps.flatten(1), "amax")
    return canvas.view(frames, 2, grid.rows, grid.cols)


def _bumps(boxes: Tensor, grid: GridConfig) -> tuple[Tensor, Tensor]:
    """Numbers (B, A, N) of the cells around each actor's centre, and exp(-d^2) of their distance d [cells] from it; 0
    off the grid."""
    reach = torch.arange(-_BUMP_REACH, _BUMP_REACH + 1, device=boxes.device)
    col, row = (boxes[..., 0] + grid.aside) / grid.cell, (boxes[..., 1] + grid.ahead) / grid.cell
    rows, cols = row.floor().long()[..., None] + reach, col.floor().long()[..., None] + reach
    along = torch.exp(-((rows + 0.5 - row[..., None]) ** 2)) * ((rows >= 0) & (rows < grid.rows))
    across = torch.exp(-((cols + 0.5 - col[..., None]) ** 2)) * ((cols >= 0) & (cols < grid.cols))
    cells = rows.clamp(0, grid.rows - 1)[..., :, None] * grid.cols + cols.clamp(0, grid.cols - 1)[..., None, :]
    return cells.flatten(2), (along[..., :, None] * across[..., None, :]).flatten(2)
