"""Reads a dataset: any frame of any episode, as arrays."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.dataset.codecs import decode
from lavsim.dataset.files import FileFacts, size_problem
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.rerendered import Rerendered
from lavsim.dataset.schema import BLOB, DatasetInfo, FieldSpec, file_of
from lavsim.dataset.shard import ShardReader
from lavsim.dataset.tables import Table, read_table
from lavsim.errors import DatasetError, UnknownName

_OPEN = 64  # episodes whose shards stay open
_TABLES = 256  # tables kept in memory, of about 1 MB each


class Dataset:
    """A dataset on disk. May be handed to other processes: files are opened where they are read.

    Args:
        root: Its folder.
        town_path: Folders with towns, for readings that are rendered from logs.

    Attributes:
        info: What it says of itself.
        episodes: Finished episodes, by number.

    Raises:
        DatasetError: no dataset, or a record or `meta/info.json` is damaged or of another version.
    """

    def __init__(self, root: Path | str, town_path: Sequence[Path] = ()) -> None:
        self.root = Path(root)
        self.info = DatasetInfo.read(self.root)
        paths = sorted((self.root / "episodes").glob("ep_*.json"))
        self.episodes: dict[int, EpisodeRecord] = {}
        for path in paths:
            record = EpisodeRecord.read(path)
            self.episodes[record.episode] = record
        self._town_path = tuple(town_path)
        self._numbers = np.array(list(self.episodes), np.int64)
        self._ends = np.cumsum([record.frames for record in self.episodes.values()], dtype=np.int64)
        self._fields = {item.name: item for item in self.info.fields}
        self._tables: OrderedDict[int, Table] = OrderedDict()
        self._shards: OrderedDict[int, ShardReader] = OrderedDict()
        self._rendered: Rerendered | None = None

    def __len__(self) -> int:
        """Frames of all episodes."""
        return int(self._ends[-1]) if len(self._ends) else 0

    def __getstate__(self) -> dict[str, Any]:
        return {"root": self.root, "town_path": self._town_path}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["root"], state["town_path"])  # type: ignore[misc]

    def locate(self, index: int) -> tuple[int, int]:
        """Episode and frame of frame number `index` of the whole dataset."""
        if not 0 <= index < len(self):
            raise IndexError(f"{self.root.name} holds {len(self)} frames")
        place = int(np.searchsorted(self._ends, index, side="right"))
        before = int(self._ends[place - 1]) if place else 0
        return int(self._numbers[place]), index - before

    def table(self, episode: int) -> Table:
        """The table of an episode.

        Raises:
            DatasetError: it is missing, cut short or damaged.
        """
        if episode in self._tables:
            self._tables.move_to_end(episode)
            return self._tables[episode]
        path = self._file("table", episode)
        problem = self._facts("table", episode).problem(path)
        if problem is not None:
            raise DatasetError(problem)
        table = read_table(path.read_bytes(), path.name, self.info.columns)
        self._tables[episode] = table
        if len(self._tables) > _TABLES:
            self._tables.popitem(last=False)
        return table

    def read(self, episode: int, frame: int, names: Sequence[str] | None = None) -> dict[str, Any]:
        """A frame.

        Args:
            episode: Number of the episode.
            frame: Of the episode, from 0.
            names: Fields wanted; all if None.

        Returns:
            Arrays by name of the field, decoded; the shapes and types are those of `info.fields`.

        Raises:
            UnknownName: no such field.
            DatasetError: a file is missing, cut short or damaged.
        """
        fields = [self._field(name) for name in (self._fields if names is None else names)]
        if not 0 <= frame < self._record(episode).frames:
            raise IndexError(f"episode {episode} holds {self._record(episode).frames} frames")
        columns = [item.name for item in fields if item.place != BLOB]
        found = self.table(episode).row(frame, columns) if columns else {}
        blobs = [item for item in fields if item.place == BLOB]
        if blobs:
            found |= self._blobs(episode, frame, blobs)
        return found

    def encoded(self, episode: int, frame: int, name: str) -> bytes:
        """A blob as it lies in the shard, or would."""
        item = self._field(name)
        if self.has_blobs:
            return self._shard(episode).read(frame, item.member)
        return self._renderer().encoded(*self._place(episode, frame), [item])[name]

    @property
    def has_blobs(self) -> bool:
        """Whether sensor readings lie on the disk; otherwise they are rendered when they are asked for."""
        return self.info.record.blobs

    def close(self) -> None:
        """Closes all files."""
        for shard in self._shards.values():
            shard.close()
        self._shards.clear()

    def _blobs(self, episode: int, frame: int, fields: Sequence[FieldSpec]) -> dict[str, Any]:
        if not self.has_blobs:
            return self._renderer().read(*self._place(episode, frame), fields)
        shard, found = self._shard(episode), {}
        for item in fields:
            data = shard.read(frame, item.member)
            try:
                found[item.name] = decode(item.codec, data, item.shape)
            except DatasetError as error:
                raise DatasetError(f"{shard.path.name}: {frame:06d}.{item.member} is {error}") from None
        return found

    def _renderer(self) -> Rerendered:
        if self._rendered is None:
            self._rendered = Rerendered(self.info.record.suite, self._town_path)
        return self._rendered

    def _place(self, episode: int, frame: int) -> tuple[Path, int]:
        """Log and tick of a frame."""
        return self._file("log", episode), int(self.table(episode)["tick"][frame])

    def _shard(self, episode: int) -> ShardReader:
        if episode in self._shards:
            self._shards.move_to_end(episode)
            return self._shards[episode]
        shard, index = self._file("shard", episode), self._file("index", episode)
        problem = self._facts("index", episode).problem(index)
        if problem is not None:
            raise DatasetError(problem)
        found = ShardReader(shard, index, [item.member for item in self.info.blobs])
        if len(found) != self._record(episode).frames:
            raise DatasetError(f"{index.name} holds {len(found)} frames, the record {self._record(episode).frames}.")
        self._shards[episode] = found
        if len(self._shards) > _OPEN:
            self._shards.popitem(last=False)[1].close()
        return found

    def _file(self, kind: str, episode: int) -> Path:
        """A file of an episode, which has the size it should have."""
        path = self.root / file_of(kind, episode)
        problem = size_problem(path, self._facts(kind, episode).bytes)
        if problem is not None:
            raise DatasetError(problem)
        return path

    def _facts(self, kind: str, episode: int) -> FileFacts:
        name = file_of(kind, episode)
        try:
            return self._record(episode).files[name]
        except KeyError:
            raise DatasetError(f"episode {episode} has no {kind}: {name} was not written.") from None

    def _record(self, episode: int) -> EpisodeRecord:
        try:
            return self.episodes[episode]
        except KeyError:
            raise DatasetError(f"{self.root.name} has no finished episode {episode}.") from None

    def _field(self, name: str) -> FieldSpec:
        try:
            return self._fields[name]
        except KeyError:
            raise UnknownName("field", name, self._fields) from None
