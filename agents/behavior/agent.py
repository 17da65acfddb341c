"""The expert: drives its path by what it knows about everybody (`sensor.lavsim.truth`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.behavior.config import config_of
from agents.behavior.control import Controller
from agents.behavior.dash import PULL, Dash
from agents.behavior.detour import STANDOFF, Detour
from agents.behavior.forecast import Forecaster
from agents.behavior.hazards import BRISK, RANGE, Ego, meetings, pressed_by
from agents.behavior.labels import labels_of
from agents.behavior.manner import Manner
from agents.behavior.memory import Memory
from agents.behavior.path import STEP, PathTracker, ReferencePath, path_of_plan
from agents.behavior.road import StopPoint, limits_along, stop_points
from agents.behavior.sight import Seen
from agents.behavior.speed import speed_profile, stopping, time_along, towards
from agents.behavior.view import View, drawings_of
from agents.behavior.way import Way
from agents.privileged import PrivilegedAgent
from lavsim.drawings import Drawing
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.types import Control, LightState, RoadOption, Role

Floats = NDArray[np.float64]

LINE_GAP = 0.8  # [m] between bumper and stop line
YELLOW_BRAKING = 3.0  # [m/s²] it stops at yellow if that much suffices
LAST_BRAKING = 8.0  # [m/s²] or this much, if its rear would not be over the line before red
HELD_UP_BRAKING = 4.0  # [m/s²] or this much, once somebody has slowed it down so that it would be late
FIRM_BRAKING = 5.0  # [m/s²] where that suffices it counts on a short yellow
YELLOW, SHORT_YELLOW = 3.0, 2.0  # [s] CARLA's yellow, and that of hazards which set the lights
REAR_OVER = 0.3  # [m] that its rear may still have before a stop line for the line to count as crossed
CRAWLS = 2.0  # [m/s]
PULL_AWAY = 1.5  # [m/s²] it counts on
NOSE_OVER = 1.5  # [m] over a line at which it can stand in nobody's way: it then counts on a short yellow
OVER_LINE = 2.5  # [m] over a stop line at which it still stops for red: the rear decides
AT_REST = 0.05  # [m/s] below the 0.1 that counts as stopped
SIGN_REACH = 2.5  # [m] before the end of its lane a stop counts for a stop sign, by the stricter rules of 2.x
JUNCTION_OPTIONS = (RoadOption.LEFT, RoadOption.RIGHT, RoadOption.STRAIGHT)
DEFAULT_LIMIT = 30.0 / 3.6  # [m/s] without a map
BACKING_AFTER = 3.0  # [s] of standing before an obstacle
HURRIED = {"limit_share": 1.3, "limit_gap": 0.0, "top_speed": 25.0, "lateral": 3.0}  # with somebody at its back
CLOSE_UP = {"headway": 0.4, "standstill": 1.2}  # to who drives before it in a gap: who comes behind needs the room
LATE = 4.0  # [m/s²] it keeps off obstacles it wants to pass if that braking suffices
PATIENCE = 20.0  # [s] of standing for others after which it takes the smallest gaps


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "BehaviorAgent"


class BehaviorAgent(PrivilegedAgent):
    """Keeps lanes, turns, stops for lights, vehicles and walkers; on `Track.PRIVILEGED`."""

    radius = 200.0  # [m] to see who comes against it while it passes something

    def setup(self, path_to_conf_file: str | None) -> None:
        super().setup(path_to_conf_file)
        self.config = config_of(path_to_conf_file)
        self._seen = Seen(self.config.sight) if self.config.visible_only else None
        self._expert: Expert | None = None

    def sensors(self) -> list[dict[str, Any]]:
        (truth,) = super().sensors()
        return [{**truth, "visibility": True} if self.config.visible_only else truth]

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        truth = input_data["truth"][1]
        if self._seen is not None:
            truth = self._seen.filter(truth)
        if self._expert is None:
            self._expert = Expert(path_of_plan(self.dense_plan), load_town(truth["town"]), self.config.manner)
        return self._expert.drive(truth)

    def labels(self) -> dict[str, int | float | str]:
        """What it brakes for and how fast it wants to be, of the last step (`agents.behavior.labels`)."""
        return self._expert.labels() if self._expert is not None else {}

    def drawings(self) -> dict[str, Drawing]:
        """Its plan, its forecasts, and what it brakes for."""
        expert = self._expert
        return drawings_of(expert.view, expert.path) if expert is not None and expert.view is not None else {}


class Expert:
    """Drives one path.

    Args:
        path: What to drive.
        town: The town's map; without it there are no stop lines and no lanes of others.
        manner: How to drive.
    """

    def __init__(self, path: ReferencePath, town: TownMap | None, manner: Manner | None = None) -> None:
        self.manner = manner or Manner()
        limits = limits_along(path, town) if town is not None else np.full(len(path), DEFAULT_LIMIT)
        self.way = Way(path, limits, self.manner)
        self._hurried = speed_profile(path, limits, self.manner.changed(**HURRIED))
        stops: list[StopPoint] = stop_points(path, town) if town is not None else []
        self.stops = [stop for stop in stops if stop.light >= 0]
        self.signs = [stop for stop in stops if stop.light < 0]
        self.junctions = path.spans(JUNCTION_OPTIONS)
        lines = [*(stop.s for stop in stops), *(begin for begin, _ in self.junctions)]
        self.detour = Detour(self.way, town, lines)
        self._tracker = PathTracker(path)
        self._forecaster = Forecaster(town)
        self._memory = Memory()
        self._controller = Controller()
        self._dash = Dash()
        self._brisk = self.manner.changed(acceleration=max(self.manner.acceleration, BRISK))
        self._dashing = self.manner.changed(acceleration=max(self.manner.acceleration, PULL), **CLOSE_UP)
        self._goes: set[int] = set()  # stop lines it decided to cross at yellow
        self._yellow_since: dict[int, float] = {}
        self._signs_done = 0  # stop signs at which it has stood or which lie behind it
        self._waiting = 0.0  # [s] it has stood for others
        self._time = -math.inf
        self._stops = False  # whether that brings it to rest
        self.reason = ""  # what held it back last: for pictures and debugging
        self.view: View | None = None  # what it had in mind last

    def drive(self, truth: Mapping[str, Any]) -> Control:
        """The control for one tick of truth."""
        xyz, yaw = truth["xyz"], truth["yaw"]
        x, y = float(xyz[0, 0]), float(xyz[0, 1])
        path = self._tracker.path = self.way.path
        s, offset = self._tracker.update(x, y)
        speed = max(float(truth["ego_speed"]), 0.0)
        half = truth["sizes"][0] / 2.0
        ahead = s + 0.5 * speed
        wanted = path.at(self.way.profile, ahead + 0.5)
        ego = Ego(s, x, y, float(yaw[0]), speed, max(wanted, 1.0), float(half[0]), float(half[1]))

        presses = pressed_by(ego, xyz, yaw, truth["velocities"], truth["sizes"], truth["classes"])
        if presses > 0.0:  # drives away from it rather than to be run into
            wanted = max(wanted, min(presses + 0.5, path.at(self._hurried, ahead + 0.5)))
            ego = ego._replace(wanted=max(wanted, 1.0))
        if self._dash.is_on:  # keeps up with who drives before it in the gap
            ego = ego._replace(wanted=max(wanted, path.at(self._hurried, ahead + 0.5), 1.0))

        begin = max(int(s / STEP), 0)
        window = path.xy[begin : begin + int(RANGE / STEP)]
        memory = self._memory.update(truth)
        forecast = self._forecaster.update(truth, memory, window)
        patience = self._patience(truth, speed)
        yields = truth["roles"][forecast.row] == Role.TRAFFIC
        met = meetings(path, ego, forecast, self._dashing if self._dash.is_on else self.manner, patience, yields)
        kerb = met.kerb
        manner = self.manner if patience > 0.5 else self._brisk
        slope = (wanted - path.at(self.way.profile, s + 0.2)) / 0.5 if wanted < speed + 0.5 else 0.0
        bounds = [("free", towards(speed, min(wanted, kerb, self.detour.eases), min(slope, 0.0), manner), False)]
        dashes = self._dash.update(ego, met, forecast, yields, self._hurried, patience, self._time)
        if dashes:
            met = met.of_followed()
            hurried = min(path.at(self._hurried, ahead + 0.5), kerb)
            bounds = [("free", min((hurried - speed) / 0.4, self._dash.pull), False)]
        if len(met.acceleration):
            worst = int(np.argmin(met.acceleration))
            held_by = f"actor {int(truth['ids'][forecast.row[worst]])}"
            bounds.append((held_by, float(met.acceleration[worst]), math.isfinite(met.stop[worst])))
        self.detour.update(ego, truth, memory, _first_touched(met.first, forecast.row), met.is_faced, patience)
        bounds.append((f"actor {self.detour.waits_for}", self._gap_to_wait(ego), True))
        bounds.append(("light", self._lights(ego, truth["lights"]), True))
        bounds.append(("stop sign", self._stop_sign(ego), True))
        bounds.append(("junction", self._junction(ego, _held(met.stop, forecast.speed, patience)), True))
        bounds.append(("goal", stopping(speed, self.path.end + 8.0 - s, self.manner), True))
        if dashes:  # what only keeps to the usual acceleration holds nobody up
            bounds = [bound for bound in bounds if bound[0] == "free" or bound[1] < self.manner.acceleration - 0.01]
        self.reason, acceleration, self._stops = min(bounds, key=lambda bound: bound[1])
        self.view = View(truth, forecast, s, min(wanted, kerb), acceleration, self.reason)
        if self.detour.backs and self._waiting > BACKING_AFTER:
            return self._controller.back(float(truth["ego_speed"]))
        return self._controller.command(path, s, offset, ego.yaw, speed, acceleration, dashes)

    @property
    def path(self) -> ReferencePath:
        """What it drives now."""
        return self.way.path

    def labels(self) -> dict[str, int | float | str]:
        """What it brakes for and how fast it wants to be; empty before its first tick."""
        view = self.view
        return labels_of(view.truth, view.reason, view.acceleration, view.wanted, self._stops) if view else {}

    def _patience(self, truth: Mapping[str, Any], speed: float) -> float:
        """1 at first, down to 0 while it stands for other road users."""
        time = float(truth["time"])
        dt = min(max(time - self._time, 0.0), 0.5)
        self._time = time
        stands = speed < 0.3 and (self.reason.startswith("actor") or self.reason == "junction")
        self._waiting = self._waiting + dt if stands else max(0.0, self._waiting - dt * speed)
        return 1.0 - min(self._waiting / PATIENCE, 1.0)

    def _gap_to_wait(self, ego: Ego) -> float:
        """Acceleration that leaves it room to steer round what it waits before [m/s²]; inf where that is too late."""
        room = self.detour.waits - ego.s - ego.half_length
        if not math.isfinite(room) or room < -STANDOFF or ego.speed**2 > 2.0 * LATE * max(room, 0.3):
            return math.inf
        return max(stopping(ego.speed, room, self.manner), -LATE)

    def _lights(self, ego: Ego, lights: Any) -> float:
        """Acceleration that the lights ahead leave [m/s²]."""
        lowest = math.inf
        for number, stop in enumerate(self.stops):
            room = stop.s - ego.s - ego.half_length
            if room < -2.0 * ego.half_length + REAR_OVER:
                continue
            if room > 60.0:
                break
            state = int(lights[stop.light])
            if state == LightState.YELLOW:
                since = self._time - self._yellow_since.setdefault(number, self._time)
                if number not in self._goes and self._crosses_at_yellow(ego, room, since):
                    self._goes.add(number)
                could_stop = ego.speed < CRAWLS or ego.speed**2 < 2.0 * HELD_UP_BRAKING * (room - LINE_GAP)
                lasts = SHORT_YELLOW if room > -NOSE_OVER else YELLOW
                if could_stop and self._time_to_clear(ego, room) > lasts - since - 0.3:
                    self._goes.discard(number)  # somebody held it up: its rear would still be on the line at red
                if number in self._goes:
                    continue
            else:
                self._goes.discard(number)
                self._yellow_since.pop(number, None)
                if state != LightState.RED:
                    continue
                if room < 0.0 and ego.speed**2 > 2.0 * 9.0 * (room + 1.8 * ego.half_length - 0.5):
                    continue  # the rear would cross anyway
            painted = room - stop.before
            if painted > 0.0 and ego.speed**2 < 2.0 * YELLOW_BRAKING * painted:
                room = painted
            lowest = min(lowest, stopping(ego.speed, room - LINE_GAP, self.manner))
        return lowest

    def _stop_sign(self, ego: Ego) -> float:
        """Acceleration that the next stop sign leaves until the ego has stood before it [m/s²]."""
        while self._signs_done < len(self.signs):
            room = self.signs[self._signs_done].s - ego.s - ego.half_length
            if room >= -OVER_LINE and not (ego.speed < AT_REST and room < SIGN_REACH):
                return stopping(ego.speed, room - LINE_GAP, self.manner) if room < 60.0 else math.inf
            self._signs_done += 1
        return math.inf

    def _crosses_at_yellow(self, ego: Ego, room: float, since: float) -> bool:
        """Whether to go on with `room` metres to the line, `since` seconds into yellow."""
        needed = ego.speed**2 / (2.0 * max(room - 0.2, 0.05))
        if needed < YELLOW_BRAKING:
            return False
        lasts = YELLOW if needed > FIRM_BRAKING else SHORT_YELLOW
        pull = 0.0 if ego.speed > CRAWLS else PULL_AWAY  # who drives may be held to its speed by a bend behind the line
        return needed > LAST_BRAKING or self._time_to_clear(ego, room, pull) < lasts - since - 0.3

    def _time_to_clear(self, ego: Ego, room: float, pull: float = PULL_AWAY) -> float:
        """Seconds until its rear is over a line that its front reaches in `room` metres; bends on the way slow it."""
        return time_along(self.way.profile, ego.s, room + 2.0 * ego.half_length + 1.0, ego.speed, pull)

    def _junction(self, ego: Ego, stops: Floats) -> float:
        """Acceleration that keeps it out of a junction it could not leave [m/s²]."""
        front = ego.s + ego.half_length
        for begin, end in self.junctions:
            room = begin - front
            if room < 0.0:
                continue
            if room > 40.0:
                break
            if np.any((stops + ego.half_length > begin) & (stops - ego.half_length < end + 0.5)):
                distance = room - 0.5
                if ego.speed**2 <= 2.0 * 4.0 * max(distance, 0.3):
                    return stopping(ego.speed, distance, self.manner)
        return math.inf


def _held(stops: Floats, speeds: Floats, patience: float) -> Floats:
    """Places where the ego would come to rest in a junction; once it has waited it goes in to wait for who moves."""
    return stops if patience > 0.5 else np.where(speeds > 1.0, math.inf, stops)


def _first_touched(places: Floats, rows: NDArray[np.int64]) -> int:
    """Row of who stands or drives on the way first; -1 if nobody does."""
    if not len(places):
        return -1
    first = int(np.argmin(places))
    return int(rows[first]) if math.isfinite(places[first]) else -1
