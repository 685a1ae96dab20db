"""A room that is served, and a bare client of it."""

from __future__ import annotations

import http.client
import json
from dataclasses import dataclass
from typing import Any

from struck.explorer.server import Explorer


@dataclass(frozen=True)
class Answer:
    """What a request was answered."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:  # noqa: ANN401 - JSON
        return json.loads(self.body)


class Client:
    """Requests as a browser sends them, or as nobody should."""

    def __init__(self, explorer: Explorer) -> None:
        self.port = explorer.port
        self.path = explorer.url.partition(str(self.port))[2]
        self.origin = f"http://127.0.0.1:{self.port}"
        self.cookie = ""

    def enter(self) -> Answer:
        """Open the address with the token, and keep the cookie."""
        answer = self.ask("GET", self.path)
        self.cookie = answer.headers["set-cookie"].partition(";")[0]
        return answer

    def ask(self, method: str, path: str, body: object = None, **headers: str | None) -> Answer:
        """Send a request; headers with the value None are left out."""
        sent: dict[str, str | None] = {"Host": f"127.0.0.1:{self.port}"}
        if self.cookie:
            sent["Cookie"] = self.cookie
        if method == "POST":
            sent["Origin"] = self.origin
        sent |= {name.capitalize(): value for name, value in headers.items()}
        data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        for name, value in sent.items():
            if value is not None:
                connection.putheader(name, value)
        if data is not None and "Content-length" not in sent:
            connection.putheader("Content-Length", str(len(data)))
        connection.endheaders(data)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        names = {name.lower(): value for name, value in answer.getheaders()}
        return Answer(answer.status, names, content)
