"""The live view's server: one fixed page and one socket, on this machine's loopback and nowhere else.

Each page is sent the newest tick when it has drawn the ones before: a slow one sees fewer ticks and never an old one,
and nothing queues up for it.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import secrets
import threading
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from lavsim.errors import ConfigError, OutputError
from lavsim.live.commands import LARGEST, Command, CommandError, parse
from lavsim.live.guard import PAGE_PATH, Guard
from lavsim.live.page import live_page
from lavsim.live.session import Session, View
from lavsim.live.stream import Stream

if TYPE_CHECKING:
    from websockets.asyncio.server import Server, ServerConnection
    from websockets.http11 import Request, Response

HOST = "127.0.0.1"
IN_FLIGHT = 2  # messages a page may have that it has not drawn yet
MOST_PAGES = 8
_MOST_MISTAKES = 50  # messages that are no commands after which a page is sent away
_OPEN_TIMEOUT, _CLOSE_TIMEOUT = 5.0, 1.0  # [s]
_POLICY_VIOLATION = 1008
_POLL = 0.5  # [s] between looks whether somebody pressed Ctrl-C


class LiveServer:
    """Serves a session in a thread of its own.

    Args:
        session: The drive.
        scene: The first message to each page (`lavsim.live.stream.scene_message`).
        port: 0 takes a free one.

    Attributes:
        address: What to open in a browser; it holds the session's secret, which browsers send to nobody.

    Raises:
        ConfigError: the library `websockets` is not installed.
        OutputError: the port is taken.
    """

    def __init__(self, session: Session, scene: str, port: int = 0) -> None:
        try:
            import websockets.asyncio.server  # noqa: F401
        except ImportError:
            raise ConfigError("lavsim view needs websockets: pip install 'lavsim[live]'.") from None
        self._session, self._scene, self._wanted = session, scene, port
        self._guard = Guard(port, secrets.token_urlsafe(24))
        self._clients: set[_Client] = set()
        self._is_told = False
        self._opened, self._trouble = threading.Event(), ""
        self._loop = asyncio.new_event_loop()
        self._closing = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="live server", daemon=True)
        self._thread.start()
        self._opened.wait()
        if self._trouble:
            self._thread.join()
            raise OutputError(self._trouble)
        session.on_change = self._changed
        self.address = f"http://{HOST}:{self.port}/#token={self.token}"

    @property
    def port(self) -> int:
        return self._guard.port

    @property
    def token(self) -> str:
        """The session's secret."""
        return self._guard.token

    def wait(self) -> None:
        """Returns when the server has ended; Ctrl-C ends the waiting."""
        while self._thread.is_alive():
            self._thread.join(_POLL)

    def close(self) -> None:
        """Sends all pages away; may be called twice."""
        self._session.on_change = lambda: None
        with contextlib.suppress(RuntimeError):  # the loop is closed already
            self._loop.call_soon_threadsafe(self._closing.set)
        self._thread.join()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except OSError as error:
            self._trouble = f"can't serve at {HOST}, port {self._wanted}: {error.strerror}."
        finally:
            self._loop.close()
            self._opened.set()

    async def _serve(self) -> None:
        from websockets.asyncio.server import serve

        async with serve(
            self._talk,
            HOST,
            self._wanted,
            process_request=self._receive,
            max_size=LARGEST,
            max_queue=16,
            compression=None,
            server_header=None,
            open_timeout=_OPEN_TIMEOUT,
            close_timeout=_CLOSE_TIMEOUT,
            logger=_quiet(),
        ) as server:
            self._guard = Guard(_port_of(server), self._guard.token)
            self._opened.set()
            await self._closing.wait()

    def _receive(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answers a request; None lets a socket open."""
        headers = request.headers
        refusal = self._guard.refusal(request.path, headers.get_all("Host"), headers.get_all("Origin"))
        if request.method != "GET":
            refusal = HTTPStatus.METHOD_NOT_ALLOWED, "Only GET is answered."
        if refusal is None and request.path == PAGE_PATH:
            return _page()
        if refusal is None and len(self._clients) >= MOST_PAGES:
            refusal = HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_PAGES} pages are open already."
        return connection.respond(refusal[0], refusal[1] + "\n") if refusal is not None else None

    async def _talk(self, connection: ServerConnection) -> None:
        """Serves one page until it goes."""
        from websockets.exceptions import ConnectionClosed

        client = _Client(connection, self._session)
        self._clients.add(client)
        sending = asyncio.ensure_future(client.send_ticks(self._scene))
        try:
            await client.listen(self._loop)
        except ConnectionClosed:
            pass
        finally:
            self._clients.discard(client)
            self._session.ask(Command("drive", {"throttle": 0.0, "brake": 0.0, "steer": 0.0}))
            if not self._clients:  # nobody looks
                self._session.ask(Command("pause", {"on": True}))
            sending.cancel()
            with contextlib.suppress(ConnectionClosed, asyncio.CancelledError):
                await sending

    def _changed(self) -> None:
        """Called by the session's thread; wakes the pages once for however many changes."""
        if not self._is_told:
            self._is_told = True
            with contextlib.suppress(RuntimeError):  # the loop is closed already
                self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        self._is_told = False
        for client in self._clients:
            client.wake.set()


class _Client:
    """One open page.

    Attributes:
        wake: Set when there may be something to send.
    """

    def __init__(self, connection: ServerConnection, session: Session) -> None:
        self._connection, self._session = connection, session
        self.wake = asyncio.Event()
        self._sent = self._seen = self._mistakes = 0
        self._is_asking = False

    async def send_ticks(self, scene: str) -> None:
        """Sends the scene, then the newest view each time the page has drawn the ones before."""
        await self._connection.send(scene)
        stream, shown = Stream(), None
        while True:
            view: View = self._session.view
            if view is not shown and self._sent - self._seen < IN_FLIGHT:
                self._sent, shown = self._sent + 1, view
                await self._connection.send(stream.message(view, self._sent))
                continue
            await self.wake.wait()
            self.wake.clear()

    async def listen(self, loop: asyncio.AbstractEventLoop) -> None:
        """Takes commands until the page goes or sends too much nonsense."""
        async for message in self._connection:
            try:
                command = parse(message)
            except CommandError as error:
                await self._answer({"error": str(error)})
                self._mistakes += 1
                if self._mistakes >= _MOST_MISTAKES:
                    await self._connection.close(_POLICY_VIOLATION, "too many malformed messages")
                continue
            if command.name == "seen":
                self._seen = max(self._seen, min(command.values["frame"], self._sent))
                self.wake.set()
            elif command.name == "hazards":
                await self._list_hazards()
            else:
                self._session.ask(command, lambda told: _answer_later(loop, self._answer(told)))

    async def _list_hazards(self) -> None:
        """Looks for places beside the drive: it takes longer than a tick."""
        if self._is_asking:
            return
        self._is_asking = True
        try:
            found = await asyncio.to_thread(self._session.hazards_ahead)
        finally:
            self._is_asking = False
        await self._answer({"hazards": found})

    async def _answer(self, told: dict[str, Any]) -> None:
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            await self._connection.send(json.dumps(told))


def _answer_later(loop: asyncio.AbstractEventLoop, answer: Any) -> None:
    """Has the server's thread await `answer`."""
    try:
        asyncio.run_coroutine_threadsafe(answer, loop)
    except RuntimeError:  # closed meanwhile
        answer.close()


def _page() -> Response:
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    text, policy = live_page()
    body = text.encode()
    headers = Headers(
        {
            "Content-Type": "text/html; charset=utf-8",
            "Content-Length": str(len(body)),
            "Content-Security-Policy": f"{policy}; frame-ancestors 'none'",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
            "Connection": "close",
        }
    )
    return Response(200, "OK", headers, body)


def _port_of(server: Server) -> int:
    port: int = next(iter(server.sockets)).getsockname()[1]
    return port


def _quiet() -> logging.Logger:
    """A logger for what strangers at the door do wrong: it says nothing."""
    logger = logging.getLogger("lavsim.live.socket")
    logger.setLevel(logging.CRITICAL + 1)
    return logger
