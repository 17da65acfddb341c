"""What the expert shows of its inner view: its plan, where it expects others, and what it brakes for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.behavior.forecast import Forecast
from agents.behavior.labels import FELT
from agents.behavior.path import STEP, ReferencePath
from lavsim.drawings import Drawing, boxes, polylines, scalar

PLAN_LENGTH = 40.0  # [m]
NEAR = 60.0  # [m] within which others are shown


@dataclass(frozen=True)
class View:
    """What the expert had in mind at a tick.

    Attributes:
        truth: The reading.
        forecast: Where others will be.
        s: Its place on its path [m].
        wanted: The speed it is after [m/s].
        acceleration: What it asked for [m/s²].
        reason: What held it back.
    """

    truth: Mapping[str, Any]
    forecast: Forecast
    s: float
    wanted: float
    acceleration: float
    reason: str


def drawings_of(view: View, path: ReferencePath) -> dict[str, Drawing]:
    """The drawings of a view."""
    first = max(int(view.s / STEP), 0)
    plan = path.xy[first : first + int(PLAN_LENGTH / STEP)]
    forecast = view.forecast
    gap = np.hypot(*(forecast.poses[:, 0, :2] - view.truth["xyz"][0, :2]).T)
    shown = np.flatnonzero((gap < NEAR) & ~forecast.is_prop & (forecast.speed > 0.2))
    ways = np.bincount(forecast.row[shown], minlength=int(forecast.row.max(initial=0)) + 1)
    found = {
        "plan": polylines([plan]),
        "forecast": polylines(list(forecast.poses[shown, :, :2]), 1.0 / np.maximum(ways[forecast.row[shown]], 1)),
        "wanted speed": scalar(view.wanted * 3.6, "km/h"),
        "acceleration": scalar(view.acceleration, "m/s²"),
    }
    held = _held_by(view)
    return found | ({"brakes for": held} if held is not None else {})


def _held_by(view: View) -> Drawing | None:
    """The box of the actor that it brakes for."""
    kind, _, actor = view.reason.partition(" ")
    if kind != "actor" or view.acceleration > FELT:
        return None
    row = int(np.flatnonzero(view.truth["ids"] == int(actor))[0])
    pose = [*view.truth["xyz"][row, :2], view.truth["yaw"][row], *view.truth["sizes"][row, :2]]
    return boxes([pose], labels=[f"brakes for {actor}"])
