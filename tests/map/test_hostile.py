"""Files that are broken or meant to do harm: our own error, soon."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from lavsim.errors import MapError
from lavsim.map.opendrive import MAX_BYTES, read_file
from lavsim.map.town_files import build_town, load_town
from lavsim.map.town_map import TownMap
from tests.map import fuzz

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")


def road(
    number: int, length: float, curves: str = "", lanes: int = 1, more: str = "", link: str = "", junction: int = -1
) -> str:
    curves = curves or f'<geometry s="0" x="0" y="{number}" hdg="0" length="{length}"><line/></geometry>'
    sides = "".join(
        f'<lane id="-{k}" type="driving"><link><predecessor id="-{k}"/><successor id="-{k}"/></link>'
        '<width sOffset="0" a="3.5"/></lane>'
        for k in range(1, lanes + 1)
    )
    return (
        f'<road id="{number}" length="{length}" junction="{junction}">{link}<planView>{curves}</planView>'
        f'<lanes><laneSection s="0"><right>{sides}</right></laneSection></lanes>{more}</road>\n'
    )


def build(*parts: str) -> TownMap:
    return build_town("t", ("<OpenDRIVE>\n" + "".join(parts) + "</OpenDRIVE>").encode(), "t.xodr")


def winding(length: float, shape: str) -> str:
    return f'<geometry s="0" x="0" y="0" hdg="0" length="{length}">{shape}</geometry>'


CASES = {
    "endless road": (lambda: build(road(1, 999_999, lanes=2)), r"t\.xodr: the map has more than 1000 km of lanes"),
    "too many lanes": (lambda: build(*(road(k, 5) for k in range(20_001))), r"line \d+: more than 20000 lane pieces"),
    "too wide": (lambda: build(road(1, 5, lanes=800)), r"line 2: too many sections with too many lanes"),
    "endless spiral": (
        lambda: build(road(1, 900, winding(900, '<spiral curvStart="-9" curvEnd="9"/>'))),
        r"t\.xodr, line 2: road 1: a spiral of 900 m would turn by",
    ),
    "endless cubic": (
        lambda: build(
            road(1, 9, winding(9, '<paramPoly3 aU="0" bU="1" cU="0" dU="1e9" aV="0" bV="0" cV="0" dV="1e9"/>'))
        ),
        r"line 2: road 1: a cubic declared 9 m long is .* m long",
    ),
    "cubic of no length": (
        lambda: build(road(1, 9, winding(9, '<paramPoly3 aU="0" bU="0" cU="0" dU="0" aV="0" bV="0" cV="0" dV="0"/>'))),
        r"line 2: road 1: a cubic declared 9 m long is 0 m long",
    ),
    "dense junction": (
        lambda: build(*(road(k, 120, junction=9) for k in range(99)), '<junction id="9"/>'),
        r"t\.xodr: the junction of road 0 has 11\.9 km of lanes",
    ),
    "deep nesting": (lambda: build("<a>" * 9000), r"t\.xodr, line \d+: not well-formed XML"),
    "long comment": (lambda: build("<!--" + "x" * 12_000_000 + "-->", road(1, 9)), r"not well-formed XML"),
    "many signals": (
        lambda: build(
            road(1, 100, lanes=60, more="<signals>" + '<signal id="1" s="1" t="0" type="206"/>' * 400 + "</signals>")
        ),
        r"line 2: too many signals over too many lanes",
    ),
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_what_is_too_much_is_refused_in_time(name: str) -> None:
    make, message = CASES[name]
    start = time.process_time()
    with pytest.raises(MapError, match=message):
        make()
    assert time.process_time() - start < 10.0


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "huge.xodr"
    with path.open("wb") as file:
        file.truncate(40 * MAX_BYTES)
    with pytest.raises(MapError, match=r"huge\.xodr: the file is larger than 64 MB"):
        read_file(path)
    with pytest.raises(MapError, match=r"huge\.xodr: the file is larger than 64 MB"):
        load_town("huge", [tmp_path])


def test_roads_that_bite_their_own_tail_are_driven_round_and_round() -> None:
    link = (
        '<link><predecessor elementType="road" elementId="1" contactPoint="end"/>'
        '<successor elementType="road" elementId="1" contactPoint="start"/></link>'
    )
    town = build(road(1, 0.002, link=link))
    assert len(town.waypoint_at(0, 0.0).next(1e4)) <= 1
    assert town.waypoint_at(0, 0.0).landmarks(1e4) == []


def test_a_web_of_short_lanes_ends() -> None:
    end = 'elementType="junction" elementId="9"'
    both = f"<link><predecessor {end}/><successor {end}/></link>"
    ways = "".join(
        f'<connection incomingRoad="{a}" linkedRoad="{b}" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection>'
        for a in range(20)
        for b in range(20)
    )
    town = build(*(road(k, 5, link=both) for k in range(20)), f'<junction id="9" type="direct">{ways}</junction>')
    assert 0 < len(town.waypoint_at(0, 0.0).next(100.0)) <= 512
    town.waypoint_at(0, 0.0).next(1e4)


def test_mutated_maps_raise_nothing_but_map_errors() -> None:
    towns, refused = fuzz.drive(count=40, seed=1)
    assert towns > 0
    assert refused > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 10))
def test_thousands_of_mutated_maps_raise_nothing_but_map_errors(seed: int) -> None:
    towns, refused = fuzz.drive(count=600, seed=seed)
    assert towns > 0
    assert refused > 0


@pytest.mark.parametrize("point", [(0.0, 0.0), (1e9, -1e9), (-1e100, 1e100), (5e5, 3.0)])
def test_nearest_in_a_map_of_two_far_roads_takes_no_time(point: tuple[float, float]) -> None:
    far = build(*(road(k, 9, winding(9, "<line/>").replace('y="0"', f'y="{y}"')) for k, y in ((1, -9e5), (2, 9e5))))
    far.nearest([(0.0, 0.0)])
    start = time.process_time()
    hit = far.nearest([point])
    assert time.process_time() - start < 1.0
    assert hit.lane[0] in (0, 1)


def test_lanes_beyond_the_map_are_refused() -> None:
    with pytest.raises(MapError, match=r"t\.xodr, line 2: lane -1 of road 1 lies 5e\+05 km off; check its widths"):
        build(road(1, 9).replace('a="3.5"', 'a="1e9"'))
