"""Tables of plug-ins, filled by a decorator in each plug-in's own file."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Hashable, Iterator
from typing import Generic, TypeVar

from lavsim.errors import UnknownName

T = TypeVar("T")


class Registry(Generic[T]):
    """Plug-ins of one kind by key.

    The modules of `package` are imported on the first look-up, so that a new file is found by being there and that
    importing the registry itself stays light.

    Args:
        kind: What an entry is, for messages ("sensor", "criterion").
        package: Dotted name of the package whose modules register themselves, or None.
        also: Called after that, for what comes from elsewhere.
    """

    def __init__(self, kind: str, package: str | None = None, also: Callable[[], None] | None = None) -> None:
        self.kind = kind
        self._package = package
        self._also = also
        self._entries: dict[Hashable, T] = {}

    def register(self, *keys: Hashable) -> Callable[[T], T]:
        """Decorator that enters a plug-in under each of `keys`."""

        def enter(entry: T) -> T:
            for key in keys:
                if key in self._entries and self._entries[key] is not entry:
                    raise ValueError(f"{self.kind} {key!r} is registered twice")
                self._entries[key] = entry
            return entry

        return enter

    def __getitem__(self, key: Hashable) -> T:
        """The entry under `key`.

        Raises:
            UnknownName: nothing is registered under it; the message names the nearest key.
        """
        self._load()
        try:
            return self._entries[key]
        except KeyError:
            raise UnknownName(self.kind, _text(key), map(_text, self._entries)) from None

    def __contains__(self, key: Hashable) -> bool:
        self._load()
        return key in self._entries

    def __iter__(self) -> Iterator[Hashable]:
        self._load()
        return iter(sorted(self._entries, key=_text))

    def __len__(self) -> int:
        self._load()
        return len(self._entries)

    def _load(self) -> None:
        if self._package is None:
            return
        package, self._package = importlib.import_module(self._package), None
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{package.__name__}.{module.name}")
        if self._also is not None:
            self._also()


def _text(key: Hashable) -> str:
    return ":".join(map(str, key)) if isinstance(key, tuple) else str(key)
