"""Looks at a recorded drive: replay, film, film strip, contact sheet; what `lavsim show LOG` calls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from lavsim.errors import OutputError
from lavsim.log.drawings import SUFFIX
from lavsim.log.replay import draws_of
from lavsim.render.canvas import write_png
from lavsim.render.scene import get_scene
from lavsim.render.sheet import draw_sheet
from lavsim.viewer.film import Cut, Footage, write_film, write_strip
from lavsim.viewer.inner import InnerView
from lavsim.viewer.panes import render_panes
from lavsim.viewer.replay import write_replay
from lavsim.viewer.tracks import read_tracks
from leaderboard.recorded import RecordedDrive
from leaderboard.replay import story_of_log

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Wish:
    """What to make of a drive; None leaves it out.

    Attributes:
        html: The replay.
        video: A film: *.mp4, *.webm, *.gif.
        strip: A film strip around `at`, PNG.
        sheet: A contact sheet at `at`, PNG.
        at: Simulation time [s]; None: the first infraction, else the middle.
        panes: Whether replay and film show cameras and LiDAR.
        cut: What is filmed.
    """

    html: Path | None = None
    video: Path | None = None
    strip: Path | None = None
    sheet: Path | None = None
    at: float | None = None
    panes: bool = False
    cut: Cut = field(default_factory=Cut)


def show_log(path: Path, wish: Wish, town_path: Sequence[Path] = (), progress: Progress | None = None) -> list[Path]:
    """Makes what is wished for of the log at `path`; the files.

    Raises:
        LavsimError: the log can't be read, holds no tick to draw, or a file can't be written.
    """
    recorded = RecordedDrive.open(path, town_path)
    story = story_of_log(recorded)
    inner = InnerView.read(path.with_suffix(SUFFIX))
    snapshots = list(recorded.log)
    footage = Footage(snapshots, recorded.town, draws_of(recorded.log), recorded.route.points, inner)
    tick = next((event.tick for event in story.infractions), snapshots[len(snapshots) // 2].tick if snapshots else 0)
    at = wish.at if wish.at is not None else tick * 0.05
    made = []
    if wish.html is not None:
        panes = None
        if wish.panes and snapshots:
            panes = render_panes(recorded.town, snapshots, footage.draws, progress=_part(progress, "sensor panes"))
        header, tracks = recorded.log.header, read_tracks(snapshots)
        write_replay(wish.html, tracks, header, recorded.town, recorded.route, story, inner, panes)
        made.append(wish.html)
    for file in (wish.video, wish.strip, wish.sheet):
        if file is not None:
            _make_folder(file)
    if wish.video is not None:
        write_film(footage, wish.video, wish.cut, _part(progress, wish.video.name))
        made.append(wish.video)
    if wish.strip is not None:
        write_strip(footage, wish.strip, at)
        made.append(wish.strip)
    if wish.sheet is not None:
        index = footage.index_at(at)
        moments = snapshots[max(0, index - 1) : index + 1]  # two ticks: a whole turn of the LiDAR
        write_png(draw_sheet(get_scene(recorded.town), moments, recorded.route.points), wish.sheet)
        made.append(wish.sheet)
    return made


def _part(progress: Progress | None, name: str) -> Callable[[float], None] | None:
    return (lambda share: progress(name, share)) if progress is not None else None


def _make_folder(file: Path) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"can't write {file}: {error.strerror}") from None
