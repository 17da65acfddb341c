"""Sketches of the American towns: wide streets, yellow centre lines, lights beyond the crossing, stops, roundabouts."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

from lavsim.towns.layout import Layout
from lavsim.towns.section import CrossSection

LOCAL = CrossSection(lane=3.3, gutter=0.5, sidewalk=2.0, parking=2.2, centre="yellow")
COLLECTOR = CrossSection(lane=3.5, gutter=0.5, sidewalk=2.0, centre="yellow")
ARTERIAL = CrossSection(lane=3.5, gutter=0.5, sidewalk=2.5, lanes=2, centre="yellow")
PARKWAY = replace(ARTERIAL, median=2.0)
CORNER = 13.0  # [m] as `Layout`'s corner radius


def us_large_a() -> Layout:
    """A prairie town on a grid of unequal blocks: arterials, parked local streets, a park with a roundabout."""
    town = Layout("us_large_a", section=LOCAL, corner_radius=CORNER, across=True, scale=1.27)
    avenues = {"1st": 0.0, "2nd": 165.0, "3rd": 310.0, "4th": 455.0, "5th": 640.0, "6th": 800.0}
    streets = {"Ash": 0.0, "Birch": 145.0, "Cedar": 300.0, "Elm": 450.0, "Fir": 590.0}
    wide_avenues, wide_streets = {"2nd", "5th"}, {"Birch", "Elm"}
    corners = {("1st", "Ash"), ("6th", "Ash"), ("1st", "Fir"), ("6th", "Fir")}
    stops = {("1st", "Cedar"): "stop", ("6th", "Cedar"): "stop", ("3rd", "Ash"): "stop", ("4th", "Ash"): "stop",
             ("3rd", "Fir"): "all stop", ("4th", "Fir"): "stop"}  # fmt: skip
    for avenue, x in avenues.items():
        for street, y in streets.items():
            name = f"{avenue} and {street}"
            if (avenue, street) == ("3rd", "Cedar"):
                town.roundabout(name, x, y, radius=22.0)
            elif (avenue, street) not in corners:
                town.junction(name, x, y, control=stops.get((avenue, street), "lights"))

    def node(avenue: str, street: str) -> str:
        return f"{avenue} and {street}"

    rows, columns = list(streets), list(avenues)
    for street in rows:
        section = ARTERIAL if street in wide_streets else COLLECTOR if street in ("Ash", "Fir") else LOCAL
        for k, (a, b) in enumerate(pairwise(columns)):
            ends = [(a, street), (b, street)]
            if any(end in corners for end in ends):
                continue  # drawn with the avenue, round the corner
            speed = 50 if street in wide_streets else 40 if section is COLLECTOR else 30
            town.street(f"{street} Street {k + 1}", node(*ends[0]), node(*ends[1]), speed=speed, section=section)
    for avenue in columns:
        section = ARTERIAL if avenue in wide_avenues else COLLECTOR if avenue in ("1st", "6th") else LOCAL
        speed = 50 if avenue in wide_avenues else 40 if section is COLLECTOR else 30
        for k, (a, b) in enumerate(pairwise(rows)):
            x, start, end, via = avenues[avenue], (avenue, a), (avenue, b), []
            if start in corners:
                start, via = ("2nd" if avenue == "1st" else "5th", a), [(x, streets[a], 60.0)]
            elif end in corners:
                end, via = ("2nd" if avenue == "1st" else "5th", b), [(x, streets[b], 60.0)]
            town.street(f"{avenue} Avenue {k + 1}", node(*start), node(*end), via=via, speed=speed, section=section)
    return town


def us_large_c() -> Layout:
    """A harbour town: an old quarter aslant along the water, a newer one square behind it, a boulevard between."""
    town = Layout("us_large_c", section=LOCAL, corner_radius=CORNER, across=True, scale=1.07)
    slant = math.radians(28.0)

    def aslant(u: float, v: float) -> tuple[float, float]:
        """From the old quarter's own axes (along and away from the water)."""
        return u * math.cos(slant) - v * math.sin(slant), u * math.sin(slant) + v * math.cos(slant)

    # The old quarter: Front and Middle Street along the water, lanes up from it to Harbour Boulevard.
    us, vs = (0.0, 160.0, 328.0, 498.0, 675.0), (0.0, 148.0, 290.0)
    for i, u in enumerate(us):
        for j, v in enumerate(vs):
            name, (x, y) = f"wharf {i}{j}", aslant(u, v)
            if (i, j) == (2, 1):
                town.roundabout(name, x, y, radius=21.0)
            elif (i, j) not in ((0, 0), (4, 0)):  # where Front Street turns inland
                town.junction(name, x, y, control="stop" if (i, j) in ((1, 0), (3, 0)) else "lights")
    for i in range(4):
        start, end, via = f"wharf {i}0", f"wharf {i + 1}0", []
        if i == 0:
            start, via = "wharf 01", [(*aslant(us[0], vs[0]), 60.0)]
        elif i == 3:
            end, via = "wharf 41", [(*aslant(us[4], vs[0]), 60.0)]
        town.street(f"Front Street {i + 1}", start, end, via=via, speed=40, section=COLLECTOR)
        town.street(f"Middle Street {i + 1}", f"wharf {i}1", f"wharf {i + 1}1", speed=30)
        town.street(f"Harbour Boulevard {i + 1}", f"wharf {i}2", f"wharf {i + 1}2", speed=50, section=PARKWAY)
    for i, lane in enumerate(("Anchor", "Barrel", "Compass", "Dory", "Eel")):
        for j in range(2):
            if (i, j) not in ((0, 0), (4, 0)):
                section = ARTERIAL if i in (1, 3) and j == 1 else LOCAL
                town.street(f"{lane} Lane {j + 1}", f"wharf {i}{j}", f"wharf {i}{j + 1}", speed=30, section=section)

    # The new quarter: square blocks inland, Lake and Oak Avenue and State Street the wide ones.
    xs, ys = (-410.0, -225.0, -55.0, 95.0), (560.0, 745.0, 920.0)
    for i, x in enumerate(xs):
        for j, y in enumerate(ys):
            if (i, j) not in ((0, 2), (3, 2)):
                control = {(1, 2): "all stop", (2, 2): "stop", (2, 0): "stop"}.get((i, j), "lights")
                town.junction(f"block {i}{j}", x, y, control=control)
    for i in range(3):
        town.street(f"Union Street {i + 1}", f"block {i}0", f"block {i + 1}0", speed=40, section=COLLECTOR)
        town.street(f"State Street {i + 1}", f"block {i}1", f"block {i + 1}1", speed=50, section=ARTERIAL)
    town.street("North Street 1", "block 01", "block 12", via=[(xs[0], ys[2], 70.0)], speed=40, section=COLLECTOR)
    town.street("North Street 2", "block 12", "block 22", speed=40, section=COLLECTOR)
    town.street("North Street 3", "block 22", "block 31", via=[(xs[3], ys[2], 70.0)], speed=40, section=COLLECTOR)
    for i, (avenue, section) in enumerate(
        (("Kings", COLLECTOR), ("Lake", ARTERIAL), ("Mill", LOCAL), ("Oak", ARTERIAL))
    ):
        speed = 30 if section is LOCAL else 50
        town.street(f"{avenue} Avenue 2", f"block {i}0", f"block {i}1", speed=speed, section=section)
        if i in (1, 2):
            town.street(f"{avenue} Avenue 3", f"block {i}1", f"block {i}2", speed=speed, section=section)

    # Between the quarters.
    def inland(i: int, v: float) -> tuple[float, float]:
        return aslant(us[i], v)

    town.street(
        "Kings Avenue 1", "block 00", "wharf 01", via=[(xs[0], 40, 90), (-200, 40, 60)], speed=50, section=COLLECTOR
    )
    town.street("Lake Avenue 1", "block 10", "wharf 02", via=[(*inland(0, 400), 90)], speed=50, section=ARTERIAL)
    town.street("Mill Avenue 1", "block 20", "wharf 12", via=[(*inland(1, 395), 90)], speed=30)
    town.street("Oak Avenue 1", "block 30", "wharf 22", via=[(*inland(2, 375), 90)], speed=50, section=ARTERIAL)
    town.street("Union Street 4", "block 30", "wharf 32", via=[(258, 564, 60)], speed=40, section=COLLECTOR)
    town.street(
        "State Street 4", "block 31", "wharf 42", via=[(580, 745, 55), (580, 636, 50)], speed=50, section=ARTERIAL
    )
    return town
