"""What is counted in a dataset."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lavsim.dataset.stats import Histogram, add_up, statistics_of
from lavsim.dataset.tables import Table
from lavsim.types import ActorClass
from tests.dataset.made import actor, info_of, row_of

EDGES = np.linspace(0.0, 10.0, 101)
numbers = st.lists(st.floats(0.0, 10.0), min_size=1, max_size=60)


@given(numbers, numbers)
def test_histograms_add_up(one: list[float], other: list[float]) -> None:
    joined = Histogram.of(np.array(one + other), EDGES)
    added = Histogram.of(np.array(one), EDGES) + Histogram.of(np.array(other), EDGES)
    np.testing.assert_array_equal(joined.counts, added.counts)
    assert (joined.least, joined.most) == (added.least, added.most)
    assert joined.mean == pytest.approx(added.mean)


@given(numbers, st.floats(0.01, 0.99))
def test_quantiles_are_right_to_a_bin(values: list[float], share: float) -> None:
    found = Histogram.of(np.array(values), EDGES).quantile(share)
    below = np.quantile(values, share, method="inverted_cdf")
    assert abs(found - below) <= 0.1 + 1e-9


def test_what_is_not_finite_does_not_count() -> None:
    histogram = Histogram.of(np.array([1.0, np.nan, np.inf, 3.0]), EDGES)
    assert (histogram.total, histogram.mean) == (2, 2.0)
    assert Histogram.of(np.zeros(0), EDGES).to_json() == {}


def test_a_table_is_counted() -> None:
    info = info_of()
    near = actor(7, at=(9.0, 0.0, 0.0), lidar_hits=3, pixels=[0], velocity=(10.0, 0.0, 0.0))
    far = actor(8, at=(0.0, 45.0, 0.0), lidar_hits=0, pixels=[0])
    walker = actor(9, ActorClass.WALKER, at=(0.0, -4.0, 0.0), lidar_hits=5, pixels=[12])
    rows = [
        row_of(info, 0, [near, far], speed=10.0, command=1, brake=1, brake_cause="light"),
        row_of(info, 5, [near, walker], speed=0.0, command=4),
    ]
    statistics = add_up([statistics_of(Table.of_rows([row], info.columns)) for row in rows])
    found = statistics.to_json()
    assert found["frames"] == 2
    assert found["shares"]["command"] == {"follow": 1, "left": 1}
    assert found["shares"]["motion"] == {"full stop": 1, "moves": 1, "stands": 1}
    assert found["shares"]["brake_cause"] == {"light": 1, "none": 1}
    assert found["shares"]["actor_class"] == {"car": 3, "walker": 1}
    assert found["quantities"]["speed"]["most"] == 36.0
    assert found["quantities"]["vehicles"]["mean"] == 1.5
    assert found["quantities"]["walker_distance"]["mean"] == 4.0
    assert found["quantities"]["vehicle_speed"]["most"] == 36.0
    rings = found["vehicles_seen"]
    assert (rings[0]["vehicles"], rings[0]["seen"]) == (2, 2)
    assert (rings[4]["vehicles"], rings[4]["seen"]) == (1, 0)


def test_a_turn_is_counted_over_whole_seconds_only() -> None:
    info = info_of()
    yaw = np.linspace(3.0, 3.0 + np.radians(60.0), 21)  # goes through half a turn, where angles wrap
    ticks = [5 * k for k in range(16)] + [5 * k + 700 for k in range(16, 21)]
    rows = [
        row_of(info, tick, yaw=(angle + np.pi) % (2 * np.pi) - np.pi) for tick, angle in zip(ticks, yaw, strict=True)
    ]
    turn = statistics_of(Table.of_rows(rows, info.columns)).histograms["turn"]
    assert turn.total == 6  # windows of ten steps before the jump; none spans it, and none fits behind it
    assert turn.mean == pytest.approx(30.0)


def test_a_table_with_few_fields_is_counted_too() -> None:
    info = info_of()
    table = Table.of_rows([row_of(info, 0, speed=1.0)], [f for f in info.columns if f.name == "speed"])
    found = statistics_of(table).to_json()
    assert found["quantities"]["speed"]["count"] == 1
    assert found["shares"]["command"] == {}
