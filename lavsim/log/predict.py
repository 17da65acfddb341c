"""What the next tick of an actor looks like, so that only surprises are stored.

Integers alone, so writer and reader agree on any machine. Estimates carry 8 fractional bits: many ticks together know
more than one quantised value does. The model is the one the world moves by (`lavsim.world.dynamics`): the centre of a
vehicle runs along its heading, pushed sideways while it turns about its rear axle. Whoever moves otherwise costs more
bytes, nothing else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel

CHANNELS = 11  # x, y, z, yaw, pitch; vx, vy, vz; lights, doors, gait
X, Y, Z, YAW, PITCH, VX, VY, VZ, LIGHTS, DOORS, GAIT = range(CHANNELS)
POSE, VELOCITY, STATE = slice(0, 5), slice(5, 8), slice(8, 11)
MOTION = (YAW, VX, VY, X, Y)  # in the order in which they are predicted, each from those before
REST = (Z, PITCH, VZ, GAIT, LIGHTS, DOORS)  # go on as they went

# Range of each channel: (value - low) & mask. Angles and gait run in circles; where a block says so, see `ranges`.
_WORD = (-(2**31), 2**32 - 1)
_CIRCLES = {YAW: (-(2**15), 2**16 - 1), PITCH: (-(2**15), 2**16 - 1), GAIT: (0, 2**8 - 1)}

_HALF = 128  # of a unit with 8 fractional bits
# Gains in 1/256: how much of a surprise an estimate takes over. Found by coordinate search on ten minutes of traffic.
_SPEED_GAIN, _ACCELERATION_GAIN, _PLACE_GAIN = 200, 96, 160
_REST_GAINS, _RATE_GAINS = (160, 160, 160, 160, 256, 256), (64, 64, 64, 64, 0, 0)
_AXLE_SHARE = 290  # 1/1000 of the length from the centre to the rear axle, as the world has it
_SIDEWAYS = 12868  # 2^26 (2 pi / 65536) / 10 / 0.05 s: [mm] x [2^-16 turn per tick] to [cm/s]

# 2^14 cos of each angle; no entry lies nearer than 1e-7 to a rounding border, so every libm gives this table.
_COSINE = np.rint(np.cos(np.arange(65536) * (2.0 * np.pi / 65536.0)) * 16384.0).astype(np.int64)


@kernel
def find_changes(
    values: NDArray[np.int32], present: NDArray[np.bool_], starts: NDArray[np.int32]
) -> tuple[NDArray[np.bool_], bool]:
    """Which rows change, and whether the circular channels all keep their range.

    Args:
        values: (T, R, CHANNELS).
        present: (T, R) where they count.
        starts: (R, CHANNELS) each row at its first tick.
    """
    ticks, rows, _ = values.shape
    changes, circular = np.zeros(rows, np.bool_), True
    for t in range(ticks):
        for r in range(rows):
            if not present[t, r]:
                continue
            same = True
            for c in range(CHANNELS):
                same &= values[t, r, c] == starts[r, c]
            changes[r] |= not same
            angles = -32768 <= values[t, r, YAW] < 32768 and -32768 <= values[t, r, PITCH] < 32768
            circular &= angles and 0 <= values[t, r, GAIT] < 256
    return changes, circular


def ranges(circular: bool) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Lowest value and mask of each channel, `(CHANNELS,)` each."""
    bounds = [_CIRCLES.get(channel, _WORD) if circular else _WORD for channel in range(CHANNELS)]
    return np.array([low for low, _ in bounds]), np.array([mask for _, mask in bounds])


def axles(sizes: NDArray[np.float32], is_vehicle: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(R,) distance from each centre to the axle it turns about [mm]; others than vehicles turn about their centre."""
    return np.where(is_vehicle, np.rint(sizes[:, 0] * np.float32(1000.0)).astype(np.int64) * _AXLE_SHARE // 1000, 0)


def residuals_of(
    values: NDArray[np.int32], present: NDArray[np.bool_], axle: NDArray[np.int64], circular: bool
) -> NDArray[np.int32]:
    """What prediction leaves of `values`.

    Args:
        values: (T, R, CHANNELS) of rows over consecutive ticks.
        present: (T, R) where they are to be kept.
        axle: (R,) see `axles`.
        circular: See `find_changes`.

    Returns:
        (R, T, CHANNELS); zero where a row is absent and at its first tick, which is stored apart.
    """
    low, mask = ranges(circular)
    residuals = np.zeros((values.shape[1], values.shape[0], CHANNELS), dtype=np.int32)
    _code(values, present, axle, low, mask, _COSINE, residuals, False)
    return residuals


def restore_values(
    values: NDArray[np.int32],
    present: NDArray[np.bool_],
    axle: NDArray[np.int64],
    circular: bool,
    residuals: NDArray[np.int32],
) -> None:
    """Fills `values` wherever `present`; the first tick of each row must be there. Inverse of `residuals_of`."""
    low, mask = ranges(circular)
    _code(values, present, axle, low, mask, _COSINE, residuals, True)


@kernel
def _code(
    values: NDArray[np.int32],
    present: NDArray[np.bool_],
    axle: NDArray[np.int64],
    low: NDArray[np.int64],
    mask: NDArray[np.int64],
    cosine: NDArray[np.int64],
    residuals: NDArray[np.int32],
    restoring: bool,
) -> None:
    """Values to residuals, or back; one function, so that both see the same predictions."""
    ticks, rows, _ = values.shape
    smooth, rate = np.zeros(len(REST), np.int64), np.zeros(len(REST), np.int64)  # [2^-8 unit], and per tick
    for r in range(rows):
        seen = 0
        yaw = turn = speed = gain = x = y = 0
        for t in range(ticks):
            if not present[t, r]:
                continue
            if seen == 0:
                yaw = int(values[t, r, YAW])
                x, y = int(values[t, r, X]) << 8, int(values[t, r, Y]) << 8
                speed = _along(values[t, r, VX], values[t, r, VY], yaw, cosine)
                for k in range(len(REST)):
                    smooth[k], rate[k] = int(values[t, r, REST[k]]) << 8, 0
                seen = 1
                continue

            # Yaw turns as in the last tick.
            found, rest = _settle(values[t, r, YAW], residuals[r, t, YAW], yaw + turn, low[YAW], mask[YAW], restoring)
            values[t, r, YAW], residuals[r, t, YAW] = found, rest
            turn = ((found - yaw + 32768) & 65535) - 32768
            yaw = found

            # Velocity points along it, and grows as it did.
            cos, sin = cosine[yaw & 65535], cosine[(yaw - 16384) & 65535]
            expected, aside = speed + gain, (axle[r] * turn * _SIDEWAYS) >> 18
            guess = ((expected * cos - aside * sin) >> 14) + _HALF >> 8
            vx, rest = _settle(values[t, r, VX], residuals[r, t, VX], guess, low[VX], mask[VX], restoring)
            values[t, r, VX], residuals[r, t, VX] = vx, rest
            guess = ((expected * sin + aside * cos) >> 14) + _HALF >> 8
            vy, rest = _settle(values[t, r, VY], residuals[r, t, VY], guess, low[VY], mask[VY], restoring)
            values[t, r, VY], residuals[r, t, VY] = vy, rest
            surprise = _along(vx, vy, yaw, cosine) - expected
            if vx == 0 and vy == 0:
                speed = gain = 0
            else:
                speed = expected + _share(surprise, _SPEED_GAIN, seen)
                gain += _share(surprise, _ACCELERATION_GAIN, seen)

            # Place moves with the velocity along the mean heading; 1 cm/s is half a millimetre a tick.
            middle = yaw - (turn >> 1)
            cos, sin = cosine[middle & 65535], cosine[(middle - 16384) & 65535]
            x += (speed * cos - aside * sin) >> 15
            y += (speed * sin + aside * cos) >> 15
            found, rest = _settle(values[t, r, X], residuals[r, t, X], (x + _HALF) >> 8, low[X], mask[X], restoring)
            values[t, r, X], residuals[r, t, X] = found, rest
            x += (((found << 8) - x) * _PLACE_GAIN) >> 8
            found, rest = _settle(values[t, r, Y], residuals[r, t, Y], (y + _HALF) >> 8, low[Y], mask[Y], restoring)
            values[t, r, Y], residuals[r, t, Y] = found, rest
            y += (((found << 8) - y) * _PLACE_GAIN) >> 8

            # The rest goes on as it went.
            for k in range(len(REST)):
                c, guess = REST[k], smooth[k] + rate[k]
                known, rest = values[t, r, c], residuals[r, t, c]
                found, rest = _settle(known, rest, (guess + _HALF) >> 8, low[c], mask[c], restoring)
                values[t, r, c], residuals[r, t, c] = found, rest
                surprise = _fold((found << 8) - guess, (mask[c] << 8) | 255)
                smooth[k] = guess + ((surprise * _REST_GAINS[k]) >> 8)
                rate[k] += (surprise * _RATE_GAINS[k]) >> 8
            seen = 2


@kernel
def _share(surprise: int, gain: int, seen: int) -> int:
    """What an estimate takes over of a surprise: all of it at the second tick, which shows the rate."""
    return surprise if seen == 1 else (surprise * gain) >> 8


@kernel
def _along(vx: int, vy: int, yaw: int, cosine: NDArray[np.int64]) -> int:
    """Speed along the heading [2^-8 cm/s]."""
    return (vx * cosine[yaw & 65535] + vy * cosine[(yaw - 16384) & 65535]) >> 6


@kernel
def _fold(difference: int, mask: int) -> int:
    """A difference on a circle of `mask` + 1 steps, as the shorter way round."""
    half = (mask + 1) >> 1
    return ((difference + half) & mask) - half


@kernel
def _settle(value: int, residual: int, guess: int, low: int, mask: int, restoring: bool) -> tuple[int, int]:
    """Value and residual of a channel: one of them is known."""
    found = ((guess + residual - low) & mask) + low if restoring else int(value)
    return found, _fold(found - guess, mask)
