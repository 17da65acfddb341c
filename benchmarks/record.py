"""The tracked record: a line of `record.jsonl` for each release or large change, and its plot in the documentation.

    python -m benchmarks.record --note "what changed" [--run "expert devtest=runs/0,runs/1"] [--repeats 3] [--no-bench]
    python -m benchmarks.record --plot

Figures of `lavsim bench` depend on the machine's pace of the moment, so what is kept is how often a thing is done while
a calibration loop runs once, on the same core, before and after: more is better, everywhere. The noise of a figure
comes from repeats, that of a score from its drives. `tests/test_record.py` fails when one falls by more than that.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

import lavsim
from leaderboard.run import Run

RECORD = Path(__file__).with_name("record.jsonl")
PLOT = Path(__file__).parents[1] / "docs" / "pictures" / "record.png"
LEAST_NOISE = 0.05  # of a bench figure
LEAST_SCORE_NOISE = 0.5  # points
WIDENED = 1.5  # the range of three repeats is 1.7 standard deviations: this makes 2.5 of it
_LOOPS, _ROUNDS = 20, 5  # 0.3 s a round


@dataclass(frozen=True)
class Figure:
    """What was measured.

    Attributes:
        value: More is better.
        noise: How much it may fall by chance: a share of a bench figure, points of a score.
        drives: Of a score.
    """

    value: float
    noise: float
    drives: int = 0


@dataclass(frozen=True)
class Line:
    """A line of the record.

    Attributes:
        commit: What was measured.
        date: Of the commit, ISO 8601.
        version: Of lavsim.
        note: What changed, in a few words.
        machine: Model of the processor; bench figures of two are not compared. Empty without any.
        loop_ms: Time of the calibration loop [ms]; 0 without bench figures.
        bench: Names of `lavsim bench` to how often it is done in one calibration loop; memory: runs in a gigabyte.
        scores: "agent routes" to the mean driving score.
        accepted: Names that may have fallen since the line before; the note says why.
    """

    commit: str
    date: str
    version: str
    note: str
    machine: str = ""
    loop_ms: float = 0.0
    bench: dict[str, Figure] = field(default_factory=dict)
    scores: dict[str, Figure] = field(default_factory=dict)
    accepted: tuple[str, ...] = ()

    @staticmethod
    def of(text: str) -> Line:
        """The line that `text` holds."""
        told = json.loads(text)
        for part in ("bench", "scores"):
            told[part] = {name: Figure(**figure) for name, figure in told[part].items()}
        return Line(**{**told, "accepted": tuple(told["accepted"])})

    def text(self) -> str:
        return json.dumps(asdict(self), ensure_ascii=False)


def read(path: Path = RECORD) -> list[Line]:
    """All lines, oldest first."""
    return [Line.of(text) for text in path.read_text(encoding="utf-8").splitlines()]


def falls(before: Line, after: Line) -> list[str]:
    """What fell by more than its noise and was not accepted, in words.

    Bench figures are compared only on one model of processor.
    """
    found = []
    if before.machine == after.machine:
        for name in before.bench.keys() & after.bench.keys():
            old, new = before.bench[name], after.bench[name]
            if new.value < old.value * (1.0 - old.noise):
                found.append(f"{name}: {new.value / old.value - 1.0:+.0%}, its noise is {old.noise:.0%}")
    for name in before.scores.keys() & after.scores.keys():
        old, new = before.scores[name], after.scores[name]
        if new.value < old.value - old.noise:
            found.append(f"{name}: {old.value:.1f} to {new.value:.1f}, its noise is {old.noise:.1f}")
    return sorted(text for text in found if text.partition(":")[0] not in after.accepted)


# ---- measuring


def calibration_loop() -> float:
    """Some of each kind of work that a tick is made of: plain Python, small arrays, and memory; 10 to 20 ms."""
    table: dict[int, float] = {}
    for k in range(20_000):
        table[k & 255] = table.get(k & 127, 1.0) * 0.5 + k
    points = np.linspace(0.0, 1.0, 192).reshape(64, 3)
    for _ in range(400):
        points = points @ np.eye(3) + 1e-6
        points = points[np.argsort(points[:, 0])]
    image = np.zeros((288, 256, 12))
    for _ in range(4):
        image = np.sqrt(image + 1.0)
    return float(image.sum() + points.sum() + sum(table.values()))


def loop_seconds() -> float:
    """Time of one calibration loop [s]: the median over rounds of their means, as the bench does it."""
    means = []
    for _ in range(_ROUNDS + 1):  # the first one warms up
        begun = time.perf_counter()
        for _ in range(_LOOPS):
            calibration_loop()
        means.append((time.perf_counter() - begun) / _LOOPS)
    return float(np.median(means[1:]))


def ratio(name: str, figure: float, loop: float) -> float:
    """A figure of the bench as it is kept; `loop` is the time of the calibration loop [s]."""
    if name.endswith("_per_s"):
        return figure * loop
    return 1e3 / figure if name.endswith("_mb") else 1e3 * loop / figure


def repeat() -> tuple[float, dict[str, float]]:
    """One run of the bench: time of the loop around it [s], and its figures as they are kept."""
    before = loop_seconds()
    done = subprocess.run([sys.executable, "-m", "lavsim", "bench", "--json"], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    loop = 0.5 * (before + loop_seconds())
    return loop, {name: ratio(name, figure, loop) for name, figure in json.loads(done.stdout).items()}


def bench_figures(repeats: Sequence[dict[str, float]]) -> dict[str, Figure]:
    """Medians over repeats, with their noise."""
    found = {}
    for name in repeats[0]:
        values = [figures[name] for figures in repeats]
        middle = float(np.median(values))
        found[name] = Figure(
            round(middle, 4), round(max(WIDENED * (max(values) - min(values)) / middle, LEAST_NOISE), 3)
        )
    return found


def measure(repeats: int) -> tuple[float, dict[str, Figure]]:
    """Time of the calibration loop [ms] and all bench figures of this checkout, on one core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    loops, figures = zip(*(repeat() for _ in range(repeats)), strict=True)
    return round(1e3 * float(np.median(loops)), 3), bench_figures(figures)


def score_of(folders: Iterable[Path]) -> Figure:
    """Mean driving score of runs, and twice its standard error over their drives."""
    scores = [record["scores"]["score_composed"] for folder in folders for record in Run.load(folder).records]
    error = float(np.std(scores, ddof=1)) / len(scores) ** 0.5 if len(scores) > 1 else 0.0
    return Figure(round(float(np.mean(scores)), 2), round(max(2.0 * error, LEAST_SCORE_NOISE), 2), len(scores))


def machine() -> str:
    """Model of the processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


# ---- the plot


_PARTS = {  # of a line: their titles and units
    "bench": ("Bench, against the first line: more is better", "%"),
    "scores": ("Scores", "driving score"),
}


def draw(lines: Sequence[Line], target: Path) -> None:
    """Bench figures against their first, and scores, from line to line; no part that has none."""
    from matplotlib.figure import Figure as Sheet

    parts = [part for part in _PARTS if any(getattr(line, part) for line in lines)]
    sheet = Sheet(figsize=(8.0, 0.7 + 3.0 * len(parts)), layout="constrained")
    names = [f"{line.commit[:7]}\n{line.date[5:16].replace('T', ' ')}" for line in lines]
    for part, axes in zip(parts, sheet.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0], strict=True):
        title, unit = _PARTS[part]
        found = [getattr(line, part) for line in lines]
        for name in sorted({name for figures in found for name in figures}):
            at = [k for k, figures in enumerate(found) if name in figures]
            values = np.array([found[k][name].value for k in at])
            noise = np.array([found[k][name].noise for k in at])
            if part == "bench":
                values, noise = 100.0 * values / values[0], 100.0 * values / values[0] * noise
            axes.errorbar(at, values, noise, marker="o", markersize=4, capsize=3, linewidth=1.2, label=name)
        axes.set_title(title, loc="left", fontsize=10)
        axes.set_ylabel(unit)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        if part == "scores":
            axes.set_ylim(-3.0, 105.0)
        axes.set_xlim(-0.5, len(lines) - 0.5)
        axes.set_xticks(range(len(lines)), names, fontsize=8)
    sheet.savefig(target, dpi=110)


def git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=RECORD.parent, capture_output=True, text=True, check=True).stdout.strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--note", help="what changed; without it nothing is appended")
    parser.add_argument("--run", action="append", default=[], metavar="'AGENT ROUTES=FOLDER,…'", help="runs to score")
    parser.add_argument("--repeats", type=int, default=3, help="of the bench, half a minute each")
    parser.add_argument("--no-bench", action="store_true", help="scores alone")
    parser.add_argument("--commit", default="HEAD", help="what the runs were driven with")
    parser.add_argument("--accept", action="append", default=[], metavar="NAME", help="may fall; the note says why")
    parser.add_argument("--plot", action="store_true", help="draws the record again")
    given = parser.parse_args()
    if given.note:
        scores = {name: score_of(map(Path, folders.split(","))) for name, _, folders in map(_parted, given.run)}
        loop, bench = (0.0, {}) if given.no_bench else measure(given.repeats)
        commit, date = git("show", "-s", "--format=%h %cI", given.commit).split()
        model = machine() if bench else ""
        line = Line(commit, date, lavsim.__version__, given.note, model, loop, bench, scores, tuple(given.accept))
        with RECORD.open("a", encoding="utf-8") as file:
            file.write(line.text() + "\n")
        print(line.text())
    if given.note or given.plot:
        draw(read(), PLOT)


def _parted(text: str) -> tuple[str, str, str]:
    return text.partition("=")


if __name__ == "__main__":
    main()
