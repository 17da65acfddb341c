"""Files that are there whole or not at all, and JSON that tells whether it is damaged."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lavsim.errors import DatasetError

PARTIAL = ".partial"
_CHECKSUM = "checksum"
_CHUNK = 1 << 20  # [bytes]


@dataclass(frozen=True)
class FileFacts:
    """What a record says about a file: its size [bytes] and its SHA-256 (hexadecimal)."""

    bytes: int
    sha256: str

    @staticmethod
    def of(path: Path) -> FileFacts:
        """Those of a file on disk."""
        digest, size = hashlib.sha256(), 0
        try:
            with path.open("rb") as file:
                while chunk := file.read(_CHUNK):
                    digest.update(chunk)
                    size += len(chunk)
        except OSError as error:
            raise DatasetError(f"{path.name}: {error.strerror or error}.") from None
        return FileFacts(size, digest.hexdigest())

    def problem(self, path: Path) -> str | None:
        """In what the file at `path` differs; None if in nothing. Reads all of it."""
        size = size_problem(path, self.bytes)
        if size is not None:
            return size
        found = FileFacts.of(path)
        return None if found == self else f"{path.name} is damaged (its SHA-256 differs)."


def size_problem(path: Path, size: int) -> str | None:
    """What is wrong with a file that should have `size` bytes, as far as its size tells."""
    try:
        found = path.stat().st_size
    except OSError:
        return f"{path.name} is missing."
    if found == size:
        return None
    return f"{path.name} is {'cut short' if found < size else 'too long'}: {found} bytes instead of {size}."


class PartialFile:
    """A file being written, under another name until it is whole.

    Args:
        path: Its name once it is; folders above are made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._partial = partial_of(path)
        self._file = self._partial.open("wb")
        self._digest = hashlib.sha256()
        self.size = 0

    def write(self, data: bytes) -> None:
        """Appends."""
        self._file.write(data)
        self._digest.update(data)
        self.size += len(data)

    def finish(self) -> FileFacts:
        """Puts the file on disk under its name."""
        self._file.close()
        publish(self.path)
        return FileFacts(self.size, self._digest.hexdigest())

    def abandon(self) -> None:
        """Removes what was written; may be called twice."""
        with suppress(OSError):  # what it still held did not fit on the disk
            self._file.close()
        self._partial.unlink(missing_ok=True)


def partial_of(path: Path) -> Path:
    """The name of `path` while it is being written."""
    return path.with_name(path.name + PARTIAL)


def publish(path: Path) -> None:
    """Gives a finished partial file its name, once its bytes are on the disk."""
    partial = partial_of(path)
    with partial.open("rb") as file:
        os.fsync(file.fileno())
    partial.replace(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Makes the names in a folder survive a loss of power."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_file(path: Path, data: bytes) -> FileFacts:
    """Writes a whole file at once; another process sees the old one or the new one."""
    file = PartialFile(path)
    try:
        file.write(data)
        return file.finish()
    except BaseException:
        file.abandon()
        raise


def write_sealed(path: Path, content: Mapping[str, Any]) -> None:
    """Writes JSON with a checksum of its content: the SHA-256 of its compact form with sorted keys."""
    sealed = {**content, _CHECKSUM: _seal(content)}
    text = json.dumps(sealed, indent=1, sort_keys=True, allow_nan=False, ensure_ascii=False) + "\n"
    write_file(path, text.encode())


def read_sealed(path: Path, version_key: str, version: int) -> dict[str, Any]:
    """The content of a file from `write_sealed`.

    Raises:
        DatasetError: it is missing, no JSON, of another version, or damaged.
    """
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise DatasetError(f"{path.name}: {error.strerror or error}.") from None
    except ValueError:
        raise DatasetError(f"{path.name} is damaged or cut short: it is no JSON.") from None
    if not isinstance(content, dict) or version_key not in content:
        raise DatasetError(f"{path.name} is no file of a dataset: it has no {version_key!r}.")
    if content[version_key] != version:
        raise DatasetError(
            f"{path.name} has {version_key} {content[version_key]!r}; this version of lavsim reads {version}."
        )
    seal = content.pop(_CHECKSUM, None)
    if seal != _seal(content):
        raise DatasetError(f"{path.name} is damaged (checksum differs).")
    return content


def _seal(content: Mapping[str, Any]) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()
