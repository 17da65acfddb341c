"""Contacts between bodies: pymunk's door, read and written in bulk through `pymunk.batch`.

The World says where every body would go in a tick; the engine moves those that may touch something and resolves what
touches on the way. A body that touched nothing keeps the World's own numbers, so driving without contact never depends
on the engine. Only bodies near a possible contact are in its space, and only walls near those.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from lavsim.types import DT
from lavsim.world.broadphase import BODY_BAND, LEVEL_GAP, Walls, walls_near
from lavsim.world.motion import WALKING

_STATE_FIELDS = (
    pymunk.batch.BodyFields.POSITION
    | pymunk.batch.BodyFields.ANGLE
    | pymunk.batch.BodyFields.VELOCITY
    | pymunk.batch.BodyFields.ANGULAR_VELOCITY
)
_CONTACT_FIELDS = (
    pymunk.batch.ArbiterFields.BODY_A_ID
    | pymunk.batch.ArbiterFields.BODY_B_ID
    | pymunk.batch.ArbiterFields.TOTAL_IMPULSE
    | pymunk.batch.ArbiterFields.POINT_A_1
)
_FRICTION = 0.4  # metal on metal
_ELASTICITY = 0.1  # of each body; the product of two, 0.01, is what bounces back: cars crumple
_SLOP = 0.01  # [m] overlap that is left alone
_SUBSTEPS = 8  # at 30 m/s 0.19 m each: nothing passes through anything. Always as many: the engine starts from the
# impulses of the step before, and a step of another length would scale them
_SETTLED = 2e-4  # [m], [rad] a tick: what moves less than that has come to rest
_LEAST_IMPULSE = 1.0  # [N s] that makes a contact worth telling
_WALL_MARGIN = 2.5  # [m] a pushed body may go in a tick and more

_STANDS, _WALKS, _WALL = 1, 2, 4  # collision categories
_FILTERS = {
    _STANDS: pymunk.ShapeFilter(categories=_STANDS),
    # Walkers on their feet make room for each other and keep off walls.
    _WALKS: pymunk.ShapeFilter(categories=_WALKS, mask=pymunk.ShapeFilter.ALL_MASKS() ^ (_WALKS | _WALL)),
    _WALL: pymunk.ShapeFilter(categories=_WALL),
}


class Contacts(NamedTuple):
    """Pairs that touched in a tick, in order of their rows.

    Attributes:
        rows: (C, 2) rows of both bodies, -1 for the static world; the lower row first.
        impulse: (C,) over the tick [N s].
        point: (C, 2) where they first touched, in the world [m].
    """

    rows: NDArray[np.int64]
    impulse: NDArray[np.float64]
    point: NDArray[np.float64]


NO_CONTACTS = Contacts(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros((0, 2)))


class Bodies(NamedTuple):
    """What the engine has to know about the rows of the world.

    Attributes:
        motion: (N,) as in `lavsim.world.motion.integrate`.
        pose: (N, 3) x, y, yaw before the tick.
        move: (N, 3) displacement and turn the World wants.
        velocity: (N, 3) vx, vy, yaw rate after the tick.
        half: (N, 2) half length, half width [m].
        mass: (N,) [kg]; infinite for what nobody pushes.
        height: (N,) z of the ground below [m].
    """

    motion: NDArray[np.uint8]
    pose: NDArray[np.float64]
    move: NDArray[np.float64]
    velocity: NDArray[np.float64]
    half: NDArray[np.float64]
    mass: NDArray[np.float64]
    height: NDArray[np.float64]


class Physics:
    """The engine's space with the bodies that may be in contact now.

    Args:
        walls: Convex polygons that nothing moves.
        has_levels: Whether roads pass over each other: bodies more than `LEVEL_GAP` apart in z then don't meet.
    """

    def __init__(self, walls: Walls, has_levels: bool = False) -> None:
        self._space = pymunk.Space()
        self._space.iterations = 12
        self._space.collision_slop = _SLOP
        self._space.collision_persistence = 1  # a pair is listed only in ticks in which it touches
        self._walls = walls
        self._has_wall = np.zeros(len(walls.sides), dtype=bool)
        self._awake: dict[int, tuple[pymunk.Body, bool]] = {}
        self._row_of_body: dict[int, int] = {}
        self._wall_of: dict[pymunk.Shape, int] = {}
        self._height = np.zeros(0)
        self._has_levels = has_levels
        if has_levels:
            self._space.on_collision(begin=self._part_levels)

    def step(
        self, rows: NDArray[np.int64], unsettled: NDArray[np.int64], bodies: Bodies
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Contacts]:
        """Moves `rows` by one tick; `bodies.pose` and `bodies.velocity` of those that touched something are updated.

        Args:
            rows: Who may touch something, ascending; all others are left out of the engine.
            unsettled: Those of them that the engine pushes apart from the last tick.
            bodies: All rows of the world; `pose` is already after the tick.

        Returns:
            Rows whose pose and velocity the engine decided, those of them still moving, and the contacts of the tick.
        """
        self._height = bodies.height
        self._keep_awake(rows, bodies)
        order = self._space_order()
        before = bodies.pose[order] - bodies.move[order]
        state = np.concatenate([before, bodies.move[order] / DT], axis=1)
        state[order < 0] = 0.0  # the static world stays at the origin
        buffer = pymunk.batch.Buffer()
        buffer.set_float_buf(state)
        pymunk.batch.set_space_bodies(self._space, _STATE_FIELDS, buffer)
        contacts = self._advance()
        touched = np.unique(contacts.rows[contacts.rows >= 0])
        felt = contacts.impulse >= _LEAST_IMPULSE  # two that are only being pushed apart exert none
        contacts = Contacts(contacts.rows[felt], contacts.impulse[felt], contacts.point[felt])
        decided = np.union1d(touched, unsettled)
        if len(decided):
            output = pymunk.batch.Buffer()
            pymunk.batch.get_space_bodies(self._space, _STATE_FIELDS, output)
            result = np.frombuffer(output.float_buf(), dtype=np.float64).reshape(-1, 6)
            where = np.flatnonzero(np.isin(order, decided))
            where = where[np.argsort(order[where])]
            bodies.pose[decided], bodies.velocity[decided] = result[where, :3], result[where, 3:]
            moving = np.abs(result[where, :3] - before[where]).max(axis=1) > _SETTLED
            return decided, np.intersect1d(decided[moving], touched), contacts
        return decided, decided, contacts

    def _advance(self) -> Contacts:
        """The tick in substeps short enough that nothing passes through anything."""
        found = []
        for _ in range(_SUBSTEPS):
            self._space.step(DT / _SUBSTEPS)
            found.append(self._read_contacts())
        rows = np.concatenate([f.rows for f in found])
        if not len(rows):
            return NO_CONTACTS
        # The engine lists pairs in an order that differs between processes; the sums below must not.
        substep = np.repeat(np.arange(_SUBSTEPS), [len(f.rows) for f in found])
        impulse, point = np.concatenate([f.impulse for f in found]), np.concatenate([f.point for f in found])
        order = np.lexsort((impulse, point[:, 1], point[:, 0], substep, rows[:, 1], rows[:, 0]))
        rows, impulse, point = rows[order], impulse[order], point[order]
        first = np.flatnonzero(np.append(True, np.any(rows[1:] != rows[:-1], axis=1)))
        return Contacts(rows[first], np.add.reduceat(impulse, first), point[first])

    def _keep_awake(self, rows: NDArray[np.int64], bodies: Bodies) -> None:
        """Makes `rows` the only bodies in the space, each as it is now."""
        wanted = {int(row): bool(bodies.motion[row] == WALKING) for row in rows}
        for row in [row for row, (_, walks) in self._awake.items() if wanted.get(row) != walks]:
            body, _ = self._awake.pop(row)
            self._space.remove(body, *body.shapes)
            del self._row_of_body[body.id]
        for row, walks in wanted.items():
            if row not in self._awake:
                self._add(row, walks, bodies)
            self._add_walls(row, bodies)

    def _add(self, row: int, walks: bool, bodies: Bodies) -> None:
        size, mass = (2.0 * bodies.half[row]).tolist(), float(bodies.mass[row])
        if math.isinf(mass):
            body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        else:
            body = pymunk.Body(mass, pymunk.moment_for_box(mass, size))
        body.position, body.angle = bodies.pose[row, :2].tolist(), float(bodies.pose[row, 2])
        self._enter(pymunk.Poly.create_box(body, size), _WALKS if walks else _STANDS)
        self._awake[row] = body, walks
        self._row_of_body[body.id] = row

    def _add_walls(self, row: int, bodies: Bodies) -> None:
        reach = float(np.hypot(*bodies.half[row]) + np.hypot(*bodies.move[row, :2])) + _WALL_MARGIN
        for wall in walls_near(float(bodies.pose[row, 0]), float(bodies.pose[row, 1]), reach, self._walls):
            if not self._has_wall[wall]:
                self._has_wall[wall] = True
                corners = self._walls.corners[wall, : self._walls.sides[wall]]
                shape = pymunk.Poly(self._space.static_body, corners.tolist())
                self._enter(shape, _WALL)
                self._wall_of[shape] = int(wall)

    def _enter(self, shape: pymunk.Poly, category: int) -> None:
        shape.friction, shape.elasticity, shape.filter = _FRICTION, _ELASTICITY, _FILTERS[category]
        if shape.body is self._space.static_body:
            self._space.add(shape)
        else:
            self._space.add(shape.body, shape)

    def _part_levels(self, arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: object) -> None:
        """Lets bodies on a bridge and what is below it pass through each other."""
        rows = [self._row_of_body.get(body.id, -1) for body in arbiter.bodies]
        walls = [self._wall_of[shape] for shape in arbiter.shapes if shape in self._wall_of]
        if walls:
            z = self._height[max(rows)]
            low, high = self._walls.z[walls[0]]
            arbiter.process_collision = bool(low < z + BODY_BAND[1] and high > z + BODY_BAND[0])
        else:
            arbiter.process_collision = bool(abs(self._height[rows[0]] - self._height[rows[1]]) <= LEVEL_GAP)

    def _space_order(self) -> NDArray[np.int64]:
        """Row of each body in the order in which the engine lists them; -1 is the static world."""
        listing = pymunk.batch.Buffer()
        pymunk.batch.get_space_bodies(self._space, pymunk.batch.BodyFields.BODY_ID, listing)
        bodies = np.frombuffer(listing.int_buf(), dtype=np.uintp)
        return np.array([self._row_of_body.get(int(body), -1) for body in bodies], dtype=np.int64)

    def _read_contacts(self) -> Contacts:
        found = pymunk.batch.Buffer()
        pymunk.batch.get_space_arbiters(self._space, _CONTACT_FIELDS, found)
        pairs = np.frombuffer(found.int_buf(), dtype=np.uintp).reshape(-1, 2)
        if not len(pairs):
            return NO_CONTACTS
        values = np.frombuffer(found.float_buf(), dtype=np.float64).reshape(-1, 4)
        rows = np.array([[self._row_of_body.get(int(b), -1) for b in pair] for pair in pairs], dtype=np.int64)
        rows = np.sort(rows, axis=1)
        rows = np.where(rows[:, :1] < 0, rows[:, ::-1], rows)  # the static world second
        apart = np.abs(self._height[rows[:, 0]] - self._height[rows[:, 1]]) > LEVEL_GAP
        impulse = np.sqrt(values[:, 0] ** 2 + values[:, 1] ** 2)
        # The engine lists pairs that `_part_levels` let pass as well; against a wall they have no impulse.
        meets = np.where(rows[:, 1] < 0, (impulse > 0.0) | (not self._has_levels), ~apart)
        return Contacts(rows[meets], impulse[meets], values[meets, 2:])
