"""The dataset card: `README.md`, with front matter as Hugging Face's hub reads it.

It says what is inside, how it was made, what the statistics are, and how to read it with and without this library. It
depends on the dataset's content alone: no clock, no path, no name of a folder.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from lavsim.dataset.codecs import find_codec
from lavsim.dataset.files import read_sealed, write_file
from lavsim.dataset.folder import CARD, PLAN
from lavsim.dataset.info import Summary, summarise
from lavsim.dataset.plan import PLAN_KEY, PLAN_SCHEMA, CollectPlan
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import FILES, SCHEMA_VERSION, TICKS_PER_FRAME, FieldSpec
from lavsim.dataset.stats import QUANTITIES
from lavsim.types import DT

LICENCE = "mit"  # that of the simulator, which owes nothing to others' assets
_SIZES = (
    (1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"),
    (10_000_000, "1M<n<10M"),
)  # fmt: skip


def write_card(root: Path) -> None:
    """Writes the card of a finished dataset.

    Raises:
        DatasetError: the dataset is damaged.
    """
    write_file(root / CARD, card_text(Dataset(root)).encode())


def card_text(dataset: Dataset) -> str:
    """The card."""
    summary = summarise(dataset)
    parts = [
        _front_matter(summary), _heading(summary), _contents(summary), _making(summary), _numbers(summary),
        _fields(dataset), _reading(dataset), _licence(),
    ]  # fmt: skip
    return "\n".join(part for part in parts if part)


def _front_matter(summary: Summary) -> str:
    frames = len(summary.dataset)
    size = next((name for limit, name in _SIZES if frames < limit), "n>10M")
    tags = ["autonomous-driving", "imitation-learning", "simulation", "lidar", "bird-eye-view", "lavsim"]
    lines = [
        "---",
        f"license: {LICENCE}",
        f"pretty_name: {json.dumps(_title(summary))}",
        "task_categories:",
        "- robotics",
        "size_categories:",
        f"- {size}",
        "tags:",
        *(f"- {tag}" for tag in tags),
    ]
    if summary.dataset.info.columns:
        lines += ["configs:", "- config_name: default", "  data_files: tables/*.parquet"]
    return "\n".join([*lines, "---", ""])


def _title(summary: Summary) -> str:
    towns = list(summary.towns)
    return f"Driving in {', '.join(towns)}" if towns else "Driving"


def _heading(summary: Summary) -> str:
    info = summary.dataset.info
    has = [name for name, is_there in (("logs of every tick", summary.has_logs), ("tables", bool(info.columns)),
                                       ("sensor readings", summary.dataset.has_blobs)) if is_there]  # fmt: skip
    return (
        f"# {_title(summary)}\n\n"
        f"Demonstrations of driving in simulated towns, recorded by lavsim {info.versions.get('lavsim', '')} at "
        f"{1.0 / (TICKS_PER_FRAME * DT):g} frames a second: {', '.join(has) or 'nothing yet'}.\n"
    )


def _contents(summary: Summary) -> str:
    found = summary.to_json()
    sizes = ", ".join(f"{kind} {_megabytes(size)}" for kind, size in found["bytes_by_kind"].items())
    rows = [
        ("frames", f"{found['frames']:,}"),
        ("episodes", f"{found['episodes']:,}"),
        ("driven", f"{found['hours']:.2f} h, {found['km']:.1f} km"),
        ("size", f"{_megabytes(found['bytes'])} ({sizes})" if sizes else _megabytes(found["bytes"])),
        ("a frame", f"{found['bytes_per_frame'] / 1000.0:.1f} kB"),
        ("weathers", _listed(found["weathers"], "frames")),
        ("how episodes ended", _listed(found["endings"], "")),
        ("schema version", str(SCHEMA_VERSION)),
    ]
    towns = [(name, str(t["episodes"]), f"{t['frames']:,}", f"{t['km']:.1f}") for name, t in found["towns"].items()]
    return "## Contents\n\n" + _table(("", ""), rows) + "\n" + _table(("town", "episodes", "frames", "km"), towns)


def _making(summary: Summary) -> str:
    dataset = summary.dataset
    info, path = dataset.info, dataset.root / PLAN
    lines = ["## How it was made", ""]
    if path.exists():
        plan = read_sealed(path, PLAN_KEY, PLAN_SCHEMA)["plan"]
        command = f"{CollectPlan.from_json(plan).command()} --out DATA"
        lines += ["```", command, "```", "", "Its plan, of which every episode is a pure function:", ""]
        lines += ["```json", json.dumps(plan, indent=1, sort_keys=True), "```", ""]
    elif info.config:
        lines += ["```json", json.dumps(dict(info.config), indent=1, sort_keys=True), "```", ""]
    versions = ", ".join(f"{name} {version}" for name, version in sorted(info.versions.items()))
    lines += [f"Seed {info.seed}. Versions: {versions or 'not told'}.", ""]
    return "\n".join(lines)


def _numbers(summary: Summary) -> str:
    if summary.statistics is None or not summary.statistics.frames:
        return ""
    found = summary.statistics.to_json()
    rows = []
    for name, numbers in found["quantities"].items():
        if numbers.get("count"):
            unit = f" [{numbers['unit']}]" if numbers["unit"] else ""
            about = QUANTITIES[name].about
            label = f"{name.replace('_', ' ')}{unit}" + (f" ({about})" if about else "")
            rows.append(
                (label, *(f"{numbers[key]:.4g}" for key in ("mean", "q05", "q25", "q50", "q75", "q95", "most")))
            )
    shares = [(name.replace("_", " "), _listed(counts, "")) for name, counts in found["shares"].items() if counts]
    seen = [
        (f"{ring['from_m']:.0f} to {ring['to_m']:.0f} m", f"{ring['vehicles']:,}",
         f"{100.0 * ring['seen'] / ring['vehicles']:.0f} %")
        for ring in found["vehicles_seen"] if ring["vehicles"] and summary.dataset.has_blobs
    ]  # fmt: skip
    text = "## Statistics\n\n" + _table(("", "mean", "5 %", "25 %", "50 %", "75 %", "95 %", "most"), rows) + "\n"
    text += _table(("", "frames, or actors in all frames"), shares) + "\n"
    if seen:
        text += _table(("vehicles at", "in all frames", "seen by a sensor"), seen) + "\n"
    return text


def _fields(dataset: Dataset) -> str:
    info = dataset.info
    text = ""
    for title, fields in (("Columns of the tables", info.columns), ("Sensor readings", info.blobs)):
        if fields:
            rows = [(f"`{f.name}`", f.dtype, _shape(f), f.unit, f.frame, f.codec, f.about) for f in fields]
            text += f"## {title}\n\n" + _table(("name", "type", "shape", "unit", "frame", "codec", "what"), rows) + "\n"
    return text


def _reading(dataset: Dataset) -> str:
    info = dataset.info
    files = [(kind, f"`{name.replace('{:06d}', '000000')}`") for kind, name in FILES.items()]
    codecs = {field.codec for field in info.blobs}
    lines = [
        "## How to read it", "",
        "```python",
        "from lavsim.dataset.reader import Dataset",
        "",
        'data = Dataset("path/to/it")',
        "episode, frame = data.locate(0)",
        "arrays = data.read(episode, frame)  # by name of the field, decoded",
        "```", "",
        "Without lavsim: an episode is there when its record is; the record names its files, their sizes and SHA-256. "
        "Tables are Parquet, a row a frame. Shards are plain tar files with WebDataset's names "
        "(`000123.rgb_0.jpg` is of frame 123); the index beside a shard is an NPY array of offset, size and CRC-32 of "
        "every member, a row a frame and a column a reading in the order below. `meta/info.json` says the same for "
        "programs.", "",
        _table(("file", "of the first episode"), files),
    ]  # fmt: skip
    if codecs:
        rows = [(name, f".{find_codec(name).suffix}", find_codec(name).about) for name in sorted(codecs)]
        lines.append(_table(("codec", "suffix", "what the bytes are"), rows))
    lines.append("World frame: x east, y south, yaw clockwise seen from above, metres and radians; the ego's frame is "
                 "x ahead, y right.\n")  # fmt: skip
    return "\n".join(lines)


def _licence() -> str:
    return (
        "## Licence\n\nMIT, as the simulator that made it: towns, vehicles and images are its own drawings, nothing "
        "was recorded in the real world, and no person is shown.\n"
    )


def _shape(field: FieldSpec) -> str:
    return " x ".join(map(str, field.shape)) or "1"


def _listed(counts: Mapping[str, int], what: str) -> str:
    return ", ".join(f"{name} {count:,} {what}".rstrip() for name, count in counts.items())


def _megabytes(size: int) -> str:
    return f"{size / 1e9:.2f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
