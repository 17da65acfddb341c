"""Statistics of a dataset as one picture of charts. Matplotlib is loaded on use."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.dataset.files import write_file
from lavsim.dataset.stats import QUANTITIES, Histogram, Statistics
from lavsim.errors import OutputError

_BARS = 40  # bins of a chart at most
_INK, _BAR, _SOFT = "#28282c", "#3c78c8", "#b8c8e0"
_SHARES = (
    ("command", "frames by command"), ("motion", "frames by motion"),
    ("brake_cause", "frames by what is braked for"), ("actor_class", "actors by class, of all frames"),
    ("weather", "frames by weather"),
)  # fmt: skip
_TITLES = {
    "speed": "speed of the ego", "turn": "turn in the next 2.5 s", "steer": "steer", "vehicles": "vehicles in a frame",
    "walkers": "walkers in a frame", "vehicle_distance": "distance to vehicles", "walker_distance":
    "distance to walkers", "lidar_hits": "LiDAR points on a vehicle that is hit", "sun_altitude": "altitude of the sun",
}  # fmt: skip
_LOGARITHMIC = ("turn", "steer", "speed")  # counts: driving straight at the limit would hide all else


def write_charts(statistics: Statistics, title: str, path: Path) -> None:
    """Writes the charts as a PNG.

    Raises:
        OutputError: it can't be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16.0, 10.5), dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{title}: {statistics.frames} frames", color=_INK)
    axes = figure.subplots(3, 5).ravel()
    names = list(_TITLES)
    for axis, name in zip(axes[: len(names)], names, strict=True):
        _histogram(axis, name, statistics.histograms[name])
    for axis, (name, label) in zip(axes[len(names) : len(names) + len(_SHARES)], _SHARES, strict=True):
        shares = dict(statistics.shares[name])
        if name == "brake_cause":
            shares.pop("none", None)
        _bars(axis, label, shares)
    _seen(axes[len(names) + len(_SHARES)], statistics)
    for axis in axes[len(names) + len(_SHARES) + 1 :]:
        axis.set_visible(False)
    file = BytesIO()
    figure.savefig(file, format="png", metadata={"Software": None})  # no version: the same numbers, the same bytes
    write_output(path, file.getvalue())


def write_output(path: Path, data: bytes) -> None:
    """Writes a file that a user asked for, whole or not at all.

    Raises:
        OutputError: it can't be written.
    """
    try:
        write_file(path, data)
    except OSError as error:
        raise OutputError(f"can't write {path}: {error.strerror or error}.") from None


def _histogram(axis: Any, name: str, histogram: Histogram) -> None:
    unit = QUANTITIES[name].unit
    axis.set_title(_TITLES[name], fontsize=10, color=_INK)
    axis.set_xlabel(f"[{unit}]" if unit else "", fontsize=8)
    if not histogram.total:
        axis.text(0.5, 0.5, "none", ha="center", transform=axis.transAxes)
        return
    filled = np.flatnonzero(histogram.counts)
    first, last = int(filled[0]), int(filled[-1]) + 1
    step = max(1, -(-(last - first) // _BARS))
    edges = histogram.edges[first : last + step : step]
    counts = np.add.reduceat(histogram.counts[first:last], np.arange(0, last - first, step))
    edges = np.append(histogram.edges[first:last:step], histogram.edges[last])
    axis.bar(edges[:-1], counts / histogram.total, np.diff(edges), align="edge", color=_BAR)
    axis.axvline(histogram.quantile(0.5), color=_INK, linewidth=0.8)
    if name in _LOGARITHMIC:
        axis.set_yscale("log")
    if name == "lidar_hits":
        axis.set_xscale("log")
    axis.tick_params(which="both", labelsize=7)


def _bars(axis: Any, label: str, shares: Mapping[str, int]) -> None:
    axis.set_title(label, fontsize=10, color=_INK)
    named = sorted(shares.items(), key=lambda item: item[1])
    if not named:
        axis.text(0.5, 0.5, "none", ha="center", transform=axis.transAxes)
        return
    axis.barh([name for name, _ in named], [count for _, count in named], color=_BAR)
    for k, (_, count) in enumerate(named):
        axis.text(count, k, f" {count:,}", va="center", fontsize=7, color=_INK)
    axis.margins(x=0.2)
    axis.tick_params(which="both", labelsize=7)


def _seen(axis: Any, statistics: Statistics) -> None:
    """Of the vehicles at each distance, how many any sensor saw."""
    axis.set_title("vehicles seen, of all there", fontsize=10, color=_INK)
    rings = statistics.to_json()["vehicles_seen"]
    middle = [(ring["from_m"] + ring["to_m"]) / 2.0 for ring in rings]
    wide = rings[0]["to_m"] * 0.9
    axis.bar(middle, [ring["vehicles"] for ring in rings], wide, color=_SOFT, label="there")
    axis.bar(middle, [ring["seen"] for ring in rings], wide, color=_BAR, label="seen")
    axis.set_xlabel("distance [m]", fontsize=8)
    axis.legend(fontsize=7)
    axis.tick_params(which="both", labelsize=7)
