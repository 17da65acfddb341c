"""The pictures of criteria: each shows what its criterion says."""

from __future__ import annotations

import pytest

from benchmarks.criteria_pictures import BAND, SIZE, draw
from benchmarks.criteria_places import judge
from benchmarks.criteria_stages import STAGES
from leaderboard.criteria.base import CRITERIA
from leaderboard.rules import RULES


def test_every_criterion_has_its_stage() -> None:
    assert set(STAGES) == set(map(str, CRITERIA))


@pytest.mark.parametrize("name", STAGES)
def test_the_left_is_spared_and_the_right_is_charged(name: str) -> None:
    stage = STAGES[name]()
    assert set(CRITERIA[name].applies) & set(RULES[stage.rules].lineage)
    assert [panel.fires for panel in stage.panels] == [False, True]
    for panel in stage.panels:
        assert judge(name, stage.rules, panel)[0] == panel.earlier + panel.fires, panel.says


def test_a_picture_has_both_panels_below_their_words() -> None:
    image = draw("collision")
    assert image.shape[0] == SIZE[1] + BAND
    assert image.shape[1] > 2 * SIZE[0]
    green, red = image[2, 2].tolist(), image[2, -3].tolist()
    assert green[1] == max(green)
    assert red[2] == max(red)
