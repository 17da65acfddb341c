"""Distances, overlaps and times to contact against shapely and small steps."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import Polygon

from lavsim.geometry import box_corners
from lavsim.world.proximity import BoxPose, BoxSet, MovingBox, box_distance, boxes_overlap, time_to_contact

CAR = (4.8, 2.0, 1.5)
POSES = st.tuples(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0), st.just(0.0), st.floats(-3.2, 3.2))
SIZES = st.tuples(st.floats(0.3, 11.0), st.floats(0.3, 3.0), st.floats(0.5, 4.0))


def polygon(pose: BoxPose, size: tuple[float, float, float]) -> Polygon:
    return Polygon(box_corners(np.array([pose[0]]), np.array([pose[1]]), np.array([pose[3]]),
                               np.array([size[0]]), np.array([size[1]]))[0])  # fmt: skip


@given(first=POSES, second=POSES, size_a=SIZES, size_b=SIZES)
def test_distance_and_overlap_are_those_of_the_footprints(
    first: BoxPose, second: BoxPose, size_a: tuple[float, float, float], size_b: tuple[float, float, float]
) -> None:
    a, b = polygon(first, size_a), polygon(second, size_b)
    assert box_distance(first, size_a, second, size_b) == pytest.approx(a.distance(b), abs=2e-4)
    if a.distance(b) > 1e-6 or a.intersection(b).area > 1e-4:
        assert boxes_overlap(first, size_a, second, size_b) == a.intersects(b)


def test_boxes_on_two_levels_are_apart_by_the_air_between() -> None:
    assert box_distance((0, 0, 0, 0), CAR, (1, 0, 6, 0.3), CAR) == pytest.approx(4.5, abs=1e-6)
    assert not boxes_overlap((0, 0, 0, 0), CAR, (1, 0, 6, 0.3), CAR)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 40))
def test_a_set_answers_as_the_pairs_do(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    poses = np.column_stack([rng.uniform(-15, 15, (count, 2)), np.zeros(count), rng.uniform(-3, 3, count)])
    sizes = np.column_stack([rng.uniform(0.5, 8.0, count), rng.uniform(0.5, 2.5, count), np.full(count, 1.5)])
    boxes, own = BoxSet(poses, sizes), (0.0, 0.0, 0.0, 0.4)
    pairs = [box_distance(own, CAR, tuple(pose), size) for pose, size in zip(poses, sizes, strict=True)]
    assert boxes.distances(own, CAR) == pytest.approx(pairs)
    hit = [k for k in range(count) if boxes_overlap(own, CAR, tuple(poses[k]), sizes[k])]
    assert boxes.overlapping(own, CAR).tolist() == hit


@pytest.mark.parametrize(
    ("gap", "speeds", "seconds"), [(20.0, (10.0, 0.0), 2.0), (20.0, (10.0, -10.0), 1.0), (20.0, (10.0, 12.0), math.inf),
                                   (0.0, (0.0, 0.0), 0.0), (20.0, (0.0, 0.0), math.inf), (20.0, (1.0, 0.0), math.inf)],
)  # fmt: skip
def test_time_to_contact_along_a_line(gap: float, speeds: tuple[float, float], seconds: float) -> None:
    first = MovingBox((0.0, 0.0, 0.0, 0.0), CAR, (speeds[0], 0.0))
    second = MovingBox((gap + 4.8, 0.0, 0.0, 0.0), CAR, (speeds[1], 0.0))
    assert time_to_contact(first, second) == pytest.approx(seconds, abs=1e-3)


def test_a_car_that_turns_in_place_reaches_what_stands_beside_it() -> None:
    first = MovingBox((0.0, 0.0, 0.0, 0.0), CAR, yaw_rate=0.5)
    second = MovingBox((0.0, 2.3, 0.0, 0.0), (0.3, 1.0, 1.8))
    expected = next(
        t for t in np.arange(0.0, 8.0, 1e-3) if polygon(first.at(t), CAR).intersects(polygon(second.pose, second.size))
    )
    assert time_to_contact(first, second) == pytest.approx(expected, abs=5e-3)


VELOCITIES = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))


@settings(max_examples=60, deadline=None)
@given(
    first=POSES, second=POSES, size_a=SIZES, size_b=SIZES, velocity_a=VELOCITIES, velocity_b=VELOCITIES,
    rate_a=st.floats(-1.0, 1.0), rate_b=st.floats(-1.0, 1.0),
)  # fmt: skip
def test_time_to_contact_is_the_first_of_many_small_steps(
    first: BoxPose, second: BoxPose, size_a: tuple[float, float, float], size_b: tuple[float, float, float],
    velocity_a: tuple[float, float], velocity_b: tuple[float, float], rate_a: float, rate_b: float,
) -> None:  # fmt: skip
    a, b = MovingBox(first, size_a, velocity_a, rate_a), MovingBox(second, size_b, velocity_b, rate_b)
    found = time_to_contact(a, b, horizon=2.0)
    gaps = {t: polygon(a.at(t), size_a).distance(polygon(b.at(t), size_b)) for t in np.arange(0.0, 2.0, 0.01)}
    assume(not any(0.0 < gap < 0.02 for gap in gaps.values()) or math.isfinite(found))
    touching = [t for t, gap in gaps.items() if gap == 0.0]
    if touching:
        assert found <= touching[0] + 5e-3
    if math.isfinite(found):
        assert polygon(a.at(found), size_a).distance(polygon(b.at(found), size_b)) < 5e-3
        assert all(gap > 0.0 for t, gap in gaps.items() if t < found - 5e-3)
