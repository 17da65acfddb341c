"""How rows move within a tick when nothing is in their way: rolling, walking, and sliding after a contact.

A vehicle rolls on the arc that its command names, within what its class can do (`lavsim.world.dynamics.Handling`). One
that a contact has upset slides until its tyres hold again.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.portable_math import asin, atan2, cos_sin
from lavsim.types import DT

# How a row of the world moves.
DRIVEN = 0  # a vehicle: speed and curvature
WALKING = 1  # velocity as commanded
RESTING = 2  # parked cars, props, whoever was knocked down: still unless pushed
GONE = 3  # no longer in the world

TYRE_GRIP = 7.0  # [m/s²] a sliding body loses that much speed on a dry road
SPIN_GRIP = 5.0  # [rad/s²] and that much spin
FASTEST_WALK = 10.0  # [m/s] nobody runs faster
TURNING_WALK, WALKER_TURN = 0.2, 6.0  # [m/s] from which a walker turns, [rad/s] how fast
STRIDE = 0.75  # [m] of a walker; sets its gait
HOLD_SLIDE, HOLD_SPIN = 0.3, 0.3  # [m/s], [rad/s] below which tyres hold again


@kernel
def integrate(
    motion: NDArray[np.uint8],
    pose: NDArray[np.float64],
    body: NDArray[np.float64],
    loose: NDArray[np.bool_],
    command: NDArray[np.float64],
    limits: NDArray[np.float64],
    rear: NDArray[np.float64],
    grip: float,
    move: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> None:
    """Where every row would go in one tick if nothing were in its way.

    Args:
        motion: (N,) `DRIVEN`, `WALKING`, `RESTING` or `GONE`.
        pose: (N, 3) x, y, yaw.
        body: (N, 3) speed ahead, slide to the right [m/s], yaw rate [rad/s]; updated.
        loose: (N,) whether a contact has upset the row and it still slides; updated.
        command: (N, 2) driven: speed after the tick [m/s] and path curvature [1/m]; walking: velocity x, y [m/s].
        limits: (N, 3) driven: largest change of speed [m/s²], curvature [1/m] and lateral acceleration [m/s²].
        rear: (N,) distance from the reference point to the rear axle of the bicycle [m].
        grip: Share of a dry road's grip, 0 to 1.
        move: (N, 3) displacement x, y and turn of the tick; filled.
        velocity: (N, 3) velocity x, y [m/s] and yaw rate [rad/s] after it; filled.
    """
    for i in range(len(motion)):
        if motion[i] == WALKING:
            _walk(i, pose[i, 2], body, command, move, velocity)
        elif motion[i] == GONE or (body[i, 0] == 0.0 and _stays(i, motion, body, command)):
            body[i, :] = 0.0
            move[i, :] = 0.0
            velocity[i, :] = 0.0
            loose[i] = False
        elif motion[i] == RESTING or loose[i]:
            _slide(i, motion[i] == DRIVEN, pose[i, 2], body, loose, command, grip, move, velocity)
        else:
            _roll(i, pose[i, 2], body, command, limits, rear[i], grip, move, velocity)


@kernel
def _stays(
    i: int, motion: NDArray[np.uint8], body: NDArray[np.float64], command: NDArray[np.float64]
) -> bool:  # fmt: skip
    return body[i, 1] == 0.0 and body[i, 2] == 0.0 and (motion[i] == RESTING or command[i, 0] == 0.0)


@kernel
def _walk(
    i: int,
    yaw: float,
    body: NDArray[np.float64],
    command: NDArray[np.float64],
    move: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> None:
    """A walker goes as told, no faster than anyone can run, and turns to where it goes."""
    vx, vy = command[i, 0], command[i, 1]
    speed = math.sqrt(vx * vx + vy * vy)
    if not math.isfinite(speed):
        vx = vy = speed = 0.0
    elif speed > FASTEST_WALK:
        vx, vy, speed = vx * FASTEST_WALK / speed, vy * FASTEST_WALK / speed, FASTEST_WALK
    turn = 0.0
    if speed > TURNING_WALK:
        turn = atan2(vy, vx) - yaw
        turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
        turn = min(max(turn, -WALKER_TURN * DT), WALKER_TURN * DT)
    body[i, 0], body[i, 1], body[i, 2] = speed, 0.0, 0.0
    move[i, 0], move[i, 1], move[i, 2] = vx * DT, vy * DT, turn
    velocity[i, 0], velocity[i, 1], velocity[i, 2] = vx, vy, turn / DT


@kernel
def _roll(
    i: int,
    yaw: float,
    body: NDArray[np.float64],
    command: NDArray[np.float64],
    limits: NDArray[np.float64],
    rear: float,
    grip: float,
    move: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> None:
    """A bicycle on an arc: the exact chord, at the speed after the tick.

    Semi-implicit, as the physics engine whose cars the model was fitted to.
    """
    before, after, bend = body[i, 0], command[i, 0], command[i, 1]
    if not math.isfinite(after):
        after = before
    if not math.isfinite(bend):
        bend = 0.0
    change = limits[i, 0] * grip * DT
    after = min(max(after, before - change), before + change)
    most = limits[i, 1]
    if after * after * most > limits[i, 2] * grip:  # too fast for that arc: it runs wide
        most = limits[i, 2] * grip / (after * after)
    bend = min(max(bend, -most), most)
    length = after * DT
    turn = length * bend
    slip = asin(min(max(bend * rear, -0.9), 0.9))
    half = 0.5 * turn
    chord = length * (1.0 - half * half / 6.0 * (1.0 - half * half / 20.0))  # sin(half) / half, exact to 1e-12 here
    cos, sin = cos_sin(yaw + slip + half)
    move[i, 0], move[i, 1], move[i, 2] = chord * cos, chord * sin, turn
    body[i, 0], body[i, 1], body[i, 2] = after, 0.0, after * bend
    cos, sin = cos_sin(yaw + slip + turn)
    velocity[i, 0], velocity[i, 1] = after * cos, after * sin
    velocity[i, 2] = after * bend


@kernel
def _slide(
    i: int,
    is_driven: bool,
    yaw: float,
    body: NDArray[np.float64],
    loose: NDArray[np.bool_],
    command: NDArray[np.float64],
    grip: float,
    move: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> None:
    """A body that friction brings back to rest, or to the speed its driver wants."""
    target = command[i, 0] if is_driven and math.isfinite(command[i, 0]) else 0.0
    loss = TYRE_GRIP * grip * DT
    ahead = _towards(body[i, 0], target, loss)
    aside = _towards(body[i, 1], 0.0, loss)
    spin = _towards(body[i, 2], 0.0, SPIN_GRIP * grip * DT)
    body[i, 0], body[i, 1], body[i, 2] = ahead, aside, spin
    cos, sin = cos_sin(yaw)
    vx, vy = ahead * cos - aside * sin, ahead * sin + aside * cos
    move[i, 0], move[i, 1], move[i, 2] = vx * DT, vy * DT, spin * DT
    velocity[i, 0], velocity[i, 1], velocity[i, 2] = vx, vy, spin
    # Where the tyres hold again the car rolls on, with the little slide that is left taken away.
    loose[i] = abs(aside) > HOLD_SLIDE or abs(spin) > HOLD_SPIN


@kernel
def _towards(value: float, target: float, change: float) -> float:
    return max(target, value - change) if value > target else min(target, value + change)


@kernel
def take_over(
    rows: NDArray[np.int64],
    pose: NDArray[np.float64],
    velocity: NDArray[np.float64],
    command: NDArray[np.float64],
    body: NDArray[np.float64],
    loose: NDArray[np.bool_],
) -> None:
    """After a contact the engine's velocities hold; tyres then bring the bodies back to rolling.

    Args:
        rows: Who was touched.
        pose: (N, 3) x, y, yaw.
        velocity: (N, 3) x, y [m/s] and yaw rate [rad/s] the engine left them with.
        command: (N, 2) as in `integrate`.
        body: (N, 3) as in `integrate`; filled for `rows`.
        loose: (N,) as in `integrate`; filled for `rows`.
    """
    for i in rows:
        cos, sin = cos_sin(pose[i, 2])
        ahead = velocity[i, 0] * cos + velocity[i, 1] * sin
        aside = -velocity[i, 0] * sin + velocity[i, 1] * cos
        spin = velocity[i, 2]
        body[i, 0], body[i, 1], body[i, 2] = ahead, aside, spin
        loose[i] = abs(aside) > HOLD_SLIDE or abs(spin - ahead * command[i, 1]) > HOLD_SPIN


@kernel
def finish(
    motion: NDArray[np.uint8],
    body: NDArray[np.float64],
    gait: NDArray[np.float64],
    pose: NDArray[np.float64],
    velocity: NDArray[np.float64],
    before: NDArray[np.float64],
    ego_motion: NDArray[np.float64],
) -> None:
    """What follows from a tick: walkers' gait, and what the ego's inertial sensors feel.

    Args:
        motion: (N,) as in `integrate`.
        body: (N, 3) as in `integrate`.
        gait: (N,) steps walked; updated.
        pose: (N, 3) after the tick.
        velocity: (N, 3) after the tick.
        before: (2,) the ego's velocity x, y before it.
        ego_motion: (6,) acceleration and rotation rate about its axes ahead, right, up; filled.
    """
    for i in range(len(motion)):
        if motion[i] == WALKING:
            gait[i] += body[i, 0] * DT / STRIDE
    ax, ay = (velocity[0, 0] - before[0]) / DT, (velocity[0, 1] - before[1]) / DT
    cos, sin = cos_sin(pose[0, 2])
    ego_motion[0] = ax * cos + ay * sin
    ego_motion[1] = -ax * sin + ay * cos
    ego_motion[5] = velocity[0, 2]
