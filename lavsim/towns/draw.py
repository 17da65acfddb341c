"""Draws the bundled towns: `python -m lavsim.towns.draw` writes their xodr files beside this script.

A town is a list of junctions and of the streets between them, as on a sketch with x to the east and y to the north
[m]. Corners of a street are (x, y, radius).
"""

from __future__ import annotations

import sys
from pathlib import Path

from lavsim.map.write import write_network
from lavsim.towns.layout import Layout


def eu_small_a() -> Layout:
    """A small European town: a ring road around an old centre of winding streets, T junctions but for the market."""
    town = Layout("eu_small_a")

    town.junction("mill", 2, 88)
    town.junction("west gate", 9, 193)
    town.junction("school", 204, 365)
    town.junction("church", 435, 348)
    town.junction("east gate", 563, 148)
    town.junction("park", 557, 62)
    town.junction("station", 380, -15)
    town.junction("bridge", 182, -9)
    town.junction("orchard", 187, 82)
    town.junction("market", 196, 176)
    town.junction("library", 209, 270)
    town.junction("gallery", 378, 88)
    town.junction("museum", 374, 165)
    town.junction("garden", 462, 176)
    town.junction("theatre", 446, 264)

    # The ring, clockwise from the mill.
    town.street("Mill Wall", "mill", "west gate", speed=50)
    town.street("North West Wall", "west gate", "school", via=[(24, 363, 50)], speed=50)
    town.street("North Wall", "school", "church", via=[(319, 376, 160)], speed=50)
    town.street("Vineyard Wall", "church", "east gate", via=[(583, 330, 60)], speed=50)
    town.street("East Wall", "east gate", "park", speed=50)
    town.street("Park Wall", "park", "station", via=[(550, -26, 45)], speed=50)
    town.street("South Wall", "station", "bridge", via=[(280, -37, 160)], speed=50)
    town.street("Harbour Wall", "bridge", "mill", via=[(-4, -4, 40)], speed=50)

    # The High Street, from gate to gate.
    town.street("High Street West", "west gate", "market", via=[(77, 209, 60), (134, 169, 60)], speed=30)
    town.street("High Street", "market", "museum", via=[(288, 185, 120)], speed=30)
    town.street("Museum Street", "museum", "garden", speed=30)
    town.street("High Street East", "garden", "east gate", via=[(515, 167, 60)], speed=30)

    # North and south of it.
    town.street("Bridge Street", "bridge", "orchard", speed=30)
    town.street("Orchard Street", "orchard", "market", speed=30)
    town.street("School Street", "market", "library", speed=30)
    town.street("Library Street", "library", "school", speed=30)
    town.street("Station Street", "station", "gallery", via=[(364, 34, 60)], speed=30)
    town.street("Gallery Street", "gallery", "museum", via=[(386, 122, 60)], speed=30)
    town.street("Park Lane", "gallery", "park", via=[(430, 70, 40), (490, 88, 40)], speed=30)
    town.street("Garden Street", "garden", "theatre", speed=30)
    town.street("Church Street", "theatre", "church", speed=30)
    town.street("Theatre Street", "library", "theatre", via=[(284, 249, 60), (358, 268, 80)], speed=30)
    town.street("Crescent", "mill", "orchard", via=[(68, 108, 30), (114, 59, 30)], speed=30)
    return town


TOWNS = {"eu_small_a": eu_small_a}


def main(folder: Path | None = None) -> None:
    """Writes every town into `folder`, by default the package's own."""
    folder = folder or Path(__file__).parent
    for name, draw in TOWNS.items():
        (folder / f"{name}.xodr").write_bytes(write_network(draw().network()))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
