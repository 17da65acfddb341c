"""The paper's ablations as a list of trainings, and their scores as tables beside the paper's.

Who trains and who drives is the command's business (`lavsim ablate`). A row is a variant; a training is a variant with
a seed. Rows that change nothing of a preset (as K = 5 of one that has five refinements) are the same training.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from agents.lav.perceive import TRAINED
from agents.lav.records import MEASURES
from agents.lav.train import TrainTask, settings_of
from agents.lav.variants import VARIANTS, find_variant
from agents.lav.weights import read_weights
from lavsim.errors import UnknownName

FULL = "full"  # the variant that others are compared with, and take shared stages from
LAST = "full"  # the stage that no other needs
_EYES = ("segmentation", "brake")


@dataclass(frozen=True)
class Training:
    """One training and the drives of what it made.

    Attributes:
        variant: Its first name.
        seed: Of the training, and of the drives.
        task: What is trained.
    """

    variant: str
    seed: int
    task: TrainTask

    @property
    def runs(self) -> Path:
        """Folder of the drives."""
        return self.task.out / "runs"


@dataclass(frozen=True)
class Scores:
    """Of a variant, over its seeds.

    Attributes:
        score, completion: Mean of each seed's drives [%].
        difference, low, high: Driving score less that of the whole LAV on the same routes and seeds, and its interval.
        smallest: The smallest difference that so many drives could show.
    """

    score: Sequence[float]
    completion: Sequence[float]
    difference: float = math.nan
    low: float = math.nan
    high: float = math.nan
    smallest: float = math.inf


def tables_of(names: Sequence[str], rows: Sequence[str] = ()) -> dict[str, list[str]]:
    """Variants by table, of tables and variants called so; of all without a name.

    Raises:
        UnknownName: there is no such table or variant.
    """
    found: dict[str, list[str]] = {}
    for variant, entry in VARIANTS.items():
        found.setdefault(entry.row.split(":")[0], []).append(variant)
    for name in names:
        if name not in found:
            raise UnknownName("table", name, found)
    for name in rows:
        find_variant(name)
    chosen = {name: [row for row in found[name] if row in rows or not rows] for name in names or found}
    return {name: kept for name, kept in chosen.items() if kept}


def trainings_of(variants: Sequence[str], seeds: int, task: TrainTask) -> tuple[list[Training], dict[str, str]]:
    """Every training once, the whole LAV's of all seeds first, and which variant's training stands for each variant.

    Args:
        variants: Rows that are asked for.
        seeds: Trainings of each.
        task: What all have in common; `out` holds a folder for each, `shared` what none of them trains.

    Raises:
        ConfigError: a setting does not fit.
    """
    stands_for: dict[str, str] = {}
    seen: dict[str, str] = {}
    for name in dict.fromkeys([FULL, *variants]):
        settings = settings_of(replace(task, variant=name)).model_dump_json()
        stands_for[name] = seen.setdefault(settings, name)
    found = []
    for name in seen.values():
        for seed in range(seeds):
            shared = [*([] if name == FULL else [task.out / FULL / f"seed{seed}"]), *task.shared]
            found.append(Training(name, seed, replace(
                task, stage="all", variant=name, out=task.out / name / f"seed{seed}", shared=shared, resume=True,
                sets=(*task.sets, f"train.seed={seed}"),
            )))  # fmt: skip
    return found, stands_for


def shipped_eyes(folder: Path, preset: str) -> Path:
    """Lays the segmentation and the brake network that ship into `folder`, as a training would leave them.

    Raises:
        ConfigError: none ship for that preset.
    """
    for stage in _EYES:
        source = TRAINED / f"{stage}-{preset}.safetensors"
        measures = read_weights(source).lineage.get("measures", {})
        (folder / stage).mkdir(parents=True, exist_ok=True)
        (folder / stage / MEASURES).write_text(json.dumps(measures, indent=1, sort_keys=True) + "\n")
        shutil.copyfile(source, folder / stage / f"{stage}.safetensors")
    return folder


def table_text(title: str, rows: Mapping[str, Scores]) -> str:
    """A table in Markdown, ours beside the paper's (means and deviations of three runs on its two test towns)."""
    lines = [
        f"### {title}",
        "",
        "| variant | driving score | route completion | less than the whole LAV (95 %) | could be shown "
        "| paper's score | paper's completion |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, scores in rows.items():
        paper = VARIANTS[name]
        beside = "" if math.isnan(scores.difference) else (
            f"{-scores.difference:.1f} ({-scores.high:.1f} to {-scores.low:.1f})"
        )  # fmt: skip
        smallest = f"{scores.smallest:.1f}" if math.isfinite(scores.smallest) else "-"
        lines.append(
            f"| {paper.row.partition(': ')[2]} | {_spread(scores.score)} | {_spread(scores.completion)} | {beside} "
            f"| {smallest} | {paper.score:.2f} | {paper.completion:.2f} |"
        )
    return "\n".join(lines) + "\n"


def _spread(values: Sequence[float]) -> str:
    mean = f"{np.mean(values):.2f}"
    return f"{mean} ± {np.std(values, ddof=1):.2f}" if len(values) > 1 else mean
