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
AVENUE = replace(ARTERIAL, back=0, lanes=2, parking=2.2)  # one-way
BROADWAY = replace(PARKWAY, median=1.5)
RURAL = CrossSection(lane=3.5, gutter=1.0, sidewalk=0.0, kerb=False, centre="yellow")
VILLAGE = CrossSection(lane=3.5, gutter=0.5, sidewalk=2.0, centre="yellow")
MOTORWAY = CrossSection(lane=3.7, gutter=2.5, sidewalk=0.0, lanes=2, median=2.5, kerb=False, centre="yellow")
RAMP = CrossSection(lane=3.7, gutter=1.2, sidewalk=0.0, back=0, kerb=False, centre="yellow")
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


def us_large_b() -> Layout:
    """A lake town: three rings, the outer one wide, and spokes, some of them staggered, around a roundabout."""
    town = Layout("us_large_b", section=LOCAL, corner_radius=CORNER, across=True)
    rings = {"Inner": 165.0, "Middle": 330.0, "Outer": 500.0}
    # Directions [deg] of the spokes, and from which ring to which they run (0 is the centre).
    spokes = (
        ("North", 90, 0, 3), ("East", 0, 0, 3), ("South", 270, 0, 3), ("West", 180, 0, 3),
        ("Maple", 45, 1, 3), ("Walnut", 135, 1, 3), ("Hazel", 225, 1, 2), ("Linden", 315, 1, 3),
        ("Poplar", 248, 2, 3), ("Alder", 202, 2, 3), ("Rowan", 22, 2, 3), ("Willow", 112, 2, 3),
    )  # fmt: skip
    stops = {("Inner", 225): "stop", ("Middle", 22): "stop", ("Middle", 112): "stop", ("Middle", 248): "yield",
             ("Outer", 112): "stop", ("Outer", 202): "stop"}  # fmt: skip

    def place(angle: float, radius: float) -> tuple[float, float]:
        return radius * math.cos(math.radians(angle)), radius * math.sin(math.radians(angle))

    town.roundabout("Lake Circle", 0.0, 0.0, radius=26.0)
    radii = list(rings.values())
    met: dict[str, list[int]] = {ring: [] for ring in rings}
    for _, angle, first, last in spokes:
        for k, ring in enumerate(rings):
            if first <= k + 1 <= last:
                met[ring].append(angle)
                control = stops.get((ring, angle), "lights")
                town.junction(f"{ring} {angle}", *place(angle, radii[k]), control=control)
    for ring, radius in rings.items():
        section = {"Inner": COLLECTOR, "Middle": LOCAL, "Outer": ARTERIAL}[ring]
        speed = {"Inner": 40, "Middle": 30, "Outer": 60}[ring]
        angles = sorted(met[ring])
        for k, (begin, end) in enumerate(zip(angles, [*angles[1:], angles[0] + 360], strict=True)):
            # Pieces of the ring: tangents to it, met half way by an arc of nearly its own radius.
            half = math.radians(end - begin) / 2.0
            x, y = place((begin + end) / 2.0, radius / math.cos(half))
            tangent = radius * math.tan(half)
            via = [(x, y, (tangent - 34.0) / math.tan(half))]
            town.street(
                f"{ring} Ring {k + 1}", f"{ring} {begin}", f"{ring} {end % 360}", via=via, speed=speed, section=section
            )  # fmt: skip
    names = list(rings)
    for name, angle, first, last in spokes:
        for k in range(first, last):
            start = "Lake Circle" if k == 0 else f"{names[k - 1]} {angle}"
            wide = angle % 90 == 0 and k > 0
            town.street(
                f"{name} Street {k + 1}", start, f"{names[k]} {angle}", speed=50 if wide else 30,
                section=(PARKWAY if angle % 180 == 0 else ARTERIAL) if wide else COLLECTOR if k == 0 else LOCAL,
            )  # fmt: skip
    return town


def us_center() -> Layout:
    """A dense downtown: short blocks, one-way streets in turn, Broadway and Main Street both ways, a park between."""
    town = Layout("us_center", section=AVENUE, corner_radius=CORNER, across=True)
    pitch_x, pitch_y, columns, rows, broadway, main = 113.0, 98.0, 9, 8, 4, 3
    park = {(6, 5)}  # the node in the middle of its four blocks
    corners = {(i, j) for i in (0, columns - 1) for j in (0, rows - 1)}
    stops = {(2, 0), (6, 0), (2, rows - 1), (6, rows - 1)}
    for i in range(columns):
        for j in range(rows):
            if (i, j) not in corners | park:
                control = "all stop" if (i, j) in stops else "lights"
                town.junction(f"{i} {j}", i * pitch_x, j * pitch_y, control=control)

    def lay(name: str, ends: list[tuple[int, int]], direction: int, both: CrossSection) -> None:
        """A street along `ends`, cut at its junctions; `direction` is 0 for both ways."""
        for k, (a, b) in enumerate(pairwise(ends)):
            if not {a, b} & (corners | park):
                first, last = (b, a) if direction < 0 else (a, b)
                town.street(
                    f"{name} {k + 1}", f"{first[0]} {first[1]}", f"{last[0]} {last[1]}",
                    speed=40 if direction else 50, section=AVENUE if direction else both,
                )  # fmt: skip

    for i in range(columns):
        outer = i in (0, columns - 1)
        name = "Broadway" if i == broadway else f"{i + 1} Avenue"
        one_way = 0 if outer or i == broadway else 1 if i % 2 else -1
        lay(name, [(i, j) for j in range(rows)], one_way, BROADWAY if i == broadway else COLLECTOR)
    for j in range(rows):
        outer = j in (0, rows - 1)
        name = "Main Street" if j == main else f"{chr(65 + j)} Street"
        one_way = 0 if outer or j == main else 1 if j % 2 else -1
        lay(name, [(i, j) for i in range(columns)], one_way, ARTERIAL if j == main else COLLECTOR)
    for i, j in sorted(corners):
        a, b = (1 if i == 0 else columns - 2, j), (i, 1 if j == 0 else rows - 2)
        town.street(
            f"Corner {i} {j}", f"{a[0]} {a[1]}", f"{b[0]} {b[1]}", via=[(i * pitch_x, j * pitch_y, 40.0)],
            speed=40, section=COLLECTOR,
        )  # fmt: skip
    return town


def us_highway() -> Layout:
    """A town below a divided motorway that ends in its main road; ramps lead into it and to a hamlet beyond."""
    town = Layout("us_highway", section=LOCAL, corner_radius=CORNER, across=True)
    three = replace(MOTORWAY, lanes=3, back=2)

    # The motorway, from the west end over the north to the east end; towards the east a lane opens before the exit,
    # and another is added by the entry and ends after it. Towards the west, ramps leave and join the right lane.
    town.junction("west end", -800, 0)
    for name, x in (
        ("lane opens", -455), ("exit 1", -315), ("entry 2", -205),
        ("exit 2", 205), ("entry 1", 315), ("lane ends", 465),
    ):  # fmt: skip
        town.ramps(
            name, x, 520, half=45.0 if name.endswith("2") else 35.0
        )  # where no lane is left over, ramps part later
    town.junction("east end", 800, 0)
    town.street("Motorway 1", "west end", "lane opens", via=[(-800, 520, 300)], speed=90, section=MOTORWAY)
    town.street("Motorway 2", "lane opens", "exit 1", speed=90, section=three)
    town.street("Motorway 3", "exit 1", "entry 2", speed=90, section=MOTORWAY)
    town.street("Motorway 4", "entry 2", "exit 2", speed=90, section=MOTORWAY)
    town.street("Motorway 5", "exit 2", "entry 1", speed=90, section=MOTORWAY)
    town.street("Motorway 6", "entry 1", "lane ends", speed=90, section=three)
    town.street("Motorway 7", "lane ends", "east end", via=[(800, 520, 300)], speed=90, section=MOTORWAY)

    # The hamlet beyond it.
    town.junction("mill", 95, 650, control="yield", crosswalks=False)
    town.junction("pond", -95, 650, control="yield", crosswalks=False)
    town.street("Mill Lane", "mill", "pond", speed=50, section=RURAL)
    town.street("Pond Loop", "mill", "pond", via=[(95, 715, 28), (-95, 715, 28)], speed=30, section=RURAL)
    town.street("Exit 2", "exit 2", "mill", speed=50, section=RAMP)
    town.street("Entry 2", "pond", "entry 2", speed=50, section=RAMP)

    # The town, five streets wide; the ramps come down to North Street.
    xs, ys = (-290.0, -150.0, -20.0, 110.0, 250.0), (-130.0, 0.0, 125.0, 250.0)
    stops = {(1, 2): "stop", (3, 2): "stop", (2, 3): "stop", (0, 2): "stop", (4, 2): "stop", (2, 0): "yield",
             (1, 0): "stop", (3, 0): "stop"}  # fmt: skip
    for i, east in enumerate(xs):
        for j, north in enumerate(ys):
            if (i, j) not in ((0, 3), (4, 3)):
                town.junction(f"{i} {j}", east, north, control=stops.get((i, j), "lights"))
    for j, name in enumerate(("South Street", "Main Road", "Market Street", "North Street")):
        section, speed = ((COLLECTOR, 40), (ARTERIAL, 50), (LOCAL, 30), (COLLECTOR, 40))[j]
        for i in range(4):
            if j < 3 or i in (1, 2):
                town.street(f"{name} {i + 1}", f"{i} {j}", f"{i + 1} {j}", speed=speed, section=section)
    for i, name in enumerate(("1st", "2nd", "3rd", "4th", "5th")):
        for j in range(3):
            if j < 2 or i in (1, 2, 3):
                section = COLLECTOR if i in (1, 3) else LOCAL
                town.street(f"{name} Street {j + 1}", f"{i} {j}", f"{i} {j + 1}", speed=30, section=section)
    town.street("North Street 1", "0 2", "1 3", via=[(xs[0], ys[3], 50)], speed=40, section=COLLECTOR)
    town.street("North Street 4", "3 3", "4 2", via=[(xs[4], ys[3], 50)], speed=40, section=COLLECTOR)
    town.street("Exit 1", "exit 1", "1 3", via=[(-150, 440, 60)], speed=50, section=RAMP)
    town.street("Entry 1", "3 3", "entry 1", via=[(110, 440, 60)], speed=50, section=RAMP)

    # To the ends of the motorway.
    town.street("Main Road West", "west end", "0 1", via=[(-560, 0, 300), (-420, 12, 300)], speed=60, section=ARTERIAL)
    town.street("Main Road East", "4 1", "east end", via=[(400, -14, 300), (560, 0, 300)], speed=60, section=ARTERIAL)
    town.street(
        "Post Road West", "west end", "0 0", via=[(-800, -130, 70), (-500, -120, 200)], speed=60, section=COLLECTOR
    )  # fmt: skip
    town.street(
        "Post Road East", "4 0", "east end", via=[(500, -120, 200), (800, -130, 70)], speed=60, section=COLLECTOR
    )  # fmt: skip
    return town


def us_rural() -> Layout:
    """Three villages and a crossroads in the country: long bends, one lane a side, yields and stops, few lights."""
    town = Layout("us_rural", section=RURAL, corner_radius=15.0, across=True, scale=1.12)

    def country(name: str, x: float, y: float, control: str = "yield") -> None:
        town.junction(name, x, y, control=control, crosswalks=False)

    # Ashby in the west.
    town.junction("ashby green", 0, 520, control="all stop")
    town.junction("ashby church", 120, 540, control="stop")
    town.junction("ashby well", 10, 395, control="stop")
    town.junction("ashby smithy", 135, 410, control="stop")
    # Brook in the north-east.
    town.junction("brook inn", 790, 770)
    town.junction("brook hall", 920, 800, control="stop")
    town.junction("brook mill", 815, 650, control="stop")
    town.junction("brook ford", 950, 670, control="stop")
    # Crane in the south-east.
    town.junction("crane school", 700, 190, control="stop")
    town.junction("crane barn", 835, 175, control="all stop")
    town.junction("crane bridge", 720, 60, control="stop")
    town.junction("crane quay", 850, 50, control="yield")
    # In the country.
    town.roundabout("crossroads", 455, 430, radius=20.0)
    country("west fork", 160, 800)
    country("north fork", 430, 850)
    country("oak fork", 470, 660, control="stop")
    country("farm", 330, 120, control="stop")
    country("hill fork", 235, 285)
    country("east fork", 1060, 420)
    country("lake fork", 880, 430, control="stop")

    streets = (
        ("Green Lane", "ashby green", "ashby church"), ("Well Lane", "ashby green", "ashby well"),
        ("Church Lane", "ashby church", "ashby smithy"), ("Smith Lane", "ashby well", "ashby smithy"),
        ("Inn Street", "brook inn", "brook hall"), ("Mill Street", "brook inn", "brook mill"),
        ("Hall Street", "brook hall", "brook ford"), ("Ford Street", "brook mill", "brook ford"),
        ("School Street", "crane school", "crane barn"), ("Bridge Street", "crane school", "crane bridge"),
        ("Barn Street", "crane barn", "crane quay"), ("Quay Street", "crane bridge", "crane quay"),
    )  # fmt: skip
    for name, start, end in streets:
        town.street(name, start, end, speed=40, section=VILLAGE)
    roads: tuple[tuple[str, str, str, list[tuple[float, float, float]]], ...] = (
        ("West Road", "ashby green", "west fork", [(-20, 690, 110), (50, 785, 90)]),
        ("North Road 1", "west fork", "north fork", [(300, 785, 150)]),
        ("Orchard Road", "ashby church", "west fork", [(105, 650, 100), (160, 720, 80)]),
        ("North Road 2", "north fork", "brook hall",
         [(560, 905, 150), (700, 860, 150), (820, 920, 99), (940, 900, 60)]),
        ("Oak Road 1", "ashby church", "oak fork", [(240, 560, 120), (340, 660, 120)]),
        ("Oak Road 2", "oak fork", "brook inn", [(590, 660, 120), (670, 760, 110)]),
        ("Fork Lane", "north fork", "oak fork", [(445, 760, 100)]),
        ("Cross Road West", "ashby smithy", "crossroads", [(235, 405, 90), (345, 460, 100)]),
        ("Cross Road North", "oak fork", "crossroads", [(480, 560, 120)]),
        ("Cross Road East", "crossroads", "lake fork", [(560, 420, 120), (680, 480, 120), (780, 420, 120)]),
        ("Cross Road South", "crossroads", "crane school", [(460, 330, 100), (560, 220, 100), (630, 190, 120)]),
        ("Lake Road North", "lake fork", "brook mill", [(885, 500, 80), (820, 560, 70)]),
        ("Lake Road South", "lake fork", "crane barn", [(890, 340, 90), (830, 270, 80)]),
        ("East Road 1", "brook ford", "east fork", [(1010, 650, 90), (1075, 540, 110)]),
        ("Lake Road East", "lake fork", "east fork", [(965, 440, 150)]),
        ("East Road 2", "east fork", "crane quay", [(1050, 300, 120), (1085, 160, 90), (980, 40, 110)]),
        ("South Road 1", "ashby well", "farm", [(5, 250, 120), (60, 110, 110), (210, 150, 130)]),
        ("South Road 2", "farm", "crane bridge", [(440, 95, 120), (545, 135, 110), (625, 70, 90)]),
        ("Hill Road 1", "ashby smithy", "hill fork", [(145, 345, 40)]),
        ("Hill Road 2", "hill fork", "farm", [(315, 253, 60), (322, 190, 90)]),
        ("Hill Road 3", "hill fork", "ashby well", [(225, 212, 30), (110, 272, 60)]),
    )  # fmt: skip  # fmt: skip
    for name, start, end, via in roads:
        town.street(name, start, end, via=via, speed=40 if name.startswith("Hill") else 60)
    return town
