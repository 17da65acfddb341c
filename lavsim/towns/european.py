"""Sketches of the European towns: narrow streets, lights before the crossing, T junctions."""

from __future__ import annotations

from dataclasses import replace

from lavsim.towns.layout import Layout
from lavsim.towns.section import CrossSection


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


def eu_small_b() -> Layout:
    """A small European town in a valley: an oblong with a main street through it, staggered lanes, T junctions only."""
    lane = CrossSection(lane=3.3, sidewalk=2.0)
    bays = replace(lane, parking=2.0, sidewalk=2.5)
    town = Layout("eu_small_b", section=lane, scale=1.2)

    town.junction("west end", 0, 132)
    town.junction("smithy", 118, 137)
    town.junction("post office", 212, 131)
    town.junction("town hall", 298, 126)
    town.junction("bakery", 384, 128)
    town.junction("chapel", 470, 137)
    town.junction("inn", 546, 146)
    town.junction("east end", 640, 150)
    town.junction("ferry", 131, -6)
    town.junction("quay", 289, -14)
    town.junction("lock", 449, 0)
    town.junction("vineyard", 203, 280, control="yield")
    town.junction("quarry", 392, 287, control="yield")
    town.junction("spring", 566, 268)

    # The Valley Road around it, clockwise from the west.
    town.street("Valley Road West", "west end", "vineyard", via=[(2, 274, 75)], speed=50)
    town.street("Hill Road", "vineyard", "quarry", via=[(298, 290, 300)], speed=50)
    town.street("Spring Road", "quarry", "spring", via=[(480, 284, 250)], speed=50)
    town.street("Valley Road East", "spring", "east end", via=[(640, 255, 55)], speed=50)
    town.street("Harbour Road", "east end", "lock", via=[(642, 18, 70)], speed=50)
    town.street("River Road East", "lock", "quay", via=[(370, -8, 250)], speed=50)
    town.street("River Road West", "quay", "ferry", via=[(212, -24, 250)], speed=50)
    town.street("Ferry Road", "ferry", "west end", via=[(-4, 8, 60)], speed=50)

    # Main Street, from end to end.
    town.street("Main Street West", "west end", "smithy", speed=30, section=bays)
    town.street("Smith Street", "smithy", "post office", speed=30, section=bays)
    town.street("Main Street", "post office", "town hall", speed=30, section=bays)
    town.street("Baker Street", "town hall", "bakery", speed=30, section=bays)
    town.street("Chapel Street", "bakery", "chapel", speed=30, section=bays)
    town.street("Inn Street", "chapel", "inn", speed=30, section=bays)
    town.street("Main Street East", "inn", "east end", speed=30, section=bays)

    # Lanes down to the river and up the hill; no two of them meet.
    town.street("Ferry Lane", "ferry", "smithy", via=[(125, 66, 60)], speed=30)
    town.street("Quay Lane", "quay", "town hall", via=[(284, 58, 60)], speed=30)
    town.street("Lock Lane", "lock", "chapel", via=[(440, 48, 45), (474, 95, 60)], speed=30)
    town.street("Vineyard Lane", "post office", "vineyard", via=[(228, 180, 45), (196, 238, 45)], speed=30)
    town.street("Quarry Lane", "bakery", "quarry", via=[(380, 202, 60)], speed=30)
    town.street("Spring Lane", "inn", "spring", via=[(540, 200, 60)], speed=30)
    return town
