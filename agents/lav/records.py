"""What a training leaves beside its weights: a curve, TensorBoard's events, pictures, and its pace."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from torch.utils.tensorboard import SummaryWriter

from lavsim.errors import OutputError

CURVE, MEASURES, PACE, PICTURES, EVENTS = "curve.csv", "measures.json", "pace.json", "pictures", "tensorboard"
_EVERY = 10  # steps between TensorBoard's points


@dataclass(frozen=True)
class Pace:
    """How a training stands, for progress bars.

    Attributes:
        step, steps: Done and in all.
        loss: Of the last step.
        samples_per_s: Since this process began.
        waiting: Share of that time in which it waited for data.
        seconds: Spent so far, in killed processes too (up to their last checkpoint).
    """

    step: int
    steps: int
    loss: float
    samples_per_s: float
    waiting: float = 0.0
    seconds: float = 0.0


class Records:
    """Writes into a stage's folder; the curve holds nothing that differs from run to run.

    Args:
        folder: Of the stage.
        step: At which the training goes on: what was written behind it is forgotten.
    """

    def __init__(self, folder: Path, step: int) -> None:
        self._folder = folder
        if step:
            _cut_curve(folder / CURVE, step)
        else:
            (folder / CURVE).unlink(missing_ok=True)
        self._events = SummaryWriter(str(folder / EVENTS), purge_step=step + 1)

    def row(self, values: Mapping[str, float]) -> None:
        """A step."""
        _write_row(self._folder / CURVE, values)
        if int(values["step"]) % _EVERY == 0:
            for name, value in values.items():
                self._events.add_scalar(f"train/{name}", value, int(values["step"]))

    def pace(self, pace: Pace) -> None:
        """How fast it went."""
        (self._folder / PACE).write_text(json.dumps(asdict(pace), indent=1) + "\n")
        for name, value in (("samples_per_s", pace.samples_per_s), ("waiting", pace.waiting)):
            self._events.add_scalar(f"pace/{name}", value, pace.step)

    def shown(self, step: int, measures: Mapping[str, float], pictures: Mapping[str, NDArray[np.uint8]]) -> None:
        """Measures and pictures (H, W, 3), red first, of the network as it then was."""
        (self._folder / MEASURES).write_text(json.dumps(measures, indent=1, sort_keys=True) + "\n")
        for name, value in measures.items():
            self._events.add_scalar(f"unseen/{name}", value, step)
        for name, picture in pictures.items():
            self._events.add_image(name, picture, step, dataformats="HWC")
            path = self._folder / PICTURES / f"{name}.png"
            path.parent.mkdir(exist_ok=True)
            if not cv2.imwrite(str(path), np.ascontiguousarray(picture[..., ::-1])):
                raise OutputError(f"can't write {str(path)!r}.")

    def close(self) -> None:
        """Writes what is pending."""
        self._events.close()


class Watch:
    """Measures a training's pace.

    Args:
        folder: Where earlier processes left theirs.
        step: At which this one began.
        batch: Samples a step.
    """

    def __init__(self, folder: Path, step: int, batch: int) -> None:
        path = folder / PACE
        self._before = float(json.loads(path.read_text())["seconds"]) if step and path.exists() else 0.0
        self._step, self._batch = step, batch
        self._begun, self._waited = time.monotonic(), 0.0

    def next(self, batches: Iterator[Any]) -> Any:
        """The next batch; waiting for it counts."""
        since = time.monotonic()
        batch = next(batches)
        self._waited += time.monotonic() - since
        return batch

    def pace(self, step: int, steps: int, loss: float) -> Pace:
        """How it stands after `step` steps."""
        elapsed = max(time.monotonic() - self._begun, 1e-9)
        rate = (step - self._step) * self._batch / elapsed
        return Pace(step, steps, loss, rate, self._waited / elapsed, self._before + elapsed)


def _write_row(path: Path, row: Mapping[str, float]) -> None:
    is_new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        if is_new:
            writer.writerow(row)
        writer.writerow([repr(value) for value in row.values()])


def _cut_curve(path: Path, step: int) -> None:
    """Leaves the curve's first `step` rows."""
    if path.exists():
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        path.write_text("".join(lines[: step + 1]), encoding="utf-8")
