"""A window of a real browser, as `tests/conftest.py` opens it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any


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
