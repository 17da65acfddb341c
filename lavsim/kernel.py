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
