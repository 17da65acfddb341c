"""The live page in a real browser: what it shows, and what it makes of keys, clicks and a phone."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed")

from lavsim.live.page import OWN_SCRIPTS, live_page
from lavsim.live.server import LiveServer
from lavsim.live.session import Session
from lavsim.live.stream import scene_message
from lavsim.viewer.page import SHARED_SCRIPTS
from tests.browser import Window
from tests.live.drives import RouteDriver, session
from tests.viewer.drives import EVIL

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True, "color_scheme": "dark"}


class Opened:
    """A session with its page in a window."""

    def __init__(self, live: Session, window: Window, is_keyboard: bool) -> None:
        simulation = live.simulation
        scene = scene_message(simulation.town, simulation.route, f"Route {EVIL}", "eu_small_a", is_keyboard)
        self.live, self.window = live, window
        self.server = LiveServer(live, scene)
        live.start()
        window.page.goto(self.server.address)
        window.settle()

    def close(self) -> None:
        self.window.page.goto("about:blank")
        self.server.close()
        self.live.close()

    def at(self, condition: str) -> None:
        """Waits until a condition on the page's state `s` holds and all is drawn."""
        self.window.until(f"(s => s.isSettled && ({condition}))(replay.state())")


@pytest.fixture
def keys(window: Window, tmp_path: Path) -> Iterator[Opened]:
    """A drive at the keys."""
    opened = Opened(session(tmp_path), window, True)
    yield opened
    opened.close()


@pytest.fixture
def watched(window: Window, tmp_path: Path) -> Iterator[Opened]:
    """An agent that shows its plan."""
    opened = Opened(session(tmp_path, RouteDriver()), window, False)
    yield opened
    opened.close()


def test_modules_are_the_replays_and_import_only_what_stands_before_them() -> None:
    folder = Path(__file__).parents[2] / "lavsim/viewer/assets"
    assert sorted(OWN_SCRIPTS) == sorted(path.stem for path in (folder / "live").glob("*.js"))
    order = [*(f"../js/{name}" for name in SHARED_SCRIPTS), *(f"./{name}" for name in OWN_SCRIPTS)]
    for name in OWN_SCRIPTS:
        used = re.findall(r'from "(.+)\.js"', (folder / "live" / f"{name}.js").read_text())
        assert set(used) <= set(order[: order.index(f"./{name}")])


def test_page_needs_nothing_from_elsewhere() -> None:
    text, policy = live_page()
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "connect-src 'self'" in policy
    assert not re.search(r"""<[^>]*src=|https?:|@import|url\(""", text)


def test_everybody_is_drawn_where_the_newest_tick_has_them(watched: Opened) -> None:
    window = watched.window
    window.page.click("#step")
    watched.at("s.tick === 2")
    view = window.ask("(({x, y, scale, angle, width, height, ahead}) => ({x, y, scale, angle, width, height, ahead}))"
                      "(replay.player.view)")  # fmt: skip
    drawn = {actor["id"]: (actor["x"], actor["y"]) for actor in window.ask("replay.drawn()")}
    snapshot = watched.live.view.snapshot
    turn = complex(math.cos(view["angle"]), math.sin(view["angle"])) * view["scale"]
    assert len(drawn) > 1
    for actor, (x, y) in zip(snapshot.ids.tolist(), snapshot.xy.tolist(), strict=True):
        at = complex(x - view["x"], y - view["y"]) * turn
        if actor in drawn:
            assert drawn[actor] == pytest.approx(
                (at.real + view["width"] / 2.0, at.imag + view["height"] * view["ahead"]), abs=0.01
            )


def test_agents_view_and_texts_from_outside_are_shown_as_they_are(watched: Opened) -> None:
    window = watched.window
    assert window.text("#title") == f"Route {EVIL}"
    for tick in range(2, 7):
        window.page.click("#step")
        watched.at(f"s.tick === {tick}")
    window.until("replay.player.inner.names.includes('plan')")
    assert "wanted speed" in window.text("#inner")
    assert not window.page.locator("#pad").is_visible()
    assert not window.page.locator("#reverse").is_visible()


def test_keys_drive(keys: Opened) -> None:
    page = keys.window.page
    page.keyboard.down("ArrowUp")
    page.keyboard.press("Space")
    keys.window.until("replay.state().tick > 25")
    page.keyboard.up("ArrowUp")
    page.keyboard.press("Space")
    keys.at("s.paused")
    snapshots = keys.live.history.snapshots
    assert max(float(s.control[0]) for s in snapshots) == 1.0
    assert snapshots[-1].ego.speed > 1.0
    assert keys.window.text("#badge") == "paused"
    page.keyboard.press("r")
    keys.at("s.reverse")


def test_past_is_looked_at_and_gone_on_from(keys: Opened) -> None:
    page = keys.window.page
    for tick in range(2, 12):
        page.click("#step")
        keys.at(f"s.tick === {tick}")
    page.evaluate("past.value = 5, past.dispatchEvent(new Event('input'))")
    keys.at("s.tick === 5")
    assert "0.30 s before" in keys.window.text("#note")
    page.keyboard.press(".")
    keys.at("s.tick === 6 && s.last === 11")
    page.click("#fork")
    keys.at("s.tick === 6 && s.last === 6")
    assert keys.window.text("#told") == "on from 0.30 s"
    page.fill("#seed", "7")
    page.click("#restart")
    keys.at("s.seed === 7 && s.last === 1")


def test_save_and_hazards(keys: Opened, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lavsim.live.session.kinds", lambda: ["DynamicObjectCrossing"])
    page, window = keys.window.page, keys.window
    page.click("#find")
    window.until("!!document.querySelector('#places button')")
    page.click("#places button")
    window.until("told.textContent.includes('m ahead')")
    page.click("#step")
    keys.at("s.tick === 2")
    assert "DynamicObjectCrossing set" in window.text("#events")
    page.click("#save")
    window.until("told.textContent.startsWith('Saved')")
    assert [path.name for path in tmp_path.iterdir()] == [window.text("#told").removeprefix("Saved ")]


@pytest.mark.parametrize("window", [PHONE], indirect=True)
def test_phone_shows_all_of_it_and_drives_by_touch(keys: Opened) -> None:
    window = keys.window
    assert window.ask("document.documentElement.scrollWidth") <= 390
    assert window.ask("document.documentElement.dataset.theme") == "dark"
    outside: Any = window.ask(
        "[...document.querySelectorAll('button, input, select')].filter(e => e.offsetParent && "
        "(b => b.right > 390.5 || b.left < 0)(e.getBoundingClientRect())).map(e => e.id)"
    )
    assert outside == []
    box = window.page.locator("[data-hold=throttle]").bounding_box()
    window.page.mouse.move(box["x"] + 20, box["y"] + 20)
    window.page.mouse.down()
    window.page.locator("#step").dispatch_event("click")
    keys.at("s.tick === 2")
    window.page.mouse.up()
    assert float(keys.live.view.snapshot.control[0]) > 0.0
