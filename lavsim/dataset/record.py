"""The finish marker of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from lavsim.dataset.files import FileFacts, read_sealed, write_sealed
from lavsim.dataset.schema import SCHEMA_VERSION, VERSION_KEY, file_of
from lavsim.errors import DatasetError


@dataclass(frozen=True)
class EpisodeRecord:
    """The finish marker of an episode: what `episodes/ep_*.json` holds.

    Attributes:
        episode: Its number.
        town, route_id, seed: What was driven.
        frames: Rows of its table.
        ticks: Of its log.
        distance: Driven [m].
        ending: How it ended.
        agent_status: `AgentStatus`; 0 is well.
        files: Size and SHA-256 of each file, by its path in the dataset's folder.
        facts: What the collector adds, in JSON types.
        breaks: Frames before which time jumps, because the ego stood too long.
    """

    episode: int
    town: str
    route_id: str
    seed: int
    frames: int
    ticks: int
    distance: float
    ending: str
    agent_status: int
    files: Mapping[str, FileFacts]
    facts: Mapping[str, Any] = field(default_factory=dict)
    breaks: tuple[int, ...] = ()

    def write(self, root: Path) -> None:
        """Writes it: from now on the episode exists."""
        content = {VERSION_KEY: SCHEMA_VERSION, **asdict(self)}
        write_sealed(root / file_of("record", self.episode), content)

    @staticmethod
    def read(path: Path) -> EpisodeRecord:
        """The record in a file.

        Raises:
            DatasetError: it is missing, damaged or of another version.
        """
        content = read_sealed(path, VERSION_KEY, SCHEMA_VERSION)
        try:
            values = {item.name: content[item.name] for item in fields(EpisodeRecord)}
            files = {name: FileFacts(**facts) for name, facts in values["files"].items()}
        except (KeyError, TypeError) as error:
            raise DatasetError(f"{path.name} is incomplete: {error}.") from None
        return EpisodeRecord(**{**values, "files": files, "breaks": tuple(values["breaks"])})
