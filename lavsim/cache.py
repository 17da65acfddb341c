"""Where derived data of a town is kept between runs: rasters, parsed maps, keyed by content."""

from __future__ import annotations

import os
from pathlib import Path


def cache_dir() -> Path:
    """The cache folder, made if missing: `LAVSIM_CACHE`, or `lavsim` below the user's cache folder."""
    base = os.environ.get("LAVSIM_CACHE")
    path = Path(base) if base else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "lavsim"
    path.mkdir(parents=True, exist_ok=True)
    return path


def replace_atomically(path: Path, write: bytes) -> None:
    """Writes `path` so that another process sees the old file or the whole new one."""
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    partial.write_bytes(write)
    partial.replace(path)
