"""The one place that says how numba compiles our kernels.

No fastmath, no parallel reductions: the same inputs give the same bytes. Compiled code is cached on disk, so only the
first run after an install pays for compilation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compiles `function` ahead of its second call; errors follow numpy (division by zero gives inf or nan)."""
    compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    return compiled


def lean_kernel(function: F) -> F:
    """Like `kernel`, for code that makes no arrays: those it is handed are not reference-counted.

    Kernels that hand tuples of many arrays on to each other spend most of their time on those counts (ten times the
    rest for the drivers of background traffic). The caller holds the arrays as long as the call lasts.
    """
    compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy", _nrt=False)(function)
    return compiled
