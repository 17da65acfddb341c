"""The report and the table of a run."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rich.console import Console

from lavsim.drawings import polylines, scalar
from lavsim.errors import OutputError
from lavsim.executor import ProcessExecutor
from lavsim.log.drawings import SUFFIX, DrawingsWriter
from lavsim.log.reader import LogReader
from leaderboard.metrics import DriveMetrics
from leaderboard.report.markup import Markup, el, join
from leaderboard.report.page import page, write_report
from leaderboard.run import Run, claim_folder
from leaderboard.table import run_table
from tests.leaderboard.runs import make_run

EVIL = '<script>alert("1")</script>'


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return make_run(tmp_path_factory.mktemp("run") / "a", agent=f"x:{EVIL}", route_id=EVIL)


def test_elements_escape_texts_and_attributes() -> None:
    assert el("p", "<b>", class_='"x"') == '<p class="&quot;x&quot;">&lt;b&gt;</p>'
    assert el("p", [el("b", 1.0), None, " & "]) == "<p><b>1</b> &amp; </p>"
    assert el("img", alt=None, hidden=True, data_x=0.125) == '<img hidden data-x="0.12">'
    assert join("<", Markup("<br>")) == "&lt;<br>"


def test_report_escapes_what_comes_from_files_and_agents(run: Run) -> None:
    text = page(run)
    assert "<script" not in text
    assert "&lt;script&gt;alert(&quot;1&quot;)&lt;/script&gt;" in text
    assert "vehicle.&lt;b&gt;" in text


def test_report_is_the_same_whoever_reads_the_drives(run: Run) -> None:
    assert page(run, executor=ProcessExecutor(2)) == page(run)


def test_report_needs_nothing_outside_itself(run: Run) -> None:
    path = write_report(run)
    assert path == run.folder / "report.html"
    text = path.read_text()
    assert not re.search(r"""(src|href)=["'](?!data:|#|replays/RouteScenario_\d_rep0\.html)""", text)
    assert "http" not in text.replace("http-equiv", "").lower()
    assert text.count("<svg") == 18  # a map and five charts for each drive
    assert all((run.folder / "replays" / f"RouteScenario_{k}_rep0.html").is_file() for k in range(3))
    assert text.count("data:image/jpeg;base64,") == 3
    assert str(run.folder) not in text


def test_drawings_are_well_formed_and_mark_the_infractions(run: Run) -> None:
    drawings = re.findall(r"<svg.*?</svg>", page(run), re.DOTALL)
    maps = [ElementTree.fromstring(d) for d in drawings if 'class="map"' in d]
    assert len(maps) == 3
    marks = [[t.text for t in m.iter("text")] for m in maps]
    assert marks == [[], ["1", "2"], []]
    assert all(len(list(m.iter("polyline"))) > 10 for m in maps)  # roads, route, track


def test_report_survives_a_missing_log_and_picture(tmp_path: Path) -> None:
    made = make_run(tmp_path / "a")
    for file in [*(made.folder / "logs").iterdir(), *(made.folder / "pictures").iterdir()]:
        file.unlink()
    text = page(made)
    assert "can&#x27;t be shown" in text or "No recorded drive" in text


def test_table_has_a_row_for_each_drive_and_the_means(run: Run) -> None:
    console = Console(width=150, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(run_table(run))
    text = console.export_text()
    assert "1 vehicle, 1 red light" in text
    assert "Failed - Agent crashed" in text
    assert EVIL in text  # a route id is text, not console markup
    mean = run.mean["score_composed"]
    assert f"{mean:.1f}" in text
    assert "PRIVILEGED" in text


def test_run_is_loaded_or_its_absence_said(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"no run in .*: it has no results\.json"):
        Run.load(tmp_path)
    (tmp_path / "results.json").write_text("{")
    with pytest.raises(OutputError, match="can't read"):
        Run.load(tmp_path)


def test_folder_with_a_run_is_replaced_only_on_demand(tmp_path: Path) -> None:
    made = make_run(tmp_path / "a")
    (made.folder / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"already holds a run \(results\.json\); give --resume, --overwrite"):
        claim_folder(made.folder, overwrite=False)
    assert json.loads((made.folder / "results.json").read_text())
    claim_folder(made.folder, overwrite=True)
    assert sorted(p.name for p in made.folder.iterdir()) == ["drives", "logs", "notes.txt", "pictures"]
    assert not list((made.folder / "logs").iterdir())
    with pytest.raises(OutputError, match="is a file; a folder is expected"):
        claim_folder(made.folder / "notes.txt", overwrite=True)


def changed(made: Run, drive: int, **entries: object) -> Run:
    """A run with other entries in one drive of its run file."""
    drives = [{**d, **entries} if d["index"] == drive else d for d in made.run["drives"]]
    return Run(made.folder, made.results, {**made.run, "drives": drives})


def test_infractions_lead_into_the_replay(run: Run) -> None:
    write_report(run)
    text = page(run)
    assert 'href="replays/RouteScenario_1_rep0.html#t=6.00"' in text
    assert 'href="replays/RouteScenario_1_rep0.html#t=12.00"' in text


def test_report_of_hundreds_of_infractions_lists_all_and_draws_some(tmp_path: Path) -> None:
    made = make_run(tmp_path / "a")
    one = made.run["drives"][1]["infractions"][0]
    text = page(changed(made, 1, infractions=[{**one, "tick": 10 + k} for k in range(350)]))
    assert text.count('<span class="dot">') == 350
    assert text.count("<circle") < 250


def test_report_says_when_a_recording_is_cut_short(tmp_path: Path) -> None:
    made = make_run(tmp_path / "a")
    log = made.folder / made.run["drives"][1]["log"]
    log.write_bytes(log.read_bytes()[:-100])
    text = page(made)
    assert text.count("The recording is cut short.") == 1
    assert text.count("<svg") == 18


def test_what_the_agent_showed_is_in_the_report(tmp_path: Path) -> None:
    made = make_run(tmp_path / "a")
    log = made.folder / made.run["drives"][1]["log"]
    shown = {"speed <b>": scalar(3.0, "m/s"), "plan": polylines([[(0.0, 0.0), (9.0, 0.0)]], frame="ego")}
    writer = DrawingsWriter(log.with_suffix(SUFFIX), lambda: shown)
    writer.start(None)  # type: ignore[arg-type]
    for snapshot in LogReader(log):
        writer.observe(snapshot)
    writer.finish(None)  # type: ignore[arg-type]
    text = page(made)
    assert text.count("<svg") == 19
    assert "agent: speed &lt;b&gt; [m/s]" in text
    assert text.count("What the agent showed around 6.0 s.") == 1


def test_drive_that_never_began_is_reported(tmp_path: Path) -> None:
    made = make_run(tmp_path / "a")
    text = page(changed(made, 2, log=None, picture=None, agent_message=f"set-up raised {EVIL}"))
    assert "No recorded drive." in text
    assert "<script" not in text


def test_repetitions_of_a_route_get_mean_and_deviation(run: Run) -> None:
    assert "deviation" not in page(run).split("<h2>Routes</h2>")[1].split("<h2>")[0]
    text = page(changed(changed(run, 1, route="7"), 2, route="7", repetition=1))
    part = text.split("<h2>Routes</h2>")[1].split("<h2>")[0]
    assert "Route 7" in part
    assert "deviation" in part


def test_what_was_measured_beside_the_score_is_told(tmp_path: Path) -> None:
    run = make_run(tmp_path)
    assert "Beside the score" not in page(run), "a results file alone has no measures"
    measures = {"success_rate": 50.0, "efficiency": None, "smoothness": 81.25, "abilities": {"Overtaking": 25.0}}
    run.run["metrics"] = measures
    run.run["drives"][0]["metrics"] = DriveMetrics(least_distance=1.5, harsh_brakings=3).to_json()
    text = page(run)
    for told in ("50.0 %", "- %", "81.2 %", "overtaking ability", "25.0 %", ">1.50<", ">3<"):
        assert told in text, told
