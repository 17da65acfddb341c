"""Sheets of small pictures, to be looked at."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.reader import Dataset

SHOWN = 12  # frames on a sheet
_COLUMNS, _GAP, _BAR = 6, 2, 6  # [px]

# Colours of the classes of `agents.lav.models.segmentation`: Cityscapes' hues.
PALETTE = np.array([(40, 40, 40), (220, 20, 60), (250, 250, 120), (128, 64, 128), (40, 90, 200)], np.uint8)

Image = NDArray[np.uint8]


def unseen_frames(data: Dataset, count: int) -> list[tuple[int, int]]:
    """Episode and frame of frames spread evenly over a dataset."""
    return [data.locate(int(place)) for place in (np.arange(count) + 0.5) * len(data) / count]


def column(images: Sequence[Image]) -> Image:
    """Images (H, W, 3) of one width below each other."""
    return np.concatenate(images)


def fitted(image: Image, width: int) -> Image:
    """An image (H, W, 3) on black, as wide as wanted; a wider one is shrunk."""
    if image.shape[1] > width:
        image = np.asarray(cv2.resize(image, (width, round(image.shape[0] * width / image.shape[1]))))
    room = width - image.shape[1]
    return np.pad(image, ((0, 0), (room // 2, room - room // 2), (0, 0)))


def barred(width: int, shares: Sequence[float]) -> Image:
    """Red bars on grey below each other, each as long as a share of the width."""
    bars = np.full((_BAR * len(shares), width, 3), 60, np.uint8)
    for number, share in enumerate(shares):
        bars[number * _BAR : (number + 1) * _BAR - 1, : round(width * share)] = (230, 60, 50)
    return bars


def sheet(cells: Sequence[Image], columns: int = _COLUMNS) -> Image:
    """Cells (H, W, 3) of one size in rows, with gaps."""
    height, width = cells[0].shape[:2]
    rows = -(-len(cells) // columns)
    across = min(columns, len(cells))
    whole = np.full((rows * (height + _GAP) - _GAP, across * (width + _GAP) - _GAP, 3), 255, np.uint8)
    for number, cell in enumerate(cells):
        row, place = divmod(number, columns)
        top, left = row * (height + _GAP), place * (width + _GAP)
        whole[top : top + height, left : left + width] = cell
    return whole
