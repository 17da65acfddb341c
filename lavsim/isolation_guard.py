"""The process between lavsim and an agent: it adopts what the agent starts, outlives it, and ends all of it.

Linux hands a process whose parent died to the nearest ancestor that asked for orphans. The agent can't be that one: it
may die first, and then what it started would be nobody's. So the agent lives in a child of the guard.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import signal
import sys
import time as clock

import psutil

PATIENCE = 5.0  # [s] of killing; what multiplies faster is left to the caller
_PAUSE = 0.002  # [s] between looks at who is left
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
_SIGNALS = {signal.SIGTERM, signal.SIGCHLD}

IS_GUARDED = sys.platform == "linux"  # elsewhere no process can ask for orphans


def stand_guard() -> None:
    """Goes on in a child, whose end, or SIGTERM from the caller, or the caller's death ends all that came of it.

    The process that called stays behind and ends as the child did: with its exit code, or by the same signal.
    """
    if not IS_GUARDED:
        die_with_parent(signal.SIGKILL)
        return
    die_with_parent(signal.SIGTERM)
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)  # so that none is lost before it is waited for
    child = os.fork()
    if child:
        _end_as(_watch(child))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    os.setsid()
    die_with_parent(signal.SIGKILL)


def die_with_parent(number: signal.Signals) -> None:
    """Asks Linux to send this process a signal when its parent dies, which else could leave a hanging agent behind."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number))


def _watch(child: int) -> int:
    """Reaps orphans until `child` or the caller ends, then kills what is left; the child's wait status."""
    os.closerange(3, os.sysconf("SC_OPEN_MAX"))  # an agent that hangs up is noticed only if nobody else holds its end
    ended: dict[int, int] = {}
    while child not in ended and signal.sigwait(_SIGNALS) == signal.SIGCHLD:
        _reap(ended)
    deadline = clock.monotonic() + PATIENCE
    while _reap(ended) and clock.monotonic() < deadline:
        for process in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.Error):
                process.kill()
        clock.sleep(_PAUSE)
    return ended.get(child, int(signal.SIGKILL))


def _reap(ended: dict[int, int]) -> bool:
    """Adds the wait statuses of children that have ended; whether others are left."""
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return False
        if pid == 0:
            return True
        ended[pid] = status


def _end_as(status: int) -> None:
    """Ends this process as the one whose wait status it is."""
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if number != signal.SIGKILL:
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {number})
        os.kill(os.getpid(), number)
    os._exit(os.waitstatus_to_exitcode(status) if os.WIFEXITED(status) else 1)
