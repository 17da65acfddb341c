"""The rotated window around a vehicle, cut from any bird's-eye image: features for the student, labels for the teacher.

Poses are (x, y, heading) in the planner frame (x right, y backward [m], heading clockwise [rad]); windows are heading
up. Source: the paper, section 3.3 (reference `lav.md` 4.7); pixel centres here lie in the middles of cells.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from agents.lav.config import CropConfig, GridConfig


def crop_rois(image: Tensor, poses: Tensor, grid: GridConfig, crop: CropConfig, cell: float) -> Tensor:
    """Windows of `image`, bilinear, zero outside.

    All windows of one frame are sampled at once: their sampling points are stacked, so that the image is not copied
    for each of them.

    Args:
        image: (B, C, H, W) over the extent of `grid`, at any resolution.
        poses: (B, R, 3) of R vehicles a frame.
        grid: The image's extent.
        crop: The window's.
        cell: Side of the window's cells [m].

    Returns:
        (B, R, C, S, S) with S = side / cell.
    """
    frames, rois = poses.shape[:2]
    size = round(crop.side / cell)
    points = planner_points(poses, window(crop, size, poses.device)).reshape(frames, rois * size, size, 2)
    found = functional.grid_sample(image, _normalised(points, grid).to(image.dtype), align_corners=False)
    return found.reshape(frames, image.shape[1], rois, size, size).transpose(1, 2)


def window(crop: CropConfig, size: int, device: torch.device | None = None) -> Tensor:
    """(S, S, 2) centres of a window's cells in its vehicle's own frame: x right, y backward [m]."""
    centres = (torch.arange(size, dtype=torch.float32, device=device) + 0.5) * (crop.side / size)
    y, x = torch.meshgrid(centres - (crop.side - crop.behind), centres - crop.side / 2.0, indexing="ij")
    return torch.stack([x, y], dim=-1)


def planner_points(poses: Tensor, points: Tensor) -> Tensor:
    """Points of vehicles' own frames in the planner frame: p = R(heading) q + position.

    Args:
        poses: (..., 3).
        points: (*S, 2), the same for every pose.

    Returns:
        (..., *S, 2).
    """
    shape = (*poses.shape[:-1], *([1] * (points.dim() - 1)))
    cos, sin = torch.cos(poses[..., 2]).reshape(shape), torch.sin(poses[..., 2]).reshape(shape)
    x = poses[..., 0].reshape(shape) + cos * points[..., 0] - sin * points[..., 1]
    y = poses[..., 1].reshape(shape) + sin * points[..., 0] + cos * points[..., 1]
    return torch.stack([x, y], dim=-1)


def to_planner(paths: Tensor, poses: Tensor) -> Tensor:
    """Paths (..., T, 2) in vehicles' own frames, whose poses are (..., 3), in the planner frame."""
    cos, sin = torch.cos(poses[..., None, 2]), torch.sin(poses[..., None, 2])
    x = poses[..., None, 0] + cos * paths[..., 0] - sin * paths[..., 1]
    y = poses[..., None, 1] + sin * paths[..., 0] + cos * paths[..., 1]
    return torch.stack([x, y], dim=-1)


def to_own(paths: Tensor, poses: Tensor) -> Tensor:
    """The inverse of `to_planner`."""
    cos, sin = torch.cos(poses[..., None, 2]), torch.sin(poses[..., None, 2])
    x, y = paths[..., 0] - poses[..., None, 0], paths[..., 1] - poses[..., None, 1]
    return torch.stack([cos * x + sin * y, cos * y - sin * x], dim=-1)


def _normalised(points: Tensor, grid: GridConfig) -> Tensor:
    """Planner metres as `grid_sample` wants them: -1 and 1 are the outer edges of the outermost cells."""
    x = points[..., 0] / grid.aside
    y = (points[..., 1] + grid.ahead) * (2.0 / (grid.ahead + grid.behind)) - 1.0
    return torch.stack([x, y], dim=-1)
