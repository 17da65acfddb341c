"""Images and class tags as the networks take them, read frame by frame from a dataset."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.config import CameraConfig, LavConfig
from agents.lav.data.arrays import FRONT, TELEPHOTO_KEPT
from lavsim.dataset.reader import Dataset
from lavsim.errors import ConfigError

WIDE = tuple(f"rgb_{number}" for number in range(5))  # -120 to 120 degrees
WIDE_TAGS = tuple(f"sem_{number}" for number in range(5))
FRONT_TAGS = tuple(name.replace("rgb", "sem") for name in FRONT)
TELEPHOTO, TELEPHOTO_TAGS = "tel_rgb", "tel_sem"

Bytes = NDArray[np.uint8]


def require_fields(data: Dataset, names: Sequence[str], stage: str) -> None:
    """Refuses a dataset that lacks what a stage learns from.

    Raises:
        ConfigError: it lacks some of it, or holds no frame.
    """
    known = {item.name for item in data.info.fields}
    missing = [name for name in names if name not in known]
    if missing:
        raise ConfigError(f"stage {stage!r} needs {', '.join(missing)}, which {data.root.name} does not hold.")
    if not len(data):
        raise ConfigError(f"{data.root.name} holds no frames to learn from.")


def frames_of(data: Dataset, standing_stride: int = 1) -> NDArray[np.int64]:
    """(N, 2) episode and frame of all frames; of those in which the ego stands only every so many."""
    found = []
    for number, record in data.episodes.items():
        if not record.frames:
            continue
        frames = np.arange(record.frames)
        keep = (np.abs(np.asarray(data.table(number)["speed"])) > _STANDS) | (frames % standing_stride == 0)
        found.append(np.stack([np.full(keep.sum(), number), frames[keep]], axis=1))
    return np.concatenate(found) if found else np.zeros((0, 2), np.int64)


def shrunk(image: Bytes, width: int, height: int) -> Bytes:
    """An image (H, W, 3) at another size; a pixel is the mean of those it covers."""
    if image.shape[:2] == (height, width):
        return image
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA))


def shrunk_tags(tags: Bytes, width: int, height: int) -> Bytes:
    """Tags (H, W) at another size; a pixel is the one at its middle."""
    if tags.shape == (height, width):
        return tags
    return np.asarray(cv2.resize(tags, (width, height), interpolation=cv2.INTER_NEAREST_EXACT))


def panorama(frame: dict[str, Bytes], cameras: CameraConfig) -> Bytes:
    """(H, 3 W, 3) the front cameras' images beside each other, left to right."""
    return np.concatenate([shrunk(frame[name], cameras.width, cameras.height) for name in FRONT], axis=1)


def panorama_tags(frame: dict[str, Bytes], cameras: CameraConfig) -> Bytes:
    """(H, 3 W) their tags."""
    return np.concatenate([shrunk_tags(frame[name], cameras.width, cameras.height) for name in FRONT_TAGS], axis=1)


def far_view(image: Bytes, config: LavConfig) -> Bytes:
    """(h, w, 3), or (h, w) of tags: a telephoto's image as the brake network takes it."""
    if config.brake.sharp is None:
        shrink = shrunk if image.ndim == 3 else shrunk_tags
        return shrink(image[:TELEPHOTO_KEPT], config.cameras.telephoto_width, config.cameras.telephoto_height)
    rows, columns = config.brake.sharp
    left = (image.shape[1] - columns) // 2
    return np.ascontiguousarray(image[:rows, left : left + columns])


def as_batch(images: Sequence[Bytes]) -> Tensor:
    """(B, 3, H, W) uint8 of images (H, W, 3), channels last in memory."""
    return torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2)


_STANDS = 0.1  # [m/s]
