"""The command line: lists, and mistakes in one line; tests/test_interfaces.py has what all commands share."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib import resources
from pathlib import Path

import pytest

from lavsim.cli import main

ROUTE = """<routes traffic="empty">
  <route id="0" town="{town}">
    <waypoints><position x="{x}" y="0" z="0"/><position x="1" y="1" z="0"/></waypoints>
  </route>
</routes>"""


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a wrong command line says: one line on stderr, nothing on stdout, exit code 2."""
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    return lines[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["scoer"], ["scoer", "'score'"]),
        (["score"], ["--agent"]),
        (["score", "--agent", "agents.idle", "--seed", "x"], ["--seed", "integer"]),
        (["score", "--agent", "agents.idel:IdleAgent"], ["agents.idel", "agents.idle"]),
        (["score", "--agent", "agents.idle:IdelAgent"], ["IdelAgent", "IdleAgent"]),
        (["score", "--agent", "nowhere/agent.py"], ["nowhere"]),
        (["score", "--agent", "agents.idle", "--routes", "quik"], ["quik", "quick"]),
        (["score", "--agent", "agents.idle", "--rules", "1.5"], ["1.5", "2.1"]),
        (["score", "--agent", "agents.idle", "--route-ids", "77"], ["77", "quick.xml"]),
        (["score", "--agent", "agents.idle", "--traffic", "dense"], ["dense", "empty"]),
        (["score", "--agent", "agents.idle", "--sensors", "lva"], ["lva", "'lav'"]),
        (["score", "--agent", "agents.idle", "--track", "RAILS"], ["RAILS", "SENSORS"]),
        (["score", "--agent", "agents.idle", "--repetitions", "0"], ["repetitions", "0"]),
        (["towns", "--town-path", "/nowhere"], ["/nowhere"]),
        (["towns", "--check", "nowhere.xodr"], ["no file", "nowhere.xodr"]),
        (["show", "eu_smal_a"], ["eu_smal_a", "eu_small_a"]),
        (["show", "quick", "--route-ids", "9"], ["9", "quick.xml"]),
        (["routes", "quik"], ["quik", "quick"]),
        (["routes", "chekc", "quick"], ["chekc", "check"]),
        (["routes", "check", "nowhere.xml"], ["nowhere.xml"]),
        (["routes", "check"], ["file"]),
        (["routes", "make", "--out", "x.xml"], ["--town"]),
        (["routes", "make", "--town", "us_larg_a", "--out", "x.xml"], ["us_larg_a", "us_large_a"]),
        (
            ["routes", "make", "--town", "eu_small_a", "--out", "x.xml", "--length", "far"],
            ["--length", "500-2000", "far"],
        ),
        (["routes", "make", "--town", "eu_small_a", "--out", "x.xml", "--length", "900-500"], ["900-500"]),
        (["routes", "make", "--town", "eu_small_a", "--out", "x.xml", "--count", "0"], ["count", "0"]),
        (["routes", "make", "--town", "eu_small_a", "--out", "x.xml", "--traffic", "dense"], ["dense", "empty"]),
        (["routes", "make", "--town", "eu_small_a", "--out", "/nowhere/x.xml"], ["/nowhere"]),
        (["report", "/nowhere"], ["/nowhere"]),
    ],
)
def test_mistakes_get_one_line(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    if arguments[0] == "score":
        arguments = [*arguments, "--out", str(tmp_path / "run")]
    line = refusal(capsys, *arguments)
    assert line.startswith("lavsim: ")
    for word in words:
        assert word in line
    assert not (tmp_path / "run").exists(), "nothing is left by a run that never began"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<routes>", ["bad.xml"]),
        (ROUTE.format(town="eu_small", x=0), ["eu_small", "eu_small_a"]),
        (ROUTE.format(town="eu_small_a", x=99999), ["bad.xml", "waypoint 0", "off the nearest driving lane"]),
        (ROUTE.format(town="eu_small_a", x="one"), ["bad.xml", "line 3"]),
    ],
)
def test_mistakes_in_route_files_get_one_line(
    text: str, words: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "bad.xml").write_text(text)
    out = ["--out", str(tmp_path / "run")]
    line = refusal(capsys, "score", "--agent", "agents.idle", "--routes", str(tmp_path / "bad.xml"), *out)
    for word in words:
        assert word in line


def test_folder_that_holds_a_run_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text("{}")
    line = refusal(capsys, "score", "--agent", "agents.idle", "--out", str(tmp_path))
    assert "--overwrite" in line


def test_routes_of_one_file_are_listed_by_its_name_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["routes", "quick", "--json"]) == 0
    short = json.loads(capsys.readouterr().out)
    assert main(["routes", "list", "quick", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == short
    assert [entry["id"] for entry in short] == ["0", "1"]
    assert main(["routes", "--json"]) == 0
    assert {entry["file"] for entry in json.loads(capsys.readouterr().out)} > {"quick", "devtest"}


def test_made_routes_are_checked_and_not_overwritten(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    made = str(tmp_path / "mine.xml")
    make = [
        "routes",
        "make",
        "--town",
        "eu_small_a",
        "--count",
        "2",
        "--length",
        "500-700",
        "--seed",
        "3",
        "--out",
        made,
    ]
    assert main(make) == 0
    assert "2 routes" in capsys.readouterr().out
    assert "--overwrite" in refusal(capsys, *make)
    assert main([*make, "--overwrite"]) == 0
    capsys.readouterr()
    assert main(["routes", "check", made]) == 0
    assert "nothing is wrong" in capsys.readouterr().out


def test_checks_print_findings_and_exit_2(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "mine.xml"
    file.write_text(ROUTE.format(town="eu_smal_a", x=0))
    assert main(["routes", "check", str(file)]) == 2
    assert "Did you mean 'eu_small_a'" in capsys.readouterr().out
    assert main(["routes", "check", str(file), "--json"]) == 2
    assert "eu_smal_a" in json.loads(capsys.readouterr().out)[0]["finding"]
    town = tmp_path / "mine.xodr"
    town.write_text("<OpenDRIVE><road/></OpenDRIVE>")
    assert main(["towns", "--check", str(town)]) == 2
    assert "mine.xodr" in capsys.readouterr().out


def test_towns_come_with_split_and_layout(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["towns", "--json"]) == 0
    entries = {entry["name"]: entry for entry in json.loads(capsys.readouterr().out)}
    small = entries["eu_small_a"]
    assert small["split"] == "training"
    assert small["road_km"] >= 3.0
    assert small["junctions"] >= 8
    assert "T junctions" in small["layout"]


def test_towns_of_one_s_own_are_listed_drawn_and_driven_through(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    source = resources.files("lavsim.towns") / "eu_small_a.xodr"
    (tmp_path / "hamlet.xodr").write_bytes(source.read_bytes())
    search = ["--town-path", str(tmp_path)]
    assert main(["towns", "--json", *search]) == 0
    assert "hamlet" in {entry["name"] for entry in json.loads(capsys.readouterr().out)}
    made = str(tmp_path / "mine.xml")
    assert main(["routes", "make", "--town", "hamlet", "--count", "1", "--out", made, *search]) == 0
    capsys.readouterr()
    assert "hamlet" in refusal(capsys, "show", made, "--out", str(tmp_path))
    assert main(["show", made, "--out", str(tmp_path / "pictures"), *search]) == 0
    assert (tmp_path / "pictures" / "mine_000.png").exists()


def test_show_draws_a_town(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["show", "eu_small_a", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "eu_small_a.png").stat().st_size > 10_000
    assert "eu_small_a.png" in capsys.readouterr().out


def test_python_m_lavsim_runs_the_command_line() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "lavsim", "agents", "--json"], capture_output=True, text=True, check=True
    )
    assert "agents.behavior:BehaviorAgent" in {entry["agent"] for entry in json.loads(done.stdout)}
