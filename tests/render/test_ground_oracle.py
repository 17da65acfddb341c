"""The ground's classes in images against the lanes' polygons, crosswalks and paint of the map, worked out by shapely.

A raster cell is 0.1 m, of paint 0.05 m: places nearer than one cell to any border are left out.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.render.ground import DASH, GAP, RESOLUTION, THINNEST, Surface, ground_raster
from lavsim.render.scene import Scene
from lavsim.render.sheet import CAMERAS
from lavsim.types import LaneType, Tag
from tests.render.test_oracle import moments

DRIVEN = (LaneType.DRIVING | LaneType.BIDIRECTIONAL | LaneType.STOP | LaneType.BIKING | LaneType.ENTRY | LaneType.EXIT
          | LaneType.OFF_RAMP | LaneType.ON_RAMP | LaneType.TRAM | LaneType.RAIL | LaneType.ROADWORKS)  # fmt: skip
# What covers what, from the bottom up; the tag it shows.
LAYERS = (
    (LaneType.MEDIAN | LaneType.BORDER | LaneType.NONE, Tag.TERRAIN),
    (LaneType.SIDEWALK, Tag.SIDEWALK),
    (LaneType.SHOULDER | LaneType.RESTRICTED, Tag.ROAD),
    (LaneType.PARKING, Tag.ROAD),
    (DRIVEN, Tag.ROAD),
)


class Paper:
    """A town as polygons and lines."""

    def __init__(self, town: TownMap) -> None:
        self.layers = [(shapely.union_all(_strips(town, int(types))), tag) for types, tag in LAYERS]
        lines = [mark for mark in town.marks if mark.kind not in ("none", "grass", "")]
        self.curbs = _painted([m for m in lines if m.kind == "curb"])
        self.solid = _painted([m for m in lines if m.kind == "solid"])
        broken = [m for m in lines if m.kind == "broken"]
        self.broken = _painted(broken)
        self.crosswalks = shapely.union_all([shapely.Polygon(polygon) for polygon in town.crosswalks])
        self.stops = _painted([m for m in lines if m.kind == "stop"])
        if not any(m.kind == "stop" for m in lines):
            places = [town.centre([s.lane], [s.paint_u])[0, :2] for light in town.lights for s in light.stop_lines]
            self.stops = shapely.union_all([shapely.Point(place).buffer(6.0) for place in places])

    def expected(self, places: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Tag at each place (N, 2), and whether it is clear of all borders and of what is drawn by other rules."""
        points = shapely.points(places)
        box = (*(places.min(axis=0) - 1.0), *(places.max(axis=0) + 1.0))
        tag = np.full(len(places), int(Tag.TERRAIN))
        clear = np.ones(len(places), bool)
        for shape, value in self.layers:
            near = shapely.clip_by_rect(shape, *box)
            tag[shapely.contains(near, points)] = value
            clear &= _is_off(near.boundary, points)
        for shape in (self.crosswalks, self.stops, self.broken, self.curbs):
            clear &= _is_off(shapely.clip_by_rect(shape, *box), points)
        # Lines are thinner than two cells: on them a cell's width of their border can't be left out, beside them it is.
        solid = shapely.clip_by_rect(self.solid, *box)
        inside = shapely.contains(solid, points)
        clear &= inside | _is_off(solid, points)
        tag[inside] = Tag.ROAD_LINE
        return tag, clear


def _is_off(shape: shapely.Geometry, points: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Whether each of `points` lies farther than a cell from `shape`."""
    off: NDArray[np.bool_] = ~(shapely.distance(shape, points) <= RESOLUTION)  # NaN: there is no such shape
    return off


def _strips(town: TownMap, types: int) -> list[shapely.Polygon]:
    lanes = town.lanes
    found = []
    for lane in np.flatnonzero(lanes.type & types).tolist():
        rows = lanes.rows(lane)
        yaw, half = lanes.points[rows, 3], lanes.width[rows, None] / 2.0 + 0.02
        aside = np.stack([-np.sin(yaw), np.cos(yaw)], axis=1) * half
        middle = lanes.points[rows, :2]
        quads = np.stack([(middle + aside)[:-1], (middle + aside)[1:], (middle - aside)[1:], (middle - aside)[:-1]], 1)
        found += [p for p in shapely.polygons(quads) if p.is_valid and p.area > 1e-6]
    return found


def _painted(marks: list) -> shapely.Geometry:  # type: ignore[type-arg]
    return shapely.union_all(
        [shapely.LineString(m.points).buffer(max(m.width, THINNEST) / 2.0, cap_style="flat") for m in marks]
    )


@pytest.fixture(scope="module")
def town() -> TownMap:
    return load_town("eu_small_a")


@pytest.fixture(scope="module")
def paper(town: TownMap) -> Paper:
    return Paper(town)


def test_tags_of_the_ground_are_those_of_the_lanes_below(town: TownMap, paper: Paper) -> None:
    scene = Scene(town)
    compared = wrong = 0
    for number, snapshot in enumerate(moments(town, 21, 6)):
        view = CAMERAS[number % 4][1]
        tags, instance = view.labels(snapshot, scene)
        depth = view.depth(snapshot, scene)
        pose = view.mount.pose(snapshot)
        row, column = np.nonzero(np.isin(tags, [Tag.ROAD, Tag.ROAD_LINE, Tag.SIDEWALK, Tag.TERRAIN]) & (depth < 60.0))
        chosen = np.random.default_rng(number).permutation(len(row))[:4000]
        row, column = row[chosen], column[chosen]
        focal = view.lens.focal
        local = np.stack([np.ones(len(row)), (column + 0.5 - view.width / 2.0) / focal,
                          -(row + 0.5 - view.height / 2.0) / focal], axis=1)  # fmt: skip
        places = pose.origin + local @ pose.axes.T * depth[row, column, None]
        on_ground = (np.abs(places[:, 2]) < 0.005) & (instance[row, column] == 0)
        places = places[on_ground, :2]
        expected, clear = paper.expected(places)
        compared += int(clear.sum())
        wrong += int((clear & (expected != tags[row, column][on_ground])).sum())
    print(f"{wrong} of {compared} places on the ground have another tag")
    assert compared > 5000
    assert wrong <= 0.005 * compared


def test_solid_lines_lie_within_one_cell_of_where_the_map_has_them(town: TownMap, paper: Paper) -> None:
    raster = ground_raster(town)
    lines = [mark for mark in town.marks if mark.kind == "solid"]
    paint = [Surface.WHITE_SOLID, Surface.YELLOW_SOLID, Surface.STOP_LINE, Surface.CROSSWALK]
    for mark in lines:
        middle = raster.at(mark.points[1:-1])
        assert np.isin(middle, paint).mean() > 0.98 or len(middle) < 10
    cells = np.argwhere(np.isin(raster.classes & 15, [Surface.WHITE_SOLID, Surface.YELLOW_SOLID]))
    chosen = np.random.default_rng(0).permutation(len(cells))[:5000]
    centres = raster.origin + (cells[chosen][:, ::-1] + 0.5) * raster.resolution
    assert shapely.distance(paper.solid, shapely.points(centres)).max() <= RESOLUTION


def test_dashes_are_as_long_as_they_should_be(town: TownMap) -> None:
    raster = ground_raster(town)
    shares = []
    for mark in town.marks:
        length = np.hypot(*np.diff(mark.points, axis=0).T).sum()
        if mark.kind != "broken" or length < 4.0 * (DASH + GAP):
            continue
        line = shapely.LineString(mark.points)
        places = shapely.get_coordinates(line.interpolate(np.arange(0.0, length, 0.05)))
        shares.append(np.isin(raster.at(places), [Surface.WHITE_BROKEN, Surface.YELLOW_BROKEN]).mean())
    assert np.mean(shares) == pytest.approx(DASH / (DASH + GAP), abs=0.02)
