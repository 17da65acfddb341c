"""Where a stage finds the scores that painting wrote."""

from __future__ import annotations

from agents.lav.data.points import Scores
from agents.lav.data.true_paint import TrueScores
from agents.lav.painted import PaintedScores
from agents.lav.stages.base import StageInput
from lavsim.dataset.reader import Dataset


def painted_scores(given: StageInput, data: Dataset) -> Scores | None:
    """The scores of a dataset's points; None where points are not painted."""
    if not given.config.painted:
        return None
    if given.config.training.painting == "truth":
        return TrueScores(data)
    return PaintedScores(given.folders["painting"], data)
