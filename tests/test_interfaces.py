"""What people and programs expect of a command: completion, JSON of every listing, colours that can be had without."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from rich.text import Text

from lavsim.cli import main
from lavsim.commands.base import app, print_rich
from tests.leaderboard.runs import make_run

# Commands that print what there is, what is so or what is wrong, with arguments for a run here; None where another
# test has the data: tests/dataset/test_commands.py, and `bench` takes half a minute.
LISTINGS: dict[str, list[str] | None] = {
    "towns": [],
    "agents": [],
    "sensors": [],
    "scenarios": [],
    "routes": [],
    "routes list": ["quick"],
    "routes check": ["quick"],
    "report": ["{run}"],
    "dataset info": None,
    "dataset check": None,
    "bench": None,
}
OTHERS = {
    "ablate", "collect", "fork", "render", "score", "rescore", "merge", "show", "train", "view", "export-scene",
    "dataset merge", "dataset split", "dataset show", "dataset export", "dataset import", "routes make",
}  # fmt: skip


def commands(group: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """All commands below a group by their names, with groups that do something of their own."""
    for word, command in group.commands.items():
        full = f"{name} {word}".strip()
        if not isinstance(command, typer.core.TyperGroup) or command.invoke_without_command:
            yield full, command
        if isinstance(command, typer.core.TyperGroup):
            yield from commands(command, full)


def test_every_command_that_lists_takes_json() -> None:
    found = dict(commands(typer.main.get_command(app)))
    unknown = set(found) - set(LISTINGS) - OTHERS
    assert not unknown, f"say whether they list something: {unknown}"
    for name in LISTINGS:
        assert "--json" in [option for parameter in found[name].params for option in parameter.opts], name


@pytest.mark.parametrize("name", [name for name, arguments in LISTINGS.items() if arguments is not None])
def test_json_of_a_listing_is_one_array_and_nothing_else(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = LISTINGS[name] or []
    if "{run}" in arguments:
        arguments = [str(make_run(tmp_path).folder)]
    assert main([*name.split(), *arguments, "--json"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    found = json.loads(said.out)
    assert isinstance(found, list)
    assert all(isinstance(entry, dict) for entry in found)
    assert found or name == "routes check"
    assert main([*name.split(), *arguments]) == 0
    if name not in ("report", "routes check"):
        assert str(next(iter(found[0].values()))) in capsys.readouterr().out


def test_report_tells_programs_what_its_table_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = make_run(tmp_path)
    assert main(["report", str(run.folder), "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert told["mean"] == run.mean
    assert [drive["status"] for drive in told["drives"]] == [record["status"] for record in run.records]
    assert told["drives"][1]["infractions"] == {"collisions_vehicle": 1, "red_light": 1}


@pytest.mark.parametrize(("no_color", "is_coloured"), [(None, True), ("1", False)])
def test_no_color_takes_the_colours_away(
    no_color: str | None, is_coloured: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    if no_color is not None:
        monkeypatch.setenv("NO_COLOR", no_color)
    print_rich(Text("Completed", style="green"))
    assert ("\x1b[32m" in capsys.readouterr().out) == is_coloured


def test_pipes_get_no_escape_codes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(make_run(tmp_path).folder)]) == 0
    assert "\x1b" not in capsys.readouterr().out


def test_interrupted_ends_with_130(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted() -> list[tuple[str, str]]:
        raise KeyboardInterrupt

    monkeypatch.setattr("lavsim.agent_source.packaged_agents", interrupted)
    assert main(["agents"]) == 130
    assert capsys.readouterr().err in ("", "lavsim: interrupted\n")  # Typer's later versions take it themselves


def test_chosen_hazards_that_have_no_room_are_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file is not written: who asked for hazards would drive without."""
    words = ["routes", "make", "--town", "eu_small_a", "--count", "1", "--out", str(tmp_path / "r.xml")]
    assert main([*words, "--hazard", "Accident"]) == 2
    assert "no route has room for Accident" in capsys.readouterr().err
    assert not (tmp_path / "r.xml").exists()
    assert main([*words, "--hazard", "DynamicObjectCrossing"]) == 0
    assert (tmp_path / "r.xml").is_file()


# ---- completion


@pytest.fixture(scope="module")
def bash(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Runs lines in a bash with a home of its own, where `lavsim` is this tree's."""
    if shutil.which("bash") is None:
        pytest.skip("there is no bash on this machine")
    folder = tmp_path_factory.mktemp("shell")
    command = folder / "lavsim"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m lavsim "$@"\n', encoding="utf-8")
    command.chmod(0o755)
    environment = {**os.environ, "HOME": str(folder), "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}

    def run(text: str) -> str:
        # A bash that has one command becomes it, and which shell asks is told from the parent.
        done = subprocess.run(
            ["bash", "-c", f"{text}\nexit $?"], env=environment, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def test_completion_is_installed_and_offers_what_ships(bash: Any) -> None:
    bash("lavsim --install-completion bash")
    asked = {
        "lavsim scen": ["scenarios"],
        "lavsim dataset m": ["merge"],
        "lavsim score --route": ["--routes", "--route-ids"],
        "lavsim score --routes q": ["quick"],
        "lavsim score --agent agents.beh": ["agents.behavior"],
        "lavsim rescore run --rules 2": ["2.0", "2.1"],
        "lavsim show eu_": ["eu_small_a", "eu_small_b"],
        "lavsim routes check no-such": [],
    }
    lines = ["source ~/.bashrc"]
    for typed in asked:
        lines += [f"COMP_WORDS=({typed}); COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 ))"]
        lines += ["_lavsim_completion lavsim; echo ${COMPREPLY[@]}"]
    said = bash("\n".join(lines)).splitlines()
    assert dict(zip(asked, map(str.split, said), strict=True)) == asked


def test_completion_is_shown_for_other_shells(bash: Any) -> None:
    for shell in ("zsh", "fish"):
        assert "_LAVSIM_COMPLETE" in bash(f"lavsim --show-completion {shell}")
