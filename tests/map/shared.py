"""Real maps and reference answers that lie beside the repository, never in it."""

from __future__ import annotations

import gzip
import json
import os
from pathlib import Path
from typing import Any

import pytest

SHARED = Path(os.environ.get("LAVSIM_SHARED") or Path(__file__).parents[3] / "shared")
MAPS = SHARED / "maps" / "carla"
ORACLE = SHARED / "maps" / "oracle"

needs_maps = pytest.mark.skipif(
    not (MAPS / "Town01.xodr").exists(), reason="needs CARLA's towns in maps/carla of LAVSIM_SHARED or ../shared"
)
needs_oracle = pytest.mark.skipif(
    not (ORACLE / "Town02.json.gz").exists(),
    reason="needs reference answers in maps/oracle of LAVSIM_SHARED or ../shared",
)


def oracle(name: str) -> Any:
    """An answer file by its stem."""
    return json.loads(gzip.decompress((ORACLE / f"{name}.json.gz").read_bytes()))
