"""What traffic does, seen from outside: an observer of Snapshots that counts distance, speed, contacts and breaches.

It never looks at a driver's own state, so it can judge any traffic, live or from a log.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.map.town_map import LaneHits, TownMap
from lavsim.traffic.audit_columns import Columns
from lavsim.traffic.audit_geometry import boxes_about_to_meet, build_stop_lines
from lavsim.traffic.audit_report import Incident, TrafficReport
from lavsim.types import DT, ActorClass, LightState, Role
from lavsim.world.snapshot import Snapshot

EVERY = 5  # ticks between two looks; contacts are read in every tick
STANDING = 0.1  # [m/s]
HALTED = 0.3  # [m/s] slow enough before a stop sign
QUEUED = 1.0  # [m/s] slower than that, a vehicle belongs to a queue
HALT_ZONE = 6.0  # [m] before the line, in which a halt counts
CROSSING_ZONE = 12.0  # [m] before a line, within which its crossing is watched for; 0.25 s at 48 m/s
QUEUE_RANGE = 150.0  # [m] a light this far ahead explains why a vehicle stands
LONG_STOP = 60.0  # [s] of standing without a red light ahead
LONGEST_STOP = 180.0  # [s] of standing at all; then the leaderboard calls an agent blocked
HARSH = -4.0  # [m/s²] braking that passengers complain about
EMERGENCY = -6.5  # [m/s²] what a dry road hardly gives
SAME_CONTACT = 2.0  # [s] a pair that touches again within that is the same event
POSE_UNIT = 1e-3  # [m] to which a Snapshot tells positions
JUMP = 6.0  # [m] beyond its speed that a vehicle was set somewhere else
NEAR_MISS_TIME = 0.5  # [s] to a contact if both go on as they do; who stops in a queue stays above that
NEAR_MISS_SPEED = 2.0  # [m/s] between them; slower is squeezing past in a queue
MOST_INCIDENTS = 5_000


@dataclass(frozen=True, eq=False)
class _Look:
    """The vehicles of traffic at one look: arrays over those present.

    Attributes:
        at: Their indices in the snapshot.
        rows: Their rows in the actor table.
        centre, front: Nearest lanes of their centres and of the middle of their front bumpers.
        front_xy: (N, 2) [m].
    """

    at: NDArray[np.int64]
    rows: NDArray[np.int32]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    speed: NDArray[np.float64]
    centre: LaneHits
    front: LaneHits
    front_xy: NDArray[np.float64]


class TrafficAudit:
    """Counts what background vehicles do in one town.

    Args:
        town: Where they drive.
        every: Ticks between two looks; only contacts are read in between.

    Attributes:
        incidents: What went wrong, in order; at most `MOST_INCIDENTS`.
    """

    def __init__(self, town: TownMap, every: int = EVERY) -> None:
        self.town = town
        self.incidents: list[Incident] = []
        self._every = every
        self._dt = every * DT
        self._lines = build_stop_lines(town, QUEUE_RANGE)
        self._columns = Columns()
        self._lights: NDArray[np.uint8] | None = None
        self._green_since = np.zeros(len(town.lights), np.int64)  # tick of the look that first saw it green
        self._last_crossing: dict[int, int] = {}  # tick by stop line
        self._last_contact: dict[tuple[int, int], int] = {}
        self._last_near_miss: dict[tuple[int, int], int] = {}
        self._counts = dict.fromkeys(
            ("contacts", "walkers_hit", "static_hit", "other_contacts", "red_lights", "red_chances", "stop_signs",
             "stop_chances", "near_misses", "off_lane", "lane_changes", "long_stops", "blocked", "harsh_brakes",
             "emergency_brakes", "jumps"), 0,
        )  # fmt: skip
        self._sums = dict.fromkeys(
            ("looks", "vehicles", "moved", "metres", "ratio", "ratio_metres", "speed", "standing", "off", "against",
             "jerk", "jerks", "headways", "headway"), 0.0,
        )  # fmt: skip
        self._worst = dict.fromkeys(("off", "still", "side"), 0.0)

    def update(self, snapshot: Snapshot) -> None:
        """Takes a snapshot into account; to be called for every tick."""
        if len(snapshot.contacts):
            self._read_contacts(snapshot)
        self._columns.grow(len(snapshot.table.ids))
        slowest = self._columns.slowest
        slowest[snapshot.rows] = np.minimum(slowest[snapshot.rows], snapshot.speeds)
        if snapshot.tick % self._every:
            return
        turn = self._turn_rates(snapshot)
        self._find_near_misses(snapshot, turn)
        look = self._look(snapshot)
        self._sums["looks"] += 1.0
        if not len(look.at):
            return
        known = ~np.isnan(turn[look.at])
        known &= self._find_jumps(snapshot, look, known)
        self._measure_speed(look, known)
        self._watch_lanes(snapshot, look, known)
        self._watch_comfort(look, known, turn[look.at])
        line, before = self._lines.ahead(look.front)
        self._watch_lines(snapshot, look, known, line, before)
        self._watch_stops(snapshot, look, known, line)
        c = self._columns
        c.xy[look.rows], c.speed[look.rows], c.lane[look.rows] = look.xy, look.speed, look.centre.lane
        slowest[:] = np.inf
        c.line[look.rows], c.before[look.rows] = line, before
        self._note_greens(snapshot)

    def report(self) -> TrafficReport:
        """What came of it so far."""
        s, n = self._sums, max(self._sums["vehicles"], 1.0)
        return TrafficReport(
            seconds=s["looks"] * self._dt,
            vehicles=s["vehicles"] / max(s["looks"], 1.0),
            vehicle_km=s["metres"] / 1000.0,
            space_mean=s["ratio"] / n,
            time_mean=s["ratio_metres"] / max(s["speed"], 1e-9),
            mean_speed=s["speed"] / n,
            standing=s["standing"] / n,
            off_lane_share=s["off"] / n,
            off_lane_worst=self._worst["off"],
            against=s["against"] / n,
            longest_stop=self._worst["still"],
            jerk=float(np.sqrt(s["jerk"] / max(s["jerks"], 1.0))),
            saturation_flow=3600.0 * s["headways"] / s["headway"] if s["headway"] else 0.0,
            side_acceleration=self._worst["side"],
            **self._counts,
        )

    def _look(self, snapshot: Snapshot) -> _Look:
        at = np.flatnonzero(snapshot.is_background & snapshot.is_vehicle)
        yaw = snapshot.yaw[at]
        xyz = snapshot.xyz[at]
        front = xyz.copy()
        half = snapshot.sizes[at, 0] / 2.0
        front[:, 0] += half * np.cos(yaw)
        front[:, 1] += half * np.sin(yaw)
        hits = self.town.nearest(np.concatenate([xyz, front]))
        n = len(at)
        return _Look(
            at, snapshot.rows[at], xyz[:, :2], yaw, snapshot.speeds[at], _part(hits, slice(0, n)),
            _part(hits, slice(n, 2 * n)), front[:, :2],
        )  # fmt: skip

    def _note(self, kind: str, snapshot: Snapshot, actors: tuple[int, ...], xy: Any, detail: str) -> None:
        if len(self.incidents) < MOST_INCIDENTS:
            self.incidents.append(Incident(kind, snapshot.tick, actors, float(xy[0]), float(xy[1]), detail))

    def _read_contacts(self, snapshot: Snapshot) -> None:
        table = snapshot.table
        for event in snapshot.contacts:
            pair = (int(event["a"]), int(event["b"]))
            rows = [table.row_of.get(actor, -1) for actor in pair]
            is_traffic = [
                row >= 0 and table.roles[row] == Role.TRAFFIC and table.classes[row] <= ActorClass.BICYCLE
                for row in rows
            ]
            if not any(is_traffic):
                continue
            last = self._last_contact.get(pair, -(10**9))
            self._last_contact[pair] = snapshot.tick
            if (snapshot.tick - last) * DT < SAME_CONTACT:
                continue
            other = rows[is_traffic.index(False)] if not all(is_traffic) else None
            kind = _contact_kind(table.roles, table.classes, other)
            self._counts[kind] += 1
            name = {"contacts": "contact", "other_contacts": "contact"}.get(kind, kind)
            speeds = [snapshot.speeds[k] if (k := snapshot.index_of(actor)) is not None else 0.0 for actor in pair]
            self._note(
                name, snapshot, pair, (event["x"] / 1000.0, event["y"] / 1000.0),
                f"{speeds[0]:.1f} and {speeds[1]:.1f} m/s, {event['impulse']:.0f} N s",
            )  # fmt: skip

    def _find_jumps(self, snapshot: Snapshot, look: _Look, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """False where a vehicle was set elsewhere since the last look."""
        moved = np.hypot(*(look.xy - self._columns.xy[look.rows]).T)
        jumped = known & (moved > JUMP + np.maximum(look.speed, self._columns.speed[look.rows]) * self._dt)
        for k in np.flatnonzero(jumped).tolist():
            self._counts["jumps"] += 1
            self._note("jump", snapshot, (self._id(snapshot, look, k),), look.xy[k], f"{moved[k]:.0f} m")
        return ~jumped

    def _measure_speed(self, look: _Look, known: NDArray[np.bool_]) -> None:
        s = self._sums
        limit = self.town.lanes.speed_limit[np.maximum(look.centre.lane, 0)]
        ratio = look.speed / limit
        s["vehicles"] += len(look.at)
        s["metres"] += float(np.hypot(*(look.xy - self._columns.xy[look.rows])[known].T).sum())
        s["ratio"] += float(ratio.sum())
        s["ratio_metres"] += float((ratio * look.speed).sum())
        s["speed"] += float(look.speed.sum())
        s["standing"] += float((look.speed < STANDING).sum())

    def _watch_lanes(self, snapshot: Snapshot, look: _Look, known: NDArray[np.bool_]) -> None:
        lanes, hits, c = self.town.lanes, look.centre, self._columns
        beyond = hits.distance - hits.width / 2.0
        off = beyond > POSE_UNIT  # the line between two lanes belongs to both
        self._sums["off"] += float(off.sum())
        self._worst["off"] = max(self._worst["off"], float(beyond.max(initial=0.0)))
        for k in np.flatnonzero(off & ~c.is_off[look.rows]).tolist():
            self._counts["off_lane"] += 1
            detail = f"{beyond[k]:.2f} m beyond lane {hits.lane[k]} at {look.speed[k]:.1f} m/s"
            self._note("off_lane", snapshot, (self._id(snapshot, look, k),), look.xy[k], detail)
        c.is_off[look.rows] = off
        outside = lanes.junction[hits.lane] < 0
        self._sums["against"] += float((outside & (np.cos(look.yaw - hits.yaw) < 0.0)).sum())
        before = c.lane[look.rows]
        beside = (before >= 0) & ((lanes.left[before] == hits.lane) | (lanes.right[before] == hits.lane))
        self._counts["lane_changes"] += int((known & beside).sum())

    def _watch_comfort(self, look: _Look, known: NDArray[np.bool_], turn: NDArray[np.float64]) -> None:
        c, rows = self._columns, look.rows
        acceleration = np.where(known, (look.speed - c.speed[rows]) / self._dt, np.nan)
        last = c.acceleration[rows]
        for name, threshold in (("harsh_brakes", HARSH), ("emergency_brakes", EMERGENCY)):
            self._counts[name] += int(((acceleration < threshold) & ~(last < threshold)).sum())
        jerk = (acceleration - last) / self._dt
        fine = np.isfinite(jerk)
        self._sums["jerk"] += float((jerk[fine] ** 2).sum())
        self._sums["jerks"] += float(fine.sum())
        side = np.abs(turn[known]) * look.speed[known]
        self._worst["side"] = max(self._worst["side"], float(side.max(initial=0.0)))
        c.acceleration[rows] = acceleration

    def _watch_lines(
        self,
        snapshot: Snapshot,
        look: _Look,
        known: NDArray[np.bool_],
        line: NDArray[np.int64],
        before: NDArray[np.float64],
    ) -> None:
        c, lines, rows = self._columns, self._lines, look.rows
        last = c.line[rows]
        near = known & (last >= 0) & (c.before[rows] < CROSSING_ZONE)
        crossed = near.copy()
        crossed[near] = lines.crossed(last[near], look.front_xy[near])
        for k in np.flatnonzero(crossed).tolist():
            light = int(lines.light[last[k]])
            self._counts["stop_chances" if light < 0 else "red_chances"] += 1
            if light >= 0:
                self._measure_headway(snapshot.tick, int(last[k]), light, bool(c.has_queued[rows[k]]))
            c.has_queued[rows[k]] = False
            if light < 0 and not c.has_halted[rows[k]]:
                self._counts["stop_signs"] += 1
                self._note("stop_sign", snapshot, (self._id(snapshot, look, k),), look.front_xy[k],
                           f"passed at {look.speed[k]:.1f} m/s")  # fmt: skip
            elif light >= 0 and self._is_red(light) and snapshot.lights[light] == LightState.RED:
                self._counts["red_lights"] += 1
                self._note("red_light", snapshot, (self._id(snapshot, look, k),), look.front_xy[k],
                           f"light {light} passed at {look.speed[k]:.1f} m/s")  # fmt: skip
        c.has_queued[rows] |= c.slowest[rows] < QUEUED
        in_zone = (line >= 0) & (before < HALT_ZONE)
        halts = in_zone & (c.slowest[rows] < HALTED)
        c.has_halted[rows] = (c.has_halted[rows] & in_zone & (line == last)) | halts

    def _measure_headway(self, tick: int, line: int, light: int, queued: bool) -> None:
        """Takes up the time between two vehicles of a queue that passed a line in the same green."""
        before = self._last_crossing.get(line, -1)
        self._last_crossing[line] = tick
        if queued and before > self._green_since[light] > 0:
            self._sums["headways"] += 1.0
            self._sums["headway"] += (tick - before) * DT

    def _note_greens(self, snapshot: Snapshot) -> None:
        if self._lights is not None:
            turned = (snapshot.lights == LightState.GREEN) & (self._lights != LightState.GREEN)
            self._green_since[turned] = snapshot.tick
        self._lights = snapshot.lights

    def _is_red(self, light: int) -> bool:
        """Whether the light was red at the last look: who crosses as it turns red came at yellow."""
        return self._lights is not None and self._lights[light] == LightState.RED

    def _watch_stops(self, snapshot: Snapshot, look: _Look, known: NDArray[np.bool_], line: NDArray[np.int64]) -> None:
        c, rows = self._columns, look.rows
        stands = known & (look.speed < STANDING)
        light = np.where(line >= 0, self._lines.light[line], -1) if len(self._lines.light) else np.full(len(rows), -1)
        held = (light >= 0) & (snapshot.lights[light] != LightState.GREEN) if len(snapshot.lights) else light >= 0
        for name, count, threshold, runs in (
            ("long_stop", "long_stops", LONG_STOP, ~held),
            ("blocked", "blocked", LONGEST_STOP, np.ones(len(rows), np.bool_)),
        ):
            column = c.still_free if name == "long_stop" else c.still
            was = column[rows]
            now = np.where(stands, was + self._dt * runs, 0.0)
            for k in np.flatnonzero((now >= threshold) & (was < threshold)).tolist():
                self._counts[count] += 1
                where = f"on lane {look.centre.lane[k]} at u {look.centre.u[k]:.1f}"
                self._note(name, snapshot, (self._id(snapshot, look, k),), look.xy[k], where)
            column[rows] = now
        self._worst["still"] = max(self._worst["still"], float(c.still[rows].max(initial=0.0)))

    def _find_near_misses(self, snapshot: Snapshot, turn: NDArray[np.float64]) -> None:
        pairs, time = boxes_about_to_meet(
            np.column_stack([snapshot.xy, snapshot.yaw]), snapshot.velocities[:, :2], np.nan_to_num(turn),
            snapshot.sizes[:, :2].astype(np.float64) / 2.0, snapshot.xyz[:, 2], NEAR_MISS_TIME, NEAR_MISS_SPEED,
        )  # fmt: skip
        is_traffic = snapshot.is_background & snapshot.is_vehicle
        for (a, b), after in zip(pairs, time, strict=True):
            if not (is_traffic[a] or is_traffic[b]):
                continue
            pair = (int(snapshot.ids[a]), int(snapshot.ids[b]))
            last = self._last_near_miss.get(pair, -(10**9))
            self._last_near_miss[pair] = snapshot.tick
            if (snapshot.tick - last) * DT < SAME_CONTACT:
                continue
            self._counts["near_misses"] += 1
            detail = f"{snapshot.speeds[a]:.1f} and {snapshot.speeds[b]:.1f} m/s, {after:.2f} s apart"
            self._note("near_miss", snapshot, pair, snapshot.xy[a], detail)

    def _turn_rates(self, snapshot: Snapshot) -> NDArray[np.float64]:
        """(N,) yaw rates [rad/s] of all actors since the last look; NaN for those that were not there."""
        c, rows = self._columns, snapshot.rows
        turned = np.mod(snapshot.yaw - c.yaw[rows] + np.pi, 2.0 * np.pi) - np.pi
        known = (c.seen[rows] >= 0) & (c.seen[rows] == snapshot.tick - self._every)
        c.yaw[rows], c.seen[rows] = snapshot.yaw, snapshot.tick
        return np.where(known, turned / self._dt, np.nan)

    def _id(self, snapshot: Snapshot, look: _Look, k: int) -> int:
        return int(snapshot.ids[look.at[k]])


def _contact_kind(roles: NDArray[np.uint8], classes: NDArray[np.uint8], other: int | None) -> str:
    """Counter of a contact of a vehicle of traffic with table row `other` (-1: the static world, None: another)."""
    if other is None:
        return "contacts"
    if other < 0 or roles[other] in (Role.PARKED, Role.PROP):
        return "static_hit"
    if classes[other] == ActorClass.WALKER and roles[other] == Role.TRAFFIC:
        return "walkers_hit"
    return "other_contacts"


def _part(hits: LaneHits, rows: slice) -> LaneHits:
    return LaneHits(**{name: column[rows] for name, column in vars(hits).items()})
