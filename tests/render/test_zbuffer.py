"""The camera kernel against plain rays."""

from __future__ import annotations

import numpy as np
import pytest

from lavsim.map.prisms import Prisms
from lavsim.render.faces import TOP
from lavsim.render.frame import Pose, rotation
from lavsim.render.solids import solids_of
from lavsim.render.zbuffer import NO_FACE, Pinhole, draw_visibility
from tests.prisms import box, cast_ray, random_prisms

NOTHING = solids_of(Prisms.empty())


def ray_of(lens: Pinhole, pose: Pose, row: int, column: int) -> np.ndarray:
    """World direction of a pixel's centre, of length 1 along the optical axis."""
    right = (column + 0.5 - lens.width / 2.0) / lens.focal
    down = (row + 0.5 - lens.height / 2.0) / lens.focal
    return pose.axes @ np.array([1.0, right, -down])


def test_box_ahead_has_its_distance_everywhere_on_its_front() -> None:
    lens, pose = Pinhole(64, 48, 50.0), Pose(np.array([0.0, 0.0, 1.5]), np.eye(3))
    view = draw_visibility(lens, pose, solids_of(box(12.0, 0.0, 4.0, 4.0, 0.0, 3.0)), NOTHING)
    front = view.face != NO_FACE
    np.testing.assert_allclose(1.0 / view.inverse_depth[front], 10.0, rtol=1e-6)
    rows, columns = np.nonzero(front)
    assert (columns.min(), columns.max()) == (22, 41)  # 4 m at 10 m through 50 px: 20 px
    assert (rows.min(), rows.max()) == (16, 30)  # 7.5 px up and down of the middle: centres 16.5 to 30.5


def test_ground_has_the_depth_of_the_plane() -> None:
    lens, pose = Pinhole(40, 30, 30.0), Pose(np.array([3.0, -2.0, 2.0]), np.eye(3))
    view = draw_visibility(lens, pose, NOTHING, NOTHING)
    depth = 1.0 / view.inverse_depth[20, :]
    np.testing.assert_allclose(depth, 2.0 * 30.0 / 5.5, rtol=1e-6)
    assert (view.inverse_depth[:15] == 0.0).all()


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.7), (0.1, -0.2, 2.0), (-0.3, 0.4, -2.5)])
@pytest.mark.parametrize("seed", [3, 4])
def test_pixels_agree_with_plain_rays(seed: int, angles: tuple[float, float, float]) -> None:
    statics, actors = random_prisms(seed, 80, 40.0), random_prisms(seed + 10, 20, 40.0)
    lens, pose = Pinhole(96, 80, 70.0), Pose(np.array([1.0, 2.0, 2.4]), rotation(*angles))
    view = draw_visibility(lens, pose, solids_of(statics), solids_of(actors))
    everything = Prisms.concatenate([statics, actors])
    rng = np.random.default_rng(seed)
    for row, column in zip(rng.integers(0, 80, 60), rng.integers(0, 96, 60), strict=True):
        ray = ray_of(lens, pose, row, column)
        expected, solid = cast_ray(pose.origin, ray, everything)
        ground = -pose.origin[2] / ray[2] if ray[2] < 0.0 else np.inf
        if ground < expected:
            expected, solid = ground, -1
        face = view.face[row, column]
        assert (view.faces.solid[face] if face >= 0 else -1) == solid
        assert view.inverse_depth[row, column] == pytest.approx(1.0 / expected, rel=1e-4)


def test_neighbouring_faces_leave_no_hole() -> None:
    ring = [box(30.0 * np.cos(a), 30.0 * np.sin(a), 1.0, 40.0, 0.0, 60.0, a) for a in np.arange(8) * np.pi / 4.0]
    lens = Pinhole(200, 150, 90.0)
    for yaw in np.linspace(0.0, 6.0, 7):
        view = draw_visibility(lens, Pose(np.array([0.0, 0.0, 2.0]), rotation(0.0, 0.3, yaw)),
                               solids_of(Prisms.concatenate(ring)), NOTHING)  # fmt: skip
        assert (view.inverse_depth > 0.0).all()


def test_roof_shows_only_from_above() -> None:
    solids, lens = solids_of(box(10.0, 0.0, 4.0, 4.0, 0.0, 2.0)), Pinhole(64, 48, 50.0)
    sides = {
        height: set(draw_visibility(lens, Pose(np.array([0.0, 0.0, height]), np.eye(3)), solids, NOTHING).faces.side)
        for height in (1.0, 5.0)
    }
    assert TOP not in sides[1.0]
    assert TOP in sides[5.0]


def test_solid_across_the_image_plane_is_cut_not_lost() -> None:
    road_wall = solids_of(box(0.0, 3.0, 100.0, 1.0, 0.0, 4.0))
    view = draw_visibility(Pinhole(64, 48, 32.0), Pose(np.array([0.0, 0.0, 1.5]), np.eye(3)), road_wall, NOTHING)
    assert view.face[24, 63] != NO_FACE
    assert 1.0 / view.inverse_depth[24, 63] == pytest.approx(2.5 * 32.0 / 31.5, rel=1e-5)


def test_solids_behind_a_wall_change_nothing_and_those_before_it_show() -> None:
    """Hidden solids are passed over whole; the same picture comes out when each is looked at by itself."""
    lens, pose = Pinhole(160, 120, 90.0), Pose(np.array([0.0, 0.0, 1.7]), rotation(0.05, -0.04, 0.1))
    wall = box(20.0, 0.0, 1.0, 60.0, 0.0, 12.0)
    behind = [box(24.0 + 3.0 * k, 2.0 * (k % 7) - 6.0, 2.0, 2.0, 0.0, 4.0 + k % 5) for k in range(40)]
    before = [box(10.0, 4.0, 1.0, 1.0, 0.0, 2.0), box(19.45, -3.0, 0.1, 1.0, 1.0, 2.0)]
    alone = draw_visibility(lens, pose, solids_of(Prisms.concatenate([wall, *before])), NOTHING)
    crowd = draw_visibility(lens, pose, solids_of(Prisms.concatenate([wall, *before, *behind])), NOTHING)
    assert set(crowd.faces.solid.tolist()) & {1, 2} == {1, 2}
    same = alone.inverse_depth > 0.04  # nearer than 25 m
    np.testing.assert_array_equal(crowd.inverse_depth[same], alone.inverse_depth[same])
    assert (crowd.inverse_depth[~same] <= 0.05).all()
    over = draw_visibility(
        lens, pose, solids_of(Prisms.concatenate([wall, box(60.0, 0.0, 4.0, 4.0, 0.0, 40.0)])), NOTHING
    )
    assert 1 in over.faces.solid  # what stands higher than the wall shows over it
