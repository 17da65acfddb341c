"""A recorded drive as a Rerun recording (*.rrd), for Rerun's viewer; needs the extra `rerun`.

Frame: Rerun's is right-handed with z up, ours left-handed; y is turned round: x stays east, y points north.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError, OutputError
from lavsim.log.reader import LogReader
from lavsim.log.replay import route_of, town_of
from lavsim.types import ActorClass, Role
from lavsim.world.snapshot import LENGTH_UNIT, Snapshot

APPLICATION = "lavsim"
_COLOURS = np.array(
    [(91, 125, 168), (59, 143, 149), (154, 106, 66), (207, 122, 28), (152, 80, 184), (60, 154, 78), (209, 51, 91),
     (138, 133, 120)], np.uint8
)  # fmt: skip
_EGO, _ROUTE, _PAINT, _CONTACT = (11, 87, 208), (29, 111, 216), (150, 156, 164), (198, 40, 40)
_CONTROLS = ("throttle", "steer", "brake")


def write_rerun(log: Path, path: Path, town_path: tuple[Path, ...] = ()) -> None:
    """Writes the drive in `log` to `path`: town and route, each tick's boxes, contacts, the ego's speed and control.

    Raises:
        ConfigError: Rerun is not installed.
        LavsimError: the log can't be read, or the file can't be written.
    """
    rerun = load_rerun("--rerun")
    reader = LogReader(log)
    town = town_of(reader, town_path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("wb").close()
    except OSError as error:
        raise OutputError(f"can't write {path}: {error.strerror}") from None
    # The id is the log's own, so that the same drive is the same recording.
    stream = rerun.RecordingStream(APPLICATION, recording_id=f"{reader.header['town']}-{log.stem}")
    stream.save(path)
    stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    lines = [flipped(_with_height(mark.points, mark.z)) for mark in town.marks if len(mark.points) > 1]
    stream.log("world/paint", rerun.LineStrips3D(lines, colors=[_PAINT] * len(lines)), static=True)
    route = flipped(route_of(reader, town).points[:, :3])
    stream.log("world/route", rerun.LineStrips3D([route], colors=[_ROUTE]), static=True)
    for snapshot in reader:
        stream.set_time("tick", sequence=snapshot.tick)
        stream.set_time("time", duration=snapshot.time)
        _log_tick(rerun, stream, snapshot)
    stream.disconnect()


def load_rerun(option: str) -> Any:
    """Rerun's module, for an option that asks for it.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        import rerun  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        raise ConfigError(f"{option} needs Rerun: pip install 'lavsim[rerun]'.") from None
    return rerun


def _log_tick(rerun: Any, stream: Any, snapshot: Snapshot) -> None:
    boxes = boxes_of(snapshot)
    stream.log("world/actors", rerun.Boxes3D(**boxes))
    stream.log("ego/speed", rerun.Scalars(snapshot.ego.forward_speed))
    for name, value in zip(_CONTROLS, snapshot.control.tolist(), strict=False):
        stream.log(f"ego/{name}", rerun.Scalars(value))
    places = np.column_stack([snapshot.contacts["x"], snapshot.contacts["y"]]) * LENGTH_UNIT
    points = flipped(_with_height(places, np.full(len(places), snapshot.ego.z + 1.0)))
    stream.log("world/contacts", rerun.Points3D(points, colors=[_CONTACT] * len(points), radii=0.4))


def boxes_of(snapshot: Snapshot) -> dict[str, Any]:
    """Centres, half sizes, quaternions (x, y, z, w), colours and labels of the actors' boxes, as Rerun takes them."""
    return boxes_at(snapshot.xyz, snapshot.sizes, snapshot.yaw, snapshot.classes, snapshot.roles, snapshot.ids)


def boxes_at(
    xyz: NDArray[Any], sizes: NDArray[Any], yaw: NDArray[Any], classes: NDArray[Any], roles: NDArray[Any],
    ids: NDArray[Any],
) -> dict[str, Any]:  # fmt: skip
    """As `boxes_of`, of actors whose origins on the ground are `xyz` (N, 3) [m], `sizes` (N, 3) [m], `yaw` [rad]."""
    sizes = sizes.astype(np.float64)
    centres = xyz.astype(np.float64)
    centres[:, 2] += sizes[:, 2] / 2.0
    half = -yaw.astype(np.float64) / 2.0  # clockwise from above becomes counter-clockwise
    zero = np.zeros_like(half)
    colours = _COLOURS[classes]
    colours[roles == Role.EGO] = _EGO
    return {
        "centers": flipped(centres),
        "half_sizes": sizes / 2.0,
        "quaternions": np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1),
        "colors": colours,
        "labels": [
            f"{ActorClass(kind).name.lower()} {actor}"
            for kind, actor in zip(classes.tolist(), ids.tolist(), strict=True)
        ],
        "show_labels": False,
    }


def _with_height(points: NDArray[np.float64], z: NDArray[np.float64] | None) -> NDArray[np.float64]:
    return np.column_stack([points[:, :2], np.zeros(len(points)) if z is None else z])


def flipped(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (N, 3) of our frame in Rerun's."""
    return points * np.array([1.0, -1.0, 1.0])
