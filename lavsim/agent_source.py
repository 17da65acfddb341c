"""Finds an agent by what the user typed, without running its code, and loads it where it will live.

A target is "module.path:Class", "module.path" or "file.py" with a `get_entry_point()`, or "file.py:Class".
"""

from __future__ import annotations

import ast
import difflib
import importlib
import importlib.util
import pkgutil
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from lavsim.errors import AgentError

ENTRY_POINT = "get_entry_point"


@dataclass(frozen=True)
class AgentSource:
    """Where an agent's class lies.

    Attributes:
        target: What the user gave.
        file: Source file, absolute; None for a compiled module.
        module: Dotted module name; the stem for a file.
        is_file: Whether the target named a file rather than a module.
        class_name: Class in it; None when `get_entry_point()` names it.
    """

    target: str
    file: Path | None
    module: str
    is_file: bool
    class_name: str | None


def find_agent(target: str, search_path: Sequence[str] | None = None) -> AgentSource:
    """Checks that `target` exists, from its source text alone: no code of the agent runs.

    Raises:
        AgentError: nothing is there; the message names the nearest file, module or class.
    """
    place, separator, class_name = target.rpartition(":")
    if not separator:
        place, class_name = target, ""
    if not place or (separator and not class_name):
        raise AgentError(f"agent {target!r} is neither 'module:Class' nor a Python file.")
    is_file = place.endswith(".py") or "/" in place
    file = _find_file(target, Path(place)) if is_file else _find_module(target, place, search_path)
    source = AgentSource(target, file, file.stem if is_file and file else place, is_file, class_name or None)
    if file is not None:
        _check_names(source, file)
    return source


def load_agent_class(target: str) -> type[Any]:
    """The agent's class; this imports its module, so it belongs into the process that runs the agent.

    Raises:
        AgentError: the target names nothing, or something that is no class.
    """
    source = find_agent(target)
    module = _import_file(source) if source.is_file else importlib.import_module(source.module)
    name = source.class_name
    if name is None:
        entry = getattr(module, ENTRY_POINT, None)
        if entry is None:
            raise AgentError(f"agent {target!r} has no {ENTRY_POINT}(); give the class as '{target}:Class'.")
        name = entry()
        if isinstance(name, type):
            return name
    found = getattr(module, str(name), None)
    if not isinstance(found, type):
        raise AgentError(f"agent {target!r}: {name!r} is not a class of module {source.module}.")
    return found


def _find_file(target: str, file: Path) -> Path:
    if file.is_file():
        return file.resolve()
    folder = file.parent
    if file.is_dir():
        raise AgentError(f"agent {target!r} is a folder; a Python file or 'module:Class' is expected.")
    if not folder.is_dir():
        raise AgentError(f"agent file {str(file)!r} does not exist: there is no folder {str(folder)!r}.")
    raise AgentError(
        f"agent file {str(file)!r} does not exist.{_nearest(file.name, (p.name for p in folder.glob('*.py')))}"
    )


def _find_module(target: str, name: str, search_path: Sequence[str] | None) -> Path | None:
    parts = name.split(".")
    if not all(part.isidentifier() for part in parts):
        raise AgentError(f"agent {target!r} is neither 'module:Class' nor a Python file.")
    path = sys.path if search_path is None else list(search_path)
    spec: ModuleSpec | None = None
    for count, part in enumerate(parts, start=1):
        dotted = ".".join(parts[:count])
        if count == 1:
            # A top-level name imports nothing; editable installs have finders of their own, so ask them all first.
            spec = _find_top_level(part, path)
        else:
            assert spec is not None
            locations = list(spec.submodule_search_locations or [])
            inner = PathFinder.find_spec(dotted, locations) if locations else None
            if inner is None:
                known = (f"{'.'.join(parts[: count - 1])}.{m.name}" for m in pkgutil.iter_modules(locations))
                raise AgentError(f"agent {target!r}: there is no module {dotted!r}.{_nearest(dotted, known)}")
            spec = inner
        if spec is None:
            near = _nearest(dotted, (m.name for m in pkgutil.iter_modules([*path, ""])))
            raise AgentError(f"agent {target!r}: there is no module {dotted!r}.{near}")
    assert spec is not None
    if spec.origin is None or not spec.origin.endswith(".py"):
        return None
    return Path(spec.origin)


def _find_top_level(name: str, path: list[str]) -> ModuleSpec | None:
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        spec = None
    return spec or PathFinder.find_spec(name, [*path, ""])


def _check_names(source: AgentSource, file: Path) -> None:
    """Refuses a class that the source text of `file` cannot define."""
    try:
        tree = ast.parse(file.read_text(encoding="utf-8"), filename=str(file))
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None)
        raise AgentError(f"agent {source.target!r}: {file}{f':{line}' if line else ''}: {error.args[0]}.") from None
    except OSError as error:
        raise AgentError(f"agent {source.target!r} can't be read: {error.strerror}.") from None
    names, is_open = _module_names(tree)
    wanted = source.class_name or ENTRY_POINT
    if wanted in names or is_open:
        return
    classes = sorted(name for name, kind in names.items() if kind == "class")
    if source.class_name is None:
        listed = f" Classes there: {', '.join(classes)}." if classes else ""
        raise AgentError(
            f"agent {source.target!r} has no {ENTRY_POINT}(); give the class as '{source.target}:Class'.{listed}"
        )
    listed = f" Classes there: {', '.join(classes)}." if classes else " It defines no class."
    raise AgentError(
        f"agent {source.target!r}: {source.module} has no class {wanted!r}.{_nearest(wanted, names) or listed}"
    )


def _module_names(tree: ast.Module) -> tuple[dict[str, str], bool]:
    """Top-level names with their kind, and whether there may be others (star import, module `__getattr__`)."""
    names: dict[str, str] = {}
    is_open = False
    waiting: list[ast.stmt] = list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.ClassDef):
            names[node.name] = "class"
        elif isinstance(node, ast.FunctionDef):
            names[node.name] = "function"
            is_open |= node.name == "__getattr__"
        elif isinstance(node, ast.ImportFrom | ast.Import):
            for alias in node.names:
                is_open |= alias.name == "*"
                names[alias.asname or alias.name.split(".")[0]] = "import"
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names.update(
                {name.id: "value" for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
            )
        else:  # the arms of `if`, `try` and `with` run at import too
            for part in ("body", "orelse", "finalbody"):
                waiting += getattr(node, part, [])
            for handler in getattr(node, "handlers", []):
                waiting += handler.body
    return names, is_open


def _import_file(source: AgentSource) -> ModuleType:
    """Imports a file the way the leaderboard does: its folder leads the path, its stem is the module's name."""
    assert source.file is not None
    folder = str(source.file.parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    spec = importlib.util.spec_from_file_location(source.module, source.file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[source.module] = module
    spec.loader.exec_module(module)
    return module


def _nearest(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, sorted(set(known)), n=1, cutoff=0.4)
    return f" Did you mean {near[0]!r}?" if near else ""


def packaged_agents() -> list[tuple[str, str]]:
    """Targets and one-line summaries of the agents in the package `agents`, read from their source.

    An agent's module says by `get_entry_point` which class it is; a package's own is in its `agent.py`.
    """
    spec = importlib.util.find_spec("agents")
    found: list[tuple[str, str]] = []
    for folder in (spec.submodule_search_locations or []) if spec is not None else []:
        for file in sorted(Path(folder).rglob("*.py")):
            entry = _entry_of(ast.parse(file.read_text(encoding="utf-8")))
            if entry is not None:
                parts = file.relative_to(Path(folder).parent).with_suffix("").parts
                module = ".".join(parts[:-1] if parts[-1] == "agent" else parts)
                found.append((f"{module}:{entry[0]}", entry[1]))
    return sorted(found)


def _entry_of(tree: ast.Module) -> tuple[str, str] | None:
    """Name and one-line summary of the class that a module's `get_entry_point` names; None without one."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name == "get_entry_point":
            names = [part.value.value for part in ast.walk(node) if isinstance(part, ast.Return)
                     and isinstance(part.value, ast.Constant)]  # fmt: skip
            for kind in tree.body:
                if isinstance(kind, ast.ClassDef) and names == [kind.name]:
                    return kind.name, (ast.get_docstring(kind) or "").split("\n")[0]
    return None
