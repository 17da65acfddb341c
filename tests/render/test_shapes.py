"""What of an actor's shape changes from tick to tick, and how much of a car a LiDAR finds."""

from __future__ import annotations

import numpy as np
import pytest

from lavsim.random import Draws
from lavsim.render.shapes import DOOR_WIDTH, STRIDE
from lavsim.render.solids import Solids
from lavsim.sensors.base import make_sensor
from lavsim.sensors.lidar import Lidar
from lavsim.types import ActorClass
from tests.scenes import plain
from tests.snapshots import EGO, Body, snapshot_of

SCENE = plain()


def solids_of_actor(body: Body) -> Solids:
    actors = SCENE.actors(snapshot_of([EGO, body]))
    return Solids(*(column[actors.instance == body.id] for column in actors))


def reach(solids: Solids) -> np.ndarray:
    """x0, y0, x1, y1 of all footprints."""
    corners = solids.xy[:, :4].reshape(-1, 2)
    return np.concatenate([corners.min(axis=0), corners.max(axis=0)])


@pytest.mark.parametrize(("bit", "side"), [(1, -1), (2, 1), (4, -1), (8, 1)])
def test_an_open_door_stands_out_on_its_own_side(bit: int, side: int) -> None:
    shut, opened = (reach(solids_of_actor(Body(1000, 20.0, doors=doors))) for doors in (0, bit))
    left, right = (shut - opened)[1], (opened - shut)[3]
    assert (left, right) == pytest.approx((DOOR_WIDTH, 0.0) if side < 0 else (0.0, DOOR_WIDTH), abs=1e-6)
    assert (
        len(solids_of_actor(Body(1000, 20.0, doors=15)).corners) == len(solids_of_actor(Body(1000, 20.0)).corners) + 4
    )


def test_doors_of_one_car_open_no_other() -> None:
    both = SCENE.actors(snapshot_of([EGO, Body(1000, 20.0, doors=3), Body(1001, 40.0)]))
    assert (both.instance == 1000).sum() == (both.instance == 1001).sum() + 2


def test_legs_of_a_walker_pass_each_other() -> None:
    walker = {"kind": ActorClass.WALKER, "size": (0.38, 0.38, 1.8), "blueprint": "walker.pedestrian.0001"}
    for gait, share in ((0, 0.0), (64, 1.0), (128, 0.0), (192, -1.0)):
        solids = solids_of_actor(Body(100_000, 10.0, gait=gait, **walker))  # type: ignore[arg-type]
        legs = solids.centre[solids.z0 == 0.0]
        assert len(legs) == 2
        left, right = legs[np.argsort(legs[:, 1])]
        assert left[0] - 10.0 == pytest.approx(share * STRIDE, abs=1e-6)
        assert right[0] - 10.0 == pytest.approx(-share * STRIDE, abs=1e-6)


@pytest.mark.parametrize(
    ("distance", "least", "most"), [(5.0, 700, 2200), (10.0, 250, 700), (25.0, 30, 110), (50.0, 6, 30)]
)
def test_a_car_gives_as_many_points_as_to_a_velodyne_64(distance: float, least: int, most: int) -> None:
    """Rear view of a car ahead, per half sweep with CARLA's drop-off; the paper has a few dozen at 25 m.

    A surface of width w and height h at distance d fills w / d / 0.383 deg azimuths by h / d / 0.635 deg channels.
    """
    lidar = make_sensor({"type": "sensor.lidar.ray_cast", "id": "top", "z": 2.4})
    assert isinstance(lidar, Lidar)
    counts = []
    for turn in (0.0, 0.6, 1.2):
        at = distance * np.array([np.cos(1.0), np.sin(1.0)])  # within the half that odd ticks sweep
        snapshot = snapshot_of([EGO, Body(1000, *at, yaw=1.0 + turn)], tick=1)
        sweep = lidar.sweep(snapshot, SCENE, Draws.of_seed(1))
        actors = SCENE.actors(snapshot)
        rows = sweep.solids - len(SCENE.statics.corners)
        counts.append(int((actors.instance[rows[rows >= 0]] == 1000).sum()))
    assert least <= min(counts)
    assert max(counts) <= most
