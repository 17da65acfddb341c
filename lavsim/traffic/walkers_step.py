"""The kernel that moves background walkers: along the footways, round each other, and across roads after a look."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.kernel_draws import draw_base, unit_at
from lavsim.map.footways import FootwayKind
from lavsim.traffic.walkers_ground import Ground
from lavsim.traffic.walkers_look import (
    DANGER_TIME,
    TIME_MARGIN,
    Actors,
    Signals,
    may_cross,
    time_to_hit,
    watch,
)
from lavsim.traffic.walkers_steer import MOST_NEAR, Crowds, enter_all, find_near, make_way
from lavsim.types import ActorClass
from lavsim.world.motion import DRIVEN, WALKING

CROSSING_PACE = 1.2  # of who crosses, in its usual speeds
FASTEST = 3.2  # [m/s] of who hurries out of a vehicle's way
HURRY = 1.8  # the same, in speeds
CROSSING_SHARE, JAYWALK_SHARE = 0.6, 0.35  # of a way across in the draw between ways; a sidewalk has 1
CAPTURE = 0.7  # [m] before the end of an edge at which the next one begins to count
ABREAST = 0.35  # [m] before the point on the next edge that it heads for a walker is on that edge, in sharp turns
LOOK_AHEAD, LOOK_TIME = 0.7, 0.5  # [m], [s] to the point that a walker heads for
AT_KERB = 0.5  # [m] from the kerb at which one waits
OFF_KERB = 0.3  # [m] beyond it one is on the road
JAYWALK_MARGIN = 1.0  # [s] more than at a crosswalk
DECIDE_EVERY = 2  # ticks; half of the walkers decide in each
LOOK_EVERY = 4  # ticks
MOST_CHANGE = 0.6  # [m/s] of velocity from one decision to the next: 6 m/s²
ALONE_TICKS = 4  # who had nobody within some metres looks round again after so long
MOST_BLOCKED, BLOCKED_SPREAD = 25, 20  # decisions: after 2.5 to 4.5 s without a way through one turns round

WALKER = np.dtype(
    [("key", "u8"), ("row", "i8"), ("hops", "i8"), ("since", "i8"), ("patience", "i8"), ("pause", "i8"),
     ("blocked", "i8"), ("alone", "i8"), ("edge", "i4"), ("next", "i4"), ("forward", "i4"), ("next_forward", "i4"),
     ("crossing", "i4"), ("jaywalks", "i4"), ("arrived", "i4"), ("blocker", "i4"), ("u", "f8"), ("speed", "f8"),
     ("share", "f8")]
)  # fmt: skip
"""One background walker.

`key` and `hops` choose its ways; `row` in the world; `since` the tick at which it came to a kerb, -1; `patience` and
`pause` there [ticks]; `blocked` for how many decisions it found no way; it is `alone` until that tick; `edge`, place
`u` on it [m] and whether it is walked `forward`; the `next` edge and its direction; whether it is `crossing` a road;
whether it `jaywalks`; whether it has `arrived` on the next edge; row of the vehicle that is its `blocker` at a kerb,
-1; `speed` [m/s]; the `share` of the room to its right that it keeps to.
"""

_SIDEWALK, _CROSSING, _JAYWALK = int(FootwayKind.SIDEWALK), int(FootwayKind.CROSSING), int(FootwayKind.JAYWALK)
_LAST_VEHICLE = int(ActorClass.BICYCLE)


@kernel
def draw_next(ground: Ground, walkers: NDArray[np.void], i: int) -> None:
    """Draws where walker `i` goes from the end of its edge; back where there is no other way."""
    own = walkers[i].edge
    forward = walkers[i].forward
    node = ground.edge[own].b if forward else ground.edge[own].a
    total = 0.0
    for k in range(ground.node_first[node], ground.node_first[node + 1]):
        total += _weight(ground, walkers, i, ground.node_edge[k])
    walkers[i].next, walkers[i].next_forward = own, 1 - forward
    if total == 0.0:
        return
    drawn = unit_at(draw_base(walkers[i].key, walkers[i].hops), 0) * total
    walkers[i].hops += 1
    for k in range(ground.node_first[node], ground.node_first[node + 1]):
        edge = ground.node_edge[k]
        weight = _weight(ground, walkers, i, edge)
        if weight > 0.0:
            walkers[i].next, walkers[i].next_forward = edge, 1 if ground.edge[edge].a == node else 0
            drawn -= weight
            if drawn < 0.0:
                return


@kernel
def _weight(ground: Ground, walkers: NDArray[np.void], i: int, edge: int) -> float:
    if edge == walkers[i].edge:
        return 0.0
    kind = ground.edge[edge].kind
    if kind == _JAYWALK:
        return JAYWALK_SHARE if walkers[i].jaywalks else 0.0
    return CROSSING_SHARE if kind == _CROSSING else 1.0


@kernel
def _along(ground: Ground, number: int, u: float, x: float, y: float) -> float:
    """Place on an edge nearest to (x, y), searched from `u` [m]."""
    edge = ground.edge[number]
    p = min(edge.first + int(u / edge.step + 0.5), edge.last)
    ahead = (x - ground.points[p, 0]) * ground.points[p, 3] + (y - ground.points[p, 1]) * ground.points[p, 4]
    return min(max((p - edge.first) * edge.step + ahead, 0.0), edge.length)


@kernel
def _done(ground: Ground, walkers: NDArray[np.void], i: int) -> float:
    """How far walker `i` has come on its edge [m]."""
    w = walkers[i]
    return w.u if w.forward else ground.edge[w.edge].length - w.u


@kernel
def _kerbs(ground: Ground, number: int, forward: int) -> tuple[float, float]:
    """Where the road begins and ends on an edge that is walked `forward` or back [m]."""
    edge = ground.edge[number]
    if forward:
        return edge.near_kerb, edge.far_kerb
    return edge.length - edge.far_kerb, edge.length - edge.near_kerb


@kernel
def _advance(ground: Ground, walkers: NDArray[np.void], i: int, x: float, y: float) -> None:
    """Finds walker `i` on its way."""
    for _ in range(3):
        w = walkers[i]
        w.u = _along(ground, w.edge, w.u, x, y)
        length = ground.edge[w.edge].length
        if not w.arrived and length - _done(ground, walkers, i) > min(CAPTURE, 0.5 * length):
            return
        w.edge, w.forward = w.next, w.next_forward
        w.u = 0.0 if w.forward else ground.edge[w.edge].length
        w.crossing = w.arrived = 0
        w.since = -1
        draw_next(ground, walkers, i)


@kernel
def _turn_round(ground: Ground, walkers: NDArray[np.void], i: int) -> None:
    walkers[i].forward = 1 - walkers[i].forward
    walkers[i].since = -1
    walkers[i].blocked = walkers[i].arrived = 0
    draw_next(ground, walkers, i)


@kernel
def _aim(ground: Ground, walkers: NDArray[np.void], i: int, ahead: float) -> tuple[float, float, bool]:
    """The point that walker `i` heads for and whether it is on the next edge; not beyond a kerb at which one looks."""
    w = walkers[i]
    number, forward = w.edge, w.forward
    place = _done(ground, walkers, i) + ahead
    waits = ground.edge[number].kind != _SIDEWALK and not w.crossing
    length = ground.edge[number].length
    if waits:
        low, _ = _kerbs(ground, number, forward)
        if place - ahead < low + OFF_KERB:
            place = min(place, low)
    leads_on = place > length
    if leads_on:
        number, forward, place = w.next, w.next_forward, place - length
        length = ground.edge[number].length
        if ground.edge[number].kind != _SIDEWALK:
            place = min(place, _kerbs(ground, number, forward)[0])
    edge = ground.edge[number]
    at = min(max(place if forward else length - place, 0.0), length) / edge.step
    p = min(edge.first + int(at), edge.last - 1)
    part = at - (p - edge.first)
    cos = ground.points[p, 3] + (ground.points[p + 1, 3] - ground.points[p, 3]) * part
    sin = ground.points[p, 4] + (ground.points[p + 1, 4] - ground.points[p, 4]) * part
    q = min(edge.first + int(at + 0.5), edge.last)
    low, high = ground.points[q, 5], ground.points[q, 6]
    aside = min(max(w.share * (high if forward else low), low), high)
    x = ground.points[p, 0] + (ground.points[p + 1, 0] - ground.points[p, 0]) * part
    y = ground.points[p, 1] + (ground.points[p + 1, 1] - ground.points[p, 1]) * part
    return x - aside * sin, y + aside * cos, leads_on


@kernel
def _look(
    ground: Ground,
    walkers: NDArray[np.void],
    i: int,
    actors: Actors,
    movers: NDArray[np.int32],
    moving: int,
    signals: Signals,
    tick: int,
) -> None:
    """What walker `i` does about the road that its edge leads over: waits, sets out, gives up, or has got across."""
    w = walkers[i]
    done = _done(ground, walkers, i)
    low, high = _kerbs(ground, w.edge, w.forward)
    if done >= high:
        w.crossing = 0
    elif done >= low + OFF_KERB:
        w.crossing = 1
    elif not w.crossing and done > low - AT_KERB:
        if w.since < 0:
            w.since = tick
            w.blocker = -1
        waited = tick - w.since
        if waited > w.patience:
            _turn_round(ground, walkers, i)
        elif waited >= w.pause and _is_its_turn(w.key, tick, LOOK_EVERY):
            margin = TIME_MARGIN + (JAYWALK_MARGIN if ground.edge[w.edge].kind == _JAYWALK else 0.0)
            place = (w.edge, w.forward == 1, done)
            pace = CROSSING_PACE * w.speed
            free, blocker = may_cross(ground, actors, movers, moving, signals, tick, place, pace, margin, w.blocker)
            w.blocker = blocker
            if free:
                w.crossing = 1
                w.since = -1


@kernel
def _wish(ground: Ground, walkers: NDArray[np.void], i: int, x: float, y: float) -> tuple[float, float]:
    """The velocity of walker `i` if nobody were in its way [m/s]."""
    w = walkers[i]
    pace = w.speed * (CROSSING_PACE if w.crossing else 1.0)
    ax, ay, leads_on = _aim(ground, walkers, i, LOOK_AHEAD + LOOK_TIME * pace)
    dx, dy = ax - x, ay - y
    gap = math.sqrt(dx * dx + dy * dy)
    if leads_on:
        edge = ground.edge[w.edge]
        p = min(edge.first + int(w.u / edge.step + 0.5), edge.last)
        before = (dx * ground.points[p, 3] + dy * ground.points[p, 4]) * (1.0 if w.forward else -1.0)
        w.arrived = 1 if before < ABREAST else 0
    if gap < 0.05:
        return 0.0, 0.0
    pace = min(pace, gap / 0.4)
    return dx / gap * pace, dy / gap * pace


@kernel
def _flee(
    actors: Actors, movers: NDArray[np.int32], moving: int, row: int, wish: tuple[float, float]
) -> tuple[float, float]:
    """On the road: goes on, hurries or stops, whatever keeps clear of a vehicle that comes for longest."""
    latest = time_to_hit(actors, movers, moving, row, wish[0], wish[1])
    if latest >= DANGER_TIME:
        return wish
    pace = max(math.sqrt(wish[0] ** 2 + wish[1] ** 2), 0.1)
    factor = max(min(HURRY, FASTEST / pace), 1.0)
    chosen = wish
    for other in ((wish[0] * factor, wish[1] * factor), (0.0, 0.0)):
        time = time_to_hit(actors, movers, moving, row, other[0], other[1])
        if time > latest:
            latest, chosen = time, other
    return chosen


@kernel
def _find_movers(actors: Actors, movers: NDArray[np.int32]) -> int:
    count = 0
    for row in range(len(actors.present)):
        if actors.present[row] and actors.classes[row] <= _LAST_VEHICLE and actors.motion[row] == DRIVEN:
            movers[count] = row
            count += 1
    return count


@kernel
def _height(ground: Ground, walkers: NDArray[np.void], i: int) -> float:
    """z of the ground under walker `i` [m]."""
    edge = ground.edge[walkers[i].edge]
    at = walkers[i].u / edge.step
    p = min(edge.first + int(at), edge.last - 1)
    part = at - (p - edge.first)
    return ground.points[p, 2] + (ground.points[p + 1, 2] - ground.points[p, 2]) * part


@kernel
def _is_its_turn(key: np.uint64, tick: int, every: int) -> bool:
    """Whether the walker with this key has its turn, one tick in `every`."""
    return (np.uint64(tick) + key) % np.uint64(every) == 0


@kernel
def _ease(before: float, after: float) -> float:
    return before + min(max(after - before, -MOST_CHANGE), MOST_CHANGE)


@kernel
def walk(
    ground: Ground,
    walkers: NDArray[np.void],
    crowds: Crowds,
    actors: Actors,
    signals: Signals,
    movers: NDArray[np.int32],
    tick: int,
    command: NDArray[np.float64],
) -> None:
    """One tick of all background walkers: sets their velocity in `command` (N, 2) [m/s] and their height.

    Args:
        ground: The town.
        walkers: (W,) `WALKER` records; whoever does not walk in the world is left alone.
        crowds: Scratch; filled anew.
        actors: All rows of the world.
        signals: The traffic lights and what was seen of them.
        movers: (N,) scratch.
        tick: Now.
        command: Of all rows of the world.
    """
    watch(signals, tick)
    enter_all(crowds, actors)
    moving = _find_movers(actors, movers)
    near = np.empty(MOST_NEAR, np.int32)
    for i in range(len(walkers)):
        row = walkers[i].row
        if not _is_its_turn(walkers[i].key, tick, DECIDE_EVERY):
            continue
        if not actors.present[row] or actors.motion[row] != WALKING:
            continue
        x, y = actors.pose[row, 0], actors.pose[row, 1]
        _advance(ground, walkers, i, x, y)
        actors.height[row] = _height(ground, walkers, i)
        if ground.edge[walkers[i].edge].kind != _SIDEWALK:
            _look(ground, walkers, i, actors, movers, moving, signals, tick)
        wish = _wish(ground, walkers, i, x, y)
        pace = math.sqrt(wish[0] ** 2 + wish[1] ** 2)
        vx, vy = wish
        if pace > 0.0:
            if walkers[i].crossing:
                vx, vy = _flee(actors, movers, moving, row, wish)
            count = 0
            if tick >= walkers[i].alone:
                count = find_near(crowds, actors, row, near)
                walkers[i].alone = tick + (ALONE_TICKS if count == 0 else 0)
            if count > 0 and (vx != 0.0 or vy != 0.0):
                w = walkers[i]
                begin = 0.0 if w.next_forward else ground.edge[w.next].length
                vx, vy = make_way(ground, actors, row, near, count, (w.edge, w.u, w.next, begin), (vx, vy))
            _be_patient(ground, walkers, i, pace, math.sqrt(vx * vx + vy * vy))
        command[row, 0] = _ease(command[row, 0], vx)
        command[row, 1] = _ease(command[row, 1], vy)


@kernel
def _be_patient(ground: Ground, walkers: NDArray[np.void], i: int, wished: float, chosen: float) -> None:
    """Counts how long walker `i` has found no way through; turns it round in the end."""
    w = walkers[i]
    if wished > 0.4 and chosen < 0.3 * wished:
        w.blocked += 1
        if w.blocked > MOST_BLOCKED + int(w.key % np.uint64(BLOCKED_SPREAD)):
            _turn_round(ground, walkers, i)
    else:
        w.blocked = max(w.blocked - 1, 0)
