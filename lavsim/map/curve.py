"""Reference lines: the five curves of OpenDRIVE as functions of s, in OpenDRIVE's frame.

Lines and arcs have closed forms. Spirals are integrated by Gauss-Legendre quadrature between nodes at most half a
radian apart, which leaves less than 1e-12 m. Cubics (poly3, paramPoly3) are followed by their arc length, which the
file's parameter only approximates; where the declared length differs, it is stretched so that the piece ends where the
next one begins.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import MapError
from lavsim.map.records import Cubic, Geometry

Floats = NDArray[np.float64]

NODE_TURN = 0.5  # [rad] of heading between the nodes of a spiral
MOST_TURN = 2_000.0  # [rad] a spiral that winds longer is a broken file
CUBIC_CELL = 1.0  # [m] of declared length between the nodes of a cubic
MOST_CELLS = 20_000
LENGTH_RATIO = 3.0  # a cubic this much longer or shorter than its length attribute is a broken file
STEEPEST = 10.0  # [1/m] largest turning rate given for a cubic; cusps have none

_X8, _W8 = (np.asarray(v) for v in np.polynomial.legendre.leggauss(8))
_GAUSS_X, _GAUSS_W = (_X8 + 1.0) / 2.0, _W8 / 2.0  # on [0, 1]


class Spiral:
    """A clothoid from (0, 0) towards +x."""

    def __init__(self, start: float, end: float, length: float) -> None:
        self.start = start
        self.rate = (end - start) / length if length > 0.0 else 0.0
        turn = max(abs(start), abs(end)) * length
        if not turn <= MOST_TURN:
            raise MapError(f"a spiral of {length:g} m would turn by {turn:.3g} rad")
        count = max(1, int(np.ceil(turn / NODE_TURN)))
        self.nodes = np.linspace(0.0, length, count + 1)
        parts = self._integral(self.nodes[:-1], self.nodes[1:])
        self.xy = np.concatenate([np.zeros((1, 2)), np.cumsum(parts, axis=0)])

    def _integral(self, low: Floats, high: Floats) -> Floats:
        along = low[:, None] + (high - low)[:, None] * _GAUSS_X
        angle = along * (self.start + 0.5 * self.rate * along)
        weight = _GAUSS_W * (high - low)[:, None]
        return np.stack([(np.cos(angle) * weight).sum(axis=1), (np.sin(angle) * weight).sum(axis=1)], axis=1)

    def __call__(self, ds: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """x, y, heading, dheading/ds and |dr/ds| at `ds`."""
        cell = np.clip(np.searchsorted(self.nodes, ds, side="right") - 1, 0, len(self.nodes) - 2)
        xy = self.xy[cell] + self._integral(self.nodes[cell], ds)
        heading = ds * (self.start + 0.5 * self.rate * ds)
        return xy[:, 0], xy[:, 1], heading, self.start + self.rate * ds, np.ones_like(ds)


Coefficients = tuple[float, float, float, float]


def _value(c: Coefficients, p: Floats) -> Floats:
    return c[0] + p * (c[1] + p * (c[2] + p * c[3]))


def _slope(c: Coefficients, p: Floats) -> Floats:
    return c[1] + p * (2.0 * c[2] + p * (3.0 * c[3]))


def _bend(c: Coefficients, p: Floats) -> Floats:
    return 2.0 * c[2] + 6.0 * c[3] * p


class CubicCurve:
    """u(p), v(p) as cubics, followed by arc length."""

    def __init__(self, cubic: Cubic, length: float) -> None:
        self.u, self.v = cubic.u, cubic.v
        count = int(min(max(8.0, np.ceil(length / CUBIC_CELL)), MOST_CELLS))
        self.p = np.linspace(0.0, cubic.end, count + 1)
        with np.errstate(over="ignore", invalid="ignore"):
            self.along = np.concatenate([[0.0], np.cumsum(self._length(self.p[:-1], self.p[1:]))])
        self.total = float(self.along[-1])
        ratio = self.total / length if length > 0.0 else 1.0
        if (not ratio > 1.0 / LENGTH_RATIO and not cubic.open_ended) or not np.isfinite(self.total):
            raise MapError(f"a cubic declared {length:g} m long is {self.total:.4g} m long")
        if not cubic.open_ended and ratio > LENGTH_RATIO:
            raise MapError(f"a cubic declared {length:g} m long is {self.total:.4g} m long")
        self.stretch = 1.0 if cubic.open_ended else ratio

    def _length(self, low: Floats, high: Floats) -> Floats:
        at = low[:, None] + (high - low)[:, None] * _GAUSS_X
        return np.asarray((np.hypot(_slope(self.u, at), _slope(self.v, at)) * _GAUSS_W).sum(axis=1) * (high - low))

    def parameter(self, along: Floats) -> Floats:
        """p after `along` metres of true arc length."""
        cell = np.clip(np.searchsorted(self.along, along, side="right") - 1, 0, len(self.p) - 2)
        low, high = self.p[cell], self.p[cell + 1]
        rest = along - self.along[cell]
        span = self.along[cell + 1] - self.along[cell]
        p = low + (high - low) * rest / np.maximum(span, 1e-12)
        for _ in range(4):
            slope = np.maximum(np.hypot(_slope(self.u, p), _slope(self.v, p)), 1e-9)
            p = np.clip(p + (rest - self._length(low, p)) / slope, low, high)
        return p

    def __call__(self, ds: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """x, y, heading, dheading/ds and |dr/ds| at `ds`; straight on beyond its ends."""
        along = ds * self.stretch
        p = self.parameter(along)
        du, dv = _slope(self.u, p), _slope(self.v, p)
        speed = np.maximum(np.hypot(du, dv), 1e-9)
        bend = (du * _bend(self.v, p) - dv * _bend(self.u, p)) / speed**3
        beyond = along - np.clip(along, 0.0, self.total)
        x, y = _value(self.u, p) + beyond * du / speed, _value(self.v, p) + beyond * dv / speed
        turning = np.clip(bend, -STEEPEST, STEEPEST) * self.stretch
        return x, y, np.arctan2(dv, du), turning, np.full_like(ds, self.stretch)


class ReferenceLine:
    """The reference line of a road."""

    def __init__(self, geometry: Sequence[Geometry]) -> None:
        self.s = np.array([g.s for g in geometry])
        self.start = np.array([(g.x, g.y, g.heading, g.curvature) for g in geometry])
        self.curves: dict[int, Spiral | CubicCurve] = {}
        for row, g in enumerate(geometry):
            if g.cubic is not None:
                self.curves[row] = CubicCurve(g.cubic, g.length)
            elif g.end_curvature is not None:
                self.curves[row] = Spiral(g.curvature, g.end_curvature, g.length)

    def pose(self, s: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """x, y, heading, dheading/ds and |dr/ds| at `s`. The last is 1 but on cubics of misstated length."""
        row = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, None)
        x, y, heading, curvature = self.start[row].T
        ds = s - self.s[row]
        half = 0.5 * curvature * ds  # chord of an arc: exact, and a line where the curvature is 0
        chord = ds * np.sinc(half / np.pi)
        out = (
            x + chord * np.cos(heading + half),
            y + chord * np.sin(heading + half),
            heading + 2.0 * half,
            curvature,
            np.ones_like(ds),
        )
        if not self.curves:
            return out
        order = np.argsort(row, kind="stable")
        numbers, first = np.unique(row[order], return_index=True)
        for number, mine in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
            curve = self.curves.get(number)
            if curve is not None:
                x0, y0, h0, _ = self.start[number]
                u, v, turned, turning, stretch = curve(ds[mine])
                out[0][mine] = x0 + u * np.cos(h0) - v * np.sin(h0)
                out[1][mine] = y0 + u * np.sin(h0) + v * np.cos(h0)
                out[2][mine], out[3][mine], out[4][mine] = h0 + turned, turning, stretch
        return out
