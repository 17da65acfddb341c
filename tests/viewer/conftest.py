"""A real browser, where there is one: Debian's chromium, driven by Playwright."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)


class Window:
    """A page in the browser and all it said.

    Attributes:
        page: Playwright's page.
        said: Errors and warnings of the console, and exceptions.
    """

    def __init__(self, page: Any) -> None:
        self.page = page
        self.said: list[str] = []
        page.on("console", lambda m: self.said.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: self.said.append(str(error)))

    def open(self, path: Path, fragment: str = "") -> None:
        """Opens a file and waits until a replay in it is drawn."""
        self.page.goto(path.resolve().as_uri() + fragment)
        if self.page.query_selector("#data, #map"):
            self.settle()

    def settle(self) -> None:
        """Waits until everything is drawn."""
        self.until("!!window.replay && replay.state().isSettled")

    def until(self, script: str, limit: float = 30.0) -> None:
        """Waits until a script's value is true."""
        end = time.monotonic() + limit
        while not self._holds(script):
            assert time.monotonic() < end, f"never came true: {script}; the page said {self.said}"
            time.sleep(0.02)

    def _holds(self, script: str) -> bool:
        from playwright.sync_api import Error

        try:
            return bool(self.page.evaluate(script))
        except Error as error:
            if "context was destroyed" not in str(error):  # a link was clicked: the next page will tell
                raise
            return False

    def text(self, selector: str) -> str:
        """Text of an element, once everything is drawn: a page that shows a new moment writes it in its next frame."""
        self.settle()
        return str(self.page.locator(selector).inner_text())

    def ask(self, script: str) -> Any:
        """Value of a script."""
        return self.page.evaluate(script)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Headless Chromium."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("there is no chromium on this machine (Debian: apt install chromium)")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()


@pytest.fixture
def window(browser: Any, request: pytest.FixtureRequest) -> Iterator[Window]:
    """A fresh window, 1280 x 800 and light; parameters (indirect) replace that. It must not have complained."""
    options: dict[str, Any] = {"viewport": {"width": 1280, "height": 800}, "color_scheme": "light"}
    context = browser.new_context(**{**options, **getattr(request, "param", {})})
    made = Window(context.new_page())
    yield made
    context.close()
    assert made.said == []
