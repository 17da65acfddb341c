"""Contacts between bodies: pymunk's door, read and written in bulk through `pymunk.batch`.

The World says where every body would go in a tick; the engine moves it there and resolves what touches on the way. A
body that touched nothing keeps the World's own numbers, so driving without contact never depends on the engine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from lavsim.types import DT

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
LEVEL_GAP = 3.0  # [m] DESIGN section 2: actors farther apart in z ignore each other
_FRICTION = 0.4
_RESTITUTION = 0.1


class Contacts:
    """Pairs that touched in a tick.

    Attributes:
        rows: (C, 2) rows of both bodies, -1 for the static world; the lower row first.
        impulse: (C,) [N s].
        point: (C, 2) where, in the world [m].
    """

    def __init__(self, rows: NDArray[np.int64], impulse: NDArray[np.float64], point: NDArray[np.float64]) -> None:
        self.rows, self.impulse, self.point = rows, impulse, point

    def __len__(self) -> int:
        return len(self.rows)


NO_CONTACTS = Contacts(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros((0, 2)))


class Physics:
    """Bodies of all actors and the town's solid walls.

    Args:
        walls: Convex polygons `(M, 2)` [m] that nothing moves.
        has_levels: Whether roads pass over each other: bodies more than `LEVEL_GAP` apart in z then don't meet.
    """

    def __init__(self, walls: Sequence[NDArray[np.float64]] = (), has_levels: bool = False) -> None:
        self._space = pymunk.Space()
        self._space.iterations = 8
        self._space.collision_persistence = 1  # a pair is listed only in ticks in which it touches
        self._buffer = pymunk.batch.Buffer()
        self._bodies: dict[int, pymunk.Body] = {}
        self._row_of_body: dict[int, int] = {}
        self._order: NDArray[np.int64] | None = None
        self._unsettled = np.zeros(0, dtype=np.int64)
        self._height = np.zeros(0)
        if has_levels:
            self._space.on_collision(begin=self._part_levels)
        for wall in walls:
            shape = pymunk.Poly(self._space.static_body, [tuple(map(float, corner)) for corner in wall])
            shape.friction, shape.elasticity = _FRICTION, _RESTITUTION
            self._space.add(shape)

    def add(self, row: int, x: float, y: float, yaw: float, length: float, width: float, mass: float) -> None:
        """Adds the box of the actor in `row`; an infinite mass is pushed by nobody."""
        if math.isinf(mass):
            body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        else:
            body = pymunk.Body(mass, pymunk.moment_for_box(mass, (length, width)))
        body.position, body.angle = (x, y), yaw
        shape = pymunk.Poly.create_box(body, (length, width))
        shape.friction, shape.elasticity = _FRICTION, _RESTITUTION
        self._space.add(body, shape)
        self._bodies[row] = body
        self._row_of_body[body.id] = row
        self._order = None

    def remove(self, row: int) -> None:
        """Takes the body of `row` out."""
        body = self._bodies.pop(row)
        self._space.remove(body, *body.shapes)
        del self._row_of_body[body.id]
        self._unsettled = self._unsettled[self._unsettled != row]
        self._order = None

    def step(
        self,
        pose: NDArray[np.float64],
        move: NDArray[np.float64],
        velocity: NDArray[np.float64],
        height: NDArray[np.float64],
    ) -> tuple[NDArray[np.int64], Contacts]:
        """Moves all bodies by one tick.

        Args:
            pose: (N, 3) x, y, yaw of all rows, updated to where they came.
            move: (N, 3) displacement and turn the World wants; zero for rows that are gone.
            velocity: (N, 3) vx, vy, yaw rate; filled for rows that touched something.
            height: (N,) z of the ground below [m].

        Returns:
            Rows whose pose and velocity the engine decided, and the contacts of the tick.
        """
        self._height = height
        order = self._space_order()
        state = np.concatenate([pose[order], move[order] / DT], axis=1)
        state[order < 0] = 0.0  # the static world stays at the origin
        self._buffer.set_float_buf(state)
        pymunk.batch.set_space_bodies(self._space, _STATE_FIELDS, self._buffer)
        self._space.step(DT)
        contacts = self._contacts()
        touched = np.unique(contacts.rows[contacts.rows >= 0])
        decided = np.union1d(touched, self._unsettled) if len(touched) + len(self._unsettled) else touched
        pose += move
        if len(decided):
            output = pymunk.batch.Buffer()
            pymunk.batch.get_space_bodies(self._space, _STATE_FIELDS, output)
            result = np.frombuffer(output.float_buf(), dtype=np.float64).reshape(-1, 6)
            where = np.flatnonzero(np.isin(order, decided))
            where = where[np.argsort(order[where])]
            pose[decided], velocity[decided] = result[where, :3], result[where, 3:]
        self._unsettled = touched  # for one more tick the engine pushes overlapping bodies apart
        return decided, contacts

    def _part_levels(self, arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: object) -> None:
        """Lets bodies on a bridge and below it pass through each other."""
        first, second = (self._row_of_body.get(body.id, -1) for body in arbiter.bodies)
        if first >= 0 and second >= 0 and abs(self._height[first] - self._height[second]) > LEVEL_GAP:
            arbiter.process_collision = False

    def _space_order(self) -> NDArray[np.int64]:
        """Row of each body in the order in which the engine lists them; -1 is the static world."""
        if self._order is None:
            listing = pymunk.batch.Buffer()
            pymunk.batch.get_space_bodies(self._space, pymunk.batch.BodyFields.BODY_ID, listing)
            bodies = np.frombuffer(listing.int_buf(), dtype=np.uintp)
            self._order = np.array([self._row_of_body.get(int(body), -1) for body in bodies], dtype=np.int64)
        return self._order

    def _contacts(self) -> Contacts:
        found = pymunk.batch.Buffer()
        pymunk.batch.get_space_arbiters(self._space, _CONTACT_FIELDS, found)
        pairs = np.frombuffer(found.int_buf(), dtype=np.uintp).reshape(-1, 2)
        if not len(pairs):
            return NO_CONTACTS
        values = np.frombuffer(found.float_buf(), dtype=np.float64).reshape(-1, 4)
        rows = np.array([[self._row_of_body.get(int(b), -1) for b in pair] for pair in pairs], dtype=np.int64)
        rows = np.sort(rows, axis=1)
        rows = np.where(rows[:, :1] < 0, rows[:, ::-1], rows)  # the static world second
        order = np.lexsort((rows[:, 1], rows[:, 0]))
        apart = np.abs(self._height[rows[order, 0]] - self._height[rows[order, 1]]) > LEVEL_GAP
        order = order[~apart | (rows[order, 1] < 0)]
        impulse = np.hypot(values[:, 0], values[:, 1])
        return Contacts(rows[order], impulse[order], values[order, 2:].copy())
