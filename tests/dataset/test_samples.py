"""Samples of a window, on tables drawn on paper: LAV's filters (reference `lav.md` 3.3) and ours."""

import math
from typing import Any

import numpy as np
import pytest

from lavsim.dataset.samples import SampleFilter, motions_of
from lavsim.dataset.tables import Column, Table
from lavsim.types import ActorClass, Role

CAR, WALKER, PROP = ActorClass.CAR, ActorClass.WALKER, ActorClass.PROP
EVERYBODY = SampleFilter(vehicle_radius=50.0, walker_radius=50.0)

Actor = tuple[int, ActorClass, float, float, float]  # id, class, x, y [m], yaw [rad]


def table(*frames: list[Actor], **extra: list[list[int]]) -> Table:
    """A table whose frames hold these actors, the ego first."""
    rows = [actor for frame in frames for actor in frame]
    ends = np.cumsum([0, *(len(frame) for frame in frames)])
    columns: dict[str, Any] = {
        "actor_id": np.array([row[0] for row in rows], np.int32),
        "actor_class": np.array([row[1] for row in rows], np.uint8),
        "actor_role": np.array([Role.PARKED if row[0] == 9 else Role.TRAFFIC for row in rows], np.uint8),
        "actor_position": np.array([[row[2], row[3], 0.0] for row in rows]),
        "actor_yaw": np.array([row[4] for row in rows]),
        "actor_size": np.tile(np.array([[4.0, 2.0, 1.5]], np.float32), (len(rows), 1)),
        "actor_velocity": np.zeros((len(rows), 3), np.float32),
    }
    for name, values in extra.items():
        columns[name] = np.array([value for frame in values for value in frame], np.int32)
    return Table({name: Column(values, ends) for name, values in columns.items()})


def ego(x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> Actor:
    return (1, CAR, x, y, yaw)


def ids(found: Table, steps: int = 1, filters: SampleFilter | None = None) -> list[int]:
    return motions_of(found, 0, steps, filters).ids.tolist()


def test_only_who_is_there_in_every_frame_counts() -> None:
    stays, leaves, comes = (5, CAR, 5.0, 0.0, 0.0), (6, CAR, 6.0, 0.0, 0.0), (7, CAR, 7.0, 0.0, 0.0)
    made = table([ego(), stays, leaves], [ego(), stays, leaves, comes], [comes, ego(), stays])
    assert ids(made, steps=1) == [1, 5, 6]
    assert ids(made, steps=2) == [1, 5]


@pytest.mark.parametrize(("kind", "radius"), [(CAR, 15.0), (WALKER, 10.0)])
def test_distance_counts_in_the_first_frame_alone(kind: ActorClass, radius: float) -> None:
    within, beyond = (5, kind, 0.0, radius - 0.1, 0.0), (6, kind, radius + 0.1, 0.0, 0.0)
    far, near = (5, kind, 40.0, 0.0, 0.0), (6, kind, 1.0, 0.0, 0.0)
    assert ids(table([ego(), within, beyond], [ego(), far, near])) == [1, 5]


def test_the_ego_comes_first_then_others_by_id_up_to_the_limit() -> None:
    others = [(number, CAR, float(number), 0.0, 0.0) for number in (4, 2, 3)]
    made = table([ego(), *others], [ego(), *reversed(others)])
    assert ids(made) == [1, 2, 3, 4]
    assert ids(made, filters=SampleFilter(most=3)) == [1, 2, 3]
    # The ego stays in front even where others have lower ids.
    lower = table([(1000, CAR, 0.0, 0.0, 0.0), *others], [(1000, CAR, 0.0, 0.0, 0.0), *others])
    assert ids(lower) == [1000, 2, 3, 4]


def test_props_are_no_samples_and_standing_cars_are() -> None:
    still = [(5, PROP, 5.0, 0.0, 0.0), (6, CAR, 6.0, 0.0, 0.0)]
    assert ids(table([ego(), *still], [ego(), *still])) == [1, 6]


def test_places_are_in_the_egos_frame_and_futures_in_each_ones_own() -> None:
    east, south = 0.0, math.pi / 2.0
    # The ego looks south at (10, 20); another, 3 m ahead and 2 m to its left, looks east and drives 1 m east a frame.
    frames = [[ego(10, 20 + k, south), (5, CAR, 12.0 + k, 23.0, east)] for k in range(3)]
    motions = motions_of(table(*frames), 0, 2)
    assert motions.places == pytest.approx(np.array([[0.0, 0.0], [3.0, -2.0]]))
    assert motions.headings == pytest.approx([0.0, -math.pi / 2.0])
    assert motions.futures == pytest.approx(np.array([[[1.0, 0.0], [2.0, 0.0]]] * 2))
    assert motions.turns == pytest.approx(np.zeros((2, 2)))
    assert motions.is_vehicle.tolist() == [True, True]


def test_a_turning_car_turns_in_its_own_frame() -> None:
    frames = [[ego(), (5, CAR, 5.0, 5.0, 3.0)], [ego(), (5, CAR, 5.0, 5.0, -3.0)]]
    assert motions_of(table(*frames), 0, 1).turns[1] == pytest.approx([2.0 * math.pi - 6.0])


def test_what_nobody_saw_can_be_left_out() -> None:
    actors = [ego(), (5, CAR, 5.0, 0.0, 0.0), (6, CAR, 6.0, 0.0, 0.0)]
    made = table(actors, actors, actor_lidar_hits=[[0, 3, 30], [0, 9, 9]], actor_pixels=[[0, 50, 4], [0, 0, 0]])
    assert ids(made) == [1, 5, 6]
    assert ids(made, filters=SampleFilter(least_hits=10)) == [1, 6]
    assert ids(made, filters=SampleFilter(least_pixels=10)) == [1, 5]
    assert motions_of(made, 0, 1).hits.tolist() == [0, 3, 30]
    assert motions_of(table(actors, actors), 0, 1).hits.tolist() == [-1, -1, -1]


def test_who_stands_is_parked_or_behind_can_be_left_out() -> None:
    frames = [
        [ego(), (5, CAR, 5.0 + k, 0.0, 0.0), (6, CAR, 6.0, 0.0, 0.0), (9, CAR, 7.0, 3.0, 0.0), (10, CAR, -5.0, k, 0.0)]
        for k in range(2)
    ]
    made = table(*frames)
    assert ids(made) == [1, 5, 6, 9, 10]
    assert ids(made, filters=SampleFilter(least_motion=0.5)) == [1, 5, 10]
    assert ids(made, filters=SampleFilter(parked=False)) == [1, 5, 6, 10]
    assert ids(made, filters=SampleFilter(ahead_only=True)) == [1, 5, 6, 9]


def test_samples_of_a_recorded_window_fit_its_poses(recorded: Any) -> None:
    from lavsim.dataset.reader import Dataset

    found = Dataset(recorded).table(1)
    motions = motions_of(found, 2, 4, EVERYBODY)
    assert len(motions.ids) > 2
    for frame in range(1, 5):
        row = found.row(2 + frame)
        by_id = {int(number): k for k, number in enumerate(row["actor_id"])}
        for k, number in enumerate(motions.ids.tolist()):
            start = found.row(2)
            at = start["actor_id"].tolist().index(number)
            yaw = start["actor_yaw"][at]
            ahead, right = motions.futures[k, frame - 1]
            step = (ahead * np.cos(yaw) - right * np.sin(yaw), ahead * np.sin(yaw) + right * np.cos(yaw))
            expected = row["actor_position"][by_id[number], :2] - start["actor_position"][at, :2]
            assert step == pytest.approx(expected, abs=1e-9)
