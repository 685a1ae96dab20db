"""Attackers of the room's server: hostile requests, slow ones, and connections without a byte."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

_STATUS = re.compile(rb"HTTP/1\.1 (\d{3}) ")
_PATHS = (
    "/",
    "/?token=" + "a" * 32,
    "/api/room",
    "/api/events",
    "/static/main.js",
    "/models/string.struck",
    "/static/heads/kemar-48000.bin",
)


@dataclass
class Attack:
    """What became of the connections of attackers."""

    statuses: Counter[int] = field(default_factory=Counter)
    closed_count: int = 0  # without an answer
    open_count: int = 0  # neither answered nor closed in time
    durations: list[float] = field(default_factory=list)  # s


class Attackers:
    """Attackers of one server, some of whom have stolen the cookie.

    Parameters
    ----------
    port : int
        Port of the server.
    cookie : str
        Cookie of the admitted visitor, for requests that are hostile all the same.
    patience : float
        Time after which a connection counts as neither answered nor closed, s.
    """

    def __init__(self, port: int, cookie: str, patience: float) -> None:
        self._port = port
        self._cookie = cookie
        self._patience = patience
        self._random = random.Random(13)  # noqa: S311 - the same requests in each run

    def attack(self) -> tuple[Attack, ...]:
        """Return what became of slow, hostile and idle connections, and of streams."""

        async def attack_in_turn() -> tuple[Attack, ...]:
            slow = await self.send_slowly(32)  # few enough to be late rather than displaced
            requests, idle = await asyncio.gather(
                self.send_requests(5_000, 100), self.stay_idle(3_000)
            )
            return slow, requests, idle, await self.follow(1_500, 5)

        return asyncio.run(attack_in_turn())

    async def send_requests(self, count: int, together: int) -> Attack:
        """Send hostile requests, some at a time, each on a connection of its own."""
        attack = Attack()
        requests = (self._request(number) for number in range(count))

        async def send_some() -> None:
            for request in requests:
                await self._connect(attack, [request])

        await asyncio.gather(*(send_some() for _ in range(together)))
        return attack

    async def send_slowly(self, count: int) -> Attack:
        """Send heads of strangers and bodies with the right cookie, ten bytes per second."""
        attack = Attack()
        head = self._head("GET", "/")
        length = f"Cookie: {self._cookie}\r\nContent-Length: 60000\r\n\r\n".encode()
        body = [self._head("POST", "/api/models/string/change") + length, *[b" "] * 1000]
        parts = [[head[at : at + 1] for at in range(len(head))], body]
        await asyncio.gather(
            *(self._connect(attack, parts[number % 2], interval=0.1) for number in range(count))
        )
        return attack

    async def stay_idle(self, count: int) -> Attack:
        """Open connections at once, and send nothing."""
        attack = Attack()
        await asyncio.gather(*(self._connect(attack, []) for _ in range(count)))
        return attack

    async def follow(self, count: int, seconds: float) -> Attack:
        """Ask for the news of the room with the right cookie, and listen for some seconds."""
        attack = Attack()
        request = self._head("GET", "/api/events") + f"Cookie: {self._cookie}\r\n\r\n".encode()
        await asyncio.gather(
            *(self._connect(attack, [request], patience=seconds) for _ in range(count))
        )
        return attack

    async def _connect(
        self,
        attack: Attack,
        parts: Sequence[bytes],
        *,
        interval: float = 0.0,
        patience: float | None = None,
    ) -> None:
        """Open a connection, send parts at intervals, s, and read until the server closes it."""
        clock = asyncio.get_running_loop().time
        start, received = clock(), bytearray()
        with contextlib.suppress(OSError):  # a connection that is reset is closed
            reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
            start = clock()
            sending = asyncio.ensure_future(_send(writer, parts, interval))
            try:
                async with asyncio.timeout(patience or self._patience):
                    while data := await reader.read(2**16):
                        received += data
            except TimeoutError:
                attack.open_count += 1
            finally:
                sending.cancel()
                await asyncio.gather(sending, return_exceptions=True)
                writer.transport.abort()
        attack.durations.append(clock() - start)
        statuses = [int(status) for status in _STATUS.findall(received)]
        attack.statuses.update(statuses)
        attack.closed_count += not statuses

    def _head(self, method: str, path: str) -> bytes:
        """Return the beginning of a head, with the right host and origin."""
        host = f"127.0.0.1:{self._port}"
        return f"{method} {path} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n".encode()

    def _request(self, number: int) -> bytes:
        """Return a request that must be refused: a stranger's, damaged, or a thief's."""
        kinds = (self._stranger, self._damaged, self._oversized, self._framed_twice, self._thief)
        return kinds[number % len(kinds)]()

    def _stranger(self) -> bytes:
        head = self._head(self._random.choice(["GET", "HEAD", "PUT"]), self._random.choice(_PATHS))
        cookie = f"Cookie: struck_{self._port}={self._random.randbytes(12).hex()}\r\n".encode()
        upgrade = b"Connection: Upgrade\r\nUpgrade: websocket\r\n"
        request = head + self._random.choice([b"", cookie, upgrade]) + b"\r\n"
        return request * self._random.choice([1, 1, 1, 50])  # at once

    def _damaged(self) -> bytes:
        request = bytearray(self._stranger())
        for _ in range(self._random.randrange(1, 20)):
            at = self._random.randrange(len(request))
            request[at : at + self._random.randrange(3)] = self._random.randbytes(
                self._random.randrange(3)
            )
        return bytes(request)

    def _oversized(self) -> bytes:
        size = self._random.choice([2**14, 2**17, 2**20])
        return self._random.choice(
            [
                self._head("GET", "/" + "a" * size),
                self._head("GET", "/") + b"X: " + b"a" * size,
                self._head("GET", "/") + b"X: a\r\n" * (size // 6) + b"\r\n",
                self._head("POST", "/") + b"Content-Length: " + b"9" * 5000 + b"\r\n\r\n",
                self._head("POST", "/") + f"Content-Length: {size}\r\n\r\n".encode() + b"a" * size,
                self._random.randbytes(size),
            ]
        )

    def _framed_twice(self) -> bytes:
        fields = [
            b"Content-Length: 5\r\n",
            b"Content-Length: -1\r\n",
            b"Content-Length: 1e3\r\n",
            b"Transfer-Encoding: chunked\r\n",
            b"Transfer-Encoding: gzip\r\n",
            b"Expect: 100-continue\r\n",
            b"Host: evil.example\r\n",
            b"Forwarded: for=;\r\nX-Forwarded-For: ,,\r\n",
        ]
        chunks = [b"", b"5\r\nabcde\r\n0\r\n\r\n", b"zz\r\n", b"ffffffffffffffff\r\n"]
        head = self._head("POST", self._random.choice(_PATHS))
        head += b"".join(self._random.sample(fields, 3)) + b"\r\n"
        return head + self._random.choice(chunks) + b"GET"

    def _thief(self) -> bytes:
        """Return a request with the right cookie for what is not there or not allowed."""
        method, path, body = self._random.choice(list(_refused(self._random)))
        cookie = f"Cookie: {self._cookie}\r\nConnection: close\r\n".encode()
        length = f"Content-Length: {len(body)}\r\n\r\n".encode()
        return self._head(method, path) + cookie + length + body


def _refused(source: random.Random) -> Iterator[tuple[str, str, bytes]]:
    """Yield methods, paths and bodies that are refused to everyone."""
    rate = source.choice(["0", "-1", "47999", "1e4", "9" * 5000, "048000", "%00", "48000.0"])
    yield "GET", f"/static/heads/kemar-{rate}.bin", b""
    yield "GET", f"/static/heads/{source.choice(['x', 'a' * 5000, '%00', '..'])}-48000.bin", b""
    yield "GET", f"/static/{source.choice(['%00', 'a' * 5000, '..%2f..', '%ff', 'con'])}", b""
    yield "GET", f"/models/{source.choice(['none', '%00', 'a' * 5000, '..%2fx'])}.struck", b""
    yield source.choice(["PUT", "DELETE", "POST"]), "/api/room", b""
    numbers = ["NaN", "Infinity", "1e999", "-1", "[]", "null", "9" * 4000, '"\\ud800"']
    number = source.choice(numbers)
    for name in ("size", "damping", "material"):
        if (name, number) != ("material", "null"):
            yield "POST", "/api/models/string/change", f'{{"{name}": {number}}}'.encode()
    yield "POST", "/api/models/string/change", b"[" * source.choice([1, 60000])
    point = source.choice([[9, 9, 9], [1e308] * 3, ["a"], [[0]], {}, [None] * 3, "\x00", []])
    yield "POST", "/api/models/string/drive", json.dumps({"point": point}).encode()
    yield "POST", "/api/models/string/drive", f'{{"point": [{number}, 0, 0]}}'.encode()
    yield "POST", "/api/models/none/drive", b"{}"


async def _send(writer: asyncio.StreamWriter, parts: Sequence[bytes], interval: float) -> None:
    """Send parts of a request at intervals, s."""
    for part in parts:
        writer.write(part)
        await writer.drain()
        if interval:
            await asyncio.sleep(interval)
