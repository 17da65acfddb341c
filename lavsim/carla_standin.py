"""A module named `carla` for agents that only need its plain data, where the real package is not installed.

Only the agent's child process installs it. It has `VehicleControl`, `Location`, `Rotation`, `Transform`, `Vector2D`,
`Vector3D`; any other name says in one line that there is no CARLA server here.
"""

from __future__ import annotations

import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from lavsim import carla_types

NAMES = ("Location", "Rotation", "Transform", "Vector2D", "Vector3D", "VehicleControl")


class _Finder(MetaPathFinder, Loader):
    """Comes last on `sys.meta_path`, so that an installed `carla` wins."""

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if fullname == "carla" else None

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        for name in NAMES:
            setattr(module, name, getattr(carla_types, name))
        module.__dict__["__getattr__"] = _refuse


def _refuse(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(name)
    raise AttributeError(
        f"lavsim's stand-in for the 'carla' package has {', '.join(NAMES)}, not {name!r}; the package itself has more"
    )


def install() -> None:
    """Makes `import carla` work in this process."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
