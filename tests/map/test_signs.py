"""Signs, trigger boxes, limits, parking spaces, drivable ground, and what is wrong in words."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from lavsim.geometry import wrap_angle
from lavsim.map.check import check_file
from lavsim.map.town_files import build_town, load_town
from lavsim.map.town_map import TownMap
from lavsim.towns.draw import TOWNS
from lavsim.types import LaneType
from tests import worlds
from tests.map.shared import MAPS, needs_maps
from tests.map.xodr import WIDTH, lanes, road, town


def junction_with(
    kind: str, orientation: str = "-", validity: str = '<validity fromLane="-1" toLane="-1"/>'
) -> TownMap:
    """Road 1 leads east into road 2, which lies in a junction and holds the reference, and on to road 3."""
    post = f'<signal id="77" s="48" t="-3" zOffset="2" hOffset="0" orientation="-" type="{kind}" dynamic="no"/>'
    reference = f'<signalReference id="77" s="0.5" t="0" orientation="{orientation}">{validity}</signalReference>'
    one_way = lanes((-1,))
    return town(
        road(
            1, 50.0, section=one_way, behind=f"<signals>{post}</signals>",
            before='<link><successor elementType="junction" elementId="9"/></link>',
        ),
        road(
            2, 20.0, start=(50.0, 0.0, 0.0), section=one_way, behind=f"<signals>{reference}</signals>",
            before='<link><predecessor elementType="road" elementId="1" contactPoint="end"/>'
            '<successor elementType="road" elementId="3" contactPoint="start"/></link>',
        ).replace('junction="-1"', 'junction="9"'),
        road(
            3, 50.0, start=(70.0, 0.0, 0.0), section=one_way,
            before='<link><predecessor elementType="junction" elementId="9"/></link>',
        ),
        '<junction id="9"><connection id="0" incomingRoad="1" connectingRoad="2" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection></junction>',
    )  # fmt: skip


@pytest.mark.parametrize(("kind", "name"), [("206", "stop"), ("205", "yield")])
def test_a_sign_governs_the_junction_lane_and_its_approach(kind: str, name: str) -> None:
    signed = junction_with(kind)
    (sign,) = signed.signs
    approach, way = signed.lane_index(1, 0, -1), signed.lane_index(2, 0, -1)
    assert (sign.kind, sign.signal_id, sign.junction, sign.value) == (name, 77, 0, 0.0)
    assert (sign.lanes, sign.approach) == ((way,), (approach,))
    assert signed.lanes.sign.tolist() == [0 if k == way else -1 for k in range(len(signed.lanes))]
    assert (signed.lanes.light == -1).all()
    assert (sign.x, sign.y, sign.z) == pytest.approx((48.0, 3.0, 2.0))
    assert float(wrap_angle(sign.yaw - np.pi)) == pytest.approx(0.0)
    (stop,) = sign.stop_lines
    assert stop.lane == approach
    assert 49.5 < stop.u <= 50.0
    # A cube of 0.45 lane widths half side that ends at the reference, 0.5 m inside the junction.
    (box,) = sign.boxes
    assert (box.lane, box.x, box.half_length) == (approach, pytest.approx(50.5 - 0.45 * WIDTH), 0.45 * WIDTH)
    assert sign.trigger == pytest.approx((box.x, box.y, box.yaw, 0.45 * WIDTH, 0.45 * WIDTH))


def test_a_sign_for_no_lane_governs_none() -> None:
    signed = junction_with("206", validity='<validity fromLane="0" toLane="0"/>')
    assert (signed.lanes.sign == -1).all()
    other_side = junction_with("206", orientation="+", validity="")
    assert (other_side.lanes.sign == -1).all()
    assert junction_with("206", validity="").signs[0].lanes == (other_side.lane_index(2, 0, -1),)


def test_lights_have_the_boxes_of_both_generations() -> None:
    lit = junction_with("1000001")
    (light,) = lit.lights
    (box,), (early,) = light.boxes, light.early_boxes
    assert (box.half_length, box.half_width, box.half_height) == (1.5, 0.25 * WIDTH, 1.0)
    assert box.x == pytest.approx(50.5 - 3.0)
    assert early.half_length == pytest.approx(0.45 * WIDTH)
    assert early.x == pytest.approx(50.5 - 0.45 * WIDTH)


def test_landmarks_ahead_stop_at_junctions_if_told_to() -> None:
    signed = junction_with("206")
    here = signed.waypoint((10.0, WIDTH / 2.0))
    (found,) = here.landmarks(60.0)
    assert (found.id, found.type, found.road_id) == ("77", "206", 2)
    assert found.distance == pytest.approx(40.5)
    assert found.waypoint is not None
    assert found.waypoint.s == pytest.approx(0.5)
    assert here.landmarks(40.0) == []
    assert here.landmarks(60.0, stop_at_junction=True) == []


SPEEDS = {
    '<object id="1" name="Speed_60" s="20" t="-5"/>': 60.0 / 3.6,
    '<object id="1" name="speed_60" s="20" t="-5"/>': 60.0 / 3.6,
    '<signal id="1" type="274" value="60" s="20" t="-5" orientation="-"/>': 60.0 / 3.6,
    '<signal id="1" type="274" value="60" unit="mph" s="20" t="-5" orientation="-"/>': 60.0 * 0.44704,
    '<signal id="1" type="274" value="60" unit="m/s" s="20" t="-5" orientation="-"/>': 60.0,
}


@pytest.mark.parametrize("thing", SPEEDS)
def test_a_speed_sign_holds_from_where_it_stands(thing: str) -> None:
    holder = "signals" if "signal" in thing else "objects"
    signed = town(road(behind=f"<{holder}>{thing}</{holder}>"))
    (sign,) = signed.signs
    assert (sign.kind, sign.value) == ("speed", pytest.approx(SPEEDS[thing]))
    y = WIDTH / 2.0
    found = signed.speed_limit_at([(10.0, y), (19.9, y), (20.1, y), (40.0, y), (40.0, -y), (np.nan, 0.0)])
    assert found == pytest.approx([30 / 3.6] * 2 + [SPEEDS[thing]] * 2 + [30 / 3.6, np.nan], nan_ok=True)


@pytest.mark.parametrize(("unit", "factor"), [("km/h", 1 / 3.6), ("mph", 0.44704), ("m/s", 1.0), ("", 1.0)])
def test_road_and_lane_limits_in_every_unit(unit: str, factor: float) -> None:
    kinds = f'<type s="0"><speed max="20" unit="{unit}"/></type><type s="30"><speed max="10"/></type>'
    limited = town(road(before=kinds))
    y = WIDTH / 2.0
    assert limited.speed_limit_at([(10.0, y), (40.0, y), (40.0, -y), (10.0, -y)]) == pytest.approx(
        [20 * factor, 10.0, 10.0, 20 * factor]
    )
    own = town(road(section=lanes((-1,), f'<speed sOffset="0" max="20" unit="{unit}"/>'), before=kinds))
    assert own.speed_limit_at([(40.0, y)]) == pytest.approx([20 * factor])


def test_parking_spaces_stand_in_rows() -> None:
    outline = "<outlines><outline>{}</outline></outlines>"
    corners = "".join(f'<cornerLocal u="{u}" v="{v}" z="0"/>' for u, v in ((0, 0), (5, 0), (5, 2), (0, 2)))
    on_road = "".join(f'<cornerRoad s="{s}" t="{t}" dz="0"/>' for s, t in ((1, 4), (6, 4), (6, 6), (1, 6)))
    row = '<repeat s="10" length="15" distance="5" tStart="-6" tEnd="-6"/>'
    parked = town(
        road(
            behind="<objects>"
            f'<object id="1" type="parkingSpace" s="0" t="0">{row}{outline.format(corners)}</object>'
            f'<object id="x" type="parkingSpace" s="0" t="0">{outline.format(on_road)}</object>'
            '<object id="3" name="Slot" s="30" t="5" length="5" width="2"><parkingSpace access="all"/></object>'
            "</objects>"
        )
    )
    places = [(round(slot.x, 6), round(slot.y, 6)) for slot in parked.parking]
    assert places == [(12.5, 5.0), (17.5, 5.0), (22.5, 5.0), (27.5, 5.0), (3.5, -5.0), (30.0, -5.0)]
    assert {(round(slot.length, 6), round(slot.width, 6)) for slot in parked.parking} == {(5.0, 2.0)}


def test_drivable_ground_is_what_lanes_cover() -> None:
    straight = town(road())
    area = straight.drivable_area()
    assert area.area == pytest.approx(50.0 * 2.0 * WIDTH, rel=5e-3)
    image, origin = straight.drivable_raster(0.25)
    assert image.sum() * 0.25**2 == pytest.approx(50.0 * 2.0 * WIDTH, rel=0.05)
    inside = ((np.array([(25.0, 1.0), (25.0, -3.0)]) - origin) / 0.25).astype(int)
    assert image[inside[:, 1], inside[:, 0]].tolist() == [True, True]
    assert not straight.drivable_raster(0.25, LaneType.SIDEWALK)[0].any()


def test_a_copy_on_disk_is_the_same_town(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LAVSIM_CACHE", str(tmp_path / "cache"))
    drawn = worlds.crossing()
    for name in ("first", "second"):
        (tmp_path / f"{name}.xodr").write_bytes(drawn.data)
    first, second = (load_town(name, [tmp_path]) for name in ("first", "second"))
    (copy,) = (tmp_path / "cache" / "towns").iterdir()
    assert first.digest == second.digest == drawn.digest
    for name, value in vars(first.lanes).items():
        assert np.array_equal(value, getattr(second.lanes, name)), name
        assert value.dtype == getattr(second.lanes, name).dtype
    assert (second.lights, second.signs, second.light_groups) == (first.lights, first.signs, first.light_groups)
    assert second.report == first.report
    assert [j.lanes for j in second.junctions] == [j.lanes for j in first.junctions]
    assert all(map(np.array_equal, second.crosswalks, first.crosswalks))
    assert second.waypoint((5.0, 5.0)).xyz.tolist() == first.waypoint((5.0, 5.0)).xyz.tolist()
    # Damaged copies are made anew.
    whole = copy.read_bytes()
    for number, raw in enumerate(
        (whole[:100], b"", whole[:-9], whole[:3000] + b"?" + whole[3001:], whole[:-40] + b"!" * 40)
    ):
        copy.write_bytes(raw)
        (tmp_path / f"again{number}.xodr").write_bytes(drawn.data)
        again = load_town(f"again{number}", [tmp_path])
        assert np.array_equal(again.lanes.points, first.lanes.points)
        assert copy.read_bytes() == whole


def test_a_town_loads_without_a_place_for_its_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cache").write_text("a file, not a folder")
    monkeypatch.setenv("LAVSIM_CACHE", str(tmp_path / "cache"))
    (tmp_path / "unkept.xodr").write_bytes(worlds.crossing().data)
    assert load_town("unkept", [tmp_path]).lanes.length.sum() > 0.0


def test_what_is_wrong_is_said_in_words(tmp_path: Path) -> None:
    path = tmp_path / "bad.xodr"
    jump = '<geometry s="50" x="52" y="0" hdg="0" length="10"><line/></geometry>'
    text = road(length=60.0, section=lanes((-1,)).replace("3.5", "1.5")).replace(
        'length="60.0"><line/></geometry>', f'length="50.0"><line/></geometry>{jump}'
    )
    signals = (
        '<signals><signal id="4" type="1000001" s="5" t="6" orientation="+"/><signalReference id="5" s="1"/></signals>'
    )
    path.write_text(f"<OpenDRIVE>{text.replace('</road>', signals + '<railroad/></road>')}</OpenDRIVE>")
    assert check_file(path) == [
        "Not read: 1 x <railroad> in <road>.",
        "Reference lines jump between two curves: road 1 by 2.00 m at s = 50.0.",
        "Driving lanes narrower than 2 m: -1 of road 1 (1.50 m).",
        "Driving lanes from which nothing leads on: -1 of road 1.",
        "Driving lanes that nothing leads into: -1 of road 1.",
        "Signal references name signals that are missing: 5.",
        "Traffic lights that govern no junction lane: 4.",
        "Traffic lights that no controller holds, so that each is a group of its own: 4.",
    ]
    path.write_text("<OpenDRIVE>")
    (finding,) = check_file(path)
    assert finding.startswith(f"{path}, line 1: not well-formed XML")


@pytest.mark.parametrize("name", sorted(TOWNS))
def test_nothing_is_wrong_with_a_bundled_town(name: str) -> None:
    assert check_file(Path(worlds.__file__).parents[1] / "lavsim" / "towns" / f"{name}.xodr") == []


@needs_maps
@pytest.mark.parametrize("path", sorted(itertools.chain(MAPS.glob("*.xodr"), MAPS.with_name("esmini").glob("*.xodr"))))
def test_every_sample_file_is_a_town(path: Path) -> None:
    loaded = build_town(path.stem, path.read_bytes(), path.name)
    assert np.isfinite(loaded.lanes.points).all()
    assert loaded.lanes.length.min() > 0.0
    assert not [line for line in loaded.report if "dropped" in line]
