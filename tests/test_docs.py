"""The documentation: its commands are ones the program has, its code compiles, its links lead somewhere."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import typer

import lavsim
from lavsim.cli import main
from lavsim.commands.base import app
from lavsim.scenarios.base import SCENARIOS
from lavsim.sensors.base import SENSORS
from leaderboard.criteria.base import CRITERIA
from leaderboard.routes import route_files

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
QUICK_START = ROOT / "docs" / "quickstart.md"
SMALL = 30_000  # bytes
CHEAP = ("(towns|routes|agents|sensors|scenarios) --json", "--version")  # listings, run as they stand

_FENCE = re.compile(r"(?:<!-- (?P<mark>[^>]*?) -->\n)?^```(?P<language>\w*)[^\n]*\n(?P<text>.*?)^```$", re.M | re.S)
_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ (.*)$", re.M)


@dataclass(frozen=True)
class Block:
    """A fenced block: where, in what language, what a comment before it says of it, and its text."""

    page: Path
    line: int
    language: str
    mark: str
    text: str

    @property
    def place(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> Iterator[Block]:
    text = page.read_text(encoding="utf-8")
    for found in _FENCE.finditer(text):
        line = text.count("\n", 0, found.start("text"))
        yield Block(page, line, found["language"], found["mark"] or "", found["text"])


def commands_of(text: str) -> Iterator[str]:
    """Lines that begin with lavsim, joined where they are continued, without what is said beside them."""
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("lavsim "):
            yield re.split(r"\s{3,}(?![A-Z])|\s+#\s", line)[0].strip()


ALL_BLOCKS = [block for page in PAGES for block in blocks(page)]
COMMANDS = sorted({(command, block.place) for block in ALL_BLOCKS for command in commands_of(block.text)})
PYTHON = [block for block in ALL_BLOCKS if block.language == "python"]


@cache
def program() -> Any:
    return typer.main.get_command(app)


def problem_of(command: str) -> str | None:
    """Why the program would not take a command of the documentation; None if it would.

    `…` stands for what a reader fills in, `[--resume]` for what may be left out, `info|check` and `towns | routes` for
    either; with any of these only names are checked, without them values too.
    """
    is_whole = not re.search(r"[…|\[\]]", command)
    words = [re.sub(r"[\[\]…]", "", word) for word in shlex.split(command)[1:]]
    group, targets = program(), []
    while words and not words[0].startswith("-") and isinstance(group, typer.core.TyperGroup):
        if group.name == "routes" and words[0] not in group.commands:  # `lavsim routes FILE`
            break
        names = words.pop(0).split("|")
        while len(words) > 1 and words[0] == "|" and not words[1].startswith("-"):
            names.append(words[1])
            del words[:2]
        for name in names:
            if name not in group.commands:
                return f"no command {name!r}"
        targets = [group.commands[name] for name in names]
        group = targets[0]
    context = typer.Context(group, info_name="lavsim")
    known = {name for each in targets or [group] for option in each.get_params(context) for name in option.opts}
    for word in "|".join(words).split("|"):
        if word.startswith("--") and word.split("=")[0] not in known:
            return f"no option {word}"
    if is_whole and targets and not isinstance(group, typer.core.TyperGroup) and "--help" not in words:
        try:
            group.make_context(group.name, list(words))
        except Exception as error:
            return str(error)
    return None


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("lavsim score --agent a.py --routes quick --seed 1", None),
        ("lavsim score … --resume", None),
        ("lavsim collect … --log-only | --resume", None),
        ("lavsim towns | routes | agents", None),
        ("lavsim routes quick", None),
        ("lavsim dataset info|check DATA", None),
        ("lavsim routes make --town a --out b.xml", None),
        ("lavsim scores", "no command 'scores'"),
        ("lavsim dataset info|chek DATA", "no command 'chek'"),
        ("lavsim score … --resumee", "no option --resumee"),
        ("lavsim score --agent a.py --seed one", "integer"),
        ("lavsim score --routes quick", "agent"),
        ("lavsim collect --out d --worker 2", "no option --worker"),
    ],
)
def test_checker_tells_right_commands_from_wrong(command: str, says: str | None) -> None:
    found = problem_of(command)
    assert (found is None) if says is None else (found is not None and says in found), found


def test_commands_are_ones_the_program_has() -> None:
    assert len(COMMANDS) > 100
    wrong = [f"{place}: {command}: {why}" for command, place in COMMANDS if (why := problem_of(command)) is not None]
    assert not wrong, "\n".join(wrong)


def test_listings_run(capsys: pytest.CaptureFixture[str]) -> None:
    cheap = sorted({c for c, _ in COMMANDS if re.fullmatch(rf"lavsim (?:{'|'.join(CHEAP)})", c)})
    assert {"lavsim towns --json", "lavsim --version"} <= set(cheap)
    for command in cheap:
        assert main(shlex.split(command)[1:]) == 0, command
        said = capsys.readouterr().out
        assert json.loads(said) if command.endswith("--json") else said.strip() == lavsim.__version__, command


def test_no_line_of_a_block_is_left_out() -> None:
    """What is neither checked as a command nor compiled must say that it is only `text`."""
    others = {"python", "make", "pip", ".", "mkdir"}
    for block in ALL_BLOCKS:
        if block.language in ("python", "xml", "toml", "text"):
            continue
        assert block.language in ("", "bash"), f"{block.place}: who checks {block.language!r}?"
        for line in block.text.replace("\\\n", " ").splitlines():
            words = [word for word in line.split() if not re.fullmatch(r"[A-Z_]+=\S+", word)]
            assert not words or words[0] in {"lavsim", *others}, f"{block.place}: {line}"


def test_scripts_modules_and_targets_exist() -> None:
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for name in re.findall(r"\bpython ([\w/]+\.py)\b", text):
            assert (ROOT / name).is_file() or name == "my_agent.py", f"{page.name}: {name}"
        for name in re.findall(r"\bpython -m ((?:benchmarks|examples|lavsim)[\w.]*)", text):
            path = ROOT / name.rstrip(".").replace(".", "/")
            assert path.with_suffix(".py").is_file() or path.is_dir(), f"{page.name}: python -m {name}"
        for name in re.findall(r"^make ([\w-]+)|`make ([\w-]+)`", text, re.M):
            assert "".join(name) in targets, f"{page.name}: make {name}"


def test_every_benchmark_has_its_command() -> None:
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    scripts = [p for p in (ROOT / "benchmarks").glob("*.py") if 'if __name__ == "__main__"' in p.read_text("utf-8")]
    assert len(scripts) > 15
    assert not [p.stem for p in scripts if f"benchmarks/{p.name}" not in page and f"benchmarks.{p.stem}" not in page]


def test_xml_and_toml_are_well_formed() -> None:
    for block in ALL_BLOCKS:
        if block.language == "xml":
            ElementTree.fromstring(block.text)
        elif block.language == "toml":
            tomllib.loads(block.text)


def test_python_compiles() -> None:
    for block in PYTHON:
        compile("\n" * block.line + block.text, block.place, "exec")


@pytest.mark.parametrize("block", [b for b in PYTHON if b.mark == "runnable"], ids=lambda block: block.place)
def test_runnable_python_runs(block: Block) -> None:
    exec(compile("\n" * block.line + block.text, block.place, "exec"), {"__name__": "docs"})


def slug(heading: str) -> str:
    """The anchor of a heading, as GitHub and MkDocs make it."""
    plain = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
    return re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", plain).strip())


def test_links_lead_to_files_and_headings() -> None:
    wrong = []
    for page in PAGES:
        text = _FENCE.sub("", page.read_text(encoding="utf-8"))
        for link in _LINK.findall(text):
            if re.match(r"[a-z]+:", link):
                continue
            name, _, anchor = link.partition("#")
            target = (page.parent / name).resolve() if name else page
            if not target.exists():
                wrong.append(f"{page.relative_to(ROOT)}: {link}")
            elif anchor and target.suffix == ".md":
                headings = {slug(h) for h in _HEADING.findall(_FENCE.sub("", target.read_text(encoding="utf-8")))}
                if anchor not in headings:
                    wrong.append(f"{page.relative_to(ROOT)}: {link} has no such heading")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("reference/sensors.md", list(SENSORS)),
        ("reference/criteria.md", list(CRITERIA)),
        ("reference/routes.md", route_files()),
        ("hazards.md", [key[1] for key in SCENARIOS if isinstance(key, tuple) and key[0] == "2.x"]),
        ("scenarios.md", [key[1] for key in SCENARIOS if isinstance(key, tuple) and key[0] == "1.0"]),
        ("reference/commands.md", [f"lavsim {name}" for name in program().commands]),
    ],
)
def test_reference_names_everything_there_is(page: str, names: list[Any]) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    missing = [name for name in names if str(name) not in text]
    if page == "scenarios.md":  # "Scenario7 to 9"
        missing = [name for name in missing if name not in ("Scenario8", "Scenario9")]
    assert not missing


def test_everything_there_is_has_its_picture() -> None:
    shown = {link for page in PAGES for link in _LINK.findall(page.read_text(encoding="utf-8"))}
    kinds = [key[1] for key in SCENARIOS if isinstance(key, tuple) and key[0] in ("1.0", "2.x")]
    assert not [kind for kind in kinds if f"pictures/hazards/{kind}.jpg" not in shown]
    criteria = (ROOT / "docs" / "reference" / "criteria.md").read_text(encoding="utf-8")
    for name in map(str, CRITERIA):
        shows = rf"^### `{name}`\n\n!\[{name}: [^\]]+\]\(../pictures/criteria/{name}\.jpg\)"
        assert re.search(shows, criteria, re.M), name
    assert not [file for file in route_files() if f"../pictures/routes-{file}.jpg" not in shown]
    sensors = (ROOT / "docs" / "reference" / "sensors.md").read_text(encoding="utf-8")
    assert f"![A reading of each of the {len(list(SENSORS))} sensors](" in sensors, "draw the sheet again"


def test_pictures_of_which_there_are_many_are_small() -> None:
    folders = [ROOT / "docs" / "pictures" / name for name in ("hazards", "criteria")]
    assert not [p.name for folder in folders for p in folder.iterdir() if p.stat().st_size > SMALL]


def test_every_page_is_in_the_site() -> None:
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in (ROOT / "docs").rglob("*.md"):
        assert page.relative_to(ROOT / "docs").as_posix() in nav, page


def test_versions_agree() -> None:
    for name in ("CITATION.cff", "pyproject.toml"):
        found = re.search(r"^version\s*[:=]\s*\"?([^\"\n]+)", (ROOT / name).read_text(encoding="utf-8"), re.M)
        assert found is not None
        assert found[1] == lavsim.__version__, name


@pytest.mark.slow
def test_quick_start_works_to_its_end(tmp_path: Path) -> None:
    """Every `lavsim` command of it in order, in a folder that holds what a clone would; `make` has run before."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    for block in blocks(QUICK_START):
        if block.mark.startswith("file: "):
            (tmp_path / block.mark.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
        for command in commands_of(block.text):
            words = [sys.executable, "-m", "lavsim", *shlex.split(command)[1:]]
            done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=600)
            assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    for name in (
        "runs/pictures/eu_small_a.png",
        "runs/mine/report.html",
        "runs/comparison.html",
        "data/first/README.md",
    ):
        assert (tmp_path / name).is_file(), name


@pytest.mark.slow
def test_site_builds_without_warnings(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="the site needs the extra 'docs'")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    outside = [
        f"{page.name}: {url}"
        for page in (tmp_path / "site").rglob("*.html")
        for url in re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=\"(https?:[^\"]+)\"", page.read_text("utf-8"))
    ]
    assert not outside
