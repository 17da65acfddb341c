"""One task list on one process, several, or a cluster."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from lavsim.errors import ConfigError
from lavsim.executor import ProcessExecutor, Report, SerialExecutor, make_executor


def square(task: int, report: Report) -> int:
    report(task)
    return task * task


def deadly(task: int, report: Report) -> int:
    if task == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return task


def wrong(task: int, report: Report) -> int:
    raise ValueError(f"no {task}")


def slow(task: str, report: Report) -> None:
    Path(task).write_text(str(os.getpid()))
    time.sleep(60.0)


def nap(task: str, report: Report) -> None:
    """The first task ends when another has said who runs it; the others would go on for a minute."""
    if not Path(task).is_dir():
        return slow(task, report)
    while not any(path.read_text() for path in Path(task).iterdir()):
        time.sleep(0.05)


def results(executor: Any, work: Any, tasks: list[Any]) -> dict[Any, Any]:
    return {done.task: done.result for done in executor.run(work, tasks)}


def test_processes_give_what_one_process_gives() -> None:
    tasks = list(range(7))
    assert results(ProcessExecutor(2), square, tasks) == results(SerialExecutor(), square, tasks)


@pytest.mark.parametrize("executor", [SerialExecutor(), ProcessExecutor(2)], ids=["serial", "process"])
def test_reports_arrive(executor: Any) -> None:
    seen: list[int] = []
    list(executor.run(square, [1, 2, 3], seen.append))
    assert sorted(seen) == [1, 2, 3]


def process_of(task: int, report: Report) -> int:
    if task == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.2)  # so that one worker alone does not do all
    return os.getpid()


def test_workers_live_on_within_the_executor_and_no_longer() -> None:
    with ProcessExecutor(2) as executor:
        first = set(results(executor, process_of, [0, 1, 4, 5]).values())
        again = set(results(executor, process_of, [0, 1, 4, 5]).values())
        assert len(first) == 2
        assert again == first
        killed = results(executor, process_of, [3])
        assert killed == {3: None}
        others = set(results(executor, process_of, [0, 1, 4, 5]).values())
        assert not others & first, "who lost a worker begins with new ones"
    assert not any(map(psutil.pid_exists, first | others))
    assert not set(results(executor, process_of, [0]).values()) & others


def test_a_task_that_kills_its_process_is_lost_and_no_other() -> None:
    done = {d.task: d for d in ProcessExecutor(2).run(deadly, list(range(6)))}
    assert sorted(done) == list(range(6))
    assert [k for k, d in done.items() if d.lost] == [3]
    assert [done[k].result for k in (0, 1, 2, 4, 5)] == [0, 1, 2, 4, 5]


def test_many_deaths_lose_no_task_but_the_deadly() -> None:
    done = list(ProcessExecutor(2).run(deadly, [3, 3, 0, 1, 2, 4]))
    assert sorted(d.task for d in done) == [0, 1, 2, 3, 3, 4]
    assert [d.task for d in done if d.lost] == [3, 3]


@pytest.mark.parametrize("executor", [SerialExecutor(), ProcessExecutor(2)], ids=["serial", "process"])
def test_who_has_enough_of_tasks_without_end_stops(executor: Any) -> None:
    taken = []

    def forever() -> Iterator[int]:
        for task in itertools.count():
            taken.append(task)
            yield task

    work = executor.run(square, forever())
    assert all(done.result == done.task**2 for done in itertools.islice(work, 3))
    work.close()
    assert len(taken) <= 3 + 2 * 2


def test_workers_of_who_has_enough_end_in_the_middle_of_their_tasks(tmp_path: Path) -> None:
    work = ProcessExecutor(2).run(nap, [str(tmp_path / name) for name in ("", "a", "b", "c")])
    assert next(work).result is None
    begun = time.monotonic()
    work.close()  # type: ignore[attr-defined]
    assert time.monotonic() - begun < 30.0
    said = [path.read_text() for path in tmp_path.iterdir()]  # nothing by who was ended between opening and writing
    workers = [int(worker) for worker in said if worker]
    assert workers
    assert not any(map(psutil.pid_exists, workers))


@pytest.mark.parametrize("executor", [SerialExecutor(), ProcessExecutor(2)], ids=["serial", "process"])
def test_what_a_task_raises_reaches_the_caller(executor: Any) -> None:
    with pytest.raises(ValueError, match="no 1"):
        list(executor.run(wrong, [1]))


def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    mark = tmp_path / "worker"
    code = (
        "from lavsim.executor import ProcessExecutor\nfrom tests.test_executor import slow\n"
        f"if __name__ == '__main__':\n    list(ProcessExecutor(2).run(slow, [{str(mark)!r}]))\n"
    )
    script = tmp_path / "parent.py"
    script.write_text(code)
    root = Path(__file__).parent.parent
    parent = subprocess.Popen([sys.executable, str(script)], env={**os.environ, "PYTHONPATH": str(root)})
    deadline = time.monotonic() + 60.0
    while not (mark.exists() and mark.read_text()) and time.monotonic() < deadline:
        time.sleep(0.05)
    worker = psutil.Process(int(mark.read_text()))
    parent.kill()
    parent.wait()
    assert not psutil.wait_procs([worker], timeout=20.0)[1]


def test_no_workers_are_refused() -> None:
    with pytest.raises(ConfigError, match="at least 1"):
        make_executor(0)
