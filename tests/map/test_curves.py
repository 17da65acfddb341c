"""The five curves, banked roads, kerbs, borders and sides of traffic."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.strategies import booleans, floats, sampled_from
from scipy.integrate import solve_ivp

from lavsim.geometry import right
from lavsim.map.curve import CubicCurve, Spiral
from lavsim.map.records import Cubic
from lavsim.map.town_map import TownMap
from tests.map.xodr import WIDTH, lanes, road, town

SHAPES = {
    "line": "<line/>",
    "arc": '<arc curvature="{k0}"/>',
    "spiral": '<spiral curvStart="{k0}" curvEnd="{k1}"/>',
    "poly3": '<poly3 a="0" b="0" c="{k0}" d="{d}"/>',
    "paramPoly3": '<paramPoly3 aU="0" bU="1" cU="0" dU="-1e-5" aV="0" bV="0" cV="{k0}" dV="{d}" pRange="arcLength"/>',
    "normalized": '<paramPoly3 aU="0" bU="40" cU="0" dU="-2" aV="0" bV="0" cV="{n}" dV="3" pRange="normalized"/>',
}


def bend(kind: str, k0: float, k1: float, ids: tuple[int, ...] = (1, -1), attributes: str = "") -> TownMap:
    shape = SHAPES[kind].format(k0=k0, k1=k1, d=(k1 - k0) / 150.0, n=k0 * 400.0)
    return town(road(length=40.0, shape=shape, section=lanes(ids), attributes=attributes, start=(3.0, -7.0, 0.4)))


@given(
    kind=sampled_from(sorted(SHAPES)),
    k0=floats(-0.03, 0.03),
    k1=floats(-0.03, 0.03),
    share=floats(0.02, 0.98),
    offset=floats(-1.7, 1.7),
    lane_id=sampled_from((1, -1)),
)
@settings(max_examples=60, deadline=None)
def test_lane_frame_round_trip_on_every_curve(
    kind: str, k0: float, k1: float, share: float, offset: float, lane_id: int
) -> None:
    bent = bend(kind, k0, k1)
    lane = bent.lane_index(1, 0, lane_id)
    u = share * float(bent.lanes.length[lane])
    x, y, _, yaw, _ = bent.centre(lane, u)[0]
    place = np.array([x, y]) + offset * right(yaw)
    hit = bent.nearest([place])
    if abs(offset) < 1.7:
        assert hit.lane[0] == lane
    assert hit.offset[0] == pytest.approx(offset, abs=2e-3)
    assert hit.u[0] == pytest.approx(u, abs=5e-3)


@given(kind=sampled_from(sorted(SHAPES)), k0=floats(-0.03, 0.03), k1=floats(-0.03, 0.03), left_hand=booleans())
@settings(max_examples=30, deadline=None)
def test_lanes_of_every_curve_are_smooth(kind: str, k0: float, k1: float, left_hand: bool) -> None:
    bent = bend(kind, k0, k1, attributes='rule="LHT"' if left_hand else "")
    for lane in range(len(bent.lanes)):
        points = bent.lanes.centre_line(lane)
        steps = np.diff(points[:, :2], axis=0)
        length = np.hypot(*steps.T)
        assert np.allclose(length, bent.lanes.step[lane], rtol=1e-3)
        assert length.sum() == pytest.approx(bent.lanes.length[lane], rel=1e-3)
        headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        middle = 0.5 * (points[1:, 3] + points[:-1, 3])
        assert np.abs(np.angle(np.exp(1j * (headings - middle)))).max() < 2e-3
        curvature = np.diff(points[:, 3]) / bent.lanes.step[lane]
        assert np.allclose(curvature, 0.5 * (points[1:, 4] + points[:-1, 4]), atol=2e-3)
        ahead = bent.lanes.lane_id[lane] < 0
        assert bent.lanes.runs_forward(lane) == (ahead != left_hand)


@given(share=floats(0.0, 1.0), distance=floats(0.1, 30.0), kind=sampled_from(sorted(SHAPES)))
@settings(max_examples=40, deadline=None)
def test_next_and_previous_are_inverse_on_every_curve(share: float, distance: float, kind: str) -> None:
    bent = bend(kind, 0.02, -0.01)
    for lane in range(2):
        here = bent.waypoint_at(lane, share * float(bent.lanes.length[lane]))
        for ahead in here.next(distance):
            (back,) = ahead.previous(distance)
            assert (back.lane, back.s) == (here.lane, pytest.approx(here.s, abs=1e-6))


@given(start=floats(-0.5, 0.5), end=floats(-0.5, 0.5), length=floats(0.5, 60.0))
@settings(max_examples=25, deadline=None)
def test_a_spiral_is_the_integral_of_its_curvature(start: float, end: float, length: float) -> None:
    def slope(s: float, state: np.ndarray) -> list[float]:
        return [np.cos(state[2]), np.sin(state[2]), start + (end - start) * s / length]

    at = np.linspace(0.0, length, 9)
    exact = solve_ivp(slope, (0.0, length), [0.0, 0.0, 0.0], t_eval=at, rtol=1e-11, atol=1e-11)
    x, y, heading, _, stretch = Spiral(start, end, length)(at)
    assert np.allclose([x, y, heading], exact.y, atol=1e-7)
    assert (stretch == 1.0).all()


def test_a_spiral_of_constant_curvature_is_an_arc() -> None:
    spiral, arc = bend("spiral", 0.05, 0.05), bend("arc", 0.05, 0.05)
    assert np.allclose(spiral.lanes.points, arc.lanes.points, atol=1e-9)


@given(c=floats(-0.02, 0.02), d=floats(-3e-4, 3e-4), ended=booleans())
@settings(max_examples=25, deadline=None)
def test_cubics_are_followed_by_arc_length(c: float, d: float, ended: bool) -> None:
    cubic = Cubic((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, c, d), 40.0, open_ended=not ended)
    curve = CubicCurve(cubic, 40.0)
    ds = np.linspace(0.0, 40.0, 801)
    x, y, heading, turning, stretch = curve(ds)
    steps = np.hypot(np.diff(x), np.diff(y))
    assert np.allclose(steps, stretch[1:] * 0.05, rtol=1e-4)
    assert np.allclose(y, c * x**2 + d * x**3, atol=1e-9)
    assert np.allclose(np.gradient(heading, ds)[2:-2], turning[2:-2], atol=1e-4)
    assert x[-1] == pytest.approx(40.0) if ended else x[-1] <= 40.0 + 1e-9


def test_a_banked_road_carries_its_lanes_up() -> None:
    profile = '<lateralProfile><superelevation s="0" a="0.1" b="0" c="0" d="0"/></lateralProfile>'
    banked = town(road(before=profile))
    left, middle = banked.lane_index(1, 0, 1), banked.lane_index(1, 0, -1)
    assert banked.centre(left, 5.0)[0, 2] == pytest.approx(WIDTH / 2.0 * np.tan(0.1))
    assert banked.centre(middle, 5.0)[0, 2] == pytest.approx(-WIDTH / 2.0 * np.tan(0.1))
    assert banked.waypoint((5.0, WIDTH / 2.0)).z == pytest.approx(-WIDTH / 2.0 * np.tan(0.1))
    level = lanes().replace('<lane id="-1" type="driving">', '<lane id="-1" type="driving" level="true">')
    assert town(road(before=profile, section=level)).centre(1, 5.0)[0, 2] == 0.0


def test_crossfall_falls_to_both_sides_and_shapes_are_interpolated() -> None:
    fall = '<lateralProfile><crossfall side="right" s="0" a="0.05" b="0" c="0" d="0"/></lateralProfile>'
    fallen = town(road(before=fall))
    assert fallen.centre([0, 1], [5.0, 5.0])[:, 2] == pytest.approx([0.0, -WIDTH / 2.0 * np.tan(0.05)])
    shape = '<shape s="{}" t="-10" a="{}" b="0" c="0" d="0"/>'
    shaped = town(road(before=f"<lateralProfile>{shape.format(0, 0)}{shape.format(50, 2)}</lateralProfile>"))
    assert shaped.centre(1, 25.0)[0, 2] == pytest.approx(1.0)


def test_kerbs_lift_their_lane() -> None:
    lifted = town(road(section=lanes((-1,), '<height sOffset="0" inner="0.1" outer="0.14"/>', "sidewalk")))
    assert lifted.lanes.points[:, 2] == pytest.approx(0.12)


def test_borders_stand_for_widths() -> None:
    section = (
        '<laneSection s="0"><right>'
        '<lane id="-1" type="driving"><border sOffset="0" a="-3" b="-0.02"/></lane>'
        '<lane id="-2" type="driving"><border sOffset="0" a="-7"/></lane></right></laneSection>'
    )
    bordered = town(road(section=section))
    assert bordered.lanes.width[bordered.lanes.rows(0)][[0, -1]] == pytest.approx([3.0, 4.0], abs=1e-6)
    assert bordered.lanes.width[bordered.lanes.rows(1)][[0, -1]] == pytest.approx([4.0, 3.0], abs=1e-6)
    assert bordered.centre(1, 0.0)[0, 1] == pytest.approx(5.0)


def test_where_traffic_keeps_left_lanes_run_the_other_way() -> None:
    marks = '<roadMark sOffset="0" type="broken" laneChange="both"/>'
    shire = town(road(section=lanes((-1, -2, 1), marks), attributes='rule="LHT"'))
    near, far, back = (shire.lane_index(1, 0, k) for k in (-1, -2, 1))
    assert np.cos(shire.centre([near, far, back], [5.0] * 3)[:, 3]) == pytest.approx([-1.0, -1.0, 1.0])
    assert (shire.lanes.s_start[near], shire.lanes.s_end[near]) == (50.0, 0.0)
    # Travelling west on the south side, the outer lane is on the left.
    assert (shire.lanes.left[near], shire.lanes.right[far]) == (far, near)
    assert shire.lanes.change_left[near]
    waypoint = shire.waypoint_at(near, 10.0)
    for beside, lane in ((waypoint.left(), far), (waypoint.right(), back)):
        assert beside is not None
        assert (beside.lane, beside.s) == (lane, pytest.approx(40.0))
    assert waypoint.next(10.0)[0].x == pytest.approx(30.0)


def test_a_direct_junction_joins_roads_without_connecting_ones() -> None:
    junction = (
        '<junction id="9" type="direct">'
        '<connection id="0" incomingRoad="1" linkedRoad="2" contactPoint="start">'
        '<laneLink from="-1" to="-1"/><laneLink from="1" to="1"/></connection>'
        '<connection id="1" incomingRoad="1" linkedRoad="3" contactPoint="start"><laneLink from="-2" to="-1"/>'
        "</connection></junction>"
    )
    into = '<link><successor elementType="junction" elementId="9"/></link>'
    out = '<link><predecessor elementType="junction" elementId="9"/></link>'
    split = town(
        road(1, section=lanes((1, -1, -2)), before=into),
        road(2, start=(50.0, 0.0, 0.0), before=out),
        road(3, start=(50.0, -WIDTH, 0.0), section=lanes((-1,)), before=out),
        junction,
    )
    pairs = {
        ((int(t.road_id[a]), int(t.lane_id[a])), (int(t.road_id[b]), int(t.lane_id[b])))
        for t in (split.lanes,)
        for a in range(len(t))
        for b in t.successors(a)
    }
    assert pairs == {((1, -1), (2, -1)), ((1, -2), (3, -1)), ((2, 1), (1, 1))}
    assert split.report == ()
