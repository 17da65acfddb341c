"""Average precision, intersection over union and displacement, against cases worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.lav.metrics import (
    FALSE,
    HIT,
    IGNORED,
    AveragePrecision,
    IntersectionOverUnion,
    displacement,
    match_centres,
)


def test_each_truth_is_hit_once_and_the_best_comes_first() -> None:
    truth = np.array([[0.0, 0.0], [10.0, 0.0]])
    found = np.array([[1.5, 0.0], [0.1, 0.0], [10.0, 2.1], [11.0, 0.0]])
    asked = np.array([True, True])
    assert match_centres(found, truth, asked).tolist() == [HIT, FALSE, FALSE, HIT]
    assert match_centres(found, truth, np.array([False, True])).tolist() == [IGNORED, FALSE, FALSE, HIT]
    assert match_centres(found, truth[:0], asked[:0]).tolist() == [FALSE] * 4
    assert match_centres(found[:0], truth, asked).shape == (0,)


def test_a_truth_that_is_asked_for_goes_before_a_nearer_one_that_is_not() -> None:
    truth, asked = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([True, False])
    assert match_centres(np.array([[0.9, 0.0], [1.0, 0.1]]), truth, asked).tolist() == [HIT, IGNORED]


def test_average_precision_of_five_detections_by_hand() -> None:
    """Right, wrong, right, wrong, right of four: precisions 1, 1/2, 2/3, 1/2, 3/5; the best from there on counts."""
    measure = AveragePrecision()
    measure.add(np.array([0.9, 0.8]), np.array([HIT, FALSE]), asked=2)
    measure.add(np.array([0.7, 0.65, 0.6, 0.5]), np.array([HIT, IGNORED, FALSE, HIT]), asked=2)
    assert measure.value() == pytest.approx((1.0 + 2.0 / 3.0 + 3.0 / 5.0) / 4.0)


def test_average_precision_at_its_ends() -> None:
    perfect, blind, empty = AveragePrecision(), AveragePrecision(), AveragePrecision()
    perfect.add(np.array([0.3, 0.2]), np.array([HIT, HIT]), 2)
    blind.add(np.zeros(0), np.zeros(0, np.int64), 3)
    assert (perfect.value(), blind.value()) == (1.0, 0.0)
    assert math.isnan(empty.value())


def test_union_by_hand_and_only_where_it_is_known() -> None:
    found = np.array([[[1, 1, 0, 0]], [[0, 0, 0, 0]]], bool)
    truth = np.array([[[0, 1, 1, 0]], [[0, 0, 0, 1]]], bool)
    measure = IntersectionOverUnion(("road", "solid"))
    measure.add(found, truth)
    assert measure.values() == {"road": pytest.approx(1 / 3), "solid": 0.0}
    measure = IntersectionOverUnion(("road", "solid"))
    measure.add(np.stack([found, found]), np.stack([truth, truth]), np.array([[[1, 1, 0, 0]], [[0, 1, 0, 0]]], bool))
    assert measure.values()["road"] == pytest.approx(2 / 3)
    assert math.isnan(measure.values()["solid"])


def test_displacement_is_the_mean_distance() -> None:
    assert displacement([[3.0, 4.0], [0.0, 1.0]], [[0.0, 0.0], [0.0, 0.0]]) == pytest.approx(3.0)
