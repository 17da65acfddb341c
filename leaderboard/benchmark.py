"""What a score belongs to: a digest of all that makes two runs comparable, and the versions that made it."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import lavsim
from leaderboard.routes import RouteEntry
from leaderboard.rules import Rules

LOOK = "fast"  # of the cameras
_PACKAGES = ("numpy", "numba", "pymunk", "opencv-python-headless", "scipy", "shapely", "lxml")


def benchmark_id(
    entries: Sequence[RouteEntry],
    digests: dict[str, str],
    traffic: Sequence[str],
    repetitions: int,
    rules: Rules,
    latency: int = 0,
) -> str:
    """16 hex digits over towns, routes, traffic profiles, look and rules; equal for comparable runs alone.

    Args:
        entries: The routes driven.
        digests: Of the towns, by name.
        traffic: Profile of each route.
        repetitions: Drives of each route.
        rules: What they are judged by.
        latency: Ticks by which controls act late.
    """
    content: dict[str, Any] = {
        "routes": [[entry.to_json(), profile] for entry, profile in zip(entries, traffic, strict=True)],
        "towns": sorted({entry.town: digests[entry.town] for entry in entries}.items()),
        "repetitions": repetitions,
        "look": LOOK,
        "rules": rules.version,
    }
    if latency:
        content["latency"] = latency
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def versions() -> dict[str, Any]:
    """Versions of what takes part in a number."""
    found = {"lavsim": lavsim.__version__, "python": platform.python_version(), "machine": platform.machine()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
