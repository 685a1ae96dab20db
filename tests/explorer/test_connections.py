"""The server under load: slow and idle connections, too many of them, and hostile requests."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack
from http.client import HTTPConnection
from multiprocessing import get_context
from pathlib import Path

import pytest

import struck
from struck.explorer import connections, server
from struck.explorer.connections import REQUEST_SECONDS
from struck.explorer.server import MAX_STREAMS, Explorer
from tests.explorer.attackers import Attack, Attackers
from tests.explorer.served import Client, opened, patience

SLOW_SECONDS = 0.2  # s in place of `REQUEST_SECONDS`


@pytest.fixture(scope="module")
def explorer() -> Iterator[Explorer]:
    bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    with Explorer(given=[struck.analyze(bar, "steel")], names=["bar"]) as opened_room:
        yield opened_room


@pytest.fixture
def client(explorer: Explorer) -> Client:
    client = Client(explorer.url)
    client.enter()
    return client


def connect(client: Client, data: bytes = b"") -> socket.socket:
    """Return a new connection on which some bytes were sent."""
    connection = socket.create_connection(("127.0.0.1", client.port), timeout=20)
    connection.sendall(data)
    return connection


def is_closed(connection: socket.socket, seconds: float) -> bool:
    """Return whether a connection ends, without an answer, within some seconds."""
    connection.settimeout(seconds)
    try:
        return connection.recv(100) == b""
    except ConnectionError:
        return True
    except TimeoutError:
        return False


@pytest.mark.parametrize("part", ["nothing", "head", "body"])
def test_a_late_request_ends_its_connection(
    client: Client, monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    monkeypatch.setattr(connections, "REQUEST_SECONDS", SLOW_SECONDS)
    head = f"POST /api/models/given_1/change HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\n"
    body = f"{head}Origin: {client.origin}\r\nCookie: {client.cookie}\r\n"
    body += "Content-Length: 60000\r\n\r\n"
    start = time.monotonic()
    with connect(client, {"nothing": "", "head": head, "body": body}[part].encode()) as connection:
        while time.monotonic() - start < 20:
            try:
                if part != "nothing":
                    connection.sendall(b"x" if part == "head" else b" ")
            except ConnectionError:
                break
            if is_closed(connection, SLOW_SECONDS / 10):
                break
    assert SLOW_SECONDS <= time.monotonic() - start < 10


def test_an_admitted_connection_outlives_the_time_of_a_request(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "REQUEST_SECONDS", SLOW_SECONDS)
    request = f"GET /api/events HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\n"
    with connect(client, f"{request}Cookie: {client.cookie}\r\n\r\n".encode()) as stream:
        while b"given_1" not in stream.recv(2**16):
            pass
        assert not is_closed(stream, 2 * SLOW_SECONDS)


def test_too_many_strangers_displace_each_other_and_no_visitor(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "REQUEST_SECONDS", 60.0)
    with ExitStack() as stack:
        visitor = HTTPConnection("127.0.0.1", client.port, timeout=20)
        stack.callback(visitor.close)
        visitor.request("GET", "/api/room", headers={"Cookie": client.cookie})
        answer = visitor.getresponse()
        assert (answer.status, bool(answer.read())) == (200, True)
        used = visitor.sock
        strangers = [stack.enter_context(connect(client)) for _ in range(66)]
        assert all(is_closed(stranger, 10) for stranger in strangers[:3])
        assert not is_closed(strangers[32], 0.05)
        visitor.request("GET", "/api/room", headers={"Cookie": client.cookie})
        assert visitor.getresponse().status == 200
        assert visitor.sock is used


def test_a_visitor_is_answered_among_idle_connections(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "REQUEST_SECONDS", 60.0)
    with ExitStack() as stack:
        for _ in range(200):
            stack.enter_context(connect(client))
        assert client.ask("GET", "/api/room").status == 200


def test_streams_of_events_are_counted(client: Client) -> None:
    request = f"GET /api/events HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\n"
    with ExitStack() as stack:
        data = f"{request}Cookie: {client.cookie}\r\n\r\n".encode()
        streams = [stack.enter_context(connect(client, data)) for _ in range(MAX_STREAMS)]
        assert all(stream.recv(100).startswith(b"HTTP/1.1 200") for stream in streams)
        refusal = client.ask("GET", "/api/events")
        assert refusal.status == 429
        assert f"{MAX_STREAMS} pages" in refusal.json["message"]
        streams[0].close()
        limit = time.monotonic() + 20
        answered = b"429"
        while b"429" in answered:
            assert time.monotonic() < limit
            with connect(client, data) as again:
                answered = again.recv(100)
        assert answered.startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize(
    "head", ["kemar-47999", "kemar-048000", "kemar-" + "9" * 5000, "kemar-", "none-48000"]
)
def test_a_head_or_rate_that_no_page_asks_for_is_not_computed(
    client: Client, monkeypatch: pytest.MonkeyPatch, head: str
) -> None:
    computed: list[str] = []
    monkeypatch.setattr(server, "head_bytes", lambda name, _rate: computed.append(name) or b"")
    assert client.ask("GET", f"/static/heads/{head}.bin").status == 404
    assert not computed


def test_heads_are_made_once_and_do_not_hold_up_changes(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_allowed, made = threading.Event(), []

    def make(name: str, rate: int) -> bytes:
        made.append(rate)
        assert is_allowed.wait(20)
        return name.encode()

    monkeypatch.setattr(server, "head_bytes", make)
    path = "/static/heads/exact-8000.bin"
    with ThreadPoolExecutor(40) as threads:  # more than the loop's own pool has
        heads = [threads.submit(client.ask, "GET", path) for _ in range(40)]
        try:
            change = client.ask("POST", "/api/models/given_1/change", {"size": 2.0})
        finally:
            is_allowed.set()
        assert change.status == 200
        assert {head.result().body for head in heads} == {b"exact"}
    assert made == [8000]


class Visits:
    """Visits of an admitted browser, each on a new connection, while others attack."""

    def __init__(self, client: Client, process: int) -> None:
        self._client = client
        self._status = Path(f"/proc/{process}/status")
        self.durations: list[float] = []  # s
        self.statuses: set[int] = set()
        self.memory: list[float] = []  # MB
        self.patience = patience()

    def go_on(self, attack: Future[tuple[Attack, ...]]) -> None:
        """Visit the room until an attack has ended."""
        while not attack.done():
            for method, path, body in (
                ("GET", "/", None),
                ("GET", "/api/room", None),
                ("GET", "/static/vendor/three/three.core.js", None),
                ("GET", "/static/heads/kemar-48000.bin", None),
                ("POST", "/api/models/string/change", {"size": 1.5}),
            ):
                start = time.monotonic()
                self.statuses.add(self._client.ask(method, path, body).status)
                self.durations.append(time.monotonic() - start)
            self.weigh()
            self.patience = max(self.patience, patience())

    def weigh(self) -> None:
        """Note the memory of the server, where the system tells it."""
        if self._status.is_file():
            found = re.search(r"VmRSS:\s+(\d+) kB", self._status.read_text())
            assert found
            self.memory.append(int(found[1]) / 1000)


def stand_ready(client: Client, seconds: float) -> None:
    """Wait until all objects of the room and the heads of the page are ready."""
    limit, states = time.monotonic() + seconds, ["waiting"]
    while set(states) != {"ready"}:
        assert "failed" not in states
        assert time.monotonic() < limit
        time.sleep(0.5)
        states = [one["state"] for one in client.ask("GET", "/api/room").json["objects"]]
    assert len(states) == 18
    for rate in (44100, 48000):
        assert client.ask("GET", f"/static/heads/kemar-{rate}.bin").status == 200
    assert client.ask("POST", "/api/models/string/change", {"size": 1.5}).status == 200


def allow_files(count: int) -> None:
    """Raise the limit of open files as far as this system allows; skip where that is too few."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = count if hard == resource.RLIM_INFINITY else min(count, hard)
    if most > soft:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    if most < count:
        pytest.skip(f"{count} open files are needed, and this system allows {most}")


@pytest.mark.prove
def test_the_room_holds_out_against_hostile_requests_and_idle_connections(tmp_path: Path) -> None:
    allow_files(8_000)
    process = opened(tmp_path, STRUCK_CACHE="off")
    try:
        assert process.stderr is not None
        client = Client(process.stderr.readline().strip(), 20 * patience())
        assert client.port is not None
        client.enter()
        client.ask("GET", "/")
        stand_ready(client, 1200)  # on a busy machine too
        visits = Visits(client, process.pid)
        visits.weigh()
        attackers = Attackers(client.port, client.cookie, 30 * visits.patience)
        # In another process, as a thread would hold up the visitor between connection and request.
        with ProcessPoolExecutor(1, get_context("spawn")) as processes:
            attack = processes.submit(attackers.attack)
            visits.go_on(attack)
            slow, requests, idle, streams = attack.result()
        visits.weigh()
    finally:
        process.terminate()
        _, err = process.communicate(timeout=60)
    assert not slow.statuses
    assert slow.closed_count == 32
    assert min(slow.durations) > 0.9 * REQUEST_SECONDS
    assert max(slow.durations) < REQUEST_SECONDS * (1 + visits.patience)
    assert idle.closed_count == 3_000
    assert len(requests.durations) == 5_000
    assert {400, 403, 404, 405, 413} <= set(requests.statuses) <= set(range(400, 500))
    assert set(streams.statuses) <= {200, 429}
    assert streams.open_count <= MAX_STREAMS
    assert not slow.open_count + requests.open_count + idle.open_count
    assert visits.statuses == {200}
    assert max(visits.durations) < 5 * visits.patience
    if visits.memory:
        assert max(visits.memory) - visits.memory[0] < 50
    assert not err.splitlines()[1:]
