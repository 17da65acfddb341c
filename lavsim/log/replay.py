"""What a recorded drive needs around it to be rendered or judged again: its town, route and draws."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lavsim.errors import LogError
from lavsim.log.reader import LogReader
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.scenery import SCENERY_VERSION
from lavsim.map.town_map import TownMap, load_town
from lavsim.random import Draws
from lavsim.world.snapshot import Snapshot


def town_of(reader: LogReader, search_path: Sequence[Path] = ()) -> TownMap:
    """The town a log was driven in.

    Raises:
        UnknownName: no town of that name is at hand.
        LogError: the town or its scenery has changed since the drive.
    """
    town = load_town(reader.town_name, search_path)
    recorded = (reader.header["town_digest"], reader.header["scenery_version"])
    if recorded != (town.digest, SCENERY_VERSION):
        raise LogError(
            f"{reader.path.name} was driven in {town.name} {recorded[0]} with scenery {recorded[1]}; "
            f"here it is {town.digest} with scenery {SCENERY_VERSION}."
        )
    return town


def route_of(reader: LogReader, town: TownMap) -> Route:
    """The dense route of a log, traced again."""
    return get_planner(town).trace(np.array(reader.header["keypoints"], dtype=np.float64))


def draws_of(reader: LogReader) -> Draws:
    """The root of all draws of a log's drive."""
    return Draws.of_seed(int(reader.header["seed"]))


def recent_of(reader: LogReader, index: int, count: int) -> list[Snapshot]:
    """The last `count` snapshots up to number `index`, newest last: what `Simulation.recent` gave at that tick."""
    return [reader[k] for k in range(max(0, index - count + 1), index + 1)]
