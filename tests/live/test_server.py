"""The live server's door: who is let in, what is served, and that nothing anybody sends brings it down."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from lavsim.errors import OutputError
from lavsim.live.server import IN_FLIGHT, MOST_PAGES, LiveServer
from lavsim.live.session import Session
from lavsim.live.stream import Stream, scene_message
from tests.live.drives import RouteDriver, session

WAIT = 20.0  # [s] that anything may take on a busy machine


def serve(live: Session) -> LiveServer:
    simulation = live.simulation
    return LiveServer(live, scene_message(simulation.town, simulation.route, "A", "b", True))


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    made = session(tmp_path_factory.mktemp("saves"))
    made.start()
    yield made
    made.close()


@pytest.fixture(scope="module")
def server(live: Session) -> Iterator[LiveServer]:
    made = serve(live)
    yield made
    made.close()


def request(server: LiveServer, path: str, method: str = "GET", headers: str | None = None) -> tuple[int, str]:
    """Status and whole text of the answer to a request written by hand; 0 if the door is shut without one."""
    if headers is None:
        headers = f"Host: 127.0.0.1:{server.port}\r\n"
    with socket.create_connection(("127.0.0.1", server.port), WAIT) as line:
        line.sendall(f"{method} {path} HTTP/1.1\r\n{headers}\r\n".encode("utf-8", "surrogateescape"))
        answer = b""
        while part := line.recv(65536):
            answer += part
    text = answer.decode(errors="replace")
    return (int(text.split()[1]) if text else 0), text


class Page:
    """A client that behaves as the page does."""

    def __init__(self, server: LiveServer, token: str | None = None, **more: Any) -> None:
        origin = more.pop("origin", f"http://127.0.0.1:{server.port}")
        query = f"?token={server.token if token is None else token}"
        self.link: ClientConnection = connect(
            f"ws://127.0.0.1:{server.port}/live{query}",
            origin=origin,
            open_timeout=WAIT,
            max_size=None,
            legacy=True,
            **more,
        )

    def hear(self, key: str) -> dict[str, Any]:
        """The next message with `key` in it; ticks on the way are acknowledged."""
        while True:
            told: dict[str, Any] = json.loads(self.link.recv(WAIT))
            if key in told:
                return told
            if "frame" in told:
                self.ask("seen", frame=told["frame"])

    def ask(self, name: str, **values: Any) -> None:
        self.link.send(json.dumps({"do": name, **values}))

    def flood(self, message: str | list[str], count: int) -> None:
        """Sends a message many times and listens until the server ends it."""
        for _ in range(count):
            self.link.send(message)
        while True:
            self.link.recv(WAIT)

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()


def test_it_listens_on_loopback_only(server: LiveServer) -> None:
    addresses = {
        line.split()[1] for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]
    }
    own = [address for address in addresses if int(address.rpartition(":")[2], 16) == server.port]
    assert own
    assert {address.partition(":")[0] for address in own} == {"0100007F"}


def test_page_is_whole_and_keeps_the_secret(server: LiveServer) -> None:
    status, text = request(server, "/")
    assert status == 200
    assert "default-src 'none'; script-src 'sha256-" in text
    assert "frame-ancestors 'none'" in text
    assert server.token not in text
    assert server.address.endswith(f"/#token={server.token}")


@pytest.mark.parametrize(
    "path",
    ["/../", "/../../etc/passwd", "/%2e%2e/", "/%2e%2e%2f%2e%2e%2fetc/passwd", "//etc/passwd", "/etc/passwd",
     "/js/main.js",
     "/page.html", "/.", "/?x", "/#", "/live/../", "/live/", "/LIVE", "/\x00", "/%00", "/live%00?token=",
     "http://127.0.0.1/etc/passwd",
     "/..\\..\\etc", "/favicon.ico"],
)  # fmt: skip
def test_nothing_but_the_page_is_served(path: str, server: LiveServer) -> None:
    status, text = request(server, path)
    assert status in (0, 400, 403, 404)
    assert "root:" not in text
    assert "<html" not in text


@pytest.mark.parametrize(
    "headers",
    ["", "Host: evil.example\r\n", "Host: evil.example:{port}\r\n", "Host: 127.0.0.1\r\n", "Host: 127.0.0.1:1\r\n",
     "Host: 127.0.0.1:{port}.evil.example\r\n", "Host: localhost:{port}\r\nHost: localhost:{port}\r\n",
     "Host: 0.0.0.0:{port}\r\n",
     "Host: 127.0.0.1:{port}\r\nOrigin: http://evil.example\r\n"],
)  # fmt: skip
def test_foreign_names_and_origins_get_nothing(headers: str, server: LiveServer) -> None:
    assert request(server, "/", headers=headers.format(port=server.port))[0] in (0, 400, 403)


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "LOCALHOST", "[::1]"])
def test_own_names_are_answered(name: str, server: LiveServer) -> None:
    assert request(server, "/", headers=f"Host: {name}:{server.port}\r\n")[0] == 200


@pytest.mark.parametrize("method", ["POST", "HEAD", "PUT", "OPTIONS", "NONSENSE"])
def test_other_methods_get_no_page(method: str, server: LiveServer) -> None:
    assert request(server, "/", method)[0] in (0, 400, 405, 426, 500)


@pytest.mark.parametrize(
    ("more", "status"),
    [({"token": "wrong"}, 403), ({"token": ""}, 403), ({"token": "ä"}, 403), ({"origin": "http://evil.example"}, 403),
     ({"origin": None}, 403), ({"origin": "null"}, 403),
     ({"additional_headers": {"Origin": "http://evil.example"}}, 403)],
)  # fmt: skip
def test_socket_needs_the_secret_and_its_own_origin(more: dict[str, Any], status: int, server: LiveServer) -> None:
    with pytest.raises(InvalidStatus) as refused:
        Page(server, **more)
    assert refused.value.response.status_code == status


def test_secrets_differ_from_session_to_session(server: LiveServer, live: Session) -> None:
    told = live.on_change
    other = serve(live)
    other.close()
    live.on_change = told
    assert len(server.token) >= 32
    assert other.token != server.token


@pytest.mark.parametrize("message", ["{", "[]", '{"do":"fly"}', '{"do":"pause","on":"x"}', "[" * 4000, b"\x00\xff", ""])
def test_nonsense_is_answered_once_and_the_page_stays(message: str | bytes, server: LiveServer) -> None:
    with Page(server) as page:
        page.link.send(message)
        assert page.hear("error")["error"]
        page.ask("look", tick=10**8)
        assert "holds ticks" in page.hear("error")["error"]


def test_large_messages_and_floods_of_nonsense_end_their_own_page_only(server: LiveServer) -> None:
    with Page(server) as other:
        for message, count, code in (("x" * 4097, 1, 1009), (["x" * 2000] * 3, 1, 1009), ("{", 60, 1008)):
            page = Page(server)
            with pytest.raises(ConnectionClosed) as closed:
                page.flood(message, count)  # a list goes out in as many fragments
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == code
        other.ask("look", tick=10**8)
        assert other.hear("error")


def test_half_requests_and_bad_frames_leave_the_server_standing(server: LiveServer) -> None:
    for rubbish in (
        b"",
        b"GET / HT",
        b"\x16\x03\x01\x02\x00" * 20,
        b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 5000,
        b"\r\n" * 9,
    ):
        with socket.create_connection(("127.0.0.1", server.port), WAIT) as line:
            line.sendall(rubbish)
    page = Page(server)
    page.link.socket.sendall(b"\xff\xff\xff\xff garbage that is no frame")
    with pytest.raises(ConnectionClosed):
        page.flood("", 0)
    assert request(server, "/")[0] == 200


def test_only_so_many_pages(server: LiveServer) -> None:
    pages = [Page(server) for _ in range(MOST_PAGES)]
    with pytest.raises(InvalidStatus) as refused:
        Page(server)
    assert refused.value.response.status_code == 503
    for page in pages:
        page.link.close()


def test_taken_port_is_one_clear_line(server: LiveServer, live: Session) -> None:
    with pytest.raises(OutputError, match=f"port {server.port}"):
        LiveServer(live, "{}", server.port)


def test_page_that_does_not_keep_up_gets_the_newest_tick_and_no_queue(server: LiveServer, live: Session) -> None:
    with Page(server) as page:
        first = page.hear("frame")
        assert "reset" in first
        while first["frame"] < IN_FLIGHT:  # each tick has its frame as long as somebody waits for it
            page.ask("step", ticks=1)
            first = page.hear("frame")
        for _ in range(30):
            page.ask("step", ticks=1)
        page.ask("save")
        while "saved" not in (told := json.loads(page.link.recv(WAIT))):
            assert told.get("frame", 0) <= IN_FLIGHT
        newest = live.view.snapshot.tick
        page.ask("seen", frame=IN_FLIGHT)
        told = page.hear("frame")
        assert told["frame"] == IN_FLIGHT + 1
        assert newest <= told["tick"] <= live.view.snapshot.tick, "the last of the steps may still have been under way"


def test_last_page_that_goes_pauses_the_drive_and_lifts_the_feet(server: LiveServer, live: Session) -> None:
    with Page(server) as page:
        page.hear("frame")
        page.ask("drive", throttle=1.0, brake=0.0, steer=0.0)
        page.ask("pause", on=False)
        while (told := page.hear("frame"))["status"]["paused"]:
            page.ask("seen", frame=told["frame"])
    changed = threading.Event()
    before, live.on_change = live.on_change, lambda: changed.set() if live.view.status["paused"] else None
    assert live.view.status["paused"] or changed.wait(WAIT)
    live.on_change = before
    assert live.driver.wheel.keys.throttle == 0.0  # type: ignore[attr-defined]


def test_ticks_tell_what_changed_and_nothing_more(tmp_path: Path) -> None:
    live = session(tmp_path, RouteDriver(), vehicles=60, walkers=40)
    stream, known = Stream(), {}
    sizes = []
    for frame in range(40):
        text = stream.message(live.view, frame)
        told = json.loads(text)
        for row, *values in zip(told["rows"], told["x"], told["y"], told["yaw"], told["state"], strict=True):
            assert known.get(row) != values
            known[row] = values
        for row in told.get("gone", []):
            del known[row]
        snapshot = live.view.snapshot
        assert {row: values[:3] for row, values in known.items()} == dict(
            zip(snapshot.rows.tolist(), snapshot.pose[:, [0, 1, 3]].tolist(), strict=True)
        )
        if "actors" not in told:
            sizes.append(len(json.dumps({k: v for k, v in told.items() if k != "inner"}, separators=(",", ":"))))
        live.advance()
    assert len(snapshot.rows) > 90
    assert max(sizes) < 10_000
