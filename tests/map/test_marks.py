"""Paint along a lane: none, joined where it goes on alike, and double."""

from __future__ import annotations

import pytest

from tests.map import xodr

PIECE = '<roadMark sOffset="{}" type="{}" color="standard" width="0.12"/>'


def marks(*pieces: tuple[float, str]) -> list[tuple[str, float, float, float]]:
    """Kind, first x, last x and y of each line of a straight road of 50 m whose one lane has these marks."""
    more = "".join(PIECE.format(s, kind) for s, kind in pieces)
    town = xodr.town(xodr.road(section=xodr.lanes((-1,), more)))
    return [
        (line.kind, round(float(line.points[0, 0]), 3), round(float(line.points[-1, 0]), 3), float(line.points[0, 1]))
        for line in town.marks
    ]


def test_a_lane_without_marks_has_none() -> None:
    assert marks() == []
    assert marks((0.0, "none")) == []


def test_equal_neighbours_are_one_line() -> None:
    assert marks((0.0, "broken"), (20.0, "broken")) == [("broken", 0.0, 50.0, 3.5)]


def test_a_mark_ends_where_another_begins() -> None:
    assert marks((0.0, "broken"), (20.0, "none"), (30.0, "solid")) == [
        ("broken", 0.0, 20.0, 3.5),
        ("solid", 30.0, 50.0, 3.5),
    ]


def test_a_double_mark_is_two_lines() -> None:
    (first, *_, y_first), (second, *_, y_second) = marks((0.0, "solid broken"))
    assert (first, second) == ("solid", "broken")
    assert abs(y_first - y_second) == pytest.approx(0.24)
