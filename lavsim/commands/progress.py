"""Progress bars on stderr."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from leaderboard.evaluator import Progress


class Shares:
    """Progress of one thing after another on stderr."""

    def __enter__(self) -> Shares:
        from rich.console import Console
        from rich.progress import Progress as Bars
        from rich.progress import TextColumn

        columns = (*Bars.get_default_columns(), TextColumn("{task.fields[note]}"))
        self._bars = Bars(*columns, console=Console(stderr=True), transient=True)
        self._tasks: dict[str, Any] = {}
        if self._bars.console.is_terminal:
            self._bars.start()
        return self

    def update(self, name: str, share: float, note: str = "") -> None:
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(name, total=1.0, note=note)
        self._bars.update(self._tasks[name], completed=share, note=note)

    def __exit__(self, *_: object) -> None:
        if self._bars.live.is_started:
            self._bars.stop()


class ScoreBar:
    """Progress of a run on stderr: share of all drives, time left, and a line for each drive done."""

    def __enter__(self) -> ScoreBar:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Bars

        self._console = Console(stderr=True)
        self._bars = Bars(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
        )
        self._task = self._bars.add_task("preparing (the first run on a machine compiles for a minute)", total=1.0)
        self._told: set[int] = set()  # drives that have had their line
        if self._console.is_terminal:  # elsewhere a mistake found before the first drive gets its one line and no more
            self._bars.start()
        return self

    def update(self, progress: Progress) -> None:
        self._bars.start()
        records = progress.results.records
        for record in (r for r in records if r.index not in self._told):
            self._console.print(
                f"{len(records)}/{progress.total} {record.route_id}: {record.status}, "
                f"score {record.scores.composed:.1f}" + (f" ({progress.failure})" if progress.failure else ""),
                highlight=False,
                markup=False,
                soft_wrap=True,
            )
        self._told = {record.index for record in records}
        text = f"{progress.name} in {progress.town}, {progress.game_time:.0f} s" if progress.town else progress.name
        if records:
            text += f", mean score {sum(r.scores.composed for r in records) / len(records):.1f}"
        self._bars.update(self._task, description=text, completed=min(progress.share, 1.0))

    def __exit__(self, *_: object) -> None:
        if self._bars.live.is_started:
            self._bars.stop()
