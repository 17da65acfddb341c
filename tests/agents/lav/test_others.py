"""Who is there, out of detections of both kinds."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.config import DriveConfig
from agents.lav.localise import Pose
from agents.lav.models.detection import Detections
from agents.lav.others import Found, Others
from lavsim.types import DT

EVERY_TICK = DriveConfig(look_every=1, least_seen=3)
HERE = Pose(np.zeros(2), 0.0)
WALKER, CAR = (0.2, 0.2), (2.2, 0.9)  # half lengths and half widths


def seen(*rows: tuple[tuple[float, float], tuple[float, float], float]) -> Detections:
    """Detections of places, half sizes and scores."""
    boxes = np.array([[*place, 0.0, *size] for place, size, _ in rows], np.float32).reshape(-1, 5)
    return Detections(torch.from_numpy(boxes), torch.tensor([score for *_, score in rows]))


def step_out(kinds: str, ticks: int = 30) -> Found:
    """What is known of a walker at 1.6 m/s who is found as `kinds` say, one letter a tick, again and again."""
    others = Others(EVERY_TICK)
    for tick in range(ticks):
        here = ((4.0 - 1.6 * DT * tick, -12.0), WALKER, 0.6)
        is_walker = kinds[tick % len(kinds)] == "w"
        found = others.update(seen(*[] if is_walker else [here]), seen(*[here] if is_walker else []), HERE, 0.0)
    return found


@pytest.mark.parametrize("kinds", ["w", "wv", "wwv", "v"])
def test_a_walker_has_one_speed_whatever_it_is_found_as(kinds: str) -> None:
    found = step_out(kinds)
    assert len(found.vehicles) == 0
    assert found.walkers == pytest.approx(np.array([[4.0 - 1.6 * DT * 29, -12.0]]), abs=1e-5)
    assert found.walking == pytest.approx(np.array([[-1.6, 0.0]]), abs=0.3)


@pytest.mark.parametrize(("as_vehicle", "as_walker", "walkers"), [(0.4, 0.9, 1), (0.9, 0.4, 0)])
def test_who_is_found_as_both_is_the_surer(as_vehicle: float, as_walker: float, walkers: int) -> None:
    others = Others(EVERY_TICK)
    for _ in range(5):
        found = others.update(seen(((3.0, -10.0), CAR, as_vehicle)), seen(((3.4, -10.2), WALKER, as_walker)), HERE, 0.0)
    assert (len(found.walkers), len(found.vehicles)) == (walkers, 1 - walkers)


def test_a_walker_beside_a_car_is_somebody_else() -> None:
    others = Others(EVERY_TICK)
    for _ in range(5):
        found = others.update(seen(((3.0, -10.0), CAR, 0.9)), seen(((1.5, -10.0), WALKER, 0.6)), HERE, 0.0)
    assert (len(found.walkers), len(found.vehicles)) == (1, 1)


@pytest.mark.parametrize(("missed", "is_there"), [(4, True), (5, False)])
def test_who_is_missed_for_a_moment_is_still_there(missed: int, is_there: bool) -> None:
    others = Others(EVERY_TICK)
    for tick in range(20):
        others.update(seen(), seen(((4.0 - 1.6 * DT * tick, -12.0), WALKER, 0.6)), HERE, 0.0)
    for _ in range(missed):
        found = others.update(seen(), seen(), HERE, 0.0)
    assert len(found.walkers) == is_there
    if is_there:
        assert found.walkers == pytest.approx(np.array([[4.0 - 1.6 * DT * (19 + missed), -12.0]]), abs=0.05)


@pytest.mark.parametrize(
    ("place", "speed", "steps_out"),
    [
        ((3.0, -11.0), 12.0, True),
        ((-3.0, -11.0), 12.0, True),
        ((3.0, -22.0), 12.0, False),  # there is time to look
        ((3.0, -11.0), 4.0, False),
        ((3.0, 2.0), 12.0, False),  # behind
    ],
)
def test_who_appears_within_braking_distance_is_taken_to_step_out(
    place: tuple[float, float], speed: float, steps_out: bool
) -> None:
    others, first = Others(EVERY_TICK), seen((place, WALKER, 0.6))
    found = others.update(seen(), first, HERE, speed * DT)
    assert len(found.walkers) == steps_out
    if steps_out:
        assert found.walking[0, 0] == -np.sign(place[0]) * 4.0


@pytest.mark.parametrize(
    ("aside", "half", "score", "steps_out"),
    [
        (3.5, (0.35, 0.2), 0.35, True),  # found as a small vehicle
        (3.5, (0.6, 0.25), 0.2, True),  # in doubt, but right beside the way
        (5.7, (0.35, 0.2), 0.2, False),  # a bin
        (3.5, (2.2, 0.9), 0.6, False),  # a parked car
        (0.5, (0.6, 0.25), 0.2, False),  # on the way: nothing to step out of
    ],
)
def test_who_is_slight_and_appears_beside_the_way_may_step_out(
    aside: float, half: tuple[float, float], score: float, steps_out: bool
) -> None:
    others = Others(EVERY_TICK)
    found = others.update(seen(((aside, -9.0), half, score)), seen(), HERE, 9.7 * DT)
    assert found.walking.tolist() == ([[-4.0, 0.0]] if steps_out else [])


def test_a_walker_from_behind_something_has_no_speed_of_that_thing() -> None:
    others, thing = Others(EVERY_TICK), seen(((5.0, -10.0), (0.5, 0.3), 0.2))
    for _ in range(8):
        others.update(thing, seen(), HERE, 9.7 * DT)
    walking = []
    for tick in range(12):
        walker = seen(((4.6 - 3.8 * DT * tick, -9.5), WALKER, 0.6))
        walking.append(others.update(seen(), walker, HERE, 9.7 * DT).walking[0, 0])
    assert walking[:5] == [-4.0] * 5, "he is taken to run"
    assert walking[-1] == pytest.approx(-3.8, abs=1.5)


def test_who_has_stood_there_is_not_taken_to_step_out() -> None:
    others = Others(EVERY_TICK)
    for tick in range(20):
        pose = Pose(np.array([12.0 * DT * tick, 0.0]), 0.0)
        here = (3.0, -25.0 + 12.0 * DT * tick)
        found = others.update(seen(), seen((here, WALKER, 0.6)), pose, 12.0 * DT)
    assert np.hypot(*found.walking[0]) < 0.5


def test_who_was_found_as_a_walker_stays_one_in_doubt() -> None:
    others = Others(EVERY_TICK)
    for tick in range(12):
        here = (4.0 - 3.0 * DT * tick, -12.0)
        doubt, sure = seen((here, (0.8, 0.35), 0.2)), seen((here, WALKER, 0.5))
        found = others.update(*((seen(), sure) if tick == 3 else (doubt, seen())), HERE, 12.0 * DT)
        assert len(found.walkers) == (tick >= 3), "before, nothing tells him from a fence"
        assert len(found.vehicles) == 0
    assert found.walking[0, 0] < -1.5


def test_a_car_is_no_walker_though_it_was_found_as_one() -> None:
    others = Others(EVERY_TICK)
    others.update(seen(), seen(((3.0, -10.0), WALKER, 0.6)), HERE, 0.0)
    for _ in range(5):
        found = others.update(seen(((3.0, -10.0), CAR, 0.6)), seen(), HERE, 0.0)
    assert (len(found.walkers), len(found.vehicles)) == (0, 1)
