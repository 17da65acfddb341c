"""The LiDAR kernel against plain rays, and the numbers of CARLA's beam model."""

from __future__ import annotations

import numpy as np
import pytest

from lavsim.map.prisms import Prisms
from lavsim.random import Draws
from lavsim.render.frame import Pose, rotation
from lavsim.render.solids import solids_of
from lavsim.render.sweep import GROUND_HIT, LidarModel, Sweep, cast_sweep
from tests.prisms import box, cast_ray, random_prisms

MODEL = LidarModel()
ALL = LidarModel(general_drop=0.0, zero_drop=0.0)  # every beam returns
NOTHING = solids_of(Prisms.empty())
DRAWS = Draws.of_seed(7)


def cast(
    statics: Prisms,
    actors: Prisms | None = None,
    tick: int = 0,
    height: float = 2.4,
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0),
    model: LidarModel = ALL,
) -> tuple[Sweep, Pose]:
    pose = Pose(np.array([0.0, 0.0, height]), rotation(*angles))
    return cast_sweep(model, pose, tick, DRAWS, solids_of(statics), solids_of(actors or Prisms.empty())), pose


def room(half: float) -> Prisms:
    """Four high walls around the sensor, their inner faces `half` metres away."""
    ends = [box(side * (half + 0.5), 0.0, 1.0, 2.0 * half + 2.0, 0.0, 90.0) for side in (-1, 1)]
    return Prisms.concatenate(ends + [box(0.0, s * (half + 0.5), 2.0 * half + 2.0, 1.0, 0.0, 90.0) for s in (-1, 1)])


def test_wall_returns_exact_ranges() -> None:
    sweep, _ = cast(box(-20.0, 0.0, 2.0, 200.0, 0.0, 50.0))
    on_wall = sweep.points[sweep.solids == 0]
    assert len(on_wall) > 4000
    np.testing.assert_allclose(on_wall[:, 0], -19.0, atol=1e-5)


def test_ground_returns_lie_at_the_mounts_height_below() -> None:
    sweep, _ = cast(Prisms.empty())
    assert set(sweep.solids) == {GROUND_HIT}
    np.testing.assert_allclose(sweep.points[:, 2], -2.4, atol=1e-5)
    assert np.linalg.norm(sweep.points[:, :3], axis=1).max() <= 85.0


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.4), (0.15, -0.1, 2.0), (0.0, 1.2, -1.0)])
@pytest.mark.parametrize("seed", [1, 2])
def test_returns_agree_with_plain_rays(seed: int, angles: tuple[float, float, float]) -> None:
    statics, actors = random_prisms(seed, 60, 35.0), random_prisms(seed + 10, 20, 35.0)
    sweep, pose = cast(statics, actors, tick=seed, angles=angles)
    everything = Prisms.concatenate([statics, actors])
    for i in np.random.default_rng(seed).integers(0, len(sweep.points), 60):
        point = sweep.points[i, :3].astype(np.float64)
        distance = np.linalg.norm(point)
        ray = pose.axes @ (point / distance)
        expected, row = cast_ray(pose.origin, ray, everything)
        ground = -pose.origin[2] / ray[2] if ray[2] < 0.0 else np.inf
        if ground < expected:
            expected, row = ground, GROUND_HIT
        assert distance == pytest.approx(expected, abs=2e-3)
        assert sweep.solids[i] == row


def test_beams_that_miss_leave_no_point() -> None:
    sweep, _ = cast(box(10.0, 0.0, 1.0, 1.0, 0.0, 1.0), height=2.4)
    elevation = np.degrees(np.arcsin(sweep.points[:, 2] / np.linalg.norm(sweep.points[:, :3], axis=1)))
    assert elevation.max() < -1.5  # the ground lies 85 m off at -1.6 degrees


def test_even_ticks_sweep_the_left_half_and_odd_ones_the_right() -> None:
    left, _ = cast(Prisms.empty(), tick=4)
    right, _ = cast(Prisms.empty(), tick=5)
    assert left.points[:, 1].max() < 1e-4
    assert right.points[:, 1].min() > -1e-4


def test_half_sweep_has_carlas_columns_and_channels() -> None:
    assert MODEL.columns == 469  # round(600 000 * 0.05 / 64)
    sweep, _ = cast(room(30.0))
    assert len(sweep.points) == 64 * 469
    elevation = np.degrees(np.arcsin(sweep.points[:, 2] / np.linalg.norm(sweep.points[:, :3], axis=1)))
    channels = elevation.reshape(64, 469)
    np.testing.assert_allclose(channels.mean(axis=1), np.linspace(10.0, -30.0, 64), atol=1e-4)


def test_drop_off_keeps_the_share_of_carlas_model() -> None:
    sweep, _ = cast(room(20.0), model=MODEL)
    assert len(sweep.points) / (64 * 469) == pytest.approx(0.55, abs=0.01)
    np.testing.assert_allclose(
        sweep.points[:, 3], np.exp(-0.004 * np.linalg.norm(sweep.points[:, :3], axis=1)), rtol=1e-5
    )


def test_faint_returns_are_dropped_more_often() -> None:
    wall = box(-70.0, 0.0, 1.0, 8.0, 0.0, 90.0)
    every, _ = cast(wall, tick=0)
    kept, _ = cast(wall, tick=0, model=LidarModel(general_drop=0.0))
    share = np.mean(kept.solids == 0) * len(kept.solids) / np.sum(every.solids == 0)
    assert share == pytest.approx(0.6 + 0.5 * np.exp(-0.004 * 69.6), abs=0.05)


def test_gap_under_a_box_lets_beams_through() -> None:
    floating = box(-10.0, 0.0, 2.0, 4.0, 1.0, 1.5)
    sweep, _ = cast(floating)
    behind = (sweep.solids == GROUND_HIT) & (np.abs(sweep.points[:, 1]) < 1.0)
    assert ((sweep.points[:, 0] < -13.0) & behind).any()
    assert ((sweep.points[:, 0] < -9.5) & (sweep.points[:, 0] > -11.0) & behind).any()


def test_sensor_inside_a_solid_sees_through_it() -> None:
    sweep, _ = cast(box(0.0, 0.0, 4.0, 4.0, 0.0, 5.0))
    assert set(sweep.solids) == {GROUND_HIT}


def test_roof_below_the_sensor_is_hit_from_above() -> None:
    sweep, _ = cast(box(0.0, 0.0, 10.0, 4.0, 0.2, 1.5))
    roof = sweep.points[sweep.solids == 0]
    assert len(roof) > 0
    np.testing.assert_allclose(roof[:, 2], -0.9, atol=1e-5)
