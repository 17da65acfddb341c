"""Modules named `srunner…` for agents that import CARLA's scenario runner for its clock, where it is not installed.

Only the agent's child process installs them. `srunner.scenariomanager.timer.GameTime` tells simulated time;
`srunner.scenariomanager.carla_data_provider.CarlaDataProvider` can be imported, and says in one line what it can't do.
"""

from __future__ import annotations

import sys
import time
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from lavsim.types import DT

PACKAGES = ("srunner", "srunner.scenariomanager")
CLOCK = "srunner.scenariomanager.timer"
PROVIDER = "srunner.scenariomanager.carla_data_provider"


class GameTime:
    """CARLA's clock: simulated seconds and the frame of the tick that the agent is asked about."""

    _time = 0.0
    _began = time.time()

    @classmethod
    def restart(cls) -> None:
        """Sets the clock to the start of a route."""
        cls._time, cls._began = 0.0, time.time()

    @classmethod
    def get_time(cls) -> float:
        """Simulated time of the route [s]."""
        return cls._time

    @classmethod
    def get_carla_time(cls) -> float:
        """The same: there is no other clock."""
        return cls._time

    @classmethod
    def get_frame(cls) -> int:
        """Number of the tick."""
        return round(cls._time / DT)

    @classmethod
    def get_wallclocktime(cls) -> float:
        """Seconds of wall-clock time since the process began."""
        return time.time() - cls._began


class _Refusing(type):
    """A class every attribute of which is refused."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise AttributeError(
            f"CarlaDataProvider.{name} needs a CARLA server; here an agent knows what its sensors and its plan say"
        )


class CarlaDataProvider(metaclass=_Refusing):
    """Imported by team code, of use to none of it here."""


_CONTENT: dict[str, dict[str, Any]] = {
    **{name: {} for name in PACKAGES},
    CLOCK: {"GameTime": GameTime},
    PROVIDER: {"CarlaDataProvider": CarlaDataProvider},
}


class _Finder(MetaPathFinder, Loader):
    """Comes last on `sys.meta_path`, so that an installed scenario runner wins."""

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname.split(".")[0] != "srunner":
            return None
        if fullname not in _CONTENT:
            raise ModuleNotFoundError(
                f"there is no scenario runner here: lavsim's stand-in for 'srunner' has {CLOCK} and {PROVIDER}, "
                f"not {fullname!r}",
                name=fullname,
            )
        return ModuleSpec(fullname, self, is_package=fullname in PACKAGES)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        module.__dict__.update(_CONTENT[module.__name__])


def install() -> None:
    """Makes `import srunner` work in this process, and sets its clock to the start of a route."""
    GameTime.restart()
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())


def tell_time(seconds: float) -> None:
    """Sets the clock for the step that follows."""
    GameTime._time = seconds
