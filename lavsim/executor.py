"""Independent tasks on one process, several, or a Ray cluster: the same tasks, the same results.

A task and its result cross between our own processes only; what is large goes to disk where the task itself writes it.
A worker that dies takes one task with it: the task is tried once more, then reported as lost, and the others go on.
Within `with executor:` its workers live on from one run to the next, and keep the towns that they have read.
"""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Generic, Protocol, Self, TypeVar

from lavsim.errors import ConfigError

T = TypeVar("T")
R = TypeVar("R")

Report = Callable[[Any], None]
Work = Callable[[T, Report], R]

_DEATHS = 2  # of workers after which what was begun runs one task at a time
_AHEAD = 2  # tasks begun for each worker, so that none waits for its next
_POLL = 0.2  # [s] between looks at what workers report
_SINGLE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Done(Generic[T, R]):
    """A task that is over.

    Attributes:
        task: As it was given.
        result: What came of it; None when it was lost.
        lost: Why there is no result, else None.
    """

    task: T
    result: R | None
    lost: str | None = None


class Executor(Protocol):
    """Runs tasks; the order in which they end is nobody's promise."""

    def __enter__(self) -> Self:
        """Keeps what it runs tasks on."""

    def __exit__(self, *_: object) -> None:
        """Lets go of it."""

    def run(self, work: Work[T, R], tasks: Iterable[T], on_report: Report | None = None) -> Iterator[Done[T, R]]:
        """Runs `work(task, report)` for each task and gives each as it ends.

        Args:
            work: A function at the top of a module; what it raises ends the run.
            tasks: What to do; taken as workers come free, so it may go on for ever. Who has enough closes the iterator
                that this returns: what still runs is ended.
            on_report: Called in this process with what tasks report on their way.
        """


class _NothingKept:
    """An executor that has nothing to keep."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


class SerialExecutor(_NothingKept):
    """One task after the other in this process."""

    def run(self, work: Work[T, R], tasks: Iterable[T], on_report: Report | None = None) -> Iterator[Done[T, R]]:
        report = on_report or _ignore
        for task in tasks:
            yield Done(task, work(task, report))


class ProcessExecutor:
    """Tasks on `workers` processes of this machine."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._keeps = False
        self._kept: _Crew | None = None

    def __enter__(self) -> Self:
        self._keeps = True
        return self

    def __exit__(self, *_: object) -> None:
        self._keeps = False
        if self._kept is not None:
            self._kept.dismiss()
            self._kept = None

    def run(self, work: Work[T, R], tasks: Iterable[T], on_report: Report | None = None) -> Iterator[Done[T, R]]:
        report, waiting = on_report or _ignore, iter(tasks)
        deaths = 0
        while left := (yield from self._pool(work, waiting, self._workers, report)):
            deaths += 1
            if deaths % _DEATHS:
                waiting = itertools.chain(left, waiting)
                continue
            for task in left:  # one of them kills its process; alone, it takes no other with it
                if (yield from self._pool(work, iter([task]), 1, report)):
                    yield Done(task, None, "its process was killed")

    def _pool(
        self, work: Work[T, R], waiting: Iterator[T], workers: int, report: Report
    ) -> Generator[Done[T, R], None, list[T]]:
        """Runs tasks until there are no more or a worker dies; returns those begun and not done."""
        begun = list(itertools.islice(waiting, _AHEAD * workers))
        if not begun:
            return []
        crew, left = self._crew(workers), list[T]()
        pending: dict[Future[R], T] = {crew.submit(work, task): task for task in begun}
        try:
            while pending:
                ended, _ = wait(pending, _POLL, FIRST_COMPLETED)
                while not crew.reports.empty():
                    report(crew.reports.get())
                for future in [f for f in pending if f in ended]:
                    task = pending.pop(future)
                    try:
                        yield Done(task, future.result())
                    except BrokenProcessPool:
                        left.append(task)
                room = 0 if left else _AHEAD * workers - len(pending)
                for task in itertools.islice(waiting, room):
                    try:
                        pending[crew.submit(work, task)] = task
                    except BrokenProcessPool:
                        left.append(task)
        finally:
            if pending:  # interrupted, or a task raised: what still runs is of no use to anybody
                crew.kill()
            elif self._keeps and workers == self._workers and not left:
                self._kept = crew
            else:
                crew.dismiss()
        return left

    def _crew(self, workers: int) -> _Crew:
        """Workers to run tasks on: those kept, if there are."""
        kept, self._kept = self._kept, None
        if kept is not None and workers == self._workers:
            return kept
        if kept is not None:
            kept.dismiss()
        return _Crew(workers)


class _Crew:
    """Worker processes.

    Args:
        workers: How many.

    Attributes:
        reports: What tasks tell on their way.
    """

    def __init__(self, workers: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.reports: Any = context.SimpleQueue()
        self._pool = ProcessPoolExecutor(workers, context, _prepare, (self.reports, os.getpid()))

    def submit(self, work: Work[T, R], task: T) -> Future[R]:
        """Begins a task.

        Raises:
            BrokenProcessPool: a worker has died.
        """
        with _single_threaded():  # workers start when there is something to do
            return self._pool.submit(_run, work, task)

    def dismiss(self) -> None:
        """Ends the workers once they have nothing to do."""
        self._pool.shutdown()

    def kill(self) -> None:
        """Ends the workers in the middle of what they do."""
        processes = list((self._pool._processes or {}).values())  # shutdown forgets them
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        for process in processes:
            process.join()


class RayExecutor(_NothingKept):
    """Tasks on a Ray cluster whose machines share this one's files.

    Args:
        address: Of the cluster; "local" starts one on this machine.

    Raises:
        ConfigError: Ray is not installed, or there is no cluster at `address`.
    """

    def __init__(self, address: str) -> None:
        try:
            import ray  # type: ignore[import-not-found]
        except ImportError:
            raise ConfigError("a cluster needs Ray: pip install 'lavsim[cluster]'.") from None
        self._ray: Any = ray
        try:
            if not ray.is_initialized():
                here = {"_node_ip_address": "127.0.0.1"} if address == "local" else {}
                os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # it would tell its makers
                ray.init(
                    address=None if address == "local" else address,
                    **here,
                    include_dashboard=False,
                    log_to_driver=False,
                    logging_level="ERROR",
                    configure_logging=False,
                )
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise ConfigError(f"no Ray cluster at {address!r}: {error}") from None

    def run(self, work: Work[T, R], tasks: Iterable[T], on_report: Report | None = None) -> Iterator[Done[T, R]]:
        ray, waiting = self._ray, iter(tasks)
        remote = ray.remote(num_cpus=1, max_retries=1)(_run_remote)
        ahead = _AHEAD * max(int(ray.cluster_resources().get("CPU", 1)), 1)
        pending = {remote.remote(work, task): task for task in itertools.islice(waiting, ahead)}
        try:
            while pending:
                ended, _ = ray.wait(list(pending), num_returns=1)
                for reference in ended:
                    task = pending.pop(reference)
                    pending.update((remote.remote(work, t), t) for t in itertools.islice(waiting, 1))
                    try:
                        yield Done(task, ray.get(reference))
                    except (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError):
                        yield Done(task, None, "its process was killed")
        finally:
            for reference in pending:  # interrupted, or the caller has enough
                ray.cancel(reference, force=True)


def make_executor(workers: int = 1, cluster: str | None = None) -> Executor:
    """The executor for `workers` processes, or for the Ray cluster at address `cluster`.

    Raises:
        ConfigError: fewer than one worker, or no such cluster.
    """
    if workers < 1:
        raise ConfigError(f"workers must be at least 1, got {workers}.")
    if cluster is not None:
        return RayExecutor(cluster)
    return ProcessExecutor(workers) if workers > 1 else SerialExecutor()


def _ignore(_: Any) -> None:
    pass


_reports: Any = None  # of this worker process


def _prepare(reports: Any, parent: int) -> None:
    """Makes a worker process ready; it ends with its parent, however that ends."""
    global _reports
    _reports = reports
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _run(work: Work[T, R], task: T) -> R:
    return work(task, _reports.put)


def _run_remote(work: Work[T, R], task: T) -> R:
    return work(task, _ignore)


@contextlib.contextmanager
def _single_threaded() -> Iterator[None]:
    """Workers started within use one thread each: results don't depend on it, but speed does."""
    before = {name: os.environ.get(name) for name in _SINGLE_THREAD}
    os.environ.update(dict.fromkeys(_SINGLE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
