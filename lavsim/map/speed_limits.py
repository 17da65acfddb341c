"""Speed limits along lanes, from signs and from a file's speed records."""

from __future__ import annotations

import heapq
from bisect import bisect_left, bisect_right
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import MapError
from lavsim.map.pieces import LanePiece
from lavsim.map.records import SpeedRecord

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

DEFAULT_LIMIT = 30.0 / 3.6  # [m/s] CARLA's limit before the first sign
MOST_LIMITS = 50_000  # speed signs times the lanes for which they count


def _at(sign: tuple[float, tuple[tuple[int, int], ...], float]) -> float:
    return sign[0]


def _limit_steps(speeds: Sequence[SpeedRecord], low: float, high: float, forward: bool) -> list[tuple[float, float]]:
    """(share of the lane travelled, limit [m/s] from there on) between s `low` and `high`."""
    inside = [speed for speed in speeds if speed.s < high]
    before = [speed for speed in inside if speed.s <= low]
    inside = [*before[-1:], *(speed for speed in inside if speed.s > low)]
    if not inside:
        return []
    starts = [low, *(speed.s for speed in inside[1:]), high]
    if forward:
        return [((a - low) / (high - low), speed.limit) for a, speed in zip(starts, inside, strict=False)]
    return [((high - b) / (high - low), speed.limit) for b, speed in zip(starts[1:], inside, strict=True)][::-1]


def speed_limits(
    pieces: list[LanePiece],
    pred: tuple[Ints, Ints],
    length: Floats,
    limits: dict[int, list[tuple[float, tuple[tuple[int, int], ...], float]]],
) -> tuple[Floats, Ints, Floats, Floats]:
    """One limit a lane piece, which holds over the longest part of it; and all its limits as compressed rows.

    Signs hold from where they stand until the next one, across lane links (CARLA's sticky signs); where several ways
    lead in, the lowest limit counts. A town without signs goes by its roads' speed records. Lanes that neither
    reaches have 30 km/h; junction roads without a record take the limit of what leads in.
    """
    count = len(pieces)
    own = np.full(count, np.nan)  # over the longest part of the lane
    leaving = np.full(count, np.nan)  # at its end
    along_lane: list[list[tuple[float, float]]] = []
    standing = {road: sorted(signs, key=_at) for road, signs in limits.items()}
    told = 0
    for k, piece in enumerate(pieces):
        records: list[tuple[float, float]] = []  # (share of the lane travelled, limit)
        low, high = piece.shape.start, piece.shape.end
        signs = standing.get(piece.road.id, [])
        for s, ranges, limit in signs[bisect_left(signs, low, key=_at) : bisect_right(signs, high, key=_at)]:
            if any(a <= piece.lane.id <= b for a, b in ranges):
                share = (s - low) / (high - low)
                records.append((share if piece.forward else 1.0 - share, limit))
        told += len(records)
        if told > MOST_LIMITS:
            raise MapError(f"line {piece.road.line}: too many speed signs over too many lanes; that is no town.")
        if not limits:
            own_speeds = [SpeedRecord(low + speed.s, speed.limit) for speed in piece.lane.speeds]
            records = _limit_steps(own_speeds or piece.road.speeds, low, high, piece.forward)
        records.sort()
        along_lane.append(records)
        if records:
            marks = [r[0] for r in records] + [1.0]
            shares: dict[float, float] = {}
            for (at, limit), end in zip(records, marks[1:], strict=True):
                shares[limit] = shares.get(limit, 0.0) + end - at
            best = max(shares, key=lambda limit: (shares[limit], -limit))
            leaving[k] = records[-1][1]
            if shares[best] >= marks[0]:
                own[k] = best
    known = ~np.isnan(leaving)
    arriving = np.full(count, np.nan)
    follow: dict[int, list[int]] = {}
    for k in range(count):
        for p in pred[1][pred[0][k] : pred[0][k + 1]]:
            follow.setdefault(int(p), []).append(k)
    # The lowest limit that any way brings: lanes are settled in rising order of it.
    rising = [(float(leaving[k]), int(k)) for k in np.flatnonzero(known)]
    heapq.heapify(rising)
    while rising:
        limit, k = heapq.heappop(rising)
        for following in follow.get(k, ()):
            if np.isnan(arriving[following]):
                arriving[following] = limit
                if not known[following]:
                    heapq.heappush(rising, (limit, following))
    limit_of = np.where(np.isnan(own), arriving, own)
    first, along, values = [0], [], []
    for k in range(count):
        steps = [(0.0, DEFAULT_LIMIT if np.isnan(arriving[k]) else float(arriving[k])), *along_lane[k]]
        if len(steps) > 1 and steps[1][0] <= 0.0:
            steps = steps[1:]
        along += [share * float(length[k]) for share, _ in steps]
        values += [limit for _, limit in steps]
        first.append(len(along))
    return (
        np.where(np.isnan(limit_of), DEFAULT_LIMIT, limit_of),
        np.array(first, np.int32),
        np.array(along),
        np.array(values),
    )
