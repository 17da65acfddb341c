"""Training samples of every vehicle in a window: where it was, and its future in its own frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.tables import Column, Table
from lavsim.geometry import wrap_angle
from lavsim.kernel import kernel
from lavsim.types import ActorClass, Role


@dataclass(frozen=True)
class SampleFilter:
    """Which actors of a window become samples; the defaults are LAV's (v1), in which only presence and distance count.

    The ego always does. Others must be vehicles or walkers that are in the table in every frame of the window, which
    means within its radius (50 m) of the ego.

    Attributes:
        vehicle_radius: Vehicles farther than this from the ego in the first frame are dropped [m]; 15 v1, 25 v2.
        walker_radius: The same of walkers [m].
        most: Actors kept, the ego included; those with the lowest ids.
        ahead_only: Drops vehicles that are not ahead of the ego's origin, and walkers: what LAV's models do themselves.
        least_hits: Others need as many LiDAR points in the first frame.
        least_pixels: Others need as many pixels in all cameras together in the first frame.
        least_motion: Others must be that far from where they were, at the end of the window [m].
        parked: Whether parked cars count; in CARLA they are no actors.

    Source: reference `lav.md` 3.3.
    """

    vehicle_radius: float = 15.0
    walker_radius: float = 10.0
    most: int = 20
    ahead_only: bool = False
    least_hits: int = 0
    least_pixels: int = 0
    least_motion: float = 0.0
    parked: bool = True


@dataclass(frozen=True)
class Motions:
    """The actors of a window, the ego first, then by id. Frames are vehicles': x ahead, y right.

    Attributes:
        ids: (N,) int32.
        classes: (N,) uint8 `ActorClass`.
        places: (N, 2) in the ego's frame at the first frame [m].
        headings: (N,) relative to the ego's, in [-pi, pi) [rad].
        sizes: (N, 3) full length, width, height [m].
        speeds: (N,) in the first frame [m/s].
        futures: (N, T, 2) where each will be, in its own frame at the first frame [m].
        turns: (N, T) its heading then, relative to the first frame's [rad].
        hits: (N,) LiDAR points on it in the first frame; -1 if not counted.
        pixels: (N,) of it in all cameras; -1 if not counted.
    """

    ids: NDArray[np.int32]
    classes: NDArray[np.uint8]
    places: NDArray[np.float64]
    headings: NDArray[np.float64]
    sizes: NDArray[np.float32]
    speeds: NDArray[np.float64]
    futures: NDArray[np.float64]
    turns: NDArray[np.float64]
    hits: NDArray[np.int32]
    pixels: NDArray[np.int32]

    @property
    def is_vehicle(self) -> NDArray[np.bool_]:
        """(N,) whether each is a vehicle, two-wheelers included."""
        return self.classes <= ActorClass.BICYCLE


def motions_of(table: Table, first: int, steps: int, filters: SampleFilter | None = None) -> Motions:
    """The samples of a window.

    Args:
        table: Of the episode.
        first: Frame at which the window begins.
        steps: T, further frames of it.
        filters: Who counts; LAV's rules if None.
    """
    filters = filters or SampleFilter()
    ids = table.columns["actor_id"]
    assert ids.ends is not None
    # (A, T + 1) rows of each actor of the first frame in the actor columns; -1 where it is absent.
    rows = _follow(ids.values, ids.ends[first : first + steps + 2])
    positions, yaws = table.columns["actor_position"].values, table.columns["actor_yaw"].values
    start = rows[:, 0]
    ego_yaw = yaws[start[0]]
    places = _turned(positions[start, :2] - positions[start[0], :2], ego_yaw)
    path = positions[rows, :2] - positions[start, None, :2]
    kept = _keep(table, rows, places, path, filters)
    path, start = path[kept, 1:], start[kept]
    return Motions(
        ids=ids.values[start],
        classes=table.columns["actor_class"].values[start],
        places=places[kept],
        headings=wrap_angle(yaws[start] - ego_yaw),
        sizes=table.columns["actor_size"].values[start],
        speeds=np.linalg.norm(table.columns["actor_velocity"].values[start].astype(np.float64), axis=1),
        futures=_turned(path, yaws[start, None]),
        turns=wrap_angle(yaws[rows[kept, 1:]] - yaws[start, None]),
        hits=_seen(table, "actor_lidar_hits", start),
        pixels=_seen(table, "actor_pixels", start),
    )


def _keep(
    table: Table,
    rows: NDArray[np.int64],
    places: NDArray[np.float64],
    path: NDArray[np.float64],
    filters: SampleFilter,
) -> NDArray[np.int64]:
    """Who stays, the ego first."""
    start = rows[:, 0]
    classes = table.columns["actor_class"].values[start]
    vehicle, walker = classes <= ActorClass.BICYCLE, classes == ActorClass.WALKER
    squared = np.sum(places * places, axis=1)
    good = (rows >= 0).all(axis=1)
    good &= (vehicle & (squared <= filters.vehicle_radius**2)) | (walker & (squared <= filters.walker_radius**2))
    if filters.ahead_only:
        good &= vehicle & (places[:, 0] > 0.0)
    if not filters.parked:
        good &= table.columns["actor_role"].values[start] != Role.PARKED
    if filters.least_hits:
        good &= _seen(table, "actor_lidar_hits", start) >= filters.least_hits
    if filters.least_pixels:
        good &= _seen(table, "actor_pixels", start) >= filters.least_pixels
    if filters.least_motion:
        good &= np.sum(path[:, -1] ** 2, axis=1) >= filters.least_motion**2
    good[0] = False
    others = np.flatnonzero(good)
    others = others[np.argsort(table.columns["actor_id"].values[start[others]], kind="stable")]
    return np.concatenate([[0], others])[: filters.most]


def _seen(table: Table, name: str, rows: NDArray[np.int64]) -> NDArray[np.int32]:
    column: Column | None = table.columns.get(name)
    if column is None:
        return np.full(len(rows), -1, np.int32)
    values = column.values[rows]
    return values if values.ndim == 1 else values.sum(axis=1, dtype=np.int32)


def _turned(offset: NDArray[np.float64], yaw: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """World offsets (…, 2) as ahead and right of heading `yaw`."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * offset[..., 0] + s * offset[..., 1], c * offset[..., 1] - s * offset[..., 0]], axis=-1)


@kernel
def _follow(ids, ends):  # type: ignore[no-untyped-def]
    """(A, T + 1) where the actors of the first frame stand in the columns of each frame; -1 where they don't."""
    count, frames = ends[1] - ends[0], len(ends) - 1
    rows = np.full((count, frames), -1, np.int64)
    for i in range(count):
        rows[i, 0] = ends[0] + i
        wanted = ids[ends[0] + i]
        for frame in range(1, frames):
            for row in range(ends[frame], ends[frame + 1]):
                if ids[row] == wanted:
                    rows[i, frame] = row
                    break
    return rows
