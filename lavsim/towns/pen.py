"""Reference lines drawn piece by piece from straight lines and arcs, on paper: x east, y north, angles to the left."""

from __future__ import annotations

import math

from lavsim.map.records import Geometry

Place = tuple[float, float, float]  # x, y [m], heading [rad]

STRAIGHT = math.radians(4.0)  # ways that turn less swing from side to side rather than round a corner
SHORT_LEG = 0.05  # [m] of straight piece beside a corner; with less there is no corner


def wrap(angle: float) -> float:
    """The same angle within [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def shifted(place: Place, ahead: float, left: float) -> Place:
    """`place` moved along and across its heading."""
    x, y, heading = place
    c, s = math.cos(heading), math.sin(heading)
    return x + ahead * c - left * s, y + ahead * s + left * c, heading


class Pen:
    """Draws a reference line; each piece starts where and as the last one ends."""

    def __init__(self, x: float, y: float, heading: float) -> None:
        self.x, self.y, self.heading, self.s = x, y, heading, 0.0
        self.pieces: list[Geometry] = []

    def line(self, length: float) -> Pen:
        """Straight on."""
        return self.arc(length, 0.0)

    def arc(self, length: float, curvature: float) -> Pen:
        """Around; positive `curvature` [1/m] to the left."""
        if length > 1e-9:
            self.pieces.append(Geometry(self.s, self.x, self.y, self.heading, length, curvature))
            half = 0.5 * curvature * length
            chord = length * (math.sin(half) / half if abs(half) > 1e-12 else 1.0)
            self.x += chord * math.cos(self.heading + half)
            self.y += chord * math.sin(self.heading + half)
            self.heading += 2.0 * half
            self.s += length
        return self

    def arc_to(self, x: float, y: float) -> Pen:
        """The arc that leaves as the last piece ends and goes through (x, y)."""
        chord = math.hypot(x - self.x, y - self.y)
        half = wrap(math.atan2(y - self.y, x - self.x) - self.heading)
        if abs(half) < 1e-9:
            return self.line(chord)
        length = chord * half / math.sin(half)
        return self.arc(length, 2.0 * half / length)

    def reach(self, x: float, y: float, heading: float) -> Pen:
        """Smoothly to a place: round one corner where that is possible, else by two arcs."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        ahead, left = (x - self.x) * c + (y - self.y) * s, (y - self.y) * c - (x - self.x) * s
        bend = wrap(heading - self.heading)
        if abs(bend) < 1e-9 and abs(left) < 1e-6:
            return self.line(ahead)
        if abs(bend) > STRAIGHT:
            behind = left / math.sin(bend)  # from the corner to the place
            before = ahead - behind * math.cos(bend)
            if before > SHORT_LEG and behind > SHORT_LEG:
                tangent = min(before, behind)
                self.line(before - tangent)
                radius = tangent / math.tan(abs(bend) / 2.0)
                self.arc(radius * abs(bend), math.copysign(1.0 / radius, bend))
                return self.line(behind - tangent)
        return self._swing(x, y, heading)

    def _swing(self, x: float, y: float, heading: float) -> Pen:
        """Two arcs whose tangents at the ends are equally long."""
        tx, ty = math.cos(heading), math.sin(heading)
        sx, sy = math.cos(self.heading), math.sin(self.heading)
        vx, vy = x - self.x, y - self.y
        along = vx * (sx + tx) + vy * (sy + ty)
        square, same = vx * vx + vy * vy, 2.0 * (1.0 - (sx * tx + sy * ty))
        root = math.sqrt(along * along + same * square)
        tangent = square / (along + root)
        middle_x = (self.x + tangent * sx + x - tangent * tx) / 2.0
        middle_y = (self.y + tangent * sy + y - tangent * ty) / 2.0
        return self.arc_to(middle_x, middle_y).arc_to(x, y)
