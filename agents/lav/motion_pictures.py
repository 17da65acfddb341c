"""True labels from above with the teacher's plan and forecasts over them."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from agents.lav.batches import plain_batch
from agents.lav.config import GridConfig
from agents.lav.data.pictures import TRUTH, draw_path, map_picture
from agents.lav.data.show import SHOWN, sheet
from agents.lav.labels import MotionSamples
from agents.lav.models.crop import to_planner
from agents.lav.models.motion import chosen
from agents.lav.models.teacher import Motions
from agents.lav.motion_measures import MOVES

PLAN, FORECAST, UNLIKELY = (255, 140, 30), (200, 110, 255), (110, 80, 140)
VEHICLE, WALKER = (70, 120, 220), (220, 60, 90)
_LIKELY = 0.2


def teacher_sheet(network: nn.Module, samples: MotionSamples, grid: GridConfig) -> NDArray[np.uint8]:
    """Frames spread evenly over those in which the ego drives and plans: the plan of the command in orange, true
    futures in green, others' likely branches in violet and unlikely ones darker. Nothing if there is no such frame.
    """
    moving = np.flatnonzero(samples.plans & (samples.speed > MOVES))
    if not len(moving):
        return np.zeros((1, 1, 3), np.uint8)
    index = moving[((np.arange(SHOWN) + 0.5) * len(moving) / SHOWN).astype(np.int64)]
    batch = plain_batch(samples, index)
    motions: Motions = network(batch.images, batch.poses, batch.goals, batch.speeds, batch.is_real)
    plans = chosen(motions.refined[:, -1] if motions.refined.shape[1] else motions.coarse[:, 0], batch.commands)
    branches = to_planner(motions.coarse, batch.poses[:, :, None].expand(-1, -1, motions.coarse.shape[2], -1))
    likely = torch.sigmoid(motions.commands) > _LIKELY
    futures = to_planner(batch.futures, batch.poses)
    cells = []
    for number, labels in enumerate(batch.images.numpy() > 0.5):
        view = map_picture(labels[[0, 3, 4]], grid)
        for layer, colour in ((labels[1], VEHICLE), (labels[2], WALKER)):
            view[cv2.resize(layer.astype(np.uint8), view.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0] = colour
        for place in torch.nonzero(batch.is_real[number]).flatten().tolist():
            if place:
                for path, is_likely in zip(branches[number, place], likely[number, place], strict=True):
                    draw_path(view, path.numpy(), grid, FORECAST if is_likely else UNLIKELY, 1)
            draw_path(view, futures[number, place].numpy(), grid, TRUTH, 1)
        draw_path(view, plans[number].numpy(), grid, PLAN, 2)
        cells.append(view)
    return sheet(cells, columns=4)
