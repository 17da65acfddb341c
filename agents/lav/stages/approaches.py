"""Frames before traffic lights and stop signs for the brake network, rendered from the logs of what was recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import ClassVar

from agents.lav.data.arrays import FRONT
from agents.lav.data.images import FRONT_TAGS, TELEPHOTO, TELEPHOTO_TAGS, require_fields
from agents.lav.data.staged import write_episode
from agents.lav.painted import painted_folder
from agents.lav.stages.base import STAGES, Stage, StageInput

STAGED_NAMES = (*FRONT, TELEPHOTO, *FRONT_TAGS, TELEPHOTO_TAGS)
_MEASURED = 4  # frames to learn from for each one to measure on


@STAGES.register("approaches")
class ApproachesStage(Stage):
    """No training: moments of the logs are rendered again. Finished episodes are skipped, so it can be killed."""

    sizes: ClassVar[Sequence[str]] = ("training.approaches",)
    is_trained: ClassVar[bool] = False

    def __init__(self, given: StageInput) -> None:
        count = given.config.training.approaches
        self._sets = [(given.data, count)]
        if given.validation is not None:
            self._sets.append((given.validation, -(-count // _MEASURED)))
        for data, _ in self._sets:
            require_fields(data, STAGED_NAMES, "approaches")

    def __len__(self) -> int:
        return sum(count for _, count in self._sets)

    def run(self, folder: Path, on_share: Callable[[float], None]) -> dict[str, float]:
        done = 0
        for data, count in self._sets:
            episodes = [number for number, record in data.episodes.items() if record.frames]
            for place, episode in enumerate(episodes):
                frames = count * (place + 1) // len(episodes) - count * place // len(episodes)
                write_episode(painted_folder(folder, data), data, episode, frames, STAGED_NAMES)
                done += frames
                on_share(done / max(len(self), 1))
        return {"frames": float(done)}
