"""Towns by name: where their files lie, and the town that a file describes."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Sequence
from dataclasses import fields
from functools import lru_cache
from importlib import resources
from pathlib import Path

from lavsim.errors import UnknownName
from lavsim.map.derived import TownData, derive, load, road_shapes, save
from lavsim.map.opendrive import read_bytes, read_network
from lavsim.map.town_map import TownMap

_log = logging.getLogger(__name__)

TOWN_PATH = "LAVSIM_TOWN_PATH"  # environment variable: folders with users' towns


def build_town(name: str, data: bytes, source: str | None = None) -> TownMap:
    """A town from OpenDRIVE text.

    Args:
        name: What it is called.
        data: The file's bytes.
        source: What messages call it; its name by default.

    Raises:
        MapError: with file and line.
    """
    source = source or name
    network = read_network(data, source)
    shapes = road_shapes(network, source)
    town = _town(name, data, hashlib.sha256(data).hexdigest(), derive(network, shapes, source))
    vars(town).update(network=network, shapes=shapes)  # as their properties would read them again
    return town


def _town(name: str, data: bytes, digest: str, derived: TownData) -> TownMap:
    for sentence in derived.report:
        _log.warning("%s: %s", name, sentence)
    return TownMap(name, digest[:16], data, **vars(derived))


def _town_files(search_path: Sequence[Path]) -> dict[str, Path]:
    folders = [Path(str(resources.files("lavsim.towns"))), *map(Path, search_path)]
    folders += [Path(p) for p in os.environ.get(TOWN_PATH, "").split(os.pathsep) if p]
    found: dict[str, Path] = {}
    for folder in folders:
        if folder.is_dir():
            for path in sorted(folder.glob("*.xodr")):
                found.setdefault(path.stem, path)
    return found


def town_names(search_path: Sequence[Path] = ()) -> list[str]:
    """Names of the towns that `load_town` finds: bundled ones, then those of `search_path` and the environment."""
    return sorted(_town_files(search_path))


def load_town(name: str, search_path: Sequence[Path] = ()) -> TownMap:
    """The town called `name`: bundled, or `<name>.xodr` in a folder of `search_path` or of `LAVSIM_TOWN_PATH`.

    Raises:
        UnknownName: there is none; the message names the nearest.
        MapError: the file can't be read as a road network.
    """
    files = _town_files(search_path)
    if name not in files:
        raise UnknownName("town", name, files)
    path = files[name].resolve()
    return _load(name, path, path.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _load(name: str, path: Path, modified: int) -> TownMap:
    data = read_bytes(path)
    digest = hashlib.sha256(data).hexdigest()
    derived = load(digest)
    if derived is not None:
        return _town(name, data, digest, derived)
    town = build_town(name, data, str(path))
    save(TownData(**{f.name: getattr(town, f.name) for f in fields(TownData)}), digest)
    return town
