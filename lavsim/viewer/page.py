"""Pages of one file that need nothing outside themselves: the replay's, with its data inside, and what others share."""

from __future__ import annotations

import base64
import hashlib
import html
import re
from functools import cache
from importlib import resources

# The modules in this order: what is imported stands before.
SHARED_SCRIPTS = ("decode", "drive", "view", "tiles", "scene", "inner", "timeline", "panel", "palette", "stage")
SCRIPTS = (*SHARED_SCRIPTS, "panes", "main")
_IMPORT = re.compile(r'^import (\{.*?\}) from "(?:\./|\.\./js/)(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?:async )?(?:function|class|const) (\w+)", re.MULTILINE)


def page_of(title: str, data: str) -> str:
    """The replay's document.

    Args:
        title: Of the window; escaped here.
        data: What `Pack.encode` made; base64, so nothing in it can be taken for markup.
    """
    body = f'{body_of("page")}<script type="application/octet-stream" id="data">{data}</script>\n'
    return document(title, asset("replay.css"), body, tuple(f"js/{name}" for name in SCRIPTS))[0]


def body_of(name: str, on_map: str = "") -> str:
    """Markup that the pages share, with what each has of its own.

    Args:
        name: Of the asset with time and details.
        on_map: Markup of what lies on the map besides.
    """
    stage = asset("stage.html").replace("<!-- on the map -->", on_map)
    return stage.replace("<!-- time and details -->", asset(f"{name}.html"))


def document(
    title: str, style: str, body: str, scripts: tuple[str, ...], head: str = "", connect: str = "'none'"
) -> tuple[str, str]:
    """A page and its content security policy, which allows its own script and nothing else.

    Args:
        title: Of the window; escaped here.
        style: CSS.
        body: Markup before the script.
        scripts: Modules among the assets, without their ending, each after those it imports.
        head: More markup for the head.
        connect: Where the script may connect to, as the policy puts it.
    """
    script = _script(scripts)
    policy = (
        f"default-src 'none'; script-src '{_digest(script)}'; style-src 'unsafe-inline'; img-src data: blob:; "
        f"connect-src {connect}; base-uri 'none'; form-action 'none'"
    )
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n{head}'
        f"<title>{html.escape(title)}</title>\n<style>{style}</style></head><body>\n"
        f"{body}<script>{script}</script>\n</body></html>\n"
    )
    return page, policy


@cache
def _script(scripts: tuple[str, ...]) -> str:
    """The modules, each a function of its own; imports and exports become plain bindings."""
    parts = []
    for path in scripts:
        source = asset(f"{path}.js")
        given = ", ".join(_EXPORT.findall(source))
        source = _IMPORT.sub(r"const \1 = modules.\2;", source)
        source = re.sub(r"^export ", "", source, flags=re.MULTILINE)
        parts.append(f"modules.{path.rpartition('/')[2]} = (() => {{\n{source}return {{ {given} }};\n}})();\n")
    return '"use strict";\nconst modules = {};\n' + "".join(parts)


def asset(name: str) -> str:
    """Text of a file among the assets."""
    return (resources.files("lavsim.viewer") / "assets" / name).read_text(encoding="utf-8")


def _digest(script: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
