"""The part of a report that tells of one drive, and the replay it leads to."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.errors import LavsimError
from lavsim.executor import Report
from lavsim.log.drawings import SUFFIX
from lavsim.log.replay import draws_of
from lavsim.types import DT
from lavsim.viewer.film import Footage, draw_strip
from lavsim.viewer.inner import InnerView
from lavsim.viewer.replay import write_replay
from lavsim.viewer.tracks import Tracks, read_tracks
from leaderboard.recorded import RecordedDrive
from leaderboard.replay import story_of
from leaderboard.report.charts import charts, scalar_charts
from leaderboard.report.drawing import map_drawing
from leaderboard.report.hazards import Tallies, count_hazards
from leaderboard.report.markup import Markup, el, join
from leaderboard.report.series import series_of
from leaderboard.rules import get_rules
from leaderboard.run import REPLAYS, Run
from leaderboard.table import short_name

_JPEG_QUALITY = 86  # of embedded pictures; the files beside are lossless
_MOST_MARKS = 200  # infractions drawn on maps and charts; the list has all


@dataclass(frozen=True)
class PartTask:
    """A drive to be told of: its place in the report, the run with this drive alone, and whether it gets a replay."""

    index: int
    run: Run
    with_replay: bool


class Part(NamedTuple):
    """What is told of a drive: its section, and what hazards it met."""

    section: Markup
    tallies: Tallies


def part_of(task: PartTask, _: Report) -> Part:
    """Reads a drive, writes its replay where one is asked for, and tells of it.

    One at a time in a process: a drive's numbers take tens of megabytes.
    """
    drive, tallies = DriveReport(task.run, task.run.records[0], task.with_replay), Tallies()
    drive.count(tallies)
    return Part(drive.section(), tallies)


def lost_part(task: PartTask, reason: str) -> Part:
    """What is told of a drive that could not be read."""
    record = task.run.records[0]
    return Part(el("section", el("h3", drive_name(task.run, record)), el("p", reason), class_="card drive"), {})


class DriveReport:
    """One drive of a run, read once.

    Args:
        run: The run.
        record: The leaderboard's record of the drive.
        with_replay: Whether its replay is written (again).

    Attributes:
        replay: Address of the replay, seen from the report; None if there is none.
    """

    def __init__(self, run: Run, record: dict[str, Any], with_replay: bool) -> None:
        self.run, self.record = run, record
        self.drive = run.drive(record["index"])
        self.infractions: list[dict[str, Any]] = self.drive.get("infractions", [])
        self.problem = ""
        self.replay: str | None = None
        self._recorded: RecordedDrive | None = None
        self._tracks: Tracks | None = None
        self._inner: InnerView | None = None
        if not self.drive.get("log"):
            self.problem = "No recorded drive."
            return
        try:
            self._recorded = RecordedDrive.open(run.folder / self.drive["log"], _town_path(run))
            self._tracks = read_tracks(self._recorded.log)
            self._inner = InnerView.read(self._recorded.log.path.with_suffix(SUFFIX))
            if with_replay:
                self._write_replay(self._recorded, self._tracks)
        except LavsimError as error:
            self.problem = f"The recorded drive can't be shown: {error}"
            return
        if (run.folder / REPLAYS / self._replay_name).is_file():
            self.replay = f"{REPLAYS}/{self._replay_name}"

    @property
    def _replay_name(self) -> str:
        return f"{Path(str(self.drive['log'])).stem}.html"

    def _write_replay(self, recorded: RecordedDrive, tracks: Tracks) -> None:
        path = self.run.folder / REPLAYS / self._replay_name
        story = story_of(recorded.log, self.drive, self.record, self.run)
        write_replay(path, tracks, recorded.log.header, recorded.town, recorded.route, story, self._inner)

    def count(self, tallies: Tallies) -> None:
        """Adds its hazards to `tallies`."""
        if self._tracks is not None and self._recorded is not None and not self.problem:
            score = float(self.record["scores"]["score_composed"])
            count_hazards(tallies, self._tracks, self._recorded.log.header, self.infractions, score)

    def moment(self, tick: int) -> str | None:
        """Address of a moment in the replay."""
        return f"{self.replay}#t={tick * DT:.2f}" if self.replay is not None else None

    def section(self) -> Markup:
        """All there is to see of the drive."""
        scores, meta = self.record["scores"], self.record["meta"]
        facts = [
            ("score", f"{scores['score_composed']:.2f}"),
            ("completion", f"{scores['score_route']:.2f} %"),
            ("penalty", f"{scores['score_penalty']:.4f}"),
            ("route", f"{self.drive.get('dense_length', meta['route_length']):.0f} m"),
            ("time", duration(meta["duration_game"])),
            ("seed", str(self.drive.get("seed", "?"))),
            ("traffic", str(self.drive.get("traffic", "?"))),
            ("speed of simulation", f"{self.drive.get('real_time_factor', 0.0):.1f} x real time"),
        ]
        message = self.drive.get("agent_message")
        link = el("a", "Open the replay", href=self.replay) if self.replay else None
        return el(
            "section",
            el("div", el("h3", drive_name(self.run, self.record)),
               el("span", self.drive.get("town", ""), class_="soft"), pill(self.record["status"]), link, class_="head"),
            el("p", [el("span", el("span", f"{name} ", class_="soft"), value) for name, value in facts],
               class_="facts small"),
            el("p", "The agent ended it: ", el("span", message, class_="mono")) if message else None,
            el("p", "The recording is cut short.", class_="soft") if self._is_cut else None,
            self._pictures(),
            class_="card drive",
            id=f"drive-{self.record['index']}",
        )  # fmt: skip

    @property
    def _is_cut(self) -> bool:
        return self._recorded is not None and self._recorded.log.status is None

    def _pictures(self) -> Markup:
        drawn, lines = self._from_log()
        pair = el("div", el("div", drawn, self._events()), el("div", lines), class_="pair")
        return join(pair, self._strip(), self._sheet())

    def _events(self) -> Markup:
        if not self.infractions:
            return el("p", "No infractions.", class_="soft events")
        entries = []
        for number, entry in enumerate(self.infractions, 1):
            when = duration(int(entry["tick"]) * DT)
            address = self.moment(int(entry["tick"]))
            what = el("b", short_name(entry["key"]).capitalize())
            moment = el("a", f"at {when}", href=address) if address else f"at {when}"
            text = el("div", el("p", what, " ", moment), el("p", entry["message"], class_="soft small"))
            entries.append(el("li", el("span", str(number), class_="dot"), text))
        return el("ol", entries, class_="events")

    def _from_log(self) -> tuple[Markup, list[Markup]]:
        """The map and the charts."""
        recorded, tracks = self._recorded, self._tracks
        if self.problem or recorded is None or tracks is None:
            return el("p", self.problem or "No recorded drive.", class_="soft"), []
        marked = self.infractions[:_MOST_MARKS]
        driven = tracks.xy[tracks.ego]
        drawing = map_drawing(recorded.town, recorded.route, driven, marked)
        caption = el(
            "figcaption", "Dashed: the route. Solid: what was driven. Ringed: start (blue) and target (green)."
        )
        if not len(tracks):
            return el("figure", drawing, caption), [el("p", "The agent never came to drive.", class_="soft")]
        rules = get_rules(self.run.run.get("rules", "1.0"))
        final = float(self.record["scores"]["score_composed"])
        series = series_of(tracks, recorded.route, self.infractions, rules, final)
        lines = charts(series, marked) + (scalar_charts(self._inner, marked) if self._inner is not None else [])
        return el("figure", drawing, caption), lines

    def _sheet(self) -> Markup | None:
        path = self.run.folder / str(self.drive.get("picture"))
        image = cv2.imread(str(path)) if self.drive.get("picture") and path.is_file() else None
        if image is None:
            return None
        return _embedded(image, "Contact sheet: bird's-eye view, cameras and LiDAR")

    def _strip(self) -> Markup | None:
        """What the agent showed around the first infraction, or where it braked hardest."""
        recorded, tracks = self._recorded, self._tracks
        if self._inner is None or not self._inner.frames or self.problem or recorded is None or not tracks:
            return None
        hardest = int(tracks.ticks[int(np.argmin(tracks.motion[:, 0]))])
        tick = next((int(entry["tick"]) for entry in self.infractions), hardest)
        footage = Footage(recorded.log, recorded.town, draws_of(recorded.log), recorded.route.points, self._inner)
        caption = el("figcaption", f"What the agent showed around {duration(tick * DT)}.")
        return el("div", _embedded(draw_strip(footage, tick * DT), "Film strip with the agent's drawings"), caption)


def _embedded(image: NDArray[np.uint8], alt: str) -> Markup:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    source = "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
    height, width = image.shape[:2]
    return el("figure", el("img", src=source, alt=alt, width=width, height=height, loading="lazy"), class_="sheet")


def pill(status: str) -> Markup:
    """A status as a coloured label."""
    return el("span", status, class_="pill good" if status in ("Completed", "Perfect") else "pill bad")


def drive_name(run: Run, record: dict[str, Any]) -> str:
    """What a drive is called: its route, and its repetition where there are several."""
    drive = run.drive(record["index"])
    name = f"Route {drive.get('route', record['route_id'])}"
    repeated = int(run.run.get("config", {}).get("repetitions", 1)) > 1
    return f"{name}, repetition {drive.get('repetition', 0)}" if repeated else name


def duration(seconds: float) -> str:
    """ "12.5 s" or "2:05.0 min"."""
    return f"{seconds:.1f} s" if seconds < 60.0 else f"{int(seconds // 60)}:{seconds % 60:04.1f} min"


def _town_path(run: Run) -> tuple[Path, ...]:
    return tuple(Path(p) for p in run.run.get("config", {}).get("town_path", ()))
