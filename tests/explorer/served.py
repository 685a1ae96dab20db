"""A room that is served, and a bare client of it."""

from __future__ import annotations

import http.client
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit


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

    def __init__(self, url: str, timeout: float = 20.0) -> None:
        parts = urlsplit(url)
        self.port = parts.port
        self.path = f"{parts.path}?{parts.query}"
        self.origin = f"http://127.0.0.1:{self.port}"
        self.cookie = ""
        self.timeout = timeout  # s

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
        sent |= {name.replace("_", "-").capitalize(): value for name, value in headers.items()}
        data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=self.timeout)
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


def opened(folder: Path, **environment: str) -> subprocess.Popen[str]:
    """Return `struck explore`, started in a folder; it writes its address on standard error."""
    return subprocess.Popen(
        [sys.executable, "-m", "struck", "explore", "--no-browser"],
        cwd=folder,
        env=os.environ | environment,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def patience() -> float:
    """Return how much slower than alone this machine is now, at least 1."""
    begun, used = time.monotonic(), time.process_time()
    while time.process_time() - used < 0.2:
        pass
    return max(1.0, (time.monotonic() - begun) / 0.2)
