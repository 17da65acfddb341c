"""A drive over time: speed, steering, jerk, distance to the nearest actor, score."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import box_corners
from lavsim.map.route import Route, RouteTracker
from lavsim.types import DT
from lavsim.viewer.tracks import Tracks
from leaderboard.criteria.base import Infraction
from leaderboard.rules import Rules
from leaderboard.score import scores

Floats = NDArray[np.float64]

FARTHEST = 50.0  # [m] distances are told up to here
SMOOTHING = 10  # ticks over which accelerations are averaged before their change is a jerk


@dataclass(frozen=True)
class Series:
    """Values at T ticks.

    Attributes:
        times: [s] simulation time.
        speed: [km/h].
        steer: As applied, -1 to 1, positive to the right.
        jerk: Along the heading [m/s³], of accelerations averaged over half a second.
        gap: To the nearest actor, box to box [m]; `FARTHEST` where nobody is nearer.
        score: Completion times penalty, as if the drive ended there.
    """

    times: Floats
    speed: Floats
    steer: Floats
    jerk: Floats
    gap: Floats
    score: Floats


def series_of(
    tracks: Tracks, route: Route, infractions: Sequence[Mapping[str, Any]], rules: Rules, final: float
) -> Series:
    """The series of a drive.

    Args:
        tracks: All of it, at least one tick.
        route: What was to be driven.
        infractions: The run file's entries.
        rules: What it was judged by.
        final: Its driving score: the last value.
    """
    return Series(
        times=tracks.times,
        speed=tracks.forward_speed * 3.6,
        steer=tracks.control[:, 1].astype(np.float64),
        jerk=_jerk(tracks.motion[:, 0].astype(np.float64)),
        gap=_gap(tracks),
        score=_score(tracks, route, infractions, rules, final),
    )


def _jerk(acceleration: Floats) -> Floats:
    if len(acceleration) < 2:
        return np.zeros(len(acceleration))
    width = min(SMOOTHING, len(acceleration))
    padded = np.pad(acceleration, (width // 2, width - 1 - width // 2), mode="edge")
    smooth = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    return np.asarray(np.gradient(smooth, DT))


def _gap(tracks: Tracks) -> Floats:
    """Distance between the ego's box and the nearest other at each tick [m]; 0 where they overlap."""
    gap = np.full(len(tracks), FARTHEST)
    others = np.arange(tracks.first[1], len(tracks.pose)) if len(tracks.first) > 1 else np.zeros(0, np.int64)
    ticks = tracks.tick_of[others]
    centre = tracks.xy[tracks.ego]
    reach = np.hypot(*(tracks.xy[others] - centre[ticks]).T)
    near = reach < FARTHEST + 12.0  # half lengths of the ego and of a bus
    others, ticks = others[near], ticks[near]
    rows = np.repeat(tracks.row, np.diff(tracks.first))
    sizes = tracks.table.sizes.astype(np.float64)
    mine, theirs = _boxes(tracks, tracks.ego[ticks], sizes[rows[0]]), _boxes(tracks, others, sizes[rows[others]])
    apart = np.minimum(
        _corner_distance(theirs, centre[ticks], tracks.yaw[tracks.ego[ticks]], sizes[rows[0]]),
        _corner_distance(mine, tracks.xy[others], tracks.yaw[others], sizes[rows[others]]),
    )
    np.minimum.at(gap, ticks, apart)
    return gap


def _boxes(tracks: Tracks, poses: NDArray[np.int64], sizes: Floats) -> Floats:
    sizes = np.broadcast_to(sizes, (len(poses), 3))
    x, y = tracks.xy[poses].T
    return box_corners(x, y, tracks.yaw[poses], sizes[:, 0], sizes[:, 1])


def _corner_distance(corners: Floats, centre: Floats, yaw: Floats, sizes: Floats) -> Floats:
    """Distance (N,) from boxes at `centre`, `yaw` to the nearest of four corners (N, 4, 2) each [m]."""
    delta = corners - centre[:, None]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    local = np.stack([delta[..., 0] * c + delta[..., 1] * s, delta[..., 1] * c - delta[..., 0] * s], axis=-1)
    half = np.broadcast_to(sizes, (len(centre), 3))[:, None, :2] / 2.0
    beyond = np.maximum(np.abs(local) - half, 0.0)
    return np.asarray(np.hypot(beyond[..., 0], beyond[..., 1]).min(axis=1, initial=np.inf))


def _score(
    tracks: Tracks, route: Route, infractions: Sequence[Mapping[str, Any]], rules: Rules, final: float
) -> Floats:
    tracker = RouteTracker(route)
    completion = []
    for place in tracks.xy[tracks.ego]:
        tracker.update(place)
        completion.append(tracker.percentage)
    found = sorted((Infraction(**{**entry, "position": tuple(entry["position"])}) for entry in infractions),
                   key=lambda i: i.tick)  # fmt: skip
    ticks = np.array([i.tick for i in found], np.int64)
    charged = np.searchsorted(ticks, tracks.ticks, side="right")
    factors = np.array([scores(100.0, found[:count], rules).composed / 100.0 for count in range(len(found) + 1)])
    result = np.asarray(completion) * factors[charged]
    result[-1:] = final
    return np.asarray(result)
