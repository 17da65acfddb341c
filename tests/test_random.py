"""Hashed draws: repeatable, spread, and the same inside kernels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.kernel_draws import draw_at, draw_base, unit_at
from lavsim.random import Draws


def test_a_draw_depends_on_its_name_and_not_on_what_was_drawn_before() -> None:
    draws = Draws.of_seed(3)
    alone = draws.stream("gnss", 7).uniform(40, 3)
    draws.stream("lidar").normal(40, 100)
    assert np.array_equal(draws.stream("gnss", 7).uniform(40, 3), alone)
    assert not np.array_equal(draws.stream("gnss", 8).uniform(40, 3), alone)
    assert not np.array_equal(draws.stream("gnss", 7).uniform(41, 3), alone)
    assert not np.array_equal(Draws.of_seed(4).stream("gnss", 7).uniform(40, 3), alone)


def test_a_longer_draw_begins_with_the_shorter_one() -> None:
    stream = Draws.of_seed(0).stream("x")
    assert np.array_equal(stream.uniform(5, 100)[:10], stream.uniform(5, 10))


@settings(deadline=None)  # the first call compiles
@given(seed=st.integers(0, 2**40), tick=st.integers(0, 2**31), index=st.integers(0, 1000))
def test_kernels_draw_the_same_words(seed: int, tick: int, index: int) -> None:
    draws = Draws.of_seed(seed).stream("kernel")
    base = np.uint64(draw_base(np.uint64(draws.key), tick))
    assert int(draw_at(base, index)) == int(draws.bits(tick, index + 1)[index])
    assert unit_at(base, index) == draws.uniform(tick, index + 1)[index]


@given(seed=st.integers(0, 2**40), tick=st.integers(-(2**62), 2**62), count=st.integers(0, 40))
def test_few_draws_are_the_first_of_many(seed: int, tick: int, count: int) -> None:
    draws = Draws.of_seed(seed)
    many = draws.bits(tick, 60)
    assert np.array_equal(draws.bits(tick, count), many[:count])
    assert [draws.integer(tick, 1000, index) for index in range(count)] == [int(word) % 1000 for word in many[:count]]


def test_uniform_and_normal_have_their_moments() -> None:
    stream = Draws.of_seed(1).stream("moments")
    unit = np.concatenate([stream.uniform(t, 1000) for t in range(100)])
    assert unit.min() >= 0.0
    assert unit.max() < 1.0
    assert unit.mean() == pytest.approx(0.5, abs=0.005)
    normal = np.concatenate([stream.normal(t, 1000, mean=2.0, std=3.0) for t in range(100)])
    assert normal.mean() == pytest.approx(2.0, abs=0.05)
    assert normal.std() == pytest.approx(3.0, abs=0.05)
    assert np.abs(np.corrcoef(unit[:-1], unit[1:])[0, 1]) < 0.02


@given(count=st.integers(1, 200), tick=st.integers(0, 1000))
def test_a_permutation_holds_every_number_once(count: int, tick: int) -> None:
    assert sorted(Draws.of_seed(0).stream("p").permutation(tick, count)) == list(range(count))


def test_the_first_draws_of_a_seed_stay_what_they_were() -> None:
    """Golden: a change here changes every drive ever seeded."""
    assert Draws.of_seed(0).stream("golden", 1).bits(2, 2).tolist() == GOLDEN


GOLDEN = [10736870385067241988, 9018227414628868339]
