"""The page of a replay: one file that needs nothing outside itself, with its data inside."""

from __future__ import annotations

import base64
import hashlib
import html
import re
from functools import cache
from importlib import resources

SCRIPTS = ("decode", "drive", "view", "tiles", "scene", "inner", "timeline", "panel", "panes", "main")  # in this order
_IMPORT = re.compile(r'^import (\{.*?\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?:async )?(?:function|class|const) (\w+)", re.MULTILINE)


def page_of(title: str, data: str) -> str:
    """The document.

    Args:
        title: Of the window; escaped here.
        data: What `Pack.encode` made; base64, so nothing in it can be taken for markup.
    """
    script, style, body = _script(), _asset("replay.css"), _asset("page.html")
    policy = (
        f"default-src 'none'; script-src '{_digest(script)}'; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        f"<title>{html.escape(title)}</title>\n<style>{style}</style></head><body>\n"
        f'<div id="loading">Opening the drive …</div>\n{body}'
        f'<script type="application/octet-stream" id="data">{data}</script>\n'
        f"<script>{script}</script>\n</body></html>\n"
    )


@cache
def _script() -> str:
    """The modules, each a function of its own; imports and exports become plain bindings."""
    parts = []
    for name in SCRIPTS:
        source = _asset(f"js/{name}.js")
        given = ", ".join(_EXPORT.findall(source))
        source = _IMPORT.sub(r"const \1 = modules.\2;", source)
        source = re.sub(r"^export ", "", source, flags=re.MULTILINE)
        parts.append(f"modules.{name} = (() => {{\n{source}return {{ {given} }};\n}})();\n")
    return '"use strict";\nconst modules = {};\n' + "".join(parts)


def _asset(name: str) -> str:
    return (resources.files("lavsim.viewer") / "assets" / name).read_text(encoding="utf-8")


def _digest(script: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
