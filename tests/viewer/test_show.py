"""`lavsim show LOG`: what it makes, and what it says about mistakes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from lavsim.cli import main
from lavsim.log.writer import LogWriter
from lavsim.viewer.pack import unpack
from leaderboard.run import Run
from tests.drives import TOWN
from tests.leaderboard.runs import make_run
from tests.viewer import drives


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return make_run(tmp_path_factory.mktemp("run") / "a")


def log_of(run: Run) -> str:
    return str(run.folder / run.run["drives"][1]["log"])


def test_log_of_a_run_is_shown_with_what_the_run_found(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [tmp_path / name for name in ("a.html", "a.gif", "a.png")]
    options = ["--html", str(files[0]), "--video", str(files[1]), "--strip", str(files[2])]
    assert main(["show", log_of(run), *options, "--from", "1", "--to", "2"]) == 0
    assert capsys.readouterr().out.split() == [str(file) for file in files]
    assert all(file.stat().st_size > 1000 for file in files)
    meta, _ = unpack(files[0].read_text().split('id="data">')[1].split("<")[0])
    assert [event["tick"] for event in meta["infractions"]] == [120, 240]
    assert meta["badge"] == {"text": "Completed", "good": True}


def test_log_alone_is_judged_again(tmp_path: Path) -> None:
    alone = tmp_path / "alone.lavlog"
    header = {"town": TOWN, "keypoints": drives.route().keypoints.tolist(), "seed": 0, "rules": "1.0"}
    writer = LogWriter(alone)
    writer.start(SimpleNamespace(header=lambda: header))  # type: ignore[arg-type]
    for snapshot in drives.snapshots():
        writer.observe(snapshot)
    writer.finish(SimpleNamespace(summary=dict))  # type: ignore[arg-type]
    alone.write_bytes(alone.read_bytes()[:-5])  # and cut short
    assert main(["show", str(alone), "--html", str(tmp_path / "a.html")]) == 0
    meta, _ = unpack((tmp_path / "a.html").read_text().split('id="data">')[1].split("<")[0])
    assert meta["note"] == "The recording is cut short."
    assert [event["name"] for event in meta["infractions"]] == ["vehicle"]
    assert meta["infractions"][0]["tick"] == drives.FIRST + drives.CONTACT


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--video", "a.avi"], [".mp4", "a.avi"]),
        (["--video", "a.gif", "--speed", "0"], ["--speed", "0"]),
        (["--video", "a.gif", "--from", "x"], ["--from", "number"]),
    ],
)
def test_mistakes_get_one_line(
    run: Run, options: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["show", log_of(run), *options]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert all(word in said[0] for word in words)
    assert main(["show", "nowhere.lavlog"]) == 2
    assert "nowhere.lavlog" in capsys.readouterr().err
