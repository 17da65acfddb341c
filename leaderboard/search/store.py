"""A folder of results, one JSON line each, that a killed search goes on from."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from lavsim.errors import OutputError
from leaderboard.record import write_text

HEADER = "search.json"
LINES = "drives.jsonl"


class Store:
    """Results by number, in a folder that belongs to one search.

    Args:
        folder: Made if missing.
        header: What decides the results, in JSON types; a folder with another header is refused.
        overwrite: Whether what an earlier search left there goes.
        owns: Names in the folder that go with it.

    Raises:
        OutputError: the folder belongs to another search, or can't be read or written.
    """

    def __init__(self, folder: Path, header: Mapping[str, Any], overwrite: bool, owns: Iterable[str] = ()) -> None:
        self.folder, self._header = folder, dict(header)
        try:
            if folder.exists() and not folder.is_dir():
                raise OutputError(f"{folder} is a file; a folder is expected")
            if overwrite:
                for path in (folder / name for name in (HEADER, LINES, *owns)):
                    shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)
            folder.mkdir(parents=True, exist_ok=True)
            for path in folder.rglob("*.partial"):  # a kill in the middle of writing
                path.unlink()
        except OSError as error:
            raise OutputError(f"can't write to {folder}: {error.strerror}") from None
        self._claim()
        self.rows = self._read()

    def add(self, number: int, row: Mapping[str, Any]) -> None:
        """Enters result `number`; the file holds all before or all with it, whatever happens."""
        self.rows[number] = dict(row)
        lines = (json.dumps({"number": k, **self.rows[k]}, allow_nan=False) for k in sorted(self.rows))
        write_text(self.folder / LINES, "".join(f"{line}\n" for line in lines))

    def _claim(self) -> None:
        path, text = self.folder / HEADER, json.dumps(self._header, indent=2, sort_keys=True) + "\n"
        if not path.exists():
            if (self.folder / LINES).exists():
                raise OutputError(f"{self.folder} holds results without a {HEADER}; give another folder or --overwrite")
            write_text(path, text)
            return
        try:
            begun = json.loads(path.read_text(encoding="utf-8"))
            now = json.loads(text)
            for name in sorted({*begun, *now}):
                if begun.get(name) != now.get(name):
                    raise OutputError(
                        f"{self.folder} was begun with {name} = {begun.get(name)!r}, not {now.get(name)!r}; "
                        "go on with it as it was begun, or give --overwrite or another folder"
                    )
        except (OSError, ValueError, AttributeError, TypeError) as error:
            raise OutputError(f"can't read {path}: {error}") from None

    def _read(self) -> dict[int, dict[str, Any]]:
        path = self.folder / LINES
        if not path.exists():
            return {}
        try:
            rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
            return {int(row.pop("number")): row for row in rows}
        except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
            raise OutputError(f"can't read {path}: {error}") from None
