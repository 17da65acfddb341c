"""A drive over time: what the report's charts show."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from lavsim.geometry import box_corners
from leaderboard.report.hazards import Tallies, count_hazards
from leaderboard.report.series import FARTHEST, series_of
from leaderboard.rules import get_rules
from tests.viewer import drives

RED = {"key": "red_light", "tick": 101, "position": [0.0, 0.0, 0.0], "message": "", "value": None, "metres": None}


def test_gap_is_the_distance_of_the_boxes() -> None:
    series = series_of(drives.tracks(), drives.route(), [], get_rules("1.0"), 10.0)
    for index in (0, 35, 60, 99, 110, 150):
        snapshot = drives.snapshots()[index]
        sizes = snapshot.sizes.astype(float)
        corners = box_corners(snapshot.xy[:, 0], snapshot.xy[:, 1], snapshot.yaw, sizes[:, 0], sizes[:, 1])
        boxes = [shapely.Polygon(c) for c in corners]
        nearest = min(boxes[0].distance(box) for box in boxes[1:])
        assert series.gap[index] == pytest.approx(min(nearest, FARTHEST), abs=1e-6), index


def test_score_falls_with_an_infraction_and_ends_at_the_record_s() -> None:
    rules = get_rules("1.0")
    clean = series_of(drives.tracks(), drives.route(), [], rules, 10.0).score
    fined = series_of(drives.tracks(), drives.route(), [RED], rules, 7.0).score
    assert (np.diff(clean[:-1]) >= 0.0).all()
    assert fined[:100] == pytest.approx(clean[:100])
    assert fined[100:-1] == pytest.approx(0.7 * clean[100:-1])
    assert (clean[-1], fined[-1]) == (10.0, 7.0)


def test_hazards_are_counted_with_what_came_of_them() -> None:
    tallies: Tallies = {}
    during, later = {**RED, "tick": 60}, {**RED, "tick": 199 + drives.FIRST}
    count_hazards(tallies, drives.tracks(), {"scenarios": [{"type": "A"}, {"type": "B"}]}, [during, later], 42.0)
    assert (tallies["A"].planned, tallies["A"].met, tallies["A"].infractions) == (1, 1, 1)
    assert tallies["A"].scores == [42.0]
    assert (tallies["B"].planned, tallies["B"].met) == (1, 0)
