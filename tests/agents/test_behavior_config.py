"""How the expert is set up, and what it knows when it drives by sight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents.behavior.agent import BehaviorAgent
from agents.behavior.config import Sight, config_of
from agents.behavior.manner import MANNERS
from agents.behavior.sight import Seen
from lavsim.errors import ConfigError, UnknownName
from lavsim.types import Role
from tests.agents.test_behavior import Other, Road, expert


@pytest.mark.parametrize("name", ["cautious", "normal", "aggressive", "expert"])
def test_manners_come_by_name(name: str) -> None:
    assert config_of(name).manner == MANNERS[name]


def test_top_speeds_and_distances_to_the_limit_are_those_of_carla() -> None:
    found = {name: (round(m.top_speed * 3.6), round(m.limit_gap * 3.6)) for name, m in MANNERS.items() if m.limit_gap}
    assert found == {"cautious": (40, 6), "normal": (50, 3), "aggressive": (70, 1)}


def test_config_is_read_from_json_and_toml(tmp_path: Path) -> None:
    file = tmp_path / "expert.toml"
    file.write_text('visible_only = true\nmanner = "cautious"\n[sight]\nmemory = 2.0\n', encoding="utf-8")
    assert config_of(str(file)) == config_of('{"visible_only": true, "manner": "cautious", "sight": {"memory": 2.0}}')
    assert config_of('{"manner": {"headway": 1.6}}').manner.headway == 1.6
    assert config_of(None) == config_of("expert")


@pytest.mark.parametrize(
    ("text", "error", "hint"),
    [
        ("cautous", UnknownName, "Did you mean 'cautious'"),
        ('{"maner": "cautious"}', ConfigError, "Did you mean 'manner'"),
        ('{"manner": {"hedway": 1.0}}', ConfigError, "Did you mean 'headway'"),
        ('{"manner": {"headway": -1.0}}', ConfigError, "manner.headway"),
        ("{oops", ConfigError, "no JSON"),
        ("nowhere.toml", ConfigError, "nowhere.toml"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_name(text: str, error: type[Exception], hint: str) -> None:
    with pytest.raises(error, match=hint):
        config_of(text)


def test_visibility_is_asked_for_only_by_who_drives_by_sight() -> None:
    for text, wanted in ((None, False), ("visible", True)):
        agent = BehaviorAgent.__new__(BehaviorAgent)
        agent.setup(text)
        assert agent.sensors()[0].get("visibility", False) is wanted


def test_hidden_actors_are_taken_out_and_seen_ones_remembered_for_a_while() -> None:
    road = Road(expert(), [Other(30.0, 0.0), Other(50.0, 0.0)])
    seen = Seen(Sight(memory=1.0))

    def known(time: float, hits: list[int], pixels: list[int]) -> list[int]:
        road.time = time
        truth = {**road.truth(), "lidar_hits": np.array(hits), "pixels": np.array(pixels)}
        kept = seen.filter(truth)
        assert set(kept["roles"][1:].tolist()) <= {int(Role.TRAFFIC)}
        assert len(kept["xyz"]) == len(kept["ids"])
        return [int(actor) for actor in kept["ids"]]

    assert known(0.0, [0, 9, 0], [0, 0, 0]) == [1, 2], "the ego needs not be seen"
    assert known(0.5, [0, 0, 0], [0, 0, 40]) == [1, 2, 3]
    assert known(1.2, [0, 0, 0], [0, 0, 0]) == [1, 3]
    assert known(1.7, [0, 2, 0], [0, 9, 0]) == [1], "a glimpse is none"
