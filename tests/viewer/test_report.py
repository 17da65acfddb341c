"""The report in a real browser: it complains of nothing, fits a phone, and leads to the moments of its drives."""

from __future__ import annotations

from pathlib import Path

import pytest

from leaderboard.report.page import write_report
from tests.browser import Window
from tests.leaderboard.runs import make_run
from tests.viewer import drives

PHONE = {"viewport": {"width": 390, "height": 844}, "color_scheme": "dark"}


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = make_run(tmp_path_factory.mktemp("run") / "a", agent=f"x:{drives.EVIL}", route_id=drives.EVIL)
    return write_report(made)


def test_infraction_opens_the_replay_at_its_moment(window: Window, report: Path) -> None:
    window.open(report)
    assert window.ask("window.evil") is None
    window.page.locator("#drive-1 .events a").nth(1).click()
    window.settle()
    assert window.ask("replay.state().tick") == 240
    assert window.page.locator("#events button").count() == 2
    window.page.go_back()
    window.page.locator("#drive-0 .head a").click()
    assert "<script>" in window.text("#title")
    assert window.ask("window.evil") is None


@pytest.mark.parametrize("window", [PHONE], indirect=True)
def test_report_fits_a_phone_in_the_dark(window: Window, report: Path) -> None:
    window.open(report)
    assert window.ask("document.documentElement.scrollWidth") == 390
    assert window.ask("getComputedStyle(document.body).backgroundColor") == "rgb(18, 22, 28)"
