"""Whom the live server answers: pages of this very server, on this very machine, that know the session's secret."""

from __future__ import annotations

import hmac
from collections.abc import Sequence
from dataclasses import dataclass
from http import HTTPStatus

PAGE_PATH, SOCKET_PATH = "/", "/live"
_NAMES = ("127.0.0.1", "localhost", "[::1]")


@dataclass(frozen=True)
class Guard:
    """Judges requests by their path and headers alone.

    Attributes:
        port: The server's.
        token: The session's secret.
    """

    port: int
    token: str

    def refusal(self, path: str, hosts: Sequence[str], origins: Sequence[str]) -> tuple[HTTPStatus, str] | None:
        """Why a request is refused; None where it is not.

        A name that leads here by a foreign DNS answer stands in `Host`; a foreign page names itself in `Origin`.

        Args:
            path: As it came, query included; nothing in it is decoded.
            hosts: All `Host` headers.
            origins: All `Origin` headers.
        """
        if len(hosts) != 1 or hosts[0].lower() not in {f"{name}:{self.port}" for name in _NAMES}:
            return HTTPStatus.FORBIDDEN, "This server answers to 127.0.0.1 and localhost only."
        is_own = len(origins) == 1 and origins[0].lower() == f"http://{hosts[0].lower()}"
        if path == PAGE_PATH:
            return None if is_own or not origins else (HTTPStatus.FORBIDDEN, "Not for pages from elsewhere.")
        place, _, query = path.partition("?")
        if place != SOCKET_PATH:
            return HTTPStatus.NOT_FOUND, "There is nothing here."
        if not is_own:
            return HTTPStatus.FORBIDDEN, "Not for pages from elsewhere."
        if not hmac.compare_digest(query.encode("utf-8", "replace"), f"token={self.token}".encode()):
            return HTTPStatus.FORBIDDEN, "Open the address that lavsim view printed."
        return None
