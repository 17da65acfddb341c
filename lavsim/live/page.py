"""The page of a live drive: the replay's drawing, other controls; it holds no data, that comes through the socket."""

from __future__ import annotations

from functools import cache

from lavsim.viewer.page import SHARED_SCRIPTS, asset, body_of, document

OWN_SCRIPTS = ("link", "world", "keys", "play")  # in this order


@cache
def live_page() -> tuple[str, str]:
    """The document and its content security policy."""
    return document(
        title="lavsim view",
        style=asset("replay.css") + asset("live/live.css"),
        body=body_of("live/page", on_map=asset("live/pad.html")),
        scripts=(*(f"js/{name}" for name in SHARED_SCRIPTS), *(f"live/{name}" for name in OWN_SCRIPTS)),
        head='<link rel="icon" href="data:,">\n',
        connect="'self'",
    )
