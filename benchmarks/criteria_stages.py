"""For each criterion two moments on the towns' streets: one that it spares, one at which it fires."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.criteria_places import (
    AMBULANCE,
    BEFORE,
    CAR,
    NOSE,
    VAN,
    WRECK,
    Mark,
    Panel,
    Stage,
    Street,
    at_light,
    at_stop_sign,
    street,
    turning,
)  # fmt: skip
from lavsim.geometry import forward, right
from lavsim.types import DT, ActorIds, LightState
from lavsim.world.snapshot import HAZARD_EMERGENCY_TEST, HAZARD_OWNS_TIMER, Snapshot


def _standing(moment: Snapshot, seconds: float) -> list[Snapshot]:
    """The same for so long, one tick more than whole ticks fill."""
    return [moment] * (round(seconds / DT) + 1)


def _cross(at: NDArray[np.float64], half: float = 1.0) -> list[Mark]:
    corners = np.array([[-1.0, -1.0], [1.0, 1.0]]) * half + at[:2], np.array([[-1.0, 1.0], [1.0, -1.0]]) * half + at[:2]
    return [("red", corners[0], False), ("red", corners[1], False)]


def _line(street: Street, aside: float, colour: str) -> Mark:
    """Along a street, `aside` metres to the right of the route."""
    return colour, np.array([street.place(s, aside)[0][:2] for s in np.arange(0.0, street.route.length, 1.0)]), False


def completion() -> Stage:
    here, length = street(), street().route.length
    goal: Mark = ("violet", np.array([here.place(length, aside)[0][:2] for aside in (-1.75, 1.75)]), False)
    runs = here.drive(0.0, length - 4.0), here.drive(0.0, length + 2.0)
    return Stage("1.0", (
        Panel("98 % of the route: goes on", here, runs[0], False, marks=lambda _: [goal]),
        Panel("the target is reached", here, runs[1], True, marks=lambda _: [goal]),
    ))  # fmt: skip


def collision() -> Stage:
    here = street()
    car = here.body(CAR, 60.0)
    gap = 60.0 - CAR.size[0] / 2.0 - NOSE
    rear = here.place(60.0 - CAR.size[0] / 2.0)[0]
    near, hit = here.drive(40.0, gap - 0.5, others=[car]), here.moment(gap, others=[car], touches=[car])
    return Stage("1.0", (
        Panel("half a metre: no contact", here, near, False),
        Panel("a contact with a vehicle", here, [*near, hit], True, marks=lambda _: _cross(rear)),
    ), 22.0)  # fmt: skip


def _tail(snapshot: Snapshot) -> list[Mark]:
    """The stretch behind the ego's rear that red lights of the originals are judged by."""
    ego = snapshot.ego
    return [("yellow", np.array([ego.xy - forward(ego.yaw) * reach for reach in (0.8 * NOSE, NOSE + 1.0)]), False)]


def red_light() -> Stage:
    here = at_light()
    over = here.moment(BEFORE - NOSE + 2.0, speed=0.0, state=LightState.RED)
    run = here.drive(BEFORE - 8.0, BEFORE + 8.0, state=LightState.RED)
    return Stage("1.0", (
        Panel("stands, only its nose over", here, _standing(over, 1.0), False, marks=_tail),
        Panel("its rear crosses at red", here, run, True, marks=_tail),
    ), 26.0)  # fmt: skip


def corrected_red_light() -> Stage:
    here = at_light()
    late = here.drive(BEFORE - 8.0, BEFORE + 0.6, state=LightState.YELLOW)
    late += here.drive(BEFORE + 0.6, BEFORE + 2.0, state=LightState.RED)
    run = here.drive(BEFORE - 8.0, BEFORE + 8.0, state=LightState.RED)

    def middle(snapshot: Snapshot) -> list[Mark]:
        return _cross(snapshot.ego.xy, 0.6)

    return Stage("corrected", (
        Panel("red once its middle was over", here, late, False, marks=middle),
        Panel("its middle crosses at red", here, run, True, marks=middle),
    ), 26.0)  # fmt: skip


def _box(snapshot: Snapshot) -> list[Mark]:
    """The trigger box of the stop sign, as it lies on its road."""
    sign = at_stop_sign().sign
    assert sign is not None
    x, y, yaw, half_length, half_width = sign.trigger
    along, aside = forward(yaw) * half_length, right(yaw) * half_width
    corners = [np.array([x, y]) + a * along + b * aside for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    return [("red", np.array(corners), True)]


def _past_the_sign(rest: float | None) -> list[Snapshot]:
    """Through the box, with a stop of half a second where the ego's middle is `rest` metres before the box's."""
    here = at_stop_sign()
    if rest is None:
        return here.drive(BEFORE - 20.0, BEFORE + 12.0, 4.0)
    place = BEFORE - rest
    stop = _standing(here.moment(place, speed=0.0), 0.5)
    return [*here.drive(BEFORE - 20.0, place, 4.0), *stop, *here.drive(place, BEFORE + 12.0, 4.0)]


def _stopped(says: str, rest: float) -> Panel:
    shown = round((20.0 - rest) / (4.0 * DT)) + 5  # a tick at rest
    return Panel(says, at_stop_sign(), _past_the_sign(rest), False, marks=_box, shown=shown)


def stop_sign() -> Stage:
    here = at_stop_sign()
    return Stage("2.0", (
        _stopped("came to rest, its nose in the box", 3.0),
        Panel("rolled through at 4 m/s", here, _past_the_sign(None), True, marks=_box),
    ), 26.0)  # fmt: skip


def corrected_stop_sign() -> Stage:
    here = at_stop_sign()
    far = _cross(here.place(BEFORE - 14.0)[0])
    return Stage("corrected", (
        _stopped("came to rest at the line", 7.5),
        Panel("only 14 m before it (cross)", here, _past_the_sign(14.0), True, marks=lambda now: [*_box(now), *far]),
    ), 40.0, 0.35)  # fmt: skip


def outside_route_lanes() -> Stage:
    here = street()
    limit = 1.75 + 1.3
    edge = _line(here, limit, "red")
    inside, outside = ([*here.drive(0.0, 40.0), *here.drive(40.0, 60.0, aside=limit + more)] for more in (-0.15, 0.3))
    return Stage("1.0", (
        Panel("its middle within 1.3 m of the lane", here, inside, False, marks=lambda _: [edge]),
        Panel("farther off its lane", here, outside, True, marks=lambda _: [edge]),
    ), 22.0)  # fmt: skip


def corrected_lanes() -> Stage:
    here = street()
    return Stage("corrected", (
        Panel("in its own lane", here, here.drive(20.0, 60.0), False),
        Panel("against traffic from the start", here, here.drive(20.0, 60.0, aside=-3.5), True),
    ))  # fmt: skip


def _speeds(snapshot: Snapshot) -> list[Mark]:
    """A second's way of everybody."""
    ends = snapshot.xy + forward(snapshot.yaw) * snapshot.speeds[:, None]
    return [("yellow", np.array([start, end]), False) for start, end in zip(snapshot.xy, ends, strict=True)]


def min_speed() -> Stage:
    here, quarter = street(), street().route.length / 4.0 + 2.0

    def along(speed: float) -> list[Snapshot]:
        moments = []
        for ahead in np.arange(0.0, quarter, speed * DT):
            ids, places = range(ActorIds.TRAFFIC, ActorIds.TRAFFIC + 3), ((13.0, 0.0), (9.0, -3.5), (-6.0, -3.5))
            cars = [
                here.body(replace(CAR, id=k), ahead + at, aside, math.pi if aside else 0.0, speed=9.0)
                for k, (at, aside) in zip(ids, places, strict=True)
            ]
            moments.append(here.moment(float(ahead), speed=speed, others=cars))
        return moments

    return Stage("2.0", (
        Panel("9 m/s, as traffic", here, along(9.0), False, marks=_speeds),
        Panel("4 m/s on a quarter of the route", here, along(4.0), True, marks=_speeds),
    ), 44.0)  # fmt: skip


def yield_emergency() -> Stage:
    here = at_light()

    def followed(ahead: float, aside: float) -> list[Snapshot]:
        other = here.body(AMBULANCE, 25.0 + ahead, aside, speed=14.0)
        during = [here.moment(25.0, others=[other], hazard=HAZARD_EMERGENCY_TEST)] * 3
        return [*during, here.moment(25.0, others=[other])]

    return Stage("2.0", (
        Panel("it was let past", here, followed(9.0, -3.5), False),
        Panel("over, and it is still behind", here, followed(-9.0, 0.0), True),
    ))  # fmt: skip


def scenario_timeout() -> Stage:
    here = street()
    wreck = here.body(WRECK, 68.0, turn=0.5)
    stands = here.moment(60.0, speed=0.0, others=[wreck], hazard=HAZARD_OWNS_TIMER)
    passes = here.drive(62.0, 74.0, aside=-3.5, others=[wreck], hazard=HAZARD_OWNS_TIMER)
    return Stage("2.0", (
        Panel("got past it after 235 s", here, [*_standing(stands, 235.0), *passes], False),
        Panel("active for 240 s", here, _standing(stands, 240.0), True),
    ))  # fmt: skip


def route_deviation() -> Stage:
    route, off = at_light().route, turning()

    def nearest(snapshot: Snapshot) -> list[Mark]:
        point = route.xy[np.hypot(*(route.xy - snapshot.ego.xy).T).argmin()]
        return [("red", np.array([snapshot.ego.xy, point]), False)]

    def turned(last: float) -> list[Snapshot]:
        return [replace(s, lights=at_light().lights(LightState.GREEN)) for s in off.drive(0.0, last)]

    return Stage("1.0", (
        Panel("less than 30 m off: goes on", replace(off, route=route), turned(BEFORE + 30.0), False, marks=nearest),
        Panel("30 m off: ends the drive", replace(off, route=route), turned(BEFORE + 58.0), True, marks=nearest),
    ), 80.0, 0.35)  # fmt: skip


def route_timeout() -> Stage:
    here = street()
    seconds = float(int(0.8 * here.route.length + 5.0))
    stands = here.moment(60.0, speed=0.0, others=[here.body(CAR, 68.0)])
    late = [*_standing(stands, 200.0), *here.drive(60.0, 75.0)]
    return Stage("1.0", (
        Panel(f"goes on after 200 of {seconds:.0f} s", here, late, False),
        Panel(f"stands after {seconds:.0f} s: ends the drive", here, _standing(stands, seconds + DT), True),
    ))  # fmt: skip


def blocked() -> Stage:
    here, van = street(), street().body(VAN, 68.0)
    stands, on = (here.moment(place, speed=0.0, others=[van]) for place in (58.0, 62.0))
    moves = here.drive(58.0, 62.0, 1.0, others=[van])
    return Stage("1.0", (
        Panel("rolls on after 170 of 180 s", here, [*_standing(stands, 170.0), *moves, *_standing(on, 170.0)], False),
        Panel("stood for 180 s: ends the drive", here, _standing(stands, 180.0 + DT), True),
    ))  # fmt: skip


def corrected_blocked() -> Stage:
    here = at_light()
    waits, sleeps = (here.moment(BEFORE - 5.0, speed=0.0, state=state) for state in (LightState.RED, LightState.GREEN))
    return Stage("corrected", (
        Panel("200 s at a red light", here, _standing(waits, 200.0), False),
        Panel("180 s at a green one", here, _standing(sleeps, 180.0 + DT), True),
    ))  # fmt: skip


def corrected_collision() -> Stage:
    here = street()
    gap = CAR.size[0] / 2.0 + NOSE
    pushed = []
    for at in np.arange(40.0, 56.0, 2.0 * DT):
        car = here.body(CAR, float(at) + gap, speed=2.0)
        pushed.append(here.moment(float(at), speed=2.0, others=[car], touches=[car]))
    last, other = (
        pushed[-1],
        here.body(replace(CAR, id=ActorIds.TRAFFIC + 1, colour=(40, 120, 60)), 56.0 + gap, -2.6, 0.35),
    )
    both = here.moment(56.0, speed=2.0, others=[here.body(CAR, 56.0 + gap), other], touches=[other])
    marks = _cross(here.place(56.0 + NOSE, -1.0)[0])
    return Stage("corrected", (
        Panel("pushed for 8 s: counted once", here, [*pushed, last], False, earlier=1),
        Panel("another one right beside", here, [*pushed, both], True, earlier=1, marks=lambda _: marks),
    ), 22.0)  # fmt: skip


STAGES: dict[str, Callable[[], Stage]] = {
    made.__name__: made
    for made in (
        completion, collision, red_light, stop_sign, outside_route_lanes, min_speed, yield_emergency, scenario_timeout,
        route_deviation, route_timeout, blocked, corrected_collision, corrected_red_light, corrected_stop_sign,
        corrected_lanes, corrected_blocked,
    )
}  # fmt: skip
