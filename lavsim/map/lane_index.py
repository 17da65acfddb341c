"""Nearest lane of many points: a grid of lane chords, searched ring by ring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.map.lane import LaneTable

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

CELL = 4.0  # [m] holds about ten chords of a lane
MOST_CELLS = 4_000_000  # a sparse map of 8 km x 8 km; larger ones get larger cells


@kernel
def interpolate(points: Floats, row: int, share: float, step: float, out: Floats) -> None:
    """x, y, z, yaw, curvature between centre points `row` and `row + 1`: cubic in the plane, linear in the rest."""
    a, b = points[row], points[row + 1]
    t = share
    h00, h10 = (1.0 + 2.0 * t) * (1.0 - t) ** 2, t * (1.0 - t) ** 2
    h01, h11 = t * t * (3.0 - 2.0 * t), t * t * (t - 1.0)
    out[0] = h00 * a[0] + h10 * step * np.cos(a[3]) + h01 * b[0] + h11 * step * np.cos(b[3])
    out[1] = h00 * a[1] + h10 * step * np.sin(a[3]) + h01 * b[1] + h11 * step * np.sin(b[3])
    for k in range(2, 5):
        out[k] = a[k] + t * (b[k] - a[k])


@kernel
def centre_points(points: Floats, first: Ints, step: Floats, lane: Ints, u: Floats) -> Floats:
    """Rows (N, 5) of the lane centres at `lane`, `u`."""
    out = np.empty((len(lane), 5))
    for k in range(len(lane)):
        start = first[lane[k]]
        last = first[lane[k] + 1] - start - 1
        position = min(max(u[k] / step[lane[k]], 0.0), float(last))
        row = min(int(position), last - 1)
        interpolate(points, start + row, position - row, step[lane[k]], out[k])
    return out


@kernel
def _search(
    queries: Floats,
    use_z: bool,
    points: Floats,
    chord_row: Ints,
    chord_lane: Ints,
    cell_first: Ints,
    cell_chord: Ints,
    origin_x: float,
    origin_y: float,
    columns: int,
    rows: int,
    cell: float,
    lane: Ints,
    share: Floats,
    chord: Ints,
) -> None:
    for n in range(len(queries)):
        x, y = queries[n, 0], queries[n, 1]
        z = queries[n, 2] if use_z else 0.0
        lane[n] = -1
        if not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z)) or len(cell_chord) == 0:
            continue
        ci = min(max(int(np.floor(min(max((x - origin_x) / cell, -1.0), columns))), 0), columns - 1)
        cj = min(max(int(np.floor(min(max((y - origin_y) / cell, -1.0), rows))), 0), rows - 1)
        best = np.inf
        ring = 0
        while True:
            i0, i1, j0, j1 = ci - ring, ci + ring, cj - ring, cj + ring
            has_sides = i0 >= 0 or i1 < columns
            j, last = max(j0, 0), min(j1, rows - 1)
            while j <= last:
                on_edge = j in (j0, j1)
                begin, stride = (max(i0, 0), 1) if on_edge or ring == 0 else (i0, i1 - i0)
                for i in range(begin, min(i1, columns - 1) + 1, stride):
                    if i < 0:
                        continue
                    cx, cy = origin_x + i * cell, origin_y + j * cell
                    gap_x, gap_y = max(cx - x, x - cx - cell, 0.0), max(cy - y, y - cy - cell, 0.0)
                    if gap_x * gap_x + gap_y * gap_y > best + 1e-6:
                        continue
                    at = j * columns + i
                    for k in range(cell_first[at], cell_first[at + 1]):
                        c = cell_chord[k]
                        a = points[chord_row[c]]
                        b = points[chord_row[c] + 1]
                        dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
                        ex, ey, ez = x - a[0], y - a[1], z - a[2]
                        if not use_z:
                            dz, ez = 0.0, 0.0
                        norm = dx * dx + dy * dy + dz * dz
                        t = (ex * dx + ey * dy + ez * dz) / norm if norm > 0.0 else 0.0
                        t = min(max(t, 0.0), 1.0)
                        fx, fy, fz = ex - t * dx, ey - t * dy, ez - t * dz
                        d = fx * fx + fy * fy + fz * fz
                        if d < best - 1e-9 or (d < best + 1e-9 and chord_lane[c] < lane[n]):
                            best = min(d, best)
                            lane[n], share[n], chord[n] = chord_lane[c], t, c
                # Rows between the edges have cells of this ring at their sides alone.
                j = j + 1 if has_sides or j + 1 > j1 else max(j + 1, j1)
            # Cells not yet seen lie beyond a side of the block that is still inside the grid.
            bound = np.inf
            if i0 > 0:
                bound = min(bound, x - (origin_x + i0 * cell))
            if i1 < columns - 1:
                bound = min(bound, origin_x + (i1 + 1) * cell - x)
            if j0 > 0:
                bound = min(bound, y - (origin_y + j0 * cell))
            if j1 < rows - 1:
                bound = min(bound, origin_y + (j1 + 1) * cell - y)
            if bound == np.inf or (bound > 0.0 and bound * bound >= best):
                break
            ring += 1


@kernel
def _refine(
    queries: Floats,
    use_z: bool,
    lane: Ints,
    share: Floats,
    chord: Ints,
    chord_row: Ints,
    points: Floats,
    point_s: Floats,
    widths: Floats,
    first: Ints,
    step: Floats,
    length: Floats,
    out: Floats,
) -> None:
    """Moves each hit from its chord onto the curve. Columns: u, s, distance, offset, width, yaw, x, y, z."""
    at = np.empty(5)
    for n in range(len(queries)):
        if lane[n] < 0:
            out[n] = np.nan
            out[n, 2] = np.inf
            continue
        k = lane[n]
        start, last = first[k], first[k + 1] - first[k] - 1
        u = (chord_row[chord[n]] - start + share[n]) * step[k]
        x, y = queries[n, 0], queries[n, 1]
        for turn in range(3):
            position = min(max(u / step[k], 0.0), float(last))
            row = min(int(position), last - 1)
            interpolate(points, start + row, position - row, step[k], at)
            cos, sin = np.cos(at[3]), np.sin(at[3])
            along = (x - at[0]) * cos + (y - at[1]) * sin
            aside = -(x - at[0]) * sin + (y - at[1]) * cos
            if turn == 2:
                break
            shift = along / max(1.0 - at[4] * aside, 0.5)
            u = min(max(u + min(max(shift, -step[k]), step[k]), 0.0), length[k])
        part = position - row
        dz = queries[n, 2] - at[2] if use_z else 0.0
        out[n, 0] = u
        out[n, 1] = point_s[start + row] + part * (point_s[start + row + 1] - point_s[start + row])
        out[n, 2] = np.sqrt((x - at[0]) ** 2 + (y - at[1]) ** 2 + dz * dz)
        out[n, 3] = aside
        out[n, 4] = widths[start + row] + part * (widths[start + row + 1] - widths[start + row])
        out[n, 5] = at[3]
        out[n, 6:9] = at[:3]


@dataclass(frozen=True, eq=False)
class LaneIndex:
    """Chords of the lanes of some types, by grid cell; for `TownMap.nearest` and for compiled kernels.

    Attributes:
        chord_row: (C,) int32, centre point at which the chord starts.
        chord_lane: (C,) int32.
        cell_first, cell_chord: chords of each cell, compressed rows; cell = row * columns + column.
        origin: x, y of the grid's corner [m].
        shape: columns (along x), rows (along y).
        cell: side of a cell [m].
    """

    chord_row: Ints
    chord_lane: Ints
    cell_first: Ints
    cell_chord: Ints
    origin: tuple[float, float]
    shape: tuple[int, int]
    cell: float

    @staticmethod
    def build(lanes: LaneTable, types: int) -> LaneIndex:
        """The index over the lanes of `types`."""
        keep = lanes.where(types)
        sizes = np.diff(lanes.first)
        row_lane = np.repeat(np.arange(len(lanes)), sizes)
        is_chord = np.ones(len(row_lane), np.bool_)
        is_chord[lanes.first[1:] - 1] = False
        wanted = np.zeros(len(lanes), np.bool_)
        wanted[keep] = True
        row = np.flatnonzero(is_chord & wanted[row_lane])
        if not len(row):
            empty = np.zeros(0, np.int32)
            return LaneIndex(empty, empty, np.zeros(2, np.int32), empty, (0.0, 0.0), (1, 1), CELL)
        a, b = lanes.points[row, :2], lanes.points[row + 1, :2]
        low = np.minimum(a, b)
        high = np.maximum(a, b)
        origin = low.min(axis=0)
        extent = high.max(axis=0) - origin
        cell = max(CELL, float(np.sqrt(extent[0] * extent[1] / MOST_CELLS)), float(extent.max()) / MOST_CELLS)
        columns, rows = (np.floor(extent / cell).astype(int) + 1).tolist()
        c0, c1 = np.floor((low - origin) / cell).astype(np.int64), np.floor((high - origin) / cell).astype(np.int64)
        # A chord is shorter than a cell, so the cells of its box's corners are all it can meet.
        cells = np.concatenate([j * columns + i for i in (c0[:, 0], c1[:, 0]) for j in (c0[:, 1], c1[:, 1])])
        chords = np.tile(np.arange(len(row)), 4)
        pairs = np.unique(cells * len(row) + chords)
        cells, chords = pairs // len(row), pairs % len(row)
        first = np.searchsorted(cells, np.arange(columns * rows + 1))
        return LaneIndex(
            row.astype(np.int32),
            row_lane[row].astype(np.int32),
            first.astype(np.int32),
            chords.astype(np.int32),
            (float(origin[0]), float(origin[1])),
            (columns, rows),
            cell,
        )

    def search(
        self, lanes: LaneTable, queries: Floats
    ) -> tuple[Ints, Floats, Floats, Floats, Floats, Floats, Floats, Floats]:
        """lane, u, s, distance, offset, width, yaw and points (N, 3) of the nearest lanes of `queries` (N, 2|3)."""
        queries = np.ascontiguousarray(queries)
        count, use_z = len(queries), queries.shape[1] >= 3
        lane, chord = np.full(count, -1, np.int32), np.zeros(count, np.int32)
        share, out = np.zeros(count), np.empty((count, 9))
        _search(
            queries, use_z, lanes.points, self.chord_row, self.chord_lane, self.cell_first, self.cell_chord,
            self.origin[0], self.origin[1], self.shape[0], self.shape[1], self.cell, lane, share, chord,
        )  # fmt: skip
        _refine(
            queries, use_z, lane, share, chord, self.chord_row, lanes.points, lanes.point_s, lanes.width,
            lanes.first, lanes.step, lanes.length, out,
        )  # fmt: skip
        return lane, out[:, 0], out[:, 1], out[:, 2], out[:, 3], out[:, 4], out[:, 5], out[:, 6:9]
