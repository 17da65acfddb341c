"""Where the ego is, and how fast others are, from noisy readings."""

from __future__ import annotations

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.localise import GNSS_STD, EgoFilter
from agents.lav.tracking import Tracker
from lavsim.geometry import geolocation
from lavsim.types import DT
from lavsim.world.dynamics import steer_curvature

TICKS = 600


def drive(noise: float, compass_fails: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors [m] of the filter and of the fixes along half a minute of bends, and of its heading."""
    rng, place = np.random.default_rng(3), EgoFilter()
    x = y = yaw = 0.0
    true, kept, fixes, turns = [], [], [], []
    for tick in range(TICKS):
        speed, steer = 8.0, 0.15 * math.sin(tick / 60.0)
        lat, lon = geolocation(x, y, 40.0, 8.0)
        fix = np.array([float(lat), float(lon)]) + rng.normal(0.0, noise, 2)
        compass = math.nan if compass_fails and tick % 7 == 3 else (yaw + math.pi / 2.0) % (2.0 * math.pi)
        pose = place.update(fix, compass, speed, 0.15 * math.sin((tick - 1) / 60.0))
        found = place.gps()
        true.append([float(lat), float(lon)])
        kept.append(found)
        fixes.append(fix)
        turns.append((pose.yaw - yaw + math.pi) % (2.0 * math.pi) - math.pi)
        curvature = steer_curvature(steer)
        x += speed * math.cos(yaw + 1.4 * curvature) * DT
        y += speed * math.sin(yaw + 1.4 * curvature) * DT
        yaw += speed * curvature * DT
    scale = math.radians(1.0) * 6.371e6 * np.array([1.0, math.cos(math.radians(40.0))])
    errors = [np.hypot(*((np.array(part) - true) * scale).T) for part in (kept, fixes)]
    return errors[0], errors[1], np.array(turns)


def test_the_filter_beats_the_fixes_and_stays_so() -> None:
    kept, fixes, turns = drive(5e-6)
    assert np.sqrt(np.mean(fixes**2)) == pytest.approx(GNSS_STD * math.sqrt(2.0 * (1 + 0.77**2) / 2), rel=0.4)
    for part in (slice(100, 350), slice(350, None)):
        assert np.mean(kept[part]) < 0.4 * np.mean(fixes[part])
    assert np.abs(turns).max() < 0.01


def test_without_noise_it_is_where_it_is_and_a_mute_compass_does_not_mislead_it() -> None:
    for compass_fails in (False, True):
        kept, _, turns = drive(0.0, compass_fails)
        assert kept.max() < 0.1
        assert np.abs(turns).max() < 0.02


def found_speeds(velocity: tuple[float, float], ticks: int = 60, aside: float = 4.0) -> np.ndarray:
    """(ticks, 2) of two cars side by side, seen in cells of half a metre."""
    tracker, found = Tracker(DT), []
    for tick in range(ticks):
        place = np.array([10.0, 2.0]) + np.array(velocity) * DT * tick
        places = np.round(2.0 * np.array([place, place + np.array([0.0, aside])])) / 2.0
        order = [0, 1] if tick % 2 else [1, 0]
        velocities = tracker.update(places[order]).velocities
        found.append(np.hypot(*velocities.T)[order])
    return np.array(found)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (7.0, 0.0), (0.0, -12.0), (1.5, 1.0)])
def test_speeds_are_told_to_half_a_metre_a_second(velocity: tuple[float, float]) -> None:
    speeds = found_speeds(velocity)
    assert np.isnan(speeds[:3]).all()
    assert np.abs(speeds[30:] - math.hypot(*velocity)).max() < 0.8
    assert np.abs(speeds[30:] - math.hypot(*velocity)).mean() < 0.4


def test_a_lost_actor_is_forgotten_and_a_new_one_begins_unknown() -> None:
    tracker, here = Tracker(DT), np.array([[5.0, 0.0]])
    for _ in range(40):
        known = tracker.update(here).velocities
    assert np.isfinite(known).all()
    for _ in range(5):
        assert tracker.update(np.zeros((0, 2))).velocities.shape == (0, 2)
    assert np.isfinite(tracker.update(here).velocities).all()
    for _ in range(12):
        tracker.update(np.zeros((0, 2)))
    assert np.isnan(tracker.update(here).velocities).all()
    assert np.isnan(tracker.update(here + 20.0).velocities).all()


def test_who_stands_is_where_he_was_found_on_average_of_many_places() -> None:
    tracker, place, rng = Tracker(DT, 3), np.array([20.0, 2.2]), np.random.default_rng(0)
    errors, error = [], np.zeros(2)
    for tick in range(80):
        moved = 0.3 if tick < 50 else 0.0  # then the ego stands, and errs the same again and again
        error = rng.normal(0.0, 0.25, 2) if moved else error
        told = tracker.update(np.array([[*(place + error), 1.8]]), moved)
        errors.append(np.abs(told.rested[0, :2] - place).max())
    assert told.seen.tolist() == [80]
    assert told.rested[0, 2] == pytest.approx(1.8)
    assert max(errors[30:]) < 0.3
    assert errors[-1] == errors[50], "nothing new is seen from the same place"


def test_who_drives_is_where_he_is_found() -> None:
    tracker = Tracker(DT)
    for tick in range(60):
        here = np.array([[0.4 * tick, 0.0]])
        told = tracker.update(here, 0.4)
    assert told.rested[0].tolist() == here[0].tolist()


def test_who_is_small_is_known_to_start_sooner_than_a_car() -> None:
    rng, lag = np.random.default_rng(0), {}
    for nimble in (False, True):
        tracker = Tracker(2.0 * DT)
        for look in range(32):  # stands for two seconds, then 1 m/s²
            time = max(2.0 * DT * look - 2.0, 0.0)
            place = np.array([[8.0 - 0.5 * time**2, -9.0]]) + rng.normal(0.0, 0.1, 2)
            told = tracker.update(place, 0.0, np.array([nimble]))
        lag[nimble] = 1.1 - float(-told.velocities[0, 0])
    assert abs(lag[True]) < 0.35
    assert lag[False] > lag[True]
