"""The one place that says how numba compiles our kernels.

No fastmath, no parallel reductions: the same inputs give the same bytes. Compiled code is cached on disk, so only the
first run after an install pays for compilation. The cache of a module is named by a digest of its source and of what
its kernels take from other modules: numba itself would go on using a kernel whose callee or constant has changed there.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher

from lavsim.cache import cache_dir

F = TypeVar("F", bound=Callable[..., Any])

_IMPORT = re.compile(r"^from ((?:lavsim|leaderboard|agents)[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)
_KEPT = 4  # caches of one module: other checkouts and branches have theirs
_folders: dict[str, Path] = {}


def kernel(function: F) -> F:
    """Compiles `function` ahead of its second call; errors follow numpy (division by zero gives inf or nan)."""
    return _compiled(function)


def lean_kernel(function: F) -> F:
    """Like `kernel`, for code that makes no arrays: those it is handed are not reference-counted.

    Kernels that hand tuples of many arrays on to each other spend most of their time on those counts (ten times the
    rest for the drivers of background traffic). The caller holds the arrays as long as the call lasts.
    """
    return _compiled(function, _nrt=False)


def _compiled(function: F, **options: Any) -> F:
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(_folder(function.__module__))  # read once, when caching is switched on
    try:
        compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    finally:
        numba.config.CACHE_DIR = before
    return compiled


def _folder(module: str) -> Path:
    """Where the kernels of `module` are cached; older caches of it are removed when a new one is begun."""
    if module not in _folders:
        folder = cache_dir() / "kernels" / f"{module}-{_digest(module)}"
        if not folder.exists():
            folder.mkdir(parents=True, exist_ok=True)
            others = [path for path in folder.parent.glob(f"{module}-*") if path.name.rpartition("-")[0] == module]
            for path in sorted(others, key=lambda path: path.stat().st_mtime)[:-_KEPT]:
                shutil.rmtree(path, ignore_errors=True)
        _folders[module] = folder
    return _folders[module]


def _digest(module: str) -> str:
    """Names what the kernels of `module` are compiled from, this file's options included."""
    digest = hashlib.blake2b(Path(__file__).read_bytes(), digest_size=8)
    for name in sorted(_sources(module, set())):
        digest.update(_text(name).encode())
    return digest.hexdigest()


def _sources(module: str, known: set[str]) -> set[str]:
    """`module` and those from which its kernels may take functions, numbers or shapes of tuples."""
    if module in known:
        return known
    known.add(module)
    here = vars(sys.modules[module]) if module in sys.modules else {}
    for source, names in _IMPORT.findall(_text(module)):
        if any(_is_compiled_in(here.get(name)) for name in re.findall(r"\w+", names)):
            _sources(source, known)
    return known


def _is_compiled_in(value: Any) -> bool:
    """Whether machine code would hold a copy of what an imported name stands for."""
    if isinstance(value, type):
        return hasattr(value, "_fields") or value.__class__.__name__ == "EnumType"
    return isinstance(value, Dispatcher | bool | int | float | tuple | np.generic | np.ndarray | np.dtype)


def _text(module: str) -> str:
    file = getattr(sys.modules.get(module), "__file__", None)
    return Path(file).read_text(encoding="utf-8") if file else ""
