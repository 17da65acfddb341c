"""The ground of a bundled town."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from lavsim.map.town_files import load_town
from lavsim.render.ground import GroundRaster, Surface, ground_raster
from lavsim.types import LaneType

TOWN = "eu_small_a"
PAINT = [Surface.CROSSWALK, Surface.STOP_LINE, Surface.WHITE_BROKEN, Surface.WHITE_SOLID, Surface.YELLOW_BROKEN]
DRIVEN = [Surface.ROAD, Surface.CROSSWALK_GAP, *PAINT]


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Iterator[GroundRaster]:
    """Drawn anew, in a cache folder of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LAVSIM_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield ground_raster(load_town(TOWN))


def test_lane_centres_lie_on_their_surface(ground: GroundRaster) -> None:
    town = load_town(TOWN)
    rows = np.repeat(np.arange(len(town.lanes)), np.diff(town.lanes.first))
    kind = town.lanes.type[rows]
    below = ground.at(town.lanes.points[:, :2])
    assert np.isin(below[kind == LaneType.DRIVING], DRIVEN).all()
    assert (below[kind == LaneType.SIDEWALK] == Surface.SIDEWALK).mean() > 0.97  # kerbs and corners take the rest


def test_crosswalks_and_stop_lines_are_painted(ground: GroundRaster) -> None:
    town = load_town(TOWN)
    centres = np.array([np.asarray(polygon)[:-1].mean(axis=0) for polygon in town.crosswalks])
    assert np.isin(ground.at(centres), [Surface.CROSSWALK, Surface.CROSSWALK_GAP]).all()
    for light in town.lights:
        for stop in light.stop_lines:
            u = stop.paint_u + np.linspace(-2.0, 2.0, 41)
            path = town.centre(np.full(41, stop.lane), u)[:, :2]
            assert (ground.at(path) == Surface.STOP_LINE).any()


def test_a_lane_mark_is_as_wide_as_it_should_be(ground: GroundRaster) -> None:
    town = load_town(TOWN)
    mark = next(m for m in town.marks if m.kind == "broken")
    along = mark.points[1] - mark.points[0]
    across = np.array([-along[1], along[0]]) / np.hypot(*along)
    offsets = np.linspace(-0.5, 0.5, 201)
    painted = [
        np.mean(ground.at(point + offsets[:, None] * across) == Surface.WHITE_BROKEN) for point in mark.points[:200, :2]
    ]
    assert max(painted) <= 0.25
    assert np.mean([p for p in painted if p > 0.05]) == pytest.approx(0.15, abs=0.02)


def test_drawn_once_and_read_again(ground: GroundRaster) -> None:
    again = ground_raster(load_town(TOWN))
    assert isinstance(again.classes, np.ndarray)
    assert not again.classes.flags.writeable
    assert (again.classes == ground.classes).all()
    assert (again.origin == ground.origin).all()


def test_scenery_leaves_the_road_free(ground: GroundRaster) -> None:
    prisms = load_town(TOWN).scenery.prisms
    low = prisms.z0 < 3.0
    corners = prisms.vertices[low].reshape(-1, 2)
    assert not np.isin(ground.at(corners), DRIVEN).any()
