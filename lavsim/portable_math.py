"""Angles for kernels in plain arithmetic, so that every CPU and C library gives the same bits.

A library's sine may differ in the last bit between processors (it picks a variant by what they can), and a town drifts
apart from one bit. Here only +, -, *, / and square roots are used, which IEEE 754 fixes, and `lavsim.kernel` never
fuses them. Errors stay below 1 unit in the last place (arcs 2, tangent 2.5) for angles up to 10^5 rad.

Not for set-up with arrays: there numpy's functions do, where `snapped` takes the last bits off the result.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel

# pi/2 in three parts; the first two have 33 bits each, so their products with small whole numbers are exact.
_HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
_PER_HALF_PI = 0.6366197723675814

# Taylor terms: on [-pi/4, pi/4] the first ones left out are below 2^-60.
_SIN = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 9))
_COS = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(2, 9))
_ATAN = tuple((-1.0) ** k / (2 * k + 1) for k in range(1, 8))  # on [-1/16, 1/16]

# atan(k/8), the second row what the first one lacks.
_ARCS = np.array(
    [
        [
            0.0, 0.12435499454676144, 0.24497866312686414, 0.35877067027057225, 0.4636476090008061,
            0.5585993153435624, 0.6435011087932844, 0.7188299996216245, 0.7853981633974483,
        ],
        [
            0.0, -3.1253241424539383e-18, 1.0698755618734451e-17, -2.4623815582638635e-17, 2.2698777452961687e-17,
            -5.4556305485916264e-18, 1.5834785051444286e-17, -2.1478388444456983e-17, 3.061616997868383e-17,
        ],
    ]
)  # fmt: skip
_PI_2, _PI_2_REST = 1.5707963267948966, 6.123233995736766e-17
GRID = 2.0**-30  # [m], [rad]: a nanometre, ten thousand times what libraries disagree about


def snapped(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """`values` on a grid of 2^-30: two libraries' results for the same thing become the same number."""
    return np.rint(np.asarray(values, dtype=np.float64) / GRID) * GRID


@kernel
def cos_sin(angle: float) -> tuple[float, float]:
    """Cosine and sine, in about the time of one."""
    turns = math.floor(angle * _PER_HALF_PI + 0.5)
    near = angle - turns * _HALF_PI[0]
    much = turns * _HALF_PI[1]
    rest = near - much
    back = rest - near
    lost = ((near - (rest - back)) - (much + back)) - turns * _HALF_PI[2]
    x = rest + lost
    tail = (rest - x) + lost  # x + tail is the angle less quarter turns, to 100 bits
    z = x * x
    p = _SIN[4] + z * (_SIN[5] + z * (_SIN[6] + z * _SIN[7]))
    p = _SIN[0] + z * (_SIN[1] + z * (_SIN[2] + z * (_SIN[3] + z * p)))
    sin = x + (x * z * p + tail * (1.0 - 0.5 * z))
    q = _COS[3] + z * (_COS[4] + z * (_COS[5] + z * _COS[6]))
    q = _COS[0] + z * (_COS[1] + z * (_COS[2] + z * q))
    most = 1.0 - 0.5 * z
    cos = most + (((1.0 - most) - 0.5 * z) + (z * z * q - x * tail))
    quarter = int(turns) & 3
    if quarter == 0:
        return cos, sin
    if quarter == 1:
        return -sin, cos
    if quarter == 2:
        return -cos, -sin
    return sin, -cos


@kernel
def sin(angle: float) -> float:
    return cos_sin(angle)[1]


@kernel
def cos(angle: float) -> float:
    return cos_sin(angle)[0]


@kernel
def tan(angle: float) -> float:
    c, s = cos_sin(angle)
    return s / c


@kernel
def atan2(y: float, x: float) -> float:
    """Angle of the vector (x, y) from the x axis, in [-pi, pi]; nan unless both are finite."""
    small, large = min(abs(x), abs(y)), max(abs(x), abs(y))
    if not abs(x) + abs(y) < math.inf:
        return math.nan
    if large == 0.0:
        arc = rest = 0.0
    else:
        k = int(small / large * 8.0 + 0.5)
        share = 0.125 * k
        t = (small - share * large) / (large + share * small)  # tangent of what is left
        z = t * t
        p = _ATAN[0] + z * (_ATAN[1] + z * (_ATAN[2] + z * (_ATAN[3] + z * (_ATAN[4] + z * (_ATAN[5] + z * _ATAN[6])))))
        arc, rest = _ARCS[0, k], _ARCS[1, k] + t * z * p + t
    if abs(y) > abs(x):
        arc, rest = _PI_2 - arc, _PI_2_REST - rest
    angle = math.pi - arc + (2.0 * _PI_2_REST - rest) if math.copysign(1.0, x) < 0.0 else arc + rest
    return math.copysign(angle, y)


@kernel
def atan(tangent: float) -> float:
    return atan2(tangent, 1.0)


@kernel
def asin(sine: float) -> float:
    """nan beyond -1 and 1."""
    return atan2(sine, math.sqrt((1.0 - sine) * (1.0 + sine)))


@kernel
def acos(cosine: float) -> float:
    """nan beyond -1 and 1."""
    return atan2(math.sqrt((1.0 - cosine) * (1.0 + cosine)), cosine)
