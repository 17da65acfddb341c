"""The query API of a town: everything that knows roads asks a `TownMap`."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.errors import MapError
from lavsim.map.chords import Chords, build_chords
from lavsim.map.derived import road_shapes
from lavsim.map.junction import Junction
from lavsim.map.landmark import Landmark, build_landmarks
from lavsim.map.lane import LaneTable
from lavsim.map.lane_index import LaneIndex, centre_points
from lavsim.map.marks import MarkLine, mark_lines, stop_mark
from lavsim.map.opendrive import read_network
from lavsim.map.parking import ParkingSlot
from lavsim.map.records import Network
from lavsim.map.section import RoadShape, SectionShape
from lavsim.map.signal import LightGroup, Sign, TrafficLight
from lavsim.map.stop_lines import is_stop_line, outline_in_world
from lavsim.map.waypoint import Waypoint
from lavsim.types import LaneType

if TYPE_CHECKING:
    from shapely import MultiPolygon

    from lavsim.map.scenery import Scenery

Floats = NDArray[np.float64]

ROADWAY = (
    LaneType.DRIVING
    | LaneType.BIDIRECTIONAL
    | LaneType.ENTRY
    | LaneType.EXIT
    | LaneType.OFF_RAMP
    | LaneType.ON_RAMP
    | LaneType.PARKING
)  # lanes that vehicles may be on


@dataclass(frozen=True, eq=False)
class LaneHits:
    """Nearest lanes of N points.

    Attributes:
        lane: (N,) int32; -1 where the town has no such lane or the point is not finite.
        u: (N,) place on the lane [m travelled].
        s: (N,) OpenDRIVE s of it [m].
        distance: (N,) to the lane's centre line [m]; in 3D when the points have z.
        offset: (N,) lateral, right of the direction of travel positive [m].
        width: (N,) lane width there [m].
        yaw: (N,) direction of travel there [rad, not wrapped].
        points: (N, 3) the place itself [m].
    """

    lane: NDArray[np.int32]
    u: Floats
    s: Floats
    distance: Floats
    offset: Floats
    width: Floats
    yaw: Floats
    points: Floats

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(N,) whether the point lies between the lane's edges."""
        return (self.lane >= 0) & (self.distance <= self.width / 2.0)


@dataclass(frozen=True, eq=False)
class TownMap:
    """A town. Immutable; what is costly is worked out on first use.

    Attributes:
        name: As it was loaded.
        digest: First 16 hex digits of the file's SHA-256.
        data: The file's bytes.
        lanes: All lanes.
        junctions: As `LaneTable.junction` numbers them.
        lights: Traffic lights as snapshots number them.
        light_groups: Which lights take turns.
        signs: Stop, yield and speed signs as `LaneTable.sign` numbers them.
        crosswalks: Polygons (M, 2) [m].
        parking: Parking spaces drawn as objects.
        geo_reference: Latitude and longitude of the origin [deg].
        report: What was mended, dropped or not read, in sentences.
    """

    name: str
    digest: str
    data: bytes = field(repr=False)
    lanes: LaneTable
    junctions: tuple[Junction, ...]
    lights: tuple[TrafficLight, ...]
    light_groups: tuple[LightGroup, ...]
    signs: tuple[Sign, ...]
    crosswalks: tuple[Floats, ...]
    parking: tuple[ParkingSlot, ...]
    geo_reference: tuple[float, float]
    report: tuple[str, ...]

    def __repr__(self) -> str:
        return f"TownMap({self.name!r}, {len(self.lanes)} lanes, {len(self.lights)} lights)"

    @cached_property
    def xodr(self) -> str:
        """The file's text."""
        return self.data.decode("utf-8", errors="replace")

    @cached_property
    def network(self) -> Network:
        """The file's records; read on first use where the town came from its copy on disk."""
        return read_network(self.data, self.name)

    @cached_property
    def shapes(self) -> dict[int, RoadShape]:
        """Curves of all roads by id."""
        return road_shapes(self.network, self.name)

    @cached_property
    def bounds(self) -> Floats:
        """x0, y0, x1, y1 of all lanes with their widths [m]."""
        low = (self.lanes.points[:, :2] - self.lanes.width[:, None] / 2.0).min(axis=0)
        high = (self.lanes.points[:, :2] + self.lanes.width[:, None] / 2.0).max(axis=0)
        return np.concatenate([low, high])

    @cached_property
    def _indexes(self) -> dict[int, LaneIndex]:
        return {}

    def index(self, types: int = LaneType.DRIVING) -> LaneIndex:
        """Search structure over the lanes of `types`; made on first use."""
        key = int(types)
        if key not in self._indexes:
            self._indexes[key] = LaneIndex.build(self.lanes, key)
        return self._indexes[key]

    def nearest(self, points: ArrayLike, types: int = LaneType.DRIVING) -> LaneHits:
        """The nearest lane centre of each of `points` (N, 2) or (N, 3), in 3D if z is given.

        Where lanes overlap (junctions) and lie equally near, the one first in the table is given.
        """
        where = np.atleast_2d(np.asarray(points, dtype=np.float64))
        lane, u, s, distance, offset, width, yaw, on_lane = self.index(types).search(self.lanes, where)
        return LaneHits(lane, u, s, distance, offset, width, yaw, on_lane)

    @cached_property
    def chords(self) -> Chords:
        """What CARLA projects onto; made on first use."""
        return build_chords(self)

    def project(self, points: ArrayLike, types: int = LaneType.DRIVING) -> LaneHits:
        """Where CARLA's `get_waypoint` puts each of `points` (N, 2) or (N, 3); z is 0 if not given.

        Like `nearest`, but by CARLA's chords: in bends s differs by up to some decimetres. Where lanes lie equally
        near, CARLA's answer is arbitrary; the one first in the table is given.
        """
        where = np.atleast_2d(np.asarray(points, dtype=np.float64))
        if where.shape[1] == 2:
            where = np.concatenate([where, np.zeros((len(where), 1))], axis=1)
        t = self.lanes
        lane, s = self.chords.nearest((t.type & int(types)) != 0, where)
        u, distance, offset, width, yaw = np.full((5, len(where)), np.nan)
        on_lane = np.full((len(where), 3), np.nan)
        distance[:] = np.inf
        for k in np.flatnonzero(lane >= 0):
            x, y, z, yaw[k], width[k] = self.exact(int(lane[k]), float(s[k]))
            on_lane[k] = x, y, z
            dx, dy, dz = where[k] - on_lane[k]
            u[k] = t.u_of_s(int(lane[k]), float(s[k]))
            distance[k] = np.sqrt(dx * dx + dy * dy + dz * dz)
            offset[k] = dy * np.cos(yaw[k]) - dx * np.sin(yaw[k])
        return LaneHits(lane, u, s, distance, offset, width, yaw, on_lane)

    def carla_waypoint(
        self, point: ArrayLike, project_to_road: bool = True, types: int = LaneType.DRIVING
    ) -> Waypoint | None:
        """CARLA's `get_waypoint`: by chords; without `project_to_road` None beyond half the lane's width in plan."""
        hit = self.project(np.asarray(point, dtype=np.float64)[None], types)
        if hit.lane[0] < 0:
            return None
        apart = float(np.hypot(*(np.asarray(point, dtype=np.float64)[:2] - hit.points[0, :2])))
        if not project_to_road and apart >= hit.width[0] / 2.0:
            return None
        return Waypoint(self, int(hit.lane[0]), float(hit.u[0]))

    def waypoint(self, point: ArrayLike, types: int = LaneType.DRIVING) -> Waypoint:
        """The waypoint nearest to `point` (2,) or (3,).

        Raises:
            MapError: the town has no lane of `types`, or the point is not finite.
        """
        hits = self.nearest(np.asarray(point, dtype=np.float64)[None], types)
        if hits.lane[0] < 0:
            raise MapError(f"{self.name} has no lane of the types asked for near {np.asarray(point).tolist()}.")
        return Waypoint(self, int(hits.lane[0]), float(hits.u[0]))

    def waypoint_at(self, lane: int, u: float) -> Waypoint:
        """The waypoint after travelling `u` metres on `lane`."""
        return Waypoint(self, int(lane), float(min(max(u, 0.0), self.lanes.length[lane])))

    def waypoint_xodr(self, road_id: int, lane_id: int, s: float) -> Waypoint | None:
        """The waypoint at file coordinates; None where the road has no such lane there (CARLA)."""
        shape = self.shapes.get(road_id)
        if shape is None or not 0.0 <= s < shape.road.length:
            return None
        section = int(np.searchsorted(shape.section_s[:-1], s, side="right")) - 1
        lane = self._lane_of.get((road_id, section, lane_id))
        return None if lane is None else Waypoint(self, lane, self.lanes.u_of_s(lane, s))

    def centre(self, lane: ArrayLike, u: ArrayLike) -> Floats:
        """x, y, z, yaw, curvature (N, 5) of lane centres at `lane` (N,), `u` (N,); u is clamped to the lane."""
        lane = np.atleast_1d(np.asarray(lane, dtype=np.int32))
        u = np.atleast_1d(np.asarray(u, dtype=np.float64))
        lane, u = np.broadcast_arrays(lane, u)
        t = self.lanes
        return centre_points(t.points, t.first, t.step, np.ascontiguousarray(lane), np.ascontiguousarray(u))

    def exact(self, lane: int, s: float, carla_yaw: bool = False) -> tuple[float, float, float, float, float]:
        """x, y, z, yaw of a lane's centre and its width at OpenDRIVE `s`, from the file's own curves.

        With `carla_yaw` the yaw is the one that CARLA gives, which takes the slope of a lane's centre against the
        reference line for an angle (no arctangent, no curvature); the same but where lanes open or close.
        """
        section = self.section(int(self.lanes.road_id[lane]), int(self.lanes.section[lane]))
        at = np.array([min(max(s, section.start), section.end - 1e-7)])
        lane_id = int(self.lanes.lane_id[lane])
        t, slope, width = section.centre(lane_id, at)
        x, y, heading, curvature, stretch = section.shape.line.pose(at)
        turned = slope if carla_yaw else np.arctan2(slope, stretch - curvature * t)
        yaw = -(heading + turned) + (0.0 if section.forward(lane_id) else np.pi)
        x, y = x - t * np.sin(heading), -(y + t * np.cos(heading))
        z = section.height(lane_id, at, t)
        return float(x[0]), float(y[0]), float(z[0]), float(yaw[0]), max(float(width[0]), 0.0)

    def poses(self, lane: int, s: Floats) -> tuple[Floats, Floats, Floats]:
        """World points (N, 3), and CARLA's yaw and pitch (N,) [rad] of a lane's centre at OpenDRIVE `s` (N,)."""
        section = self.section(int(self.lanes.road_id[lane]), int(self.lanes.section[lane]))
        at = np.clip(s, section.start, section.end - 1e-7)
        lane_id = int(self.lanes.lane_id[lane])
        forward = section.forward(lane_id)
        t, slope, _ = section.centre(lane_id, at)
        x, y, heading, _ = section.shape.pose(at)
        z = section.height(lane_id, at, t)
        points = np.stack([x - t * np.sin(heading), -(y + t * np.cos(heading)), z], axis=1)
        climb = section.shape.elevation(at)[1] * (1.0 if forward else -1.0)
        return points, -(heading + slope) + (0.0 if forward else np.pi), np.arctan(climb)

    def lane_polygon(self, lane: int) -> Floats:
        """Outline (M, 2) of a lane: its left edge in the direction of travel, then its right edge back."""
        points, half = self.lanes.centre_line(lane), self.lanes.width[self.lanes.rows(lane), None] / 2.0
        aside = np.stack([-np.sin(points[:, 3]), np.cos(points[:, 3])], axis=1) * half
        return np.concatenate([points[:, :2] - aside, (points[:, :2] + aside)[::-1]])

    @cached_property
    def _lane_of(self) -> dict[tuple[int, int, int], int]:
        t = self.lanes
        keys = zip(t.road_id.tolist(), t.section.tolist(), t.lane_id.tolist(), strict=True)
        return {key: lane for lane, key in enumerate(keys)}

    def lane_index(self, road_id: int, section: int, lane_id: int) -> int:
        """Row of a lane in the table.

        Raises:
            MapError: there is no such lane.
        """
        lane = self._lane_of.get((int(road_id), int(section), int(lane_id)))
        if lane is None:
            raise MapError(f"{self.name} has no lane {lane_id} in section {section} of road {road_id}.")
        return lane

    @cached_property
    def _sections(self) -> dict[tuple[int, int], SectionShape]:
        return {}

    def section(self, road_id: int, section: int) -> SectionShape:
        """Curves of one section of a road."""
        key = (road_id, section)
        if key not in self._sections:
            self._sections[key] = SectionShape(self.shapes[road_id], section)
        return self._sections[key]

    def speed_limit_at(self, points: ArrayLike, types: int = LaneType.DRIVING) -> Floats:
        """Speed limit (N,) [m/s] on the nearest lane of each of `points` (N, 2|3); NaN where there is none.

        Signs hold from where they stand, until the next one.
        """
        hits = self.nearest(points, types)
        t = self.lanes
        limits = np.full(len(hits.lane), np.nan)
        for k in np.flatnonzero(hits.lane >= 0):
            rows = slice(t.limit_first[hits.lane[k]], t.limit_first[hits.lane[k] + 1])
            row = int(np.searchsorted(t.limit_u[rows], hits.u[k] + 1e-6, side="right")) - 1
            limits[k] = t.limit[rows][max(row, 0)]
        return limits

    def drivable_area(self, types: int = ROADWAY) -> MultiPolygon:
        """Ground covered by lanes of `types`, as one geometry."""
        from lavsim.map.area import drivable_area

        return drivable_area(self, int(types))

    def drivable_raster(self, resolution: float = 0.5, types: int = ROADWAY) -> tuple[NDArray[np.bool_], Floats]:
        """The same as an image (rows to +y, columns to +x) and the x, y of its corner [m]; `resolution` [m/px]."""
        from lavsim.map.area import drivable_raster

        return drivable_raster(self, resolution, int(types))

    @cached_property
    def marks(self) -> tuple[MarkLine, ...]:
        """Paint and kerbs, from lane marks and stop-line objects."""
        lines: list[MarkLine] = []
        for road in self.network.roads:
            for index in range(len(road.sections)):
                section = self.section(road.id, index)
                for lane in section.record.lanes:
                    lines += mark_lines(section, lane.id, lane.marks)
            for thing in road.objects:
                if is_stop_line(thing):
                    lines.append(stop_mark(outline_in_world(thing, self.shapes[road.id])))
        return tuple(lines)

    def topology(self) -> list[tuple[Waypoint, Waypoint]]:
        """From the start of each driving lane to that of each lane that follows it, or to its own end (CARLA)."""
        pairs: list[tuple[Waypoint, Waypoint]] = []
        for lane in self.lanes.where(LaneType.DRIVING).tolist():
            start = self.waypoint_at(lane, 0.0)
            following = [self.waypoint_at(int(k), 0.0) for k in self.lanes.successors(lane)]
            pairs += [(start, end) for end in following or [self.waypoint_at(lane, np.inf)]]
        return pairs

    @cached_property
    def landmarks(self) -> tuple[Landmark, ...]:
        """All places where signals count (CARLA's `get_all_landmarks`)."""
        return build_landmarks(self)

    @cached_property
    def _landmarks_by_road(self) -> dict[int, list[tuple[int, Landmark]]]:
        found: dict[int, list[tuple[int, Landmark]]] = {}
        for number, landmark in enumerate(self.landmarks):
            found.setdefault(landmark.road_id, []).append((number, landmark))
        return found

    def landmarks_of(self, road_id: int) -> list[tuple[int, Landmark]]:
        """Landmarks that count on a road, with their numbers."""
        return self._landmarks_by_road.get(road_id, [])

    @cached_property
    def scenery(self) -> Scenery:
        """Buildings, poles and trees; the same for the same file."""
        from lavsim.map.scenery import build_scenery

        return build_scenery(self)
