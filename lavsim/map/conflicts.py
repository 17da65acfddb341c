"""Where lanes of a junction sweep the same ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import MapError
from lavsim.kernel import kernel
from lavsim.map.lane import CLEAR_HEIGHT, compressed
from lavsim.map.pieces import STEP
from lavsim.types import LaneType

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

MOST_JUNCTION_POINTS = 20_000  # 10 km of lanes in one junction
MOST_JUNCTION_WORK = 2_000_000_000  # squares of that, over all junctions
SWEPT_HALF_WIDTH = 1.2  # [m] what a car sweeps beside its lane's centre, for conflicts inside junctions


@kernel
def _meet(own: Floats, cloud: Floats, owner: Ints, reach: float, near: NDArray[np.bool_]) -> None:
    """Sets `near` (n, lanes) where a point of `own` has one of a lane within `reach` in plan, `CLEAR_HEIGHT` in z."""
    for i in range(len(own)):
        for k in range(len(cloud)):
            dx, dy = own[i, 0] - cloud[k, 0], own[i, 1] - cloud[k, 1]
            if dx**2 + dy**2 < reach**2 and abs(own[i, 2] - cloud[k, 2]) < CLEAR_HEIGHT:
                near[i, owner[k]] = True


def conflicts_of(
    first: Ints,
    step: Floats,
    points: Floats,
    junction: Ints,
    types: Ints,
    road_id: Ints,
    pairs: Sequence[tuple[int, int]],
) -> tuple[Ints, Ints, Floats]:
    """Where driving lanes of a junction sweep the same ground."""
    before: dict[int, set[int]] = {}
    chained = set(pairs)
    for source, target in pairs:
        before.setdefault(target, set()).add(source)
    reach = 2.0 * SWEPT_HALF_WIDTH
    found: list[tuple[int, int]] = []
    spans: list[tuple[float, float]] = []
    work = 0
    for number in range(int(junction.max(initial=-1)) + 1):
        lanes = np.flatnonzero((junction == number) & ((types & int(LaneType.DRIVING)) > 0))
        rows = [np.arange(first[k], first[k + 1]) for k in lanes]
        if not rows:
            continue
        if sum(map(len, rows)) > MOST_JUNCTION_POINTS:
            total = sum(map(len, rows)) * STEP / 1000.0
            raise MapError(f"the junction of road {road_id[lanes[0]]} has {total:.3g} km of lanes; check their widths.")
        work += sum(map(len, rows)) ** 2
        if work > MOST_JUNCTION_WORK:
            raise MapError("the map has too many junctions with too many lanes each; that is no town.")
        everything = np.concatenate(rows)
        owner = np.repeat(np.arange(len(lanes), dtype=np.int32), [len(r) for r in rows])
        cloud = points[everything]
        for a, lane in enumerate(lanes):
            low, high = points[rows[a]].min(axis=0) - reach, points[rows[a]].max(axis=0) + reach
            around = ((cloud[:, :2] >= low[:2]) & (cloud[:, :2] <= high[:2])).all(axis=1)
            near = np.zeros((len(rows[a]), len(lanes)), np.bool_)
            _meet(points[rows[a]], cloud[around], owner[around], reach, near)
            for b in np.flatnonzero(near.any(axis=0)):
                other = int(lanes[b])
                if other == lane or (lane, other) in chained or (other, lane) in chained:
                    continue
                if before.get(int(lane), set()) & before.get(other, set()):
                    continue
                at = np.flatnonzero(near[:, b])
                found.append((int(lane), other))
                spans.append((float(at[0] * step[lane]), float(at[-1] * step[lane])))
    order = sorted(range(len(found)), key=lambda k: found[k])
    first_row, other_lane = compressed([found[k] for k in order], len(junction))
    return first_row, other_lane, np.array([spans[k] for k in order], np.float64).reshape(-1, 2)
