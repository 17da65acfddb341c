"""What the sensors' agent sees at a tick: painted points, boxes, the map, motions, and whether to brake.

Networks run on one thread, convolutions in bfloat16 where the processor multiplies it. Those of fixed sizes are traced
once and frozen, which saves a quarter of their time.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.lav.bodies import body_points, with_body, without_poles
from agents.lav.config import DriveConfig, LavConfig
from agents.lav.data.images import as_batch, far_view, shrunk
from agents.lav.data.points import SCORES, thinned
from agents.lav.devices import has_bfloat16
from agents.lav.halting import Told
from agents.lav.models.backbone import Seen
from agents.lav.models.brake import BrakeNetwork, causes_of, stop_of, telephoto_size
from agents.lav.models.detection import PEDESTRIAN, VEHICLE, Detections, decode, without_ego
from agents.lav.models.student import Student
from agents.lav.models.teacher import Motions
from agents.lav.painting import Painter
from agents.lav.weights import Weights, read_weights, stage_file
from lavsim.errors import ConfigError
from lavsim.sensors.suites import SUITES

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

TRAINED = Path(__file__).parent / "trained"
SUITE = SUITES["lav"]
CAMERAS, TELEPHOTO, LIDAR = ("RGB_0", "RGB_1", "RGB_2"), "TEL_RGB", "LIDAR"
LIDAR_HEIGHT = float(next(sensor["z"] for sensor in SUITE if sensor["id"] == LIDAR))  # [m] over the ground
_MOST_FOUND = 20
_SIZES = {"segmentation": ("cameras", "segmentation"), "brake": ("cameras",)}


@dataclass(frozen=True)
class Trained:
    """What drives.

    Attributes:
        student: Of the stage `full`.
        segmentation: None where points are not painted.
        brake: Of the stage `brake`.
    """

    student: Weights
    segmentation: Weights | None
    brake: Weights


def read_trained(path: str | Path | None) -> Trained:
    """The weights that drive.

    Args:
        path: The folder of a training, the file of a student's weights (segmentation and brake network are then those
            that ship), or None for those that ship.

    Raises:
        ConfigError: a file is missing, of another stage, or of other sizes than the student's.
    """
    given = Path(path) if path else TRAINED / "full-tiny.safetensors"
    folder = given if given.is_dir() else None
    student = _of_stage(stage_file(folder, "full") if folder else given, "full")

    def beside(stage: str) -> Weights:
        shipped = TRAINED / f"{stage}-{student.config.name}.safetensors"
        found = _of_stage(stage_file(folder, stage) if folder else shipped, stage)
        for name in _SIZES[stage]:
            if getattr(found.config, name) != getattr(student.config, name):
                raise ConfigError(
                    f"the weights of {stage!r} are of preset {found.config.name!r}, the student's of "
                    f"{student.config.name!r}: their {name} differ."
                )
        return found

    return Trained(student, beside("segmentation") if student.config.painted else None, beside("brake"))


def _of_stage(path: Path, stage: str) -> Weights:
    weights = read_weights(path)
    if weights.stage != stage:
        raise ConfigError(f"{path.name} has weights of stage {weights.stage!r}, not {stage!r}.")
    return weights


class Sight(NamedTuple):
    """What is seen at a tick, in the planner frame.

    Attributes:
        features: (1, F, H / 2, W / 2) that motions are read from.
        vehicles, walkers: Who is found, best first; the ego is not.
        map: (3, H, W) logits of road, solid and broken marks.
        points: (P, F) what the networks were given, [m] in the vehicle's frame.
    """

    features: Tensor
    vehicles: Detections
    walkers: Detections
    map: Tensor
    points: Floats


class Perceiver:
    """The networks of an agent.

    Args:
        trained: Their weights.
        drive: How sure detections must be; the weights' own if None.
    """

    def __init__(self, trained: Trained, drive: DriveConfig | None = None) -> None:
        own = trained.student.config
        self.config: LavConfig = own.model_copy(update={"drive": drive or own.drive})
        self._is_fast = has_bfloat16("cpu")
        self._student = _loaded(Student(self.config), trained.student)
        self._painter = Painter(trained.segmentation, SUITE, CAMERAS) if trained.segmentation else None
        grid, cameras = self.config.grid, trained.brake.config.cameras
        self._brake_config = trained.brake.config
        channels = self._student.perception.pillars.channels
        self._backbone = self._frozen(self._student.perception.backbone, torch.zeros(1, channels, grid.rows, grid.cols))
        self._brake = self._frozen(
            _loaded(BrakeNetwork(trained.brake.config), trained.brake),
            torch.zeros(1, 3, cameras.height, 3 * cameras.width),
            torch.zeros(1, 3, *telephoto_size(trained.brake.config)),
        )

    def paint(self, points: Floats, images: Sequence[Bytes]) -> Floats:
        """(P, 8) points (P, 4) of the LiDAR's with the scores of three images; as they are where they are not painted.

        Only those within the grid are kept, and no more than the networks take.
        """
        points = thinned(points, self.config)
        if self._painter is None:
            return points
        scores = self._painter.paint(points, self._painter.classes(images))
        assert scores.shape[1] == SCORES
        return np.concatenate([points, scores], axis=1)

    def see(self, points: Floats) -> Sight:
        """What is seen in points (P, F)."""
        drive = self.config.drive
        with torch.inference_mode(), self._precision():
            scan = torch.from_numpy(points)
            image = self._student.perception.pillars(scan, torch.zeros(len(scan), dtype=torch.long), 1)
            seen = Seen(*(part.float() for part in self._backbone(image.float())))
            least = min(drive.detection_score, drive.doubtful_score)
            vehicles, walkers = (
                decode(seen, self.config.grid, kind, _MOST_FOUND, score)[0]
                for kind, score in ((VEHICLE, least), (PEDESTRIAN, drive.walker_score))
            )
        body = body_points(points, LIDAR_HEIGHT)
        vehicles, walkers = (with_body(found, body) for found in (without_ego(vehicles), walkers))
        walkers = without_poles(walkers, points, LIDAR_HEIGHT)
        return Sight(seen.features, vehicles, walkers, seen.map[0], points)

    def foresee(self, features: Tensor, poses: Tensor, goals: Tensor, speeds: Tensor) -> Motions:
        """Motions of the vehicles at poses (1, R, 3); the rest as `MotionNetwork`'s."""
        with torch.inference_mode(), self._precision():
            motions: Motions = self._student.motion(features, poses, goals, speeds)
        return Motions(*(part.float() for part in motions))

    def brake(self, images: Sequence[Bytes], telephoto: Bytes) -> Told:
        """Whether to stop, and for what, as far as the network tells."""
        size = self._brake_config.cameras
        wide = np.concatenate([shrunk(image, size.width, size.height) for image in images], axis=1)
        far = far_view(telephoto, self._brake_config)
        with torch.inference_mode():
            outputs: Tensor = self._brake(*(as_batch([image]).float() / 255.0 for image in (wide, far))).float()
            stop = float(torch.sigmoid(stop_of(outputs))[0])
            if outputs.ndim == 1:
                return Told(stop)
            causes = causes_of(outputs)
            _, red, yellow, green = torch.softmax(causes.light[0], dim=0).tolist()
            sign, others = (float(torch.sigmoid(logit)[0]) for logit in (causes.sign, causes.others))
            return Told(stop, red, yellow, sign, others, float(causes.distance[0]), green, tells_causes=True)

    def _precision(self, cache: bool = True) -> Any:
        return torch.autocast("cpu", torch.bfloat16, enabled=self._is_fast, cache_enabled=cache)

    def _frozen(self, network: nn.Module, *inputs: Tensor) -> Any:
        given = tuple(part.contiguous(memory_format=torch.channels_last) for part in inputs)
        with torch.no_grad(), self._precision(cache=False), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of tracing itself, which PyTorch replaces by what is slower here
            return torch.jit.freeze(torch.jit.trace(network, given, strict=False, check_trace=False))


def _loaded(network: Any, weights: Weights) -> Any:
    network.load_state_dict(dict(weights.tensors))
    return network.eval().requires_grad_(False).to(memory_format=torch.channels_last)
