"""The student learns the teacher's motions from points, end to end (paper, section 3.3; reference `lav.md` 5.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from agents.lav.batches import Batch, draw_batch, plain_batch, worth_learning
from agents.lav.config import LavConfig
from agents.lav.data.painted import painted_scores
from agents.lav.data.points import turned
from agents.lav.data.show import SHOWN, sheet
from agents.lav.labels import MotionSamples, read_motions
from agents.lav.models.motion import chosen, path_loss
from agents.lav.models.student import Driven, Student
from agents.lav.models.teacher import MotionNetwork, Motions, make_teacher
from agents.lav.motion_measures import measures_with
from agents.lav.plan_pictures import plan_picture
from agents.lav.stages.base import STAGES, Stage, StageInput, StepContext, TrainConfig
from agents.lav.stages.bev import COMMAND_WEIGHT, DRIVEN_SHARE, OTHERS_WEIGHT, TURN_WEIGHT, teacher_loss
from agents.lav.stages.perception import Scene, SceneReader, perception_loss
from agents.lav.stages.perception import measures_of as perception_measures
from lavsim.dataset.reader import Dataset
from lavsim.dataset.windows import Windows
from lavsim.random import Draws

# The ego's window stands askew in what the student sees by up to this; small angles are commoner.
ASKEW = np.radians(20.0)
_CHUNK = 32  # of the measures
_STRIDE = 2  # of frames on which perception is measured again


class Lesson(NamedTuple):
    """What the student sees, and what the teacher sees of it.

    Attributes:
        scene: Frames of a turned world.
        motions: In the world as it is.
        poses: (B, R, 3) of the windows in the moved and turned world.
    """

    scene: Scene
    motions: Batch
    poses: Tensor


@STAGES.register("full")
class FullStage(Stage):
    """All six branches as the teacher has them, for the ego and for others, while perception goes on learning."""

    parents: ClassVar[Sequence[str]] = ("painting", "perception", "bev")
    defaults: ClassVar[TrainConfig] = TrainConfig(
        batch=16, epochs=3.0, learning_rate=1e-3, average=0.995, precision="auto"
    )

    def __init__(self, given: StageInput) -> None:
        torch.manual_seed(given.train.seed)
        self._config, scheme = given.config, given.config.training
        student = Student(given.config)
        if scheme.perception == "staged":
            student.perception.load_state_dict(given.parents["perception"].tensors)
        self.network = student.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._teacher = _teacher(given) if scheme.distillation else None
        self._seen = _Lessons(given, given.data)
        self._chosen = worth_learning(self._seen.samples, Draws.of_seed(given.train.seed).stream("windows"))
        self._unseen = _Lessons(given, given.validation) if given.validation is not None else None

    @classmethod
    def needs(cls, config: LavConfig) -> Sequence[str]:
        scheme = config.training
        asked = {
            "painting": config.painted and scheme.painting == "network",
            "perception": scheme.perception == "staged",
            "bev": scheme.distillation,
        }
        return [parent for parent in cls.parents if asked[parent]]

    def __len__(self) -> int:
        return len(self._chosen)

    def load(self, samples: NDArray[np.int64], draws: Draws) -> Lesson:
        return self._seen.drawn(self._chosen[samples], draws)

    def loss(self, batch: Lesson, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        scheme, motions = self._config.training, batch.motions
        driven: Driven = self.network(
            batch.scene.points, batch.scene.frame, batch.poses, motions.goals, motions.speeds, motions.is_real
        )
        if self._teacher is None:
            loss, parts = teacher_loss(driven.motions, motions, context.progress, scheme.others)
        else:
            self._teacher.to(context.device)
            with torch.no_grad():
                taught = self._teacher(motions.images, motions.poses, motions.goals, motions.speeds, motions.is_real)
            loss, parts = distillation_loss(driven.motions, taught, motions, scheme.others)
        seen, more = perception_loss(driven.seen, batch.scene, self._config)
        return loss + seen * (scheme.perception != "none"), parts | more

    def measure(self) -> dict[str, float]:
        if self._unseen is None:
            return {}
        return self._unseen.measures(self.network)

    def pictures(self) -> Mapping[str, NDArray[np.uint8]]:
        if self._unseen is None:
            return {}
        samples = self._unseen.samples
        moving = np.flatnonzero(samples.speed > 1.0)
        chosen = moving[((np.arange(SHOWN) + 0.5) * len(moving) / SHOWN).astype(int)] if len(moving) else moving
        cells = [self._unseen.picture(self.network, int(number)) for number in chosen]
        return {"unseen": sheet(cells, columns=4)} if cells else {}


class _Lessons:
    """Frames of a dataset with their motions."""

    def __init__(self, given: StageInput, data: Dataset) -> None:
        self._config = given.config
        self._reader = SceneReader(data, given.config, painted_scores(given, data))
        self._windows = Windows(list(data.episodes.values()), given.config.motion.waypoints)
        self.samples: MotionSamples = read_motions(data, given.config)

    def drawn(self, samples: NDArray[np.int64], draws: Draws) -> Lesson:
        """Samples under one draw: windows jittered, and the student's world moved and turned so that the ego's window
        lies where it does when it drives, and about straight."""
        motions = draw_batch(self.samples, samples, draws)
        unit = draws.stream("askew").uniform(0, 2 * len(samples), -1.0, 1.0).reshape(2, -1)
        angles = ASKEW * unit[0] * np.abs(unit[1]) - motions.poses[:, 0, 2].numpy()
        return self._lesson(samples, motions, angles.astype(np.float64), draws)

    def plain(self, samples: NDArray[np.int64], motions: Batch) -> Lesson:
        """Samples as they are."""
        return self._lesson(samples, motions, np.zeros(len(samples)), None)

    def measures(self, network: Any) -> dict[str, float]:
        """Of motions at true poses, and of perception."""
        device = next(network.parameters()).device

        def foresee(samples: NDArray[np.int64], motions: Batch) -> Motions:
            driven = _driven(network, self.plain(samples, motions), device)
            return Motions(*(value.cpu() for value in driven.motions))

        found = measures_with(foresee, self.samples, _CHUNK)
        data = self._reader.data
        places = [data.locate(number) for number in range(0, len(data), _STRIDE)]
        return found | {
            name: value for name, value in perception_measures(network.perception, self._reader, places).items()
            if name != "frames"
        }  # fmt: skip

    def picture(self, network: Any, number: int) -> NDArray[np.uint8]:
        """What the network makes of a window."""
        device = next(network.parameters()).device
        motions = plain_batch(self.samples, np.array([number]))
        lesson = self.plain(np.array([number]), motions)
        return plan_picture(_driven(network, lesson, device), lesson.scene, motions, self._config)

    def _lesson(
        self, samples: NDArray[np.int64], motions: Batch, angles: NDArray[np.float64], draws: Draws | None
    ) -> Lesson:
        places = [self._windows[int(number)] for number in samples]
        rights = motions.poses[:, 0, 0].numpy().astype(np.float64)
        scene = self._reader.scene(places, angles, draws, rights)
        poses = motions.poses.numpy().copy()
        for pose, angle, right in zip(poses, angles.tolist(), rights.tolist(), strict=True):
            pose[:, :2] = turned(pose[:, :2] - [right, 0.0], angle)
            pose[:, 2] += angle
        return Lesson(scene, motions, torch.from_numpy(poses))


def distillation_loss(
    motions: Motions, taught: Motions, batch: Batch, with_others: bool = True
) -> tuple[Tensor, dict[str, float]]:
    """How far the student's motions are from the teacher's: all branches, all refinements, of everybody.

    The commanded branch counts as much as all; all are refined towards the teacher's last plan of the command, as in
    the paper's leaderboard entry.

    Args:
        motions: The student's.
        taught: The teacher's.
        batch: Of which vehicles are real, and of commands: turns are rare, and weigh more.
        with_others: Whether others are learnt from.
    """
    weight = torch.tensor(TURN_WEIGHT, device=batch.commands.device)[batch.commands]
    ego = _driven_first(motions.coarse[:, 0], taught.coarse[:, 0], batch.commands)
    if motions.refined.shape[1]:
        wanted = taught.refined[:, -1] if taught.refined.shape[1] else taught.coarse[:, 0]
        wanted = chosen(wanted, batch.commands)[:, None, None].expand_as(motions.refined)
        ego = ego + _driven_first(motions.refined, wanted, batch.commands)
    ego = (ego * weight).sum() / weight.sum()
    likely = functional.binary_cross_entropy_with_logits(
        motions.commands, torch.sigmoid(taught.commands), reduction="none"
    ).mean(dim=-1)
    real = batch.is_real.to(ego.dtype)
    theirs = real.clone()
    theirs[:, 0] = 0.0
    each = path_loss(motions.coarse, taught.coarse).mean(dim=-1)
    others = (each * theirs).sum() / theirs.sum().clamp(min=1.0)
    counted = real if with_others else real - theirs
    command = (likely * counted).sum() / counted.sum()
    total = ego + OTHERS_WEIGHT * others * with_others + COMMAND_WEIGHT * command
    return total, {"ego": ego.item(), "others": others.item(), "command": command.item()}


def _driven_first(paths: Tensor, taught: Tensor, commands: Tensor) -> Tensor:
    """(B,) errors of paths (B, ..., 6, T, 2) over all branches, and as much again of the commanded one."""
    every = path_loss(paths, taught).flatten(1).mean(dim=1)
    driven = path_loss(chosen(paths, commands), chosen(taught, commands)).reshape(len(paths), -1).mean(dim=1)
    return (1.0 - DRIVEN_SHARE) * every + DRIVEN_SHARE * driven


def _driven(network: Any, lesson: Lesson, device: torch.device) -> Driven:
    scene, motions = lesson.scene, lesson.motions
    driven: Driven = network(
        scene.points.to(device), scene.frame.to(device), lesson.poses.to(device), motions.goals.to(device),
        motions.speeds.to(device), motions.is_real.to(device),
    )  # fmt: skip
    return driven


def _teacher(given: StageInput) -> MotionNetwork:
    """The teacher, which learns no more."""
    teacher = make_teacher(given.config)
    teacher.load_state_dict(given.parents["bev"].tensors)
    return teacher.eval().requires_grad_(False)
