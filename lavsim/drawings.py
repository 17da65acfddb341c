"""What an agent may show of its inner view: named drawings of a tick, in plain dicts and arrays.

An agent returns them from `drawings()`; it is asked only where somebody wants to see them (`--drawings`), after each
step. They never reach the log or the score. Anything but plain data is refused, so they travel from the agent's process
like its controls.

    def drawings(self):
        return {
            "plan": polylines([self.path]),
            "seen": boxes(self.poses, likelihood=self.scores),
            "free": raster(self.heatmap, pose=(16.0, 0.0, 0.0), resolution=0.5, frame="ego"),
            "wanted speed": scalar(self.speed, "m/s"),
        }

Convention:
    `frame` "world": x, y, yaw of the world [m, rad]. "ego": x ahead, y to the right of the ego's box centre.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.errors import ConfigError

Drawing = dict[str, Any]

KINDS = ("points", "boxes", "polylines", "raster", "scalar")
MOST_DRAWINGS = 32  # names of a tick
MOST_SHAPES = 2_000  # boxes or lines of a drawing
MOST_POINTS = 20_000
MOST_CELLS = 512 * 512
LONGEST_TEXT = 80


def points(xy: ArrayLike, likelihood: ArrayLike | None = None, frame: str = "world") -> Drawing:
    """Single places.

    Args:
        xy: (N, 2) [m].
        likelihood: (N,) 0 to 1, shown as strength; 1 by default.
        frame: "world" or "ego".
    """
    return checked({"kind": "points", "frame": frame, "xy": xy, "likelihood": likelihood})


def boxes(
    poses: ArrayLike, likelihood: ArrayLike | None = None, labels: Sequence[str] = (), frame: str = "world"
) -> Drawing:
    """Boxes.

    Args:
        poses: (N, 5) x, y of the centre [m], yaw [rad], length, width [m].
        likelihood: (N,) 0 to 1; 1 by default.
        labels: One text a box, or none.
        frame: "world" or "ego".
    """
    return checked({"kind": "boxes", "frame": frame, "poses": poses, "likelihood": likelihood, "labels": list(labels)})


def polylines(lines: Sequence[ArrayLike], likelihood: ArrayLike | None = None, frame: str = "world") -> Drawing:
    """Lines: plans, forecasts.

    Args:
        lines: K lines, each (M, 2) [m].
        likelihood: (K,) 0 to 1; 1 by default.
        frame: "world" or "ego".
    """
    parts = [np.asarray(line, np.float64).reshape(-1, 2) for line in lines]
    xy = np.concatenate(parts) if parts else np.zeros((0, 2))
    count = [len(part) for part in parts]
    return checked({"kind": "polylines", "frame": frame, "xy": xy, "count": count, "likelihood": likelihood})


def raster(
    values: ArrayLike, pose: ArrayLike = (0.0, 0.0, 0.0), resolution: float = 0.5, frame: str = "ego"
) -> Drawing:
    """A grid seen from above: row 0 ahead, columns to the right.

    Args:
        values: (H, W) 0 to 1.
        pose: x, y of its middle [m] and the heading that points up in it [rad].
        resolution: Side of a cell [m].
        frame: "world" or "ego".
    """
    return checked({"kind": "raster", "frame": frame, "values": values, "pose": pose, "resolution": resolution})


def scalar(value: float, unit: str = "") -> Drawing:
    """A number, shown beside the picture."""
    return checked({"kind": "scalar", "value": value, "unit": unit})


def checked_all(value: Any) -> dict[str, Drawing]:
    """Drawings by name as an agent returned them.

    Raises:
        ConfigError: they are no such thing; the message says which and why.
    """
    if value is None:
        return {}
    if not isinstance(value, Mapping) or not all(isinstance(name, str) and name for name in value):
        raise ConfigError("drawings() must return a dict of drawings by name")
    if len(value) > MOST_DRAWINGS:
        raise ConfigError(f"drawings() returned {len(value)} drawings; at most {MOST_DRAWINGS} are kept")
    found = {}
    for name, drawing in value.items():
        try:
            found[name[:LONGEST_TEXT]] = checked(drawing)
        except ConfigError as error:
            raise ConfigError(f"drawing {name[:LONGEST_TEXT]!r}: {error}") from None
    return found


def checked(value: Any) -> Drawing:
    """A drawing with its arrays in their own types and shapes.

    Raises:
        ConfigError: something in it is missing, of the wrong shape, not finite, or too much.
    """
    kind = value.get("kind") if isinstance(value, Mapping) else None
    if kind not in KINDS:
        raise ConfigError(f"a drawing's kind must be one of {', '.join(KINDS)}, got {kind!r}")
    if kind == "scalar":
        return {"kind": kind, "value": _number(value, "value"), "unit": str(value.get("unit", ""))[:LONGEST_TEXT]}
    frame = value.get("frame", "world")
    if frame not in ("world", "ego"):
        raise ConfigError(f"frame must be 'world' or 'ego', got {frame!r}")
    checks = {"points": _points, "boxes": _boxes, "polylines": _polylines, "raster": _raster}
    return {"kind": kind, "frame": frame, **checks[kind](value)}


def _points(value: Mapping[str, Any]) -> Drawing:
    xy = _array(value, "xy", 2, MOST_POINTS)
    return {"xy": xy, "likelihood": _likelihood(value, len(xy))}


def _boxes(value: Mapping[str, Any]) -> Drawing:
    poses = _array(value, "poses", 5, MOST_SHAPES)
    labels = [str(label)[:LONGEST_TEXT] for label in value.get("labels") or ()]
    if labels and len(labels) != len(poses):
        raise ConfigError(f"{len(poses)} boxes have {len(labels)} labels")
    return {"poses": poses, "likelihood": _likelihood(value, len(poses)), "labels": labels}


def _polylines(value: Mapping[str, Any]) -> Drawing:
    xy = _array(value, "xy", 2, MOST_POINTS)
    count = _plain(value, "count").astype(np.int32).reshape(-1)
    if len(count) > MOST_SHAPES or (count < 0).any() or int(count.sum()) != len(xy):
        raise ConfigError(f"the lines' lengths must be at most {MOST_SHAPES} numbers that add up to {len(xy)} points")
    return {"xy": xy, "count": count, "likelihood": _likelihood(value, len(count))}


def _raster(value: Mapping[str, Any]) -> Drawing:
    values = _plain(value, "values")
    if values.ndim != 2 or values.size > MOST_CELLS:
        raise ConfigError(f"a raster must be (H, W) with at most {MOST_CELLS} cells, got {values.shape}")
    cells = values if values.dtype == np.uint8 else np.rint(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)
    pose = _array(value, "pose", 3, 1)
    resolution = _number(value, "resolution")
    if resolution <= 0.0:
        raise ConfigError(f"resolution must be positive [m], got {resolution}")
    return {"values": np.ascontiguousarray(cells), "pose": pose[0], "resolution": resolution}


def _plain(value: Mapping[str, Any], key: str) -> NDArray[Any]:
    try:
        array = np.asarray(value[key])
    except KeyError:
        raise ConfigError(f"it has no {key!r}") from None
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{key!r} is no array: {error}") from None
    if array.dtype.kind not in "biuf":
        raise ConfigError(f"{key!r} must hold numbers, got {array.dtype}")
    if not np.isfinite(array).all():
        raise ConfigError(f"{key!r} holds numbers that are not finite")
    return array


def _array(value: Mapping[str, Any], key: str, width: int, most: int) -> NDArray[np.float32]:
    array = _plain(value, key).astype(np.float32)
    if array.size % width or array.size // width > most:
        raise ConfigError(f"{key!r} must be (N, {width}) with N at most {most}, got {array.shape}")
    if np.abs(array).max(initial=0.0) > 1e6:
        raise ConfigError(f"{key!r} lies farther than 1,000 km away")
    return array.reshape(-1, width)


def _likelihood(value: Mapping[str, Any], count: int) -> NDArray[np.float32]:
    if value.get("likelihood") is None:
        return np.ones(count, np.float32)
    likelihood = _plain(value, "likelihood").astype(np.float32).reshape(-1)
    if len(likelihood) != count:
        raise ConfigError(f"{count} shapes have {len(likelihood)} likelihoods")
    return np.clip(likelihood, 0.0, 1.0)


def _number(value: Mapping[str, Any], key: str) -> float:
    array = _plain(value, key)
    if array.size != 1:
        raise ConfigError(f"{key!r} must be one number, got {array.shape}")
    return float(array.reshape(-1)[0])
