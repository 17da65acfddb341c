"""The replay in a real browser: what it shows, and that it shows it where it was."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lavsim.log.drawings import DrawingsWriter
from lavsim.viewer.inner import InnerView
from lavsim.viewer.page import SCRIPTS, page_of
from lavsim.viewer.replay import Event, Story, replay_page, write_replay
from lavsim.viewer.tracks import read_tracks
from tests.browser import Window
from tests.viewer import drives
from tests.viewer.test_drawings import some

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


def story(infractions: int = 2) -> Story:
    places = drives.tracks().xy
    return Story(
        title=f"Route {drives.EVIL}",
        subtitle="eu_small_a, seed 0",
        badge="Failed - Agent crashed",
        note=f"The agent ended it: {drives.EVIL}",
        infractions=[
            Event(
                drives.FIRST + 60 + k % 100, f"red light {drives.EVIL}", "Agent ran a red light", *places[60 + k % 100]
            )
            for k in range(infractions)
        ],
    )


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replay")
    writer = DrawingsWriter(folder / "a.lavdraw", some)
    writer.start(None)  # type: ignore[arg-type]
    for snapshot in drives.snapshots():
        writer.observe(snapshot)
    writer.finish(None)  # type: ignore[arg-type]
    inner = InnerView.read(folder / "a.lavdraw")
    write_replay(folder / "a.html", drives.tracks(), drives.HEADER, drives.town(), drives.route(), story(), inner)
    return folder / "a.html"


def expected(window: Window, index: int) -> dict[int, tuple[float, float]]:
    """Where each actor of a tick belongs on the screen, worked out from the snapshot and the camera's place."""
    view = window.ask("(({x, y, scale, angle, width, height, ahead}) => ({x, y, scale, angle, width, height, ahead}))"
                      "(replay.player.view)")  # fmt: skip
    snapshot = drives.snapshots()[index]
    turn = complex(math.cos(view["angle"]), math.sin(view["angle"])) * view["scale"]
    places = {}
    for actor, (x, y) in zip(snapshot.ids.tolist(), snapshot.xy.tolist(), strict=True):
        at = complex(x - view["x"], y - view["y"]) * turn
        places[actor] = (at.real + view["width"] / 2.0, at.imag + view["height"] * view["ahead"])
    return places


def test_page_holds_no_text_from_outside_but_its_title(page: Path) -> None:
    text = page.read_text()
    assert "<script>window.evil" not in text
    assert text.count("<script") == 2
    assert re.search(r"default-src 'none'; script-src 'sha256-[\w+/]+=*'; style-src", text)
    assert not re.search(r"""<[^>]*(src|href)=|https?:|@import|url\(""", text.split('id="data"')[0])
    assert page_of("<b>", "").count("<b>") == 0


def test_modules_import_only_what_stands_before_them() -> None:
    folder = Path(__file__).parents[2] / "lavsim/viewer/assets/js"
    assert sorted(SCRIPTS) == sorted(path.stem for path in folder.glob("*.js"))
    for number, name in enumerate(SCRIPTS):
        used = re.findall(r'from "\./(\w+)\.js"', (folder / f"{name}.js").read_text())
        assert set(used) <= set(SCRIPTS[:number]), name


@pytest.mark.parametrize("index", [0, 45, 79, 80, 150])
def test_actors_are_drawn_where_the_log_has_them(window: Window, page: Path, index: int) -> None:
    window.open(page, f"#t={(drives.FIRST + index) * 0.05}")
    for turn in ("", "replay.player.turn(false)", "replay.player.fit()", "replay.player.zoomMiddle(3.7)"):
        window.ask(turn or "0")
        window.settle()
        assert window.ask("replay.state().tick") == drives.FIRST + index
        places = expected(window, index)
        drawn = {actor["id"]: (actor["x"], actor["y"]) for actor in window.ask("replay.drawn()")}
        assert 1 in drawn or "zoom" in turn
        assert (1002 in drawn) <= (drives.VISITOR[0] <= index < drives.VISITOR[1])
        for actor, at in drawn.items():
            assert at == pytest.approx(places[actor], abs=0.5), (turn, actor)


def test_ego_s_pixels_lie_where_it_is(window: Window, page: Path) -> None:
    import cv2

    window.open(page, "#t=2.05")
    window.ask("document.querySelectorAll('#layers input').forEach((box) => box.checked && box.click())")
    window.ask("replay.player.select(-1)")
    window.settle()
    image = cv2.imdecode(np.frombuffer(window.page.locator("#map").screenshot(), np.uint8), cv2.IMREAD_COLOR)
    blue, green, red = (image[..., k].astype(int) for k in range(3))
    rows, columns = np.nonzero((abs(blue - 208) < 12) & (abs(green - 87) < 12) & (abs(red - 11) < 12))
    places = expected(window, 40)
    assert len(rows) > 200
    middle = (float(columns.min() + columns.max() + 1) / 2.0, float(rows.min() + rows.max() + 1) / 2.0)
    assert middle[0] == pytest.approx(places[1][0], abs=1.0)
    assert middle[1] == pytest.approx(places[1][1], abs=1.5)


def test_plays_steps_and_scrubs(window: Window, page: Path) -> None:
    window.open(page)
    keys = window.page.keyboard
    assert window.ask("replay.state().tick") == drives.FIRST
    keys.press("ArrowRight")
    assert window.ask("replay.state().tick") == drives.FIRST + 1
    keys.press("Shift+ArrowRight")
    assert window.ask("replay.state().tick") == drives.FIRST + 21
    window.page.click("#back")
    assert window.ask("replay.state().tick") == drives.FIRST + 20
    window.page.click("#play")
    window.until(f"replay.state().tick >= {drives.FIRST + 30}")
    keys.press("Space")
    window.until("!replay.state().isPlaying")
    box = window.page.locator("#timeline").bounding_box()
    window.page.mouse.click(box["x"] + box["width"] / 2.0, box["y"] + 45.0)
    assert window.ask("replay.state().tick") == pytest.approx(drives.FIRST + 99.5, abs=1.0)
    window.page.mouse.down()
    window.page.mouse.move(box["x"] + box["width"] / 4.0, box["y"] + 45.0, steps=3)
    window.page.mouse.up()
    assert window.ask("replay.state().tick") == pytest.approx(drives.FIRST + 49.0, abs=2.0)
    keys.press("End")
    assert window.ask("replay.state().tick") == drives.FIRST + drives.TICKS - 1


def test_infractions_lead_to_their_moment(window: Window, page: Path) -> None:
    window.open(page)
    events = window.page.locator("#events button")
    assert events.count() == 4  # two infractions, a hazard, a contact
    assert "<script>" in events.nth(1).inner_text()  # text it is, and text it stays
    window.page.locator("#events button", has_text="red light").first.click()
    assert window.ask("replay.state().tick") == drives.FIRST + 60
    window.page.locator("#events button", has_text="Contact with car 1000").click()
    assert window.ask("replay.state().tick") == drives.FIRST + drives.CONTACT
    box = window.page.locator("#timeline").bounding_box()
    x = window.ask(f"replay.player.timeline.x({drives.HAZARD[0]})")
    window.page.mouse.click(box["x"] + x + 3.0, box["y"] + 9.0)
    assert window.ask("replay.state().tick") == drives.FIRST + drives.HAZARD[0]
    assert window.text("#hud-state") == "DynamicObjectCrossing"
    assert window.ask("window.evil") is None


def test_inspector_tells_what_the_log_says(window: Window, page: Path) -> None:
    window.open(page, f"#t={(drives.FIRST + 130) * 0.05}")
    facts = window.text("#facts").split("\n")
    assert facts[facts.index("actor") + 1] == "1 (ego)"
    assert facts[facts.index("speed") + 1] == "21.6 km/h"
    window.ask("replay.player.select(1)")
    facts = window.text("#facts").split("\n")
    assert facts[facts.index("actor") + 1] == "1000 (traffic)"
    assert facts[facts.index("speed") + 1] == "7.2 km/h"
    assert facts[facts.index("lamps") + 1] == "brake"
    assert "<script>" in facts[facts.index("blueprint") + 1]
    window.page.keyboard.press("e")
    assert window.ask("replay.state().selected") == 1


def test_time_to_contact_is_that_of_moving_boxes(window: Window, page: Path) -> None:
    window.open(page, f"#t={(drives.FIRST + 20) * 0.05}")
    time_of = window.ask("replay.player.drive.nearestContact(20)")
    a, b = (drives.snapshots()[20].xy[k] for k in (0, 1))
    gap = float(np.hypot(*(b - a))) - 4.902 / 2.0 - 4.5 / 2.0
    assert time_of["id"] == 1000
    assert time_of["time"] == pytest.approx(gap / 4.0, abs=0.05)


def test_what_the_agent_showed_is_there(window: Window, page: Path) -> None:
    window.open(page, "#t=3")
    assert window.text("#scalars").split() == ["speed", "3.5", "m/s"]
    names = window.page.locator("#layers label").all_inner_texts()
    assert [name for name in names if name in ("plan", "seen", "dots", "heat")] == ["plan", "seen", "dots", "heat"]


def test_theme_follows_the_system_and_the_switch(window: Window, page: Path) -> None:
    window.open(page)
    back = "getComputedStyle(document.body).backgroundColor"
    seen = [(window.ask("replay.state().theme"), window.ask(back))]
    for _ in range(2):
        window.page.click("#theme")
        window.settle()
        seen.append((window.ask("replay.state().theme"), window.ask(back)))
    assert [theme for theme, _ in seen] == ["light", "light", "dark"]
    assert seen[0][1] != seen[2][1]
    window.page.click("#theme")
    window.page.emulate_media(color_scheme="dark")
    window.until("replay.state().theme === 'dark'")


@pytest.mark.parametrize("window", [PHONE], indirect=True)
def test_fits_a_phone(window: Window, page: Path) -> None:
    window.open(page)
    assert window.ask("document.documentElement.scrollWidth") == 390
    for name in ("#play", "#timeline", "#theme", "#speed", "#zoom-in"):
        box = window.page.locator(name).bounding_box()
        assert box["x"] >= 0.0
        assert box["x"] + box["width"] <= 390.0, name
    window.page.tap("#play")
    assert window.ask("replay.state().isPlaying")
    window.page.tap("#play")
    before = window.ask("replay.state().scale")
    _pinch(window, 100.0, 200.0)
    window.until(f"Math.abs(replay.state().scale / {before} - 2) < 0.02")


def _pinch(window: Window, begin: float, end: float) -> None:
    """Two fingers on the map, from one distance to another."""
    box = window.page.locator("#map").bounding_box()
    x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
    session = window.page.context.new_cdp_session(window.page)

    def touch(kind: str, gap: float) -> None:
        points: list[dict[str, Any]] = [] if kind == "touchEnd" else [
            {"x": x - gap / 2.0, "y": y, "id": 0}, {"x": x + gap / 2.0, "y": y, "id": 1}
        ]  # fmt: skip
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", begin)
    for share in np.linspace(0.2, 1.0, 5):
        touch("touchMove", begin + share * (end - begin))
    touch("touchEnd", end)


def test_wheel_zooms_where_it_points_and_a_drag_frees_the_camera(window: Window, page: Path) -> None:
    window.open(page)
    window.ask("replay.player.follow(false)")
    box = window.page.locator("#map").bounding_box()
    at = (200.0, 150.0)
    before = window.ask(f"replay.player.view.toWorld({at[0]}, {at[1]})")
    window.page.mouse.move(box["x"] + at[0], box["y"] + at[1])
    window.page.mouse.wheel(0, -400)
    window.until("replay.state().scale > 8")
    assert window.ask(f"replay.player.view.toWorld({at[0]}, {at[1]})") == pytest.approx(before, abs=0.1)
    window.ask("replay.player.follow(true)")
    window.page.mouse.down()
    window.page.mouse.move(box["x"] + 300.0, box["y"] + 250.0, steps=4)
    window.page.mouse.up()
    assert not window.ask("replay.state().isFollowing")


@pytest.mark.parametrize(("ticks", "infractions"), [(0, 0), (1, 0), (200, 400)])
def test_empty_short_and_eventful_drives_open(window: Window, tmp_path: Path, ticks: int, infractions: int) -> None:
    tracks = read_tracks(drives.snapshots()[:ticks])
    text = replay_page(tracks, {}, drives.town(), drives.route(), story(infractions))
    (tmp_path / "a.html").write_text(text)
    window.open(tmp_path / "a.html")
    assert window.page.locator("#events button").count() == infractions + (2 if ticks == 200 else 0)
    window.page.keyboard.press("ArrowRight")
    window.settle()
