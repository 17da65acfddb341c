"""Ranges of parameters and the draws from them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lavsim.errors import LavsimError
from lavsim.random import Draws
from lavsim.scenarios.base import SCENARIOS
from lavsim.scenarios.parameters import parse_parameters
from leaderboard.hazard_maker import hazard_types
from leaderboard.search.cross_entropy import ELITE, POPULATION, Belief, belief_before, folded
from leaderboard.search.ranges import TRIGGER, Range, default_ranges, parse_range, ranges_of, rounded, values_at

KIND = ("2.x", "DynamicObjectCrossing")


@pytest.mark.parametrize(("generation", "kind"), hazard_types())
def test_every_type_has_ranges_whose_ends_it_takes(generation: str, kind: str) -> None:
    ranges = default_ranges(generation, kind)
    assert ranges
    config = SCENARIOS[generation, kind].Config
    for share in (0.0, 0.3, 1.0):
        values = values_at(ranges, [share] * len(ranges))
        values.pop(TRIGGER, None)
        config(**parse_parameters(config, values))


def test_ranges_lie_around_what_the_route_file_gives() -> None:
    assert str(default_ranges(*KIND, {"distance": 30.0})[0]) == "distance=15:45"
    assert str(default_ranges("2.x", "InvadingTurn", {"offset": 1.2})[1]) == "offset=0.6:1.446"  # 1.5 is its most
    assert str(default_ranges("2.x", "AccidentTwoWays")[2]) == "frequency=20:100"
    assert [str(each) for each in default_ranges("2.x", "PedestrianCrossing")] == ["trigger=-10:10"]


def test_a_range_is_read_as_it_prints() -> None:
    for text in ("distance=10:40", "direction=left|right", "trigger=-5:5", "crossing_angle=12:12"):
        assert str(parse_range(text, *KIND)) == text
    assert parse_range("distance=12", *KIND) == Range("distance", 12.0, 12.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("distance", "NAME=LOW:HIGH"),
        ("distanse=1:2", "Did you mean 'distance'"),
        ("distance=40:10", "40 to 10 does not rise"),
        ("distance=a:b", "two numbers"),
        ("distance=nan", "two numbers"),
        ("distance=-5:5", "distance must be positive"),
        ("direction=up", "refuses up"),
        ("crossing_angle=-90:0", "-60 to 60"),
    ],
)
def test_a_wrong_range_is_one_line(text: str, words: str) -> None:
    with pytest.raises(LavsimError, match=words) as error:
        parse_range(text, *KIND)
    assert "\n" not in str(error.value)


def test_a_place_is_not_searched() -> None:
    with pytest.raises(LavsimError, match="no number"):
        parse_range("start_actor_flow=1:2", "2.x", "CrossingBicycleFlow")


def test_a_parameter_has_one_range() -> None:
    with pytest.raises(LavsimError, match="two ranges"):
        ranges_of(*KIND, ["distance=1:2", "distance=3:4"])


@given(low=st.floats(-1e4, 1e4), span=st.floats(0.0, 1e4), share=st.floats(0.0, 1.0))
def test_a_value_lies_in_its_range_and_keeps_four_digits(low: float, span: float, share: float) -> None:
    value = Range("x", low, low + span).value(share)
    assert isinstance(value, float)
    assert low - 1e-3 * abs(low) - 1e-9 <= value <= low + span + 1e-3 * max(abs(low), abs(low + span)) + 1e-9
    assert rounded(value) == value == float(f"{value:g}")


@given(st.lists(st.floats(-3.0, 4.0), min_size=1, max_size=5))
def test_folding_stays_in_the_cube_and_leaves_what_is_in_it(values: list[float]) -> None:
    found = folded(np.array(values))
    assert np.all((found >= 0.0) & (found <= 1.0))
    inside = (np.array(values) >= 0.0) & (np.array(values) <= 1.0)
    np.testing.assert_allclose(found[inside], np.array(values)[inside])


def test_draws_of_a_candidate_hang_on_nothing_but_seed_number_and_attempt() -> None:
    belief, draws = Belief.at_first(3), Draws.of_seed(1)
    first = belief.draw(draws, 5, 0)
    assert np.array_equal(first, belief.draw(draws, 5, 0))
    assert not np.array_equal(first, belief.draw(draws, 5, 1))
    assert not np.array_equal(first, belief.draw(draws, 6, 0))
    assert not np.array_equal(first, belief.draw(Draws.of_seed(2), 5, 0))


def test_the_method_closes_in_on_a_small_failing_corner() -> None:
    """A hundredth of the square fails: found far more often than by drawing everywhere."""
    goal, draws = np.array([0.83, 0.21]), Draws.of_seed(3)
    points, margins = np.zeros((0, 2)), list[float]()
    for number in range(12 * POPULATION):
        belief = belief_before(number // POPULATION, points, margins)
        point = belief.draw(draws, number, 0)
        points = np.vstack([points, point])
        margins.append(float(max(np.abs(point - goal).max() - 0.05, 0.0)))
    assert sum(margin == 0.0 for margin in margins) > 2 * ELITE  # everywhere: one in a hundred
    assert np.abs(belief.mean - goal).max() < 0.1
