"""Perception learns boxes and the map from painted points (paper, section 3.2; reference `lav.md` 4.5, 4.6, 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.config import LavConfig
from agents.lav.data.painted import painted_scores
from agents.lav.data.pictures import FOUND, TRUTH, draw_boxes, draw_points, map_picture
from agents.lav.data.points import Scores, scan_points
from agents.lav.data.scenes import actors_of, turned_map
from agents.lav.data.show import SHOWN, sheet, unseen_frames
from agents.lav.data.windows import bev_config
from agents.lav.metrics import AveragePrecision, IntersectionOverUnion, match_centres
from agents.lav.models.backbone import Seen
from agents.lav.models.detection import (
    PEDESTRIAN,
    VEHICLE,
    Detections,
    decode,
    detection_labels,
    detection_loss,
    map_loss,
    without_ego,
)
from agents.lav.models.student import Perception
from agents.lav.stages.base import STAGES, Stage, StageInput, StepContext, TrainConfig
from lavsim.dataset.reader import Dataset
from lavsim.errors import ConfigError
from lavsim.random import Draws

TURN = np.radians(30.0)  # the world is turned about the ego by up to this
MAP = ("road", "solid", "broken")
_STANDING, _STANDING_KEPT = 0.1, 4  # [m/s]; of frames in which the ego stands, every so many
_MEASURED_RANGE, _MEASURED_HITS = 30.0, 5  # [m], points: of actors that must be found
_LEAST_SCORE, _MOST_FOUND, _SHOWN_SCORE = 0.05, 50, 0.3
_BATCH = 16  # of the measures


class Scene(NamedTuple):
    """Frames as perception takes them.

    Attributes:
        points: (P, F) of all frames together.
        frame: (P,) the frame of each.
        boxes: (B, A, 5) in the planner frame.
        kinds: (B, A).
        hits: (B, A).
        map: (B, 4, H, W) uint8: road, solid, broken, known.
    """

    points: Tensor
    frame: Tensor
    boxes: Tensor
    kinds: Tensor
    hits: Tensor
    map: Tensor


@STAGES.register("perception")
class PerceptionStage(Stage):
    """Where vehicles and walkers are, how large and which way they head, and road and marks."""

    parents: ClassVar[Sequence[str]] = ("painting",)
    defaults: ClassVar[TrainConfig] = TrainConfig(
        batch=16, epochs=2.0, learning_rate=1e-3, average=0.995, precision="auto"
    )
    sizes: ClassVar[Sequence[str]] = ("grid", "pillars", "painted", "backbone", "temporal", "training.painting")

    def __init__(self, given: StageInput) -> None:
        torch.manual_seed(given.train.seed)
        self._config = given.config
        network = Perception(given.config)
        self.network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._frames = SceneReader(given.data, given.config, painted_scores(given, given.data))
        self._kept = moving_frames(given.data)
        self._unseen = (
            SceneReader(given.validation, given.config, painted_scores(given, given.validation))
            if given.validation is not None
            else None
        )
        if not len(self._kept):
            raise ConfigError(f"{given.data.root.name} holds no frame to learn from.")

    @classmethod
    def needs(cls, config: LavConfig) -> Sequence[str]:
        return cls.parents if config.painted and config.training.painting == "network" else ()

    def __len__(self) -> int:
        return len(self._kept)

    def load(self, samples: NDArray[np.int64], draws: Draws) -> Scene:
        angles = draws.stream("turn").uniform(0, len(samples), -TURN, TURN)
        places = [(int(episode), int(frame)) for episode, frame in self._kept[samples]]
        return self._frames.scene(places, angles, draws)

    def loss(self, batch: Scene, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        return perception_loss(self.network(batch.points, batch.frame, len(batch.boxes)), batch, self._config)

    def measure(self) -> dict[str, float]:
        if self._unseen is None:
            return {}
        data = self._unseen.data
        return measures_of(self.network, self._unseen, [data.locate(number) for number in range(len(data))])

    def pictures(self) -> Mapping[str, NDArray[np.uint8]]:
        if self._unseen is None:
            return {}
        cells = [picture_of(self.network, self._unseen, place) for place in unseen_frames(self._unseen.data, SHOWN)]
        return {"unseen": sheet(cells, columns=4)}


class SceneReader:
    """Reads frames of a dataset as perception takes them.

    Args:
        data: The dataset.
        config: Sizes.
        scores: What its points are painted with, or None.

    Raises:
        ConfigError: it has no picture from above.
    """

    def __init__(self, data: Dataset, config: LavConfig, scores: Scores | None) -> None:
        self.data, self.config = data, config
        self._scores, self._bev = scores, bev_config(data)

    def scene(
        self,
        places: Sequence[tuple[int, int]],
        angles: NDArray[np.float64] | None = None,
        draws: Draws | None = None,
        rights: NDArray[np.float64] | None = None,
    ) -> Scene:
        """Frames at (episode, frame), each seen from so far right of the ego [m] and then turned by its angle; without
        draws nothing is left to chance."""
        turns = np.zeros(len(places)) if angles is None else angles
        aside = np.zeros(len(places)) if rights is None else rights
        moves = zip(places, turns.tolist(), aside.tolist(), strict=True)
        points, maps, actors = [], [], []
        for number, ((episode, frame), angle, right) in enumerate(moves):
            own = draws.stream("sample", number) if draws is not None else None
            points.append(scan_points(self.data, episode, frame, self.config, self._scores, angle, own, right))
            layers = self.data.read(episode, frame, ["bev"])["bev"]
            maps.append(turned_map(layers, self._bev, self.config.grid, angle, right))
            actors.append(actors_of(self.data.table(episode), frame, angle, right))
        frame_of = np.repeat(np.arange(len(places)), [len(part) for part in points])
        boxes, kinds, hits = (torch.from_numpy(np.stack(part)) for part in zip(*actors, strict=True))
        scan, seen = torch.from_numpy(np.concatenate(points)), torch.from_numpy(np.stack(maps))
        return Scene(scan, torch.from_numpy(frame_of), boxes, kinds, hits, seen)


def moving_frames(data: Dataset) -> NDArray[np.int64]:
    """(N, 2) episode and frame of what is worth learning from: a frame of a standing ego looks like the one before."""
    found = []
    for episode, record in data.episodes.items():
        if not record.frames:
            continue
        standing = np.abs(data.table(episode)["speed"]) < _STANDING
        kept = np.flatnonzero(~standing | (np.arange(record.frames) % _STANDING_KEPT == 0))
        found.append(np.column_stack([np.full(len(kept), episode), kept]))
    return np.concatenate(found) if found else np.zeros((0, 2), np.int64)


def perception_loss(seen: Seen, scene: Scene, config: LavConfig) -> tuple[Tensor, dict[str, float]]:
    """Detection's and the map's loss, and both."""
    labels = detection_labels(scene.boxes, scene.kinds, config.grid, config.backbone, scene.hits)
    balanced, kind = config.training.balanced, seen.map.dtype
    detection = detection_loss(seen, labels, balanced)
    layers = map_loss(seen.map, scene.map[:, :3].to(kind), scene.map[:, 3].to(kind), balanced)
    return detection + layers, {"detection": detection.item(), "map": layers.item()}


def measures_of(network: torch.nn.Module, reader: SceneReader, places: Sequence[tuple[int, int]]) -> dict[str, float]:
    """Average precisions at 2 m of what has 5 points within 30 m, without the ego; unions of the map's layers."""
    device = next(network.parameters()).device
    precisions = {VEHICLE: AveragePrecision(), PEDESTRIAN: AveragePrecision()}
    unions = IntersectionOverUnion(MAP)
    for begin in range(0, len(places), _BATCH):
        scene = reader.scene(places[begin : begin + _BATCH])
        seen = network(scene.points.to(device), scene.frame.to(device), len(scene.boxes))
        layers = scene.map.numpy().astype(bool)
        unions.add((seen.map > 0.0).cpu().numpy(), layers[:, :3], layers[:, 3])
        for kind, precision in precisions.items():
            found = decode(seen, reader.config.grid, kind, _MOST_FOUND, _LEAST_SCORE)
            for number, detections in enumerate(found):
                _add_frame(precision, without_ego(detections), scene, number, kind, reader.config)
    measures = {
        "vehicle_ap": precisions[VEHICLE].value(),
        "pedestrian_ap": precisions[PEDESTRIAN].value(),
        "vehicles": float(precisions[VEHICLE].asked),
        "pedestrians": float(precisions[PEDESTRIAN].asked),
        **{f"{layer}_iou": value for layer, value in unions.values().items()},
        "frames": float(len(places)),
    }
    return {name: value for name, value in measures.items() if not np.isnan(value)}  # what nothing was asked of


def _add_frame(
    precision: AveragePrecision, found: Detections, scene: Scene, number: int, kind: int, config: LavConfig
) -> None:
    """A frame's detections of one kind; those beyond the range count only if they hit what is asked for."""
    grid = config.grid
    own = scene.kinds[number].numpy() == kind
    own[0] = False
    truth, hits = scene.boxes[number].numpy()[own, :2], scene.hits[number].numpy()[own]
    inside = (np.abs(truth[:, 0]) < grid.aside) & (truth[:, 1] > -grid.ahead) & (truth[:, 1] < grid.behind)
    asked = inside & (np.hypot(*truth.T) <= _MEASURED_RANGE) & (hits >= _MEASURED_HITS)
    centres, scores = found.boxes[:, :2].cpu().numpy(), found.scores.cpu().numpy()
    verdicts = match_centres(centres, truth, asked)
    near = (np.hypot(*centres.T) <= _MEASURED_RANGE) | (verdicts == 1)
    precision.add(scores[near], verdicts[near], int(asked.sum()))


def picture_of(network: torch.nn.Module, reader: SceneReader, place: tuple[int, int]) -> NDArray[np.uint8]:
    """What the network sees in a frame (boxes found in red over the map it found), over the truth below it."""
    device = next(network.parameters()).device
    scene, grid = reader.scene([place]), reader.config.grid
    seen = network(scene.points.to(device), scene.frame.to(device), 1)
    views = [map_picture((seen.map[0] > 0.0).cpu().numpy(), grid), map_picture(scene.map[0, :3].numpy() > 0, grid)]
    draw_points(views[1], scene.points.numpy(), grid)
    real = scene.boxes[0][(scene.kinds[0] >= 0) & (scene.hits[0] > 0)].numpy()
    for view in views:
        draw_boxes(view, real, grid, TRUTH)
    for kind in (VEHICLE, PEDESTRIAN):
        draw_boxes(views[0], decode(seen, grid, kind, least=_SHOWN_SCORE)[0].boxes.cpu().numpy(), grid, FOUND)
    return np.concatenate(views)
