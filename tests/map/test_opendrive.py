"""Files in, records out; and what is said about files that are no maps."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from lavsim.errors import MapError
from lavsim.map.opendrive import read_file, read_network, reference_origin
from lavsim.map.town_files import build_town
from lavsim.map.write import write_network
from lavsim.towns.draw import TOWNS
from lavsim.towns.layout import Layout

ROAD = """<?xml version="1.0"?>
<OpenDRIVE>
  <header revMajor="1" revMinor="4"/>
  <road name="" length="50" id="7" junction="-1">
    <planView>
      <geometry s="0" x="0" y="0" hdg="0" length="50">{shape}</geometry>
    </planView>
    <lanes>
      <laneSection s="0">
        <center><lane id="0" type="none"/></center>
        <right><lane id="-1" type="driving"><width sOffset="0" a="{width}" b="0" c="0" d="0"/></lane></right>
      </laneSection>
    </lanes>
  </road>
</OpenDRIVE>
"""


def text(shape: str = "<line/>", width: str = "3.5") -> str:
    return ROAD.format(shape=shape, width=width)


def test_a_plain_road_is_read() -> None:
    network = read_network(text())
    assert [road.id for road in network.roads] == [7]
    assert network.notes == ()


@pytest.mark.parametrize("name", sorted(TOWNS))
def test_written_records_are_read_back_equal(name: str) -> None:
    drawn = TOWNS[name]().network()
    read = read_network(write_network(drawn))
    assert read.junctions == drawn.junctions
    assert read.controllers == drawn.controllers
    for before, after in zip(drawn.roads, read.roads, strict=True):
        assert after.geometry == before.geometry
        assert after.sections == before.sections
        assert (after.signals, after.references, after.objects) == (before.signals, before.references, before.objects)
        assert (after.predecessor, after.successor) == (before.predecessor, before.successor)
        assert [s.limit for s in after.speeds] == pytest.approx([s.limit for s in before.speeds])


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ("<OpenDRIVE>\n<road>\n</OpenDRIVE>", r"^x\.xodr, line 3: not well-formed XML"),
        ("", r"^x\.xodr, line \d+: not well-formed XML"),
        ("<roads/>", r"^x\.xodr, line 1: expected the root element OpenDRIVE, got 'roads'"),
        ("<OpenDRIVE/>", r"line 1: the file has no road"),
        (text("<helix/>"), r"line 6: geometry 'helix' is unknown; known are line, arc, spiral, poly3, paramPoly3"),
        (text("<spiral curvStart='0'/>"), r"line 6: <spiral> lacks 'curvEnd'"),
        (text("<spiral curvStart='0' curvEnd='11'/>"), r"line 6: spiral curvEnd must be within"),
        (text("<paramPoly3 pRange='miles'/>"), r"line 6: pRange must be 'arcLength' or 'normalized', got 'miles'"),
        (text("<arc curvature='nan'/>"), r"line 6: <arc> curvature must be a finite number, got 'nan'"),
        (text("<arc curvature='99'/>"), r"line 6: arc curvature must be within"),
        (text("<arc/>"), r"line 6: <arc> lacks 'curvature'"),
        (text(width="wide"), r"line 11: <width> a must be a number, got 'wide'"),
        (text(width="1e308"), r"line 11: <width> a must be a finite number"),
        (text().replace(' id="7"', ""), r"line 4: <road> lacks 'id'"),
        (text().replace('length="50" id', 'length="-3" id'), r"line 4: road length must be positive"),
        (text().replace('id="-1"', 'id="-4"'), r"line 9: lane ids must run from 0 to -4 without a gap"),
        (
            text().replace('<?xml version="1.0"?>', '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]>'),
            r"document type",
        ),
    ],
)
def test_what_is_no_map_is_refused_with_file_and_line(broken: str, message: str) -> None:
    with pytest.raises(MapError, match=message):
        read_network(broken, "x.xodr")


def test_two_roads_of_one_id_are_refused() -> None:
    road = text()[text().index("  <road") : text().index("</OpenDRIVE>")]
    with pytest.raises(MapError, match="road id 7 is used 2 times"):
        read_network(text().replace("</OpenDRIVE>", road + "</OpenDRIVE>"))


def test_an_entity_bomb_ends_in_an_error() -> None:
    bomb = '<?xml version="1.0"?><!DOCTYPE z [<!ENTITY a "aaaaaaaaaa">' + "".join(
        f'<!ENTITY {chr(98 + k)} "{("&" + chr(97 + k) + ";") * 10}">' for k in range(9)
    )
    with pytest.raises(MapError):
        read_network(bomb + "]><OpenDRIVE><header name='&j;'/></OpenDRIVE>")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"nowhere\.xodr: No such file"):
        read_file(tmp_path / "nowhere.xodr")


def test_a_road_linked_to_nothing_is_reported_and_loses_the_link() -> None:
    link = '<link><successor elementType="road" elementId="8" contactPoint="start"/></link><planView>'
    lane = '<lane id="-1" type="driving"><link><successor id="-1"/></link>'
    linked = text().replace("<planView>", link, 1).replace('<lane id="-1" type="driving">', lane)
    town = build_town("t", linked.encode())
    assert town.report == ("Lane -1 of road 7 leads to road 8, which is missing; dropped.",)
    assert not len(town.lanes.succ)


def test_ids_that_are_no_numbers_are_numbered_and_reported() -> None:
    town = build_town("t", text().replace('id="7"', 'id="Kalle"').encode())
    assert town.report == ("Road ids that are no whole numbers were numbered: 'Kalle' is 1.",)
    assert town.lanes.road_id.tolist() == [1]


def test_a_width_of_nothing_leaves_a_lane_of_nothing() -> None:
    town = build_town("t", text(width="0").encode())
    assert town.lanes.width.max() == 0.0


def test_what_is_not_read_is_counted() -> None:
    extra = text().replace("</lanes>", "</lanes><objects><tunnel/><tunnel/></objects><railroad/>")
    assert read_network(extra).notes == ("1 x <railroad> in <road> not read", "2 x <tunnel> in <objects> not read")


def test_the_origin_is_read_from_the_projection() -> None:
    assert reference_origin("+proj=tmerc +lat_0=49 +lon_0=8 +k=1") == (49.0, 8.0)
    assert reference_origin("") == (42.0, 2.0)
    assert reference_origin("+lat_0=- +lon_0=1e999") == (42.0, 2.0)


def test_an_arc_is_followed_exactly() -> None:
    town = build_town("t", text("<arc curvature='0.1'/>").encode())
    points = town.lanes.centre_line(0)
    centre = np.array([0.0, -10.0])  # a left bend of 10 m radius; the world's y points south
    assert np.allclose(np.hypot(*(points[:, :2] - centre).T), 10.0 + 1.75, atol=1e-9)
    assert np.allclose(points[:, 4], -1.0 / 11.75)
    assert town.lanes.length[0] == pytest.approx(50.0 * 1.175)
    assert points[-1, 3] == pytest.approx(-5.0)  # 50 m at 0.1 1/m turn 5 rad, unwrapped
    assert math.isclose(town.lanes.step[0] * (len(points) - 1), town.lanes.length[0])


def test_a_layout_without_room_says_so() -> None:
    layout = Layout("tight")
    layout.junction("a", 0.0, 0.0)
    layout.street("one", (-50.0, 0.0), "a")
    layout.street("two", "a", (50.0, 0.0))
    layout.street("three", (0.0, -8.0), "a")
    with pytest.raises(ValueError, match="street three: no room for leg 1"):
        layout.network()
