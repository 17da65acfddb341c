"""Writes onto LiDAR points what the cameras saw there (paper, section 3.2; Vora et al. 2020, CVPR).

Convention:
    Points are x ahead, y right, z up [m] in the LiDAR's frame, which is the vehicle's moved. A camera's axes
    are right, down and ahead; columns count to the right, rows downward, from the image's upper left corner.

Source: reference `lav.md` 2.4; its slip of points just outside an image is avoided by testing before truncation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from agents.lav.config import CameraConfig
from agents.lav.data.images import as_batch, shrunk
from agents.lav.devices import has_bfloat16
from agents.lav.models.segmentation import CLASSES, calibrated, in_unit_range, make_segmentation
from agents.lav.weights import Weights
from lavsim.errors import ConfigError
from lavsim.kernel import kernel

Floats = NDArray[np.float32]
_NEAREST = 0.1  # [m] ahead of a camera


class Painter:
    """Paints points with a trained segmentation.

    Args:
        weights: Of the stage `segmentation`.
        suite: Sensor dicts in CARLA's form, the cameras' and the LiDAR's among them.
        cameras: Ids of the cameras, left to right: where two see a point, the later one tells.
        lidar: Id of the LiDAR.

    Raises:
        ConfigError: the suite has no such sensor, or one that is tilted.
    """

    def __init__(
        self, weights: Weights, suite: Sequence[Mapping[str, Any]], cameras: Sequence[str], lidar: str = "LIDAR"
    ) -> None:
        self._size = weights.config.cameras
        self._network = segmentation_of(weights)
        self._views = views_of(suite, cameras, lidar, self._size)
        self._is_fast = has_bfloat16("cpu")

    def classes(self, images: Sequence[NDArray[np.uint8]]) -> Floats:
        """(C, H, W, classes) logits of images (h, w, 3), red first."""
        batch = as_batch([shrunk(image, self._size.width, self._size.height) for image in images])
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=self._is_fast):
            logits: Tensor = calibrated(self._network(in_unit_range(batch)).float())
        return np.ascontiguousarray(logits.permute(0, 2, 3, 1).numpy())

    def paint(self, points: Floats, logits: Floats) -> Floats:
        """(N, 4) scores of points (N, >= 3), from the logits (C, H, W, classes) of one image of each camera."""
        return painted(points, logits, self._views)


def segmentation_of(weights: Weights) -> nn.Module:
    """The trained network, in evaluation mode.

    Raises:
        ConfigError: the weights are another stage's.
    """
    if weights.stage != "segmentation":
        raise ConfigError(f"painting needs weights of stage 'segmentation', these are of {weights.stage!r}.")
    network = make_segmentation(weights.config.segmentation)
    network.load_state_dict(dict(weights.tensors))
    folded(network.eval())
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def folded(network: nn.Module) -> None:
    """Puts normalisations into the convolutions before them, in place: the same answers in less time."""
    for part in network.children():
        if isinstance(part, nn.Sequential) and len(part) > 1 and isinstance(part[0], nn.Conv2d):
            if isinstance(part[1], nn.BatchNorm2d):
                part[0], part[1] = fuse_conv_bn_eval(part[0], part[1]), nn.Identity()
        else:
            folded(part)


def views_of(
    suite: Sequence[Mapping[str, Any]], cameras: Sequence[str], lidar: str, size: CameraConfig
) -> NDArray[np.float64]:
    """(C, 9) how each camera looks, for `painted`.

    A row is the place in the LiDAR's frame (3) [m], cosine and sine of the yaw, focal lengths right and down [px], and
    the middle column and row [px], for images of `size`.

    Raises:
        ConfigError: the suite has no such sensor, or one that is tilted.
    """
    mounts = {str(values["id"]).upper(): values for values in suite}
    missing = [name for name in (*cameras, lidar) if name.upper() not in mounts]
    if missing:
        raise ConfigError(f"there is no sensor {missing[0]!r} to paint points with.")
    origin = mounts[lidar.upper()]
    return np.array([_view(mounts[name.upper()], origin, size) for name in cameras])


def _view(camera: Mapping[str, Any], origin: Mapping[str, Any], size: CameraConfig) -> list[float]:
    for values in (camera, origin):
        if any(values.get(key, 0.0) for key in ("pitch", "roll")):
            raise ConfigError(f"sensor {values['id']!r} is tilted; points are painted for level sensors only.")
    turn = math.radians(origin.get("yaw", 0.0))
    ahead, right = camera["x"] - origin["x"], camera["y"] - origin["y"]
    yaw = math.radians(camera["yaw"]) - turn
    focal = camera["width"] / (2.0 * math.tan(math.radians(camera["fov"]) / 2.0))
    return [
        ahead * math.cos(turn) + right * math.sin(turn),
        right * math.cos(turn) - ahead * math.sin(turn),
        camera["z"] - origin["z"],
        math.cos(yaw),
        math.sin(yaw),
        focal * size.width / camera["width"],
        focal * size.height / camera["height"],
        size.width / 2.0,
        size.height / 2.0,
    ]


def painted(points: Floats, logits: Floats, views: NDArray[np.float64]) -> Floats:
    """Scores of points: of each class the softmax at the point's pixel, times one minus the background's.

    Args:
        points: (N, >= 3) [m] in the LiDAR's frame.
        logits: (C, H, W, classes), the background first.
        views: (C, 9) of `views_of`.

    Returns:
        (N, classes - 1), zeros for a point that no camera sees.
    """
    scores = np.zeros((len(points), logits.shape[-1] - 1), np.float32)
    _paint(np.ascontiguousarray(points), np.ascontiguousarray(logits), views, scores)
    return scores


def certain(classes: NDArray[np.integer], count: int = len(CLASSES)) -> Floats:
    """(..., count) logits that leave no doubt about classes (...)."""
    return np.where(classes[..., None] == np.arange(count), np.float32(80.0), np.float32(0.0)).astype(np.float32)


@kernel
def _paint(points, logits, views, scores):  # type: ignore[no-untyped-def]
    cameras, height, width, classes = logits.shape
    for n in range(len(points)):
        for camera in range(cameras - 1, -1, -1):
            view = views[camera]
            ahead, right = points[n, 0] - view[0], points[n, 1] - view[1]
            depth = ahead * view[3] + right * view[4]
            if depth <= _NEAREST:
                continue
            u = view[5] * (right * view[3] - ahead * view[4]) / depth + view[7]
            v = view[6] * (view[2] - points[n, 2]) / depth + view[8]
            if not (0.0 <= u < width and 0.0 <= v < height):
                continue
            pixel = logits[camera, int(v), int(u)]
            top = pixel.max()
            total = np.float32(0.0)
            for k in range(classes):
                total += np.exp(pixel[k] - top)
            shown = np.float32(1.0) - np.exp(pixel[0] - top) / total
            for k in range(1, classes):
                scores[n, k - 1] = np.exp(pixel[k] - top) / total * shown
            break
