"""Hazards of users: every file of a folder they name is read, and a mistake in one is told with file and line."""

from __future__ import annotations

import importlib.util
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

from lavsim.errors import LavsimError, ScenarioError

SCENARIO_PATH = "LAVSIM_SCENARIO_PATH"  # environment variable: folders with users' hazards, also for child processes
_PACKAGE = "lavsim_user_scenarios_"
_read: set[Path] = set()


def use_folders(folders: Sequence[Path]) -> None:
    """Reads the hazards of `folders`, here and in every process begun from here on.

    Raises:
        ScenarioError: a folder is not there, or a file in it can't be read as Python; the message says where.
    """
    given = [Path(folder).resolve() for folder in folders]
    for folder in given:
        if not folder.is_dir():
            raise ScenarioError(f"--scenario-path: there is no folder {str(folder)!r}.")
    before = [part for part in os.environ.get(SCENARIO_PATH, "").split(os.pathsep) if part]
    os.environ[SCENARIO_PATH] = os.pathsep.join(dict.fromkeys([*map(str, given), *before]))
    read_folders()


def read_folders() -> None:
    """Reads what the environment names and has not been read yet."""
    for folder in (Path(part) for part in os.environ.get(SCENARIO_PATH, "").split(os.pathsep) if part):
        for path in sorted(folder.glob("*.py")):
            if path not in _read:
                _read.add(path)
                _run(path)


def _run(path: Path) -> None:
    name = f"{_PACKAGE}{len(_read)}.{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None, "a .py file has a loader"
    assert spec.loader is not None, "a .py file has a loader"
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        _read.discard(path)
        raise ScenarioError(located(error, path)) from error


def located(error: Exception, path: Path) -> str:
    """What went wrong in the file at `path`, with its line."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        return f"{path}, line {error.lineno}: {error.msg}"
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    line = f", line {frames[-1].lineno}" if frames else ""
    said = str(error) if isinstance(error, LavsimError) else f"{type(error).__name__}: {error}"
    return f"{path}{line}: {said}"


def file_of(thing: object) -> Path | None:
    """The file of a user in which the class of `thing` is written; None for lavsim's own."""
    module = sys.modules.get(type(thing).__module__)
    if module is None or not module.__name__.startswith(_PACKAGE):
        return None
    return Path(str(module.__file__))
