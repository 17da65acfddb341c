"""Pitch of what stands on slopes."""

from __future__ import annotations

import numpy as np

from lavsim.map.rise import LEVEL_RISE, pitch_on, rise_along
from lavsim.map.town_map import TownMap
from tests.map.xodr import road, town

RISE = 0.08


def hill(rise: float) -> TownMap:
    """A road along x that climbs, with a lane up (y > 0) and one down."""
    profile = f'<elevationProfile><elevation s="0" a="1.0" b="{rise}" c="0" d="0"/></elevationProfile>'
    return town(road(before=profile))


def pitches(hill: TownMap, places: list[tuple[float, float, float]], yaw: list[float]) -> np.ndarray:
    return pitch_on(hill, rise_along(hill), hill.nearest(places), np.array(yaw))


def test_cars_lean_by_where_they_look_whatever_their_lane() -> None:
    up, down = np.arctan(RISE), -np.arctan(RISE)
    places = [(20.0, 1.75, 2.6), (30.0, -1.75, 3.4), (30.0, 1.75, 3.4), (10.0, 1.75, 1.8)]
    found = pitches(hill(RISE), places, [0.0, np.pi, np.pi, np.pi / 2.0])
    np.testing.assert_allclose(found, [up, down, down, 0.0], atol=1e-6)


def test_roads_that_hardly_rise_count_as_level() -> None:
    assert pitches(hill(LEVEL_RISE * 0.9), [(20.0, 1.75, 1.0)], [0.0])[0] == 0.0
    assert pitches(hill(LEVEL_RISE * 1.1), [(20.0, 1.75, 1.0)], [0.0])[0] > 0.0


def test_nothing_leans_where_there_is_no_lane() -> None:
    assert pitches(hill(RISE), [(np.nan, np.nan, np.nan)], [0.0])[0] == 0.0
