"""A plan of drives short enough to collect many times in tests."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from lavsim.dataset.plan import CollectPlan


def short_plan(**changes: Any) -> CollectPlan:
    """Episodes of 12 frames in `eu_small_a` with little traffic, as logs alone; `changes` replaces fields."""
    fields: dict[str, Any] = {
        "towns": ("eu_small_a",), "frames": 30, "seed": 2, "vehicles": (4, 8), "walkers": (0, 2), "episode_frames": 12,
        "length": (150.0, 400.0), "log_only": True,
    }  # fmt: skip
    return CollectPlan(**{**fields, **changes})


def digests(root: Path) -> dict[str, str]:
    """SHA-256 of every file below `root`, by its path."""
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }
