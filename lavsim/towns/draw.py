"""Draws the bundled towns: `python -m lavsim.towns.draw` writes their xodr files beside this script.

A town is a list of nodes and of the streets between them, as on a sketch with x to the east and y to the north [m].
Corners of a street are (x, y, radius).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from lavsim.map.write import write_network
from lavsim.towns import american, european
from lavsim.towns.layout import Layout

TOWNS: dict[str, Callable[[], Layout]] = {
    "eu_small_a": european.eu_small_a,
    "eu_small_b": european.eu_small_b,
    "us_large_a": american.us_large_a,
    "us_large_b": american.us_large_b,
    "us_large_c": american.us_large_c,
    "us_highway": american.us_highway,
    "us_rural": american.us_rural,
    "us_center": american.us_center,
}


def main(folder: Path | None = None) -> None:
    """Writes every town into `folder`, by default the package's own."""
    folder = folder or Path(__file__).parent
    for name, draw in TOWNS.items():
        (folder / f"{name}.xodr").write_bytes(write_network(draw().network()))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
