"""HTML built from elements, so that every text is escaped by construction."""

from __future__ import annotations

import html
from collections.abc import Iterable

Attribute = str | float | bool | None


class Markup(str):
    """Text that is markup already; anything else is escaped when it goes into an element."""

    __slots__ = ()


Child = str | float | Markup | None | Iterable["Child"]

_VOID = frozenset({"br", "col", "hr", "img", "meta"})


def el(tag: str, *children: Child, **attributes: Attribute) -> Markup:
    """An element.

    Args:
        tag: Its name.
        children: Texts (escaped), markup (kept), numbers, lists of those; None is left out.
        attributes: Values are escaped; a trailing underscore is dropped (`class_`), others become dashes. True stands
            alone, None and False are left out.
    """
    parts = [f"<{tag}"]
    for name, value in attributes.items():
        if value is None or value is False:
            continue
        key = name.rstrip("_").replace("_", "-")
        parts.append(f" {key}" if value is True else f' {key}="{html.escape(_text(value))}"')
    parts.append(">")
    if tag not in _VOID:
        parts += [str(join(*children)), f"</{tag}>"]
    return Markup("".join(parts))


def join(*children: Child) -> Markup:
    """Children one after another."""
    return Markup("".join(_child(child) for child in children))


def _child(child: Child) -> str:
    if child is None:
        return ""
    if isinstance(child, Markup):
        return str(child)
    if isinstance(child, str | float | int):
        return html.escape(_text(child))
    return "".join(_child(c) for c in child)


def _text(value: str | float | bool) -> str:
    if isinstance(value, float):
        return f"{value:.2f}".rstrip("0").rstrip(".")
    return str(value)
