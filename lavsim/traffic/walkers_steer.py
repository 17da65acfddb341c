"""How walkers make way for each other and for what stands on the sidewalk: the best of a few headings and paces."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.portable_math import cos_sin
from lavsim.traffic.walkers_ground import Ground
from lavsim.traffic.walkers_look import Actors
from lavsim.types import ActorClass

CELL = 3.0  # [m]
HORIZON = 2.0  # [s] that a walker looks ahead
LOOK_STEP = 0.25  # [s]
MOST_NEAR = 12  # others that a walker minds
ROOM = 0.08  # [m] kept between bodies
WANTED_ROOM = 0.2  # [m] that they like to keep
BODY = 1.25  # radius of a walker, in half widths of its box: it has corners
FAST_VEHICLE = 2.0  # [m/s] vehicles above that are the road's business
STEADY = 0.5  # price of a change of velocity [s/m]: who has begun to give way goes on with it
_ANGLES = (0.0, 0.4, -0.4, 0.85, -0.85, 1.35, -1.35, 2.2, -2.2)  # [rad], to the right first
_PACES = (1.0, 0.55, 0.25)
_WALKER, _LAST_VEHICLE = int(ActorClass.WALKER), int(ActorClass.BICYCLE)


class Crowds(NamedTuple):
    """Who is where: boxes by hashed cell.

    Attributes:
        head: (buckets,) first entry, -1 for none; as many as a power of two.
        follow: (entries,) the entry after each, -1 at the end.
        row: (entries,) row of the world.
    """

    head: NDArray[np.int32]
    follow: NDArray[np.int32]
    row: NDArray[np.int32]


def make_crowds(rows: int) -> Crowds:
    """An empty table for a world of up to `rows` rows."""
    buckets = 64
    while buckets < 4 * rows:
        buckets *= 2
    return Crowds(np.zeros(buckets, np.int32), np.zeros(32 * rows, np.int32), np.zeros(32 * rows, np.int32))


@kernel
def _bucket(crowds: Crowds, cx: int, cy: int) -> int:
    return ((cx * 73856093) ^ (cy * 19349663)) & (len(crowds.head) - 1)


@kernel
def enter_all(crowds: Crowds, actors: Actors) -> None:
    """Enters every walker into its cell, and props and slow vehicles into all they cover."""
    crowds.head[:] = -1
    used = 0
    for row in range(len(actors.present)):
        if not actors.present[row]:
            continue
        reach = 0.0
        if actors.classes[row] != _WALKER:
            speed_squared = actors.velocity[row, 0] ** 2 + actors.velocity[row, 1] ** 2
            if actors.classes[row] <= _LAST_VEHICLE and speed_squared > FAST_VEHICLE**2:
                continue
            reach = 0.5 * math.sqrt(actors.sizes[row, 0] ** 2 + actors.sizes[row, 1] ** 2)
        x, y = actors.pose[row, 0], actors.pose[row, 1]
        for cy in range(math.floor((y - reach) / CELL), math.floor((y + reach) / CELL) + 1):
            for cx in range(math.floor((x - reach) / CELL), math.floor((x + reach) / CELL) + 1):
                if used == len(crowds.row):
                    return
                b = _bucket(crowds, cx, cy)
                crowds.row[used], crowds.follow[used] = row, crowds.head[b]
                crowds.head[b] = used
                used += 1


@kernel
def find_near(crowds: Crowds, actors: Actors, own: int, near: NDArray[np.int32]) -> int:
    """Fills `near` with rows within `CELL` of row `own`, ascending, each once; returns how many."""
    x, y = actors.pose[own, 0], actors.pose[own, 1]
    column, line = math.floor(x / CELL), math.floor(y / CELL)
    found = 0
    for cy in range(line - 1, line + 2):
        for cx in range(column - 1, column + 2):
            entry = crowds.head[_bucket(crowds, cx, cy)]
            while entry >= 0:
                row = crowds.row[entry]
                entry = crowds.follow[entry]
                reach = CELL
                if actors.classes[row] != _WALKER:
                    reach += 0.5 * math.sqrt(actors.sizes[row, 0] ** 2 + actors.sizes[row, 1] ** 2)
                dx, dy = actors.pose[row, 0] - x, actors.pose[row, 1] - y
                if row == own or dx * dx + dy * dy > reach * reach:
                    continue
                if abs(actors.height[row] - actors.height[own]) > 2.0:
                    continue
                found = _insert(near, found, row)
    return found


@kernel
def _insert(near: NDArray[np.int32], found: int, row: int) -> int:
    """Keeps the lowest rows in order, so that the order of the table does not matter."""
    at = found
    while at > 0 and near[at - 1] >= row:
        at -= 1
    if at < found and near[at] == row:
        return found
    if at >= len(near):
        return found
    for k in range(min(found, len(near) - 1), at, -1):
        near[k] = near[k - 1]
    near[at] = row
    return min(found + 1, len(near))


@kernel
def room(actors: Actors, own: int, other: int, x: float, y: float, t: float) -> float:
    """Room between walker `own` standing at (x, y) and row `other` as it will be in `t` [m]; negative if they meet."""
    radius = 0.5 * BODY * max(actors.sizes[own, 0], actors.sizes[own, 1])
    dx = x - actors.pose[other, 0] - actors.velocity[other, 0] * t
    dy = y - actors.pose[other, 1] - actors.velocity[other, 1] * t
    if actors.classes[other] == _WALKER:
        return math.sqrt(dx * dx + dy * dy) - radius - 0.5 * BODY * actors.sizes[other, 0]
    cos, sin = cos_sin(actors.pose[other, 2])
    ahead = max(abs(dx * cos + dy * sin) - 0.5 * actors.sizes[other, 0], 0.0)
    aside = max(abs(dy * cos - dx * sin) - 0.5 * actors.sizes[other, 1], 0.0)
    return math.sqrt(ahead * ahead + aside * aside) - radius


@kernel
def squeeze(actors: Actors, own: int, near: NDArray[np.int32], count: int, vx: float, vy: float) -> tuple[float, float]:
    """Price of going on at `vx`, `vy` for the bodies near: how soon it meets one, and how close it passes."""
    price, least = 0.0, np.inf
    x, y = actors.pose[own, 0], actors.pose[own, 1]
    for k in range(count):
        now = room(actors, own, near[k], x, y, 0.0)
        t = LOOK_STEP
        while t <= HORIZON:
            gap = room(actors, own, near[k], x + vx * t, y + vy * t, t)
            least = min(least, gap)
            if gap < ROOM and gap < now + 0.02:
                price += 6.0 * (HORIZON + 0.25 - t) + (20.0 if t < 0.6 else 0.0)
                break
            t += LOOK_STEP
    if least < WANTED_ROOM:
        price += 0.8 * (WANTED_ROOM - max(least, 0.0))
    return price, least


@kernel
def off_ground(ground: Ground, number: int, x: float, y: float, u: float) -> float:
    """How far (x, y), near `u` on an edge, is off the ground that belongs to it [m]."""
    edge = ground.edge[number]
    at = min(max(u, 0.0), edge.length)
    for _ in range(2):
        p = min(edge.first + int(at / edge.step + 0.5), edge.last)
        cos, sin = ground.points[p, 3], ground.points[p, 4]
        dx, dy = x - ground.points[p, 0], y - ground.points[p, 1]
        along = (p - edge.first) * edge.step + dx * cos + dy * sin
        at = min(max(along, 0.0), edge.length)
    aside = dy * cos - dx * sin
    over = max(ground.points[p, 5] - aside, aside - ground.points[p, 6], 0.0)
    return over + max(-along, along - edge.length, 0.0)


@kernel
def make_way(
    ground: Ground,
    actors: Actors,
    own: int,
    near: NDArray[np.int32],
    count: int,
    ways: tuple[int, float, int, float],
    wish: tuple[float, float],
) -> tuple[float, float]:
    """The velocity that comes nearest to `wish` [m/s] and runs into nobody.

    Args:
        ground: The town.
        actors: All that is there.
        own: Row of the walker.
        near: Rows that it minds, the first `count` of them.
        ways: Its edge and place on it [m], the next edge and the place where that begins [m].
        wish: x, y.
    """
    vx, vy = wish
    price, _ = squeeze(actors, own, near, count, vx, vy)
    if price == 0.0:
        return wish
    swerve = (vx - actors.velocity[own, 0]) ** 2 + (vy - actors.velocity[own, 1]) ** 2
    best = price + STEADY * math.sqrt(swerve)
    x, y = actors.pose[own, 0], actors.pose[own, 1]
    pace = math.sqrt(vx * vx + vy * vy)
    chosen_x, chosen_y = vx, vy
    for a in range(len(_ANGLES)):
        cos, sin = cos_sin(_ANGLES[a])
        for p in range(len(_PACES)):
            cx, cy = (wish[0] * cos - wish[1] * sin) * _PACES[p], (wish[0] * sin + wish[1] * cos) * _PACES[p]
            cost = (1.6 if _ANGLES[a] > 0.0 else 1.9) * abs(_ANGLES[a]) * _PACES[p] + 2.2 * (1.0 - _PACES[p])
            swerve = (cx - actors.velocity[own, 0]) ** 2 + (cy - actors.velocity[own, 1]) ** 2
            cost += STEADY * math.sqrt(swerve)
            if cost >= best:
                continue
            for step in range(1, 3):
                t = 0.5 * step
                over = off_ground(ground, ways[0], x + cx * t, y + cy * t, ways[1])
                if over > 0.03:
                    over = min(over, off_ground(ground, ways[2], x + cx * t, y + cy * t, ways[3]))
                if over > 0.03:
                    cost += 3.0 + 20.0 * over
            if cost < best:
                cost += squeeze(actors, own, near, count, cx, cy)[0]
            if cost < best:
                best, chosen_x, chosen_y = cost, cx, cy
    still = 2.6 + squeeze(actors, own, near, count, 0.0, 0.0)[0]
    if still < best and pace > 0.0:
        return 0.0, 0.0
    return chosen_x, chosen_y
