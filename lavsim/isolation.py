"""The child process an agent lives in: it may raise, hang, leak or die, and only its own route ends.

The parent hands it readings through shared memory, waits with a time-out, watches its memory, keeps its output in a
capped file, and leaves no process of it behind. See `lavsim.isolation_child` for the other side, and
`lavsim.isolation_guard` for the process between the two.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import secrets
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time as clock
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any

import psutil

from lavsim.agent import AgentFailure, AgentPlan, AgentSpec, AgentStatus, Readings, Track, parse_control
from lavsim.drawings import Drawing, checked_all
from lavsim.errors import ConfigError
from lavsim.isolation_guard import IS_GUARDED, PATIENCE
from lavsim.messages import Channel, MessageError
from lavsim.types import Control

SHARED_BYTES = 2**28  # address space only: pages are taken as they are written
REPLY_LIMIT = 2**24  # [bytes] a control or a list of sensors is far below
WATCH_INTERVAL = 0.5  # [s] between looks at the child's memory
FIRST_STEP = 5.0  # times as long as the others: compilers and networks warm up in it
CLOSE_TIMEOUT = 5.0  # [s] that `destroy` may take
GUARD_TIMEOUT = PATIENCE + 1.0  # [s] that the guard may take to end what the agent started
MARK = "LAVSIM_AGENT"  # variable by which what an agent started is known again
_ROUNDS = 5  # of killing, for those that multiply meanwhile

SINGLE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLIS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "OPENCV_FOR_THREADS_NUM",
    ),
    "1",
)


class ChildAgent:
    """An agent in a process of its own, for one route.

    Args:
        spec: Which agent, and its limits.
        output: File for what it prints (stdout and stderr together, capped by the spec); None drops it.
        environment: Variables the child gets beside the parent's own.
    """

    def __init__(
        self, spec: AgentSpec, output: Path | str | None = None, environment: dict[str, str] | None = None
    ) -> None:
        self.spec = spec
        self._output = Path(output) if output is not None else None
        self._environment = dict(environment or {})
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: Channel | None = None
        self._stream: socket.socket | None = None
        self._drain: threading.Thread | None = None
        self._watched = 0.0
        self._limit = FIRST_STEP * spec.step_timeout  # [s] that the next step may take
        self._mark = secrets.token_hex(8)
        self._offspring: set[psutil.Process] = set()  # all that were ever seen
        self._track = Track.SENSORS
        self._sensors: list[dict[str, Any]] = []
        self._drawings: dict[str, Drawing] = {}

    @property
    def track(self) -> Track:
        return self._track

    @property
    def pid(self) -> int | None:
        """The child's process id while it lives."""
        return self._process.pid if self._process is not None else None

    def start(self, plan: AgentPlan, spacing: float | None = None) -> None:
        """Starts the process and sets the agent up in it.

        Raises:
            AgentFailure: SETUP_FAILED or SENSORS_INVALID.
        """
        self._spawn()
        reply = self._ask(
            {
                "order": "start",
                "spec": self.spec.to_json(),
                "plan": plan.to_message(),
                "spacing": self.spec.plan_spacing if spacing is None else spacing,
                "path": sys.path,
            },
            self.spec.setup_timeout,
            AgentStatus.SETUP_FAILED,
        )
        try:
            self._track = Track(reply["track"])
            self._sensors = [dict(sensor) for sensor in reply["sensors"]]
        except (KeyError, TypeError, ValueError):
            self._end()
            raise AgentFailure(AgentStatus.SETUP_FAILED, "the agent's process sent a malformed answer") from None

    def sensors(self) -> list[dict[str, Any]]:
        return [dict(sensor) for sensor in self._sensors]

    def step(self, readings: Readings, time: float) -> Control:
        """One step.

        Raises:
            AgentFailure: CRASHED (raised, died, unusable control, too much memory) or TIMED_OUT.
        """
        message = {"order": "step", "time": time, "readings": {key: list(value) for key, value in readings.items()}}
        limit, self._limit = self._limit, self.spec.step_timeout
        reply = self._ask(message, limit, AgentStatus.CRASHED)
        # Parsed again here: the child belongs to the agent, and its word is not trusted.
        self._drawings = _believable(reply.get("drawings"))
        return parse_control(SimpleNamespace(**{key: reply.get(key) for key in Control.__dataclass_fields__}))

    def drawings(self) -> dict[str, Drawing]:
        """What the agent showed after its last step."""
        return self._drawings

    def close(self) -> None:
        """Lets the agent `destroy` itself if it still answers, then ends whatever is left of its process group."""
        if self._process is not None and self._channel is not None and self._process.poll() is None:
            with contextlib.suppress(AgentFailure):
                self._ask({"order": "close"}, CLOSE_TIMEOUT, AgentStatus.CRASHED)
        self._end()

    def __enter__(self) -> ChildAgent:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ process

    def _spawn(self) -> None:
        ours, theirs = socket.socketpair()
        shared = tempfile.TemporaryFile() if not hasattr(os, "memfd_create") else None  # noqa: SIM115 - closed below
        descriptor = shared.fileno() if shared is not None else os.memfd_create("lavsim", 0)
        os.ftruncate(descriptor, SHARED_BYTES)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "lavsim.isolation_child", str(theirs.fileno()), str(descriptor)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                pass_fds=(theirs.fileno(), descriptor),
                start_new_session=True,
                env={**os.environ, **SINGLE_THREAD, "PYTHONUNBUFFERED": "1", MARK: self._mark, **self._environment},
            )
            block = mmap.mmap(descriptor, SHARED_BYTES)
        finally:
            theirs.close()
            if shared is not None:
                shared.close()
            else:
                os.close(descriptor)
        self._stream = ours
        self._channel = Channel(ours, block, REPLY_LIMIT)
        assert self._process.stdout is not None
        self._drain = threading.Thread(
            target=_drain, args=(self._process.stdout, self._output, self.spec.output_limit), daemon=True
        )
        self._drain.start()
        self._watched = clock.monotonic()

    def _ask(self, message: dict[str, Any], timeout: float, status: AgentStatus) -> dict[str, Any]:
        """Sends `message` and gives the answer; any failure ends the child, with `status` unless it timed out."""
        channel, stream = self._channel, self._stream
        if channel is None or stream is None:
            raise AgentFailure(status, "the agent's process has ended")
        deadline = clock.monotonic() + timeout
        try:
            stream.settimeout(timeout)
            channel.send(message, in_shared=True)
            self._wait(stream, deadline)
            stream.settimeout(max(deadline - clock.monotonic(), 1.0))
            reply = channel.receive()
        except TimeoutError:
            self._end()
            what = "set-up" if status is AgentStatus.SETUP_FAILED else "run_step"
            kind = status if status is AgentStatus.SETUP_FAILED else AgentStatus.TIMED_OUT
            raise AgentFailure(kind, f"{what} took longer than {timeout:g} s") from None
        except (EOFError, OSError):
            raise AgentFailure(status, self._end_of_process()) from None
        except MessageError as error:
            self._end()
            raise AgentFailure(status, f"the agent's process sent nonsense: {error}") from None
        except _MemoryError as error:
            self._end()
            raise AgentFailure(status, str(error)) from None
        except BaseException:
            self._end()
            raise
        if not isinstance(reply, dict):
            self._end()
            raise AgentFailure(status, "the agent's process sent a malformed answer")
        if "failure" in reply:
            code, text = reply["failure"]
            raise AgentFailure(AgentStatus(code), str(text))
        return reply

    def _wait(self, stream: socket.socket, deadline: float) -> None:
        """Returns when an answer is there; looks at the child's memory now and then."""
        poll = select.poll()
        poll.register(stream, select.POLLIN)
        while True:
            now = clock.monotonic()
            if now - self._watched > WATCH_INTERVAL:
                self._watch_memory()
                self._watched = now
            if now >= deadline:
                raise TimeoutError
            if poll.poll(1000.0 * min(WATCH_INTERVAL, deadline - now)):
                return
            if self._process is None or self._process.poll() is not None:
                raise EOFError  # dead, though a process it forked still holds the stream open

    def _watch_memory(self) -> None:
        assert self._process is not None
        try:
            child = psutil.Process(self._process.pid)
            used = 0 if IS_GUARDED else child.memory_info().rss  # most of the guard's is the agent's, too
            for process in child.children(recursive=True):
                self._offspring.add(process)
                with contextlib.suppress(psutil.Error):
                    used += process.memory_info().rss
        except psutil.Error:
            return
        if used > self.spec.memory_limit:
            limit = self.spec.memory_limit / 2**30
            raise _MemoryError(f"the agent used {used / 2**30:.2f} GiB of memory, over its limit of {limit:.2f} GiB")

    def _end_of_process(self) -> str:
        """Ends the child and says how it had ended."""
        code: int | None = None
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = self._process.wait(GUARD_TIMEOUT)
        self._end()
        if code is None:
            return "the agent's process closed its connection"
        if code < 0:
            with contextlib.suppress(ValueError):
                return f"the agent's process was killed by {signal.Signals(-code).name}"
        return f"the agent's process ended itself with exit code {code}"

    def _end(self) -> None:
        """Ends the agent and everything it started, and waits for it.

        The guard does so. Should the agent have killed or stopped that, what it started is known by its environment or
        from earlier looks.
        """
        process, self._process = self._process, None
        stream, self._stream = self._stream, None
        self._channel = None
        if stream is not None:
            stream.close()
        if process is None:
            return
        with contextlib.suppress(psutil.Error):
            self._offspring |= set(psutil.Process(process.pid).children(recursive=True))
        if IS_GUARDED:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(GUARD_TIMEOUT)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for _ in range(_ROUNDS):
            left = {p for p in self._offspring | _marked(self._mark) if p.is_running()}
            for orphan in left:
                with contextlib.suppress(psutil.Error):
                    self._offspring |= set(orphan.children(recursive=True))
                    orphan.kill()
            if not left or not psutil.wait_procs(left, timeout=2.0)[1]:
                break
        self._offspring.clear()
        if self._drain is not None:
            self._drain.join(2.0)
            self._drain = None


class _MemoryError(Exception):
    pass


def _marked(mark: str) -> set[psutil.Process]:
    """Processes that have `mark` in their environment."""
    found = set()
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, OSError):
            if process.environ().get(MARK) == mark:
                found.add(process)
    return found


def _believable(drawings: Any) -> dict[str, Drawing]:
    try:
        return checked_all(drawings)
    except ConfigError:
        return {}


def _drain(stream: IO[bytes], path: Path | None, limit: int) -> None:
    """Copies `stream` to `path` up to `limit` bytes and reads the rest away, so that the child never blocks on it."""
    written, is_capped = 0, False
    file: IO[bytes] | None = None
    try:
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = path.open("wb")
        while chunk := os.read(stream.fileno(), 65536):
            if file is None or is_capped:
                continue
            part = chunk[: limit - written]
            file.write(part)
            written += len(part)
            if len(part) < len(chunk):
                file.write(b"\n[output cut here: limit reached]\n")
                is_capped = True
            file.flush()
    except OSError:
        while os.read(stream.fileno(), 65536):  # a full disk must not stop the agent
            pass
    finally:
        if file is not None:
            file.close()
        stream.close()
