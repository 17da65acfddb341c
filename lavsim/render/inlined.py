"""Kernels that become part of their callers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def inlined(function: F) -> F:
    """Like `lavsim.kernel.lean_kernel`, always written out where it is called and compiled with its caller.

    For what is called once a run of pixels or once a pixel: handing over a tuple of arrays copies each of its words,
    which costs more than most such calls do.
    """
    compiled: F = numba.njit(nogil=True, error_model="numpy", _nrt=False, forceinline=True)(function)
    return compiled
