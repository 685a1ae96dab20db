"""Connections of the server: how many there are, and how long each may take over a request.

uvicorn 0.54 gives a request all the time that it takes to arrive, and its `limit_concurrency`
answers the admitted browser by 503 as it answers strangers. So the bounds are here: a connection
is a stranger's until `struck.explorer.admission` lets a request of it in.
"""

from __future__ import annotations

import asyncio
import socket
from operator import attrgetter

import h11
import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_CONNECTIONS = 64  # a browser has six; chosen by judgement, below a system's limit of open files
REQUEST_SECONDS = 2.0  # s; the page's requests are one packet each
IDLE_SECONDS = 5  # s between two requests of an admitted connection; the default of uvicorn
# s that a stranger's connection has before another may displace it, so that a request that follows
# its connection arrives on a busy machine too. A queue of 3,000 then lasts some 3 s.
GRACE_SECONDS = 0.05
_ACCEPTORS = 8  # tasks, each with one connection that waits for room; chosen by judgement
# Number of connections from which on strangers are closed: each acceptor may start one and accept
# the next meanwhile.
_ROOM = MAX_CONNECTIONS - 2 * _ACCEPTORS


class Connection(H11Protocol):
    """A connection that is closed when its request is late, or where there are too many.

    A stranger's connection is closed `REQUEST_SECONDS` after it was made, whatever it has sent. An
    admitted one has as long for each request, from its first byte to its last.
    """

    is_admitted = False
    start = 0.0  # s, on the clock of the event loop
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Start the deadline."""
        super().connection_made(transport)
        self.app_state = {**self.app_state, "admit": self.admit}
        self.start = self.loop.time()
        self._set_deadline()

    def data_received(self, data: bytes) -> None:
        """Read a part of a request, which starts or ends the deadline."""
        super().data_received(data)
        self._set_deadline()

    def connection_lost(self, exc: Exception | None) -> None:
        """End the deadline with the connection."""
        super().connection_lost(exc)
        self._cancel_deadline()

    def admit(self) -> None:
        """Note that a request of this connection was let in."""
        self.is_admitted = True
        self._set_deadline()

    def _set_deadline(self) -> None:
        """Start a deadline if the client is awaited, and cancel it otherwise."""
        if self.is_admitted and self.conn.their_state not in {h11.IDLE, h11.SEND_BODY}:
            self._cancel_deadline()
        elif self._deadline is None and not self.transport.is_closing():
            self._deadline = self.loop.call_later(REQUEST_SECONDS, self.transport.abort)

    def _cancel_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None


class Server(uvicorn.Server):
    """A server of an application with bounded connections.

    Parameters
    ----------
    app : ASGI application
        Calls `scope["state"]["admit"]` for each request that it lets in.
    listening : socket
        Where connections are accepted. uvicorn accepts as many as come, so it is not given to it.
    """

    def __init__(self, app: ASGIApp, listening: socket.socket) -> None:
        config = uvicorn.Config(
            app,
            ws="none",
            log_level="critical",
            access_log=False,
            proxy_headers=False,
            timeout_keep_alive=IDLE_SECONDS,
            timeout_graceful_shutdown=1,
        )
        super().__init__(config)
        self._listening = listening

    async def main_loop(self) -> None:
        """Accept connections until the server ends."""
        self._listening.settimeout(0)
        tasks = [asyncio.create_task(self._accept()) for _ in range(_ACCEPTORS)]
        try:
            await super().main_loop()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _accept(self) -> None:
        """Accept one connection after the other, each when there is room for it."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, _ = await loop.sock_accept(self._listening)
            except OSError:  # the client has reset it, or the system has no more files
                await asyncio.sleep(GRACE_SECONDS)
                continue
            try:
                while delay := self._make_room():  # noqa: ASYNC110 - time alone closes them
                    await asyncio.sleep(delay)
                await loop.connect_accepted_socket(self._protocol, connection)
            except OSError:
                connection.close()
            except asyncio.CancelledError:
                connection.close()
                raise

    def _protocol(self) -> Connection:
        return Connection(self.config, self.server_state, self.lifespan.state)

    def _make_room(self) -> float:
        """Close the oldest connection of a stranger if it is too many; return the delay until then.

        Connections that are admitted are waited for.
        """
        connections = [
            connection
            for connection in self.server_state.connections
            if isinstance(connection, Connection) and not connection.transport.is_closing()
        ]
        if len(connections) < _ROOM:
            return 0.0
        strangers = [connection for connection in connections if not connection.is_admitted]
        if not strangers:
            return GRACE_SECONDS
        oldest = min(strangers, key=attrgetter("start"))
        delay = oldest.start + GRACE_SECONDS - asyncio.get_running_loop().time()
        if delay <= 0:
            oldest.transport.abort()
        return max(0.0, delay)
