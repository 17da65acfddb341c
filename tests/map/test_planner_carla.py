"""The planner's graph against CARLA's map library, where that is installed: order, points and nodes of segments."""

from __future__ import annotations

from importlib import resources
from typing import Any

import numpy as np
import pytest

from lavsim.map.planner import RoutePlanner
from lavsim.map.town_files import load_town, town_names
from lavsim.map.town_map import TownMap
from tests.map.shared import MAPS

HOP = 1.0


@pytest.fixture(scope="module")
def carla() -> Any:
    module = pytest.importorskip("carla", reason="needs the `carla` package (extra `dev`)")
    if not hasattr(module, "Map"):
        pytest.skip("needs the `carla` package (extra `dev`), not a stand-in")
    return module


def xodr_of(name: str) -> str:
    own = MAPS / f"{name}.xodr"
    return own.read_text() if own.exists() else (resources.files("lavsim.towns") / f"{name}.xodr").read_text()


def lane_of(town: TownMap, waypoint: Any) -> int:
    return town.lane_index(waypoint.road_id, waypoint.section_id, waypoint.lane_id)


def path_length(entry: Any, end: Any) -> int:
    """Points between entry and exit as CARLA's planner counts them."""
    if entry.transform.location.distance(end.transform.location) <= HOP:
        return min(len(entry.next(HOP)), 1)
    count, here = 0, entry.next(HOP)[0]
    while here.transform.location.distance(end.transform.location) > HOP:
        count += 1
        ahead = here.next(HOP)
        if not ahead or count > 10_000:
            break
        here = ahead[0]
    return count


@pytest.mark.parametrize("name", town_names((MAPS,)))
def test_segments_stand_in_carla_s_order_with_its_points_and_nodes(carla: Any, name: str) -> None:
    town = load_town(name, (MAPS,))
    planner = RoutePlanner(town)
    topology = carla.Map(name, xodr_of(name)).get_topology()
    theirs = [(lane_of(town, entry), lane_of(town, end)) for entry, end in topology]
    ours = [(lane, following if following >= 0 else lane) for lane, following in planner._segments]
    assert ours == theirs
    every = max(1, len(ours) // 60)
    for (entry, end), (lane, following) in list(zip(topology, planner._segments, strict=True))[::every]:
        assert len(planner._path(lane, following).u) == path_length(entry, end), (entry, end)
        for waypoint, place in ((entry, (lane, 0.0)), (end, planner._border(lane, following))):
            at = waypoint.transform.location
            assert planner._vertex(*place) == tuple(np.round([at.x, at.y, at.z]).tolist())
