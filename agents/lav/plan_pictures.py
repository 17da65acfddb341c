"""A frame from above with what the student sees, plans and forecasts."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.batches import Batch
from agents.lav.config import LavConfig
from agents.lav.data.pictures import FOUND, TRUTH, draw_boxes, draw_path, map_picture
from agents.lav.models.crop import to_planner
from agents.lav.models.detection import VEHICLE, decode
from agents.lav.models.motion import chosen
from agents.lav.models.student import Driven

PLAN, FORECAST, UNLIKELY = (255, 140, 30), (200, 110, 255), (110, 80, 140)
_FEWEST = 0.3  # score of a detection that is drawn


class Labelled(Protocol):
    """Boxes (B, A, 5), kinds (B, A) and LiDAR hits (B, A) of frames, as tensors."""

    @property
    def boxes(self) -> Tensor: ...
    @property
    def kinds(self) -> Tensor: ...
    @property
    def hits(self) -> Tensor: ...


def plan_picture(driven: Driven, scene: Labelled, batch: Batch, config: LavConfig) -> NDArray[np.uint8]:
    """The first frame: detections in red, true boxes and futures in green, the plan of the command in orange, others'
    likeliest branch in violet and their other branches darker, over the map that is seen.

    Args:
        driven: What the student made of it.
        scene: Who there is.
        batch: Poses and true futures.
        config: Sizes.
    """
    grid = config.grid
    view = map_picture((driven.seen.map[0] > 0.0).cpu().numpy(), grid)
    real = (scene.kinds[0] >= 0) & (scene.hits[0] > 0)
    draw_boxes(view, scene.boxes[0][real].numpy(), grid, TRUTH)
    draw_boxes(view, decode(driven.seen, grid, VEHICLE, least=_FEWEST)[0].boxes.cpu().numpy(), grid, FOUND)
    motions, poses = driven.motions, batch.poses[:1]
    futures = to_planner(batch.futures[:1], poses)[0]
    branches = to_planner(motions.coarse[0].cpu(), poses[0][:, None].expand(-1, motions.coarse.shape[2], -1))
    likeliest = motions.commands[0].argmax(dim=-1).cpu()
    for number in torch.nonzero(batch.is_real[0]).flatten().tolist():
        if number:
            for branch, path in enumerate(branches[number]):
                draw_path(view, path.numpy(), grid, FORECAST if branch == likeliest[number] else UNLIKELY, 1)
        draw_path(view, futures[number].numpy(), grid, TRUTH, 1)
    plans = motions.refined[:1, -1] if motions.refined.shape[1] else motions.coarse[:1, 0]
    draw_path(view, to_planner(chosen(plans.cpu(), batch.commands[:1]), poses[:, 0])[0].numpy(), grid, PLAN, 2)
    return view
