"""A recorded drive with the town and the route it belongs to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lavsim.errors import LogError
from lavsim.log.reader import LogReader
from lavsim.log.replay import route_of
from lavsim.map.route import Route
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap


@dataclass(frozen=True)
class RecordedDrive:
    """A log and what its header names."""

    log: LogReader
    town: TownMap
    route: Route

    @staticmethod
    def open(path: Path, town_path: Sequence[Path] = ()) -> RecordedDrive:
        """The drive in the log at `path`.

        Raises:
            LavsimError: no such log, its town is not to be found, or is another one than was driven.
        """
        log = LogReader(path)
        town = load_town(log.town_name, tuple(town_path))
        digest = log.header.get("town_digest", town.digest)
        if digest != town.digest:
            raise LogError(f"{path.name} was driven in another {town.name}: its digest is {digest}, not {town.digest}.")
        return RecordedDrive(log, town, route_of(log, town))
