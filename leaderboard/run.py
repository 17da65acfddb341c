"""A run on disk: its folder, what is in it, and how it is read again for tables and reports."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lavsim.errors import OutputError
from leaderboard.record import RESULTS, RUN

LOGS, PICTURES, REPORT = "logs", "pictures", "report.html"
REPLAYS = "replays"  # a page for each drive, written with the report
COMPARISON = "comparison.html"
DRIVES = "drives"  # a file for each drive done: `leaderboard.checkpoint`
_OURS = (RESULTS, RUN, REPORT, COMPARISON, LOGS, PICTURES, REPLAYS, DRIVES)


@dataclass(frozen=True)
class Run:
    """What `lavsim score` leaves.

    Attributes:
        folder: Where it lies.
        results: Content of results.json, in the leaderboard's layout.
        run: Content of run.json: ours.
    """

    folder: Path
    results: dict[str, Any]
    run: dict[str, Any]

    @staticmethod
    def load(folder: Path) -> Run:
        """The run in `folder`.

        Raises:
            OutputError: there is none, or its files are not JSON.
        """
        contents = []
        for name in (RESULTS, RUN):
            try:
                contents.append(json.loads((folder / name).read_text()))
            except FileNotFoundError:
                raise OutputError(f"no run in {folder}: it has no {name}") from None
            except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
                raise OutputError(f"can't read {folder / name}: {error}") from None
        return Run(folder, *contents)

    @property
    def records(self) -> list[dict[str, Any]]:
        """The leaderboard's records, in order."""
        return list(self.results["_checkpoint"]["records"])

    @property
    def total(self) -> dict[str, Any]:
        """The leaderboard's global record; empty while the run goes on."""
        return dict(self.results["_checkpoint"]["global_record"])

    @property
    def mean(self) -> dict[str, float]:
        """Mean scores; empty while the run goes on."""
        return dict(self.total.get("scores_mean") or self.total.get("scores") or {})

    def of_one(self, record: dict[str, Any]) -> Run:
        """The same run as if it had this drive alone."""
        results = {**self.results, "_checkpoint": {**self.results["_checkpoint"], "records": [record]}}
        return Run(self.folder, results, {**self.run, "drives": [self.drive(record["index"])]})

    def drive(self, index: int) -> dict[str, Any]:
        """The run file's entry of a drive; empty if it has none."""
        return next((d for d in self.run.get("drives", []) if d["index"] == index), {})


def claim_folder(folder: Path, overwrite: bool, resume: bool = False) -> None:
    """Makes `folder` ready for a run.

    Args:
        folder: The run's.
        overwrite: Whether what an earlier run left there goes, and nothing else.
        resume: Whether it stays, to be gone on with.

    Raises:
        OutputError: it holds a run already, or can't be written.
    """
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder} is a file; a folder is expected")
        held = [] if resume else [folder / name for name in _OURS if (folder / name).exists()]
        if held and not overwrite:
            raise OutputError(
                f"{folder} already holds a run ({held[0].name}); give --resume, --overwrite or another folder"
            )
        for path in held:
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        for path in sorted(folder.rglob("*.partial")) if resume else ():  # a kill in the middle of writing
            path.unlink()
        for name in (LOGS, PICTURES, DRIVES):
            (folder / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"can't write to {folder}: {error.strerror}") from None
