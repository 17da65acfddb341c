"""Painting: points land on their own class, scores by hand, and the cache of a dataset's scores."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.config import CameraConfig, find_preset
from agents.lav.data.images import WIDE, WIDE_TAGS
from agents.lav.models.segmentation import classes_of_tags, make_segmentation
from agents.lav.painting import certain, folded, painted, segmentation_of, views_of
from agents.lav.weights import Weights
from lavsim.errors import ConfigError
from lavsim.random import Draws
from lavsim.sensors.base import make_sensor
from lavsim.sensors.suites import SUITES
from lavsim.types import ActorClass
from tests.scenes import street
from tests.snapshots import Body, snapshot_of

MICRO = find_preset("micro")
SUITE = SUITES["lav_data"]
VIEWS = views_of(SUITE, WIDE, "LIDAR", CameraConfig())
FULL = (5, 288, 256)


def test_points_land_on_their_own_class() -> None:
    """Of points whose pixel and its neighbours show one class, 99 % and more are painted with it."""
    walkers = [
        Body(100_000 + n, 8.0 + 5.0 * n, -3.0 + n, kind=ActorClass.WALKER, size=(0.5, 0.5, 1.8)) for n in range(3)
    ]
    cars = [Body(1000 + n, 9.0 + 9.0 * n, 3.0 * (-1) ** n, yaw=0.3 * n) for n in range(4)]
    behind = [Body(2000, -9.0, 2.0), Body(2001, -6.0, -7.0, yaw=1.0)]
    snapshot = snapshot_of([Body(1, 0.0, 0.0), *cars, *walkers, *behind])
    semantic = {"type": "sensor.lidar.ray_cast_semantic", "id": "truth", "x": 0.0, "y": 0.0, "z": 2.4, "yaw": 0.0}
    returns = make_sensor(semantic).read([snapshot], street(), Draws(1))
    sensors = {str(values["id"]).lower(): make_sensor(values) for values in SUITE}
    tags = np.stack([sensors[name].view.labels(snapshot, street())[0] for name in WIDE_TAGS])  # type: ignore[attr-defined]
    classes = classes_of_tags(torch.from_numpy(tags)).numpy()
    points = np.stack([returns[axis] for axis in "xyz"], axis=1)
    scores = painted(points, certain(classes), VIEWS)
    truth = classes_of_tags(torch.from_numpy(returns["ObjTag"].astype(np.uint8))).numpy()
    plain = np.stack([cv2.erode((image == value).astype(np.uint8), np.ones((3, 3))) for image in classes
                      for value in range(5)]).reshape(5, 5, *FULL[1:])  # fmt: skip
    inner = painted(points, certain(np.asarray(plain.any(axis=1), np.int64)), VIEWS)[:, 0] > 0.5
    told = np.where(scores.max(axis=1) > 0.5, scores.argmax(axis=1) + 1, 0)
    assert inner.sum() > 0.6 * len(points)
    assert (told == truth)[inner].mean() >= 0.99
    for value in range(1, 5):
        assert (truth[inner] == value).sum() > 20
        assert (told == truth)[inner & (truth == value)].mean() >= 0.97, value


@pytest.mark.parametrize(
    ("point", "camera", "row", "column"),
    [
        ((11.5, 0.0, 0.0), 2, 144, 128),  # straight ahead, at the cameras' height
        ((11.5, 1.0, 0.0), 2, 144, 148),  # 1 m to the right at 10 m: 20.48 px
        ((11.5, 0.0, -1.0), 2, 164, 128),  # below
        ((6.5, 5.0 * np.sqrt(3.0), 0.0), 3, 144, 128),  # along the camera that looks 60 degrees to the right
        ((-3.5, -5.0 * np.sqrt(3.0), 0.0), 0, 144, 128),  # 120 degrees to the left
        ((11.5, 10.0 * np.tan(np.radians(31.0)), 0.0), 3, 144, 14),  # where two cameras look the later one tells
    ],
)
def test_a_point_falls_on_the_pixel_that_geometry_tells(
    point: tuple[float, float, float], camera: int, row: int, column: int
) -> None:
    logits = np.zeros((*FULL, 5), np.float32)
    logits[..., 0] = 80.0
    rows, columns = slice(row - 1, row + 2), slice(column - 1, column + 2)
    logits[camera, rows, columns, 0], logits[camera, rows, columns, 4] = 0.0, 80.0
    found = painted(np.array([point], np.float32), logits, VIEWS)
    np.testing.assert_allclose(found, [[0.0, 0.0, 0.0, 1.0]], atol=1e-6)


@pytest.mark.parametrize("point", [(-10.0, 0.0, 0.0), (1.5, 0.0, -2.0), (3.0, 0.0, 5.0), (1.55, 0.0, 0.0)])
def test_a_point_that_no_camera_sees_gets_nothing(point: tuple[float, float, float]) -> None:
    logits = certain(np.full(FULL, 4, np.int64))
    assert painted(np.array([point], np.float32), logits, VIEWS).sum() == 0.0


def test_scores_are_probabilities_times_one_minus_the_background() -> None:
    probabilities = np.array([0.5, 0.1, 0.2, 0.15, 0.05])
    logits = np.broadcast_to(np.log(probabilities), (*FULL, 5)).astype(np.float32)
    found = painted(np.array([[11.5, 0.0, 0.0]], np.float32), logits, VIEWS)
    np.testing.assert_allclose(found[0], probabilities[1:] * 0.5, rtol=1e-5)


def test_views_follow_the_size_of_the_images() -> None:
    small = views_of(SUITE, WIDE, "LIDAR", MICRO.cameras)
    np.testing.assert_allclose(small[:, :5], VIEWS[:, :5])
    np.testing.assert_allclose(small[0, 5:] / VIEWS[0, 5:], [48 / 256, 48 / 288, 48 / 256, 48 / 288])


def test_tilted_and_missing_sensors_get_one_line() -> None:
    with pytest.raises(ConfigError, match="no sensor 'RGB_9'"):
        views_of(SUITE, ("RGB_9",), "LIDAR", CameraConfig())
    tilted = [{**values, "pitch": 5.0} for values in SUITE]
    with pytest.raises(ConfigError, match="tilted"):
        views_of(tilted, WIDE, "LIDAR", CameraConfig())
    with pytest.raises(ConfigError, match="of 'bev'"):
        segmentation_of(Weights("bev", MICRO, {}))


def test_normalisations_fold_into_convolutions() -> None:
    config = find_preset("micro")
    network = make_segmentation(config.segmentation)
    for part in network.modules():
        if isinstance(part, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(part.running_mean, -1.0, 1.0)
            torch.nn.init.uniform_(part.running_var, 0.5, 2.0)
    images = torch.rand(2, 3, 48, 48)
    before = network.eval()(images)
    folded(network)
    assert not any(isinstance(part, torch.nn.BatchNorm2d) for part in network.modules())
    assert torch.allclose(network(images), before, atol=1e-4)
