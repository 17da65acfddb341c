"""The moments of a run at which its agent failed: where an expert should show what to do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lavsim.dataset.fork import Failure
from lavsim.errors import UnknownName
from lavsim.log.reader import LogReader
from leaderboard.run import Run

# Of the infractions those that come at one moment; completion and speeds build up over a whole route.
KINDS = (
    "collisions_layout",
    "collisions_pedestrian",
    "collisions_vehicle",
    "red_light",
    "stop_infraction",
    "outside_route_lanes",
    "route_dev",
    "vehicle_blocked",
)
_MOVES = 0.5  # [m/s]


def named_kinds(names: str | None) -> tuple[str, ...]:
    """Kinds by names between commas; all of them without.

    Raises:
        UnknownName: there is no such kind.
    """
    if names is None:
        return KINDS
    wanted = tuple(name.strip() for name in names.split(","))
    for name in wanted:
        if name not in KINDS:
            raise UnknownName("infraction", name, KINDS)
    return wanted


def failures_of(run: Run, kinds: Sequence[str] = KINDS) -> list[Failure]:
    """The infractions of a run's recorded drives; who got blocked failed when he last moved.

    Args:
        run: The run.
        kinds: Keys of the results file that count.
    """
    found = []
    for drive in run.run.get("drives", []):
        if not drive.get("log"):
            continue
        log = LogReader(run.folder / drive["log"])
        for infraction in drive["infractions"]:
            if infraction["key"] in kinds:
                found.append(Failure(log.path, _moment(log, infraction), infraction["key"]))
    return found


def _moment(log: LogReader, infraction: dict[str, Any]) -> int:
    tick = min(int(infraction["tick"]), log[len(log) - 1].tick)
    if infraction["key"] == "vehicle_blocked":
        while tick > log[0].tick and log.at_tick(tick).ego.speed < _MOVES:
            tick -= 1
    return tick
