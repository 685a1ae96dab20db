"""Admission to the server: one browser of this machine, to which the address was given.

Any page that a browser shows can send requests to this machine. So each must name this server as
its host, come from its own page, and bring a cookie that only the address with the token sets.
"""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from urllib.parse import parse_qs

from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_STEP = '<!doctype html><title>struck</title><meta http-equiv="refresh" content="0;url=/">'
LARGEST_BODY = 2**16  # bytes of a request: the page sends numbers alone
_SAFE = {"GET", "HEAD"}
_IMPORT_MAP = re.compile(r'<script type="importmap">(.*?)</script>', re.DOTALL)


class TooLarge(Exception):  # noqa: N818 - it ends a request, and no other module catches it
    """A request's body exceeds `LARGEST_BODY`."""


def policy(page: Path) -> str:
    """Return the content security policy of a page: its own files, and the import map in it.

    Inline scripts of the page are refused, except the import map, which is allowed by its hash.
    """
    inline = _IMPORT_MAP.search(page.read_text(encoding="utf-8"))
    digest = hashlib.sha256((inline[1] if inline else "").encode()).digest()
    hash_source = f"'sha256-{base64.b64encode(digest).decode()}'"
    return "; ".join(
        (
            "default-src 'none'",
            f"script-src 'self' 'wasm-unsafe-eval' {hash_source}",
            "style-src 'self'",
            "img-src 'self' data: blob:",
            "connect-src 'self'",
            "worker-src 'self'",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        )
    )


def headers(page: Path) -> Mapping[str, str]:
    """Return the headers of every answer: the policy, and the isolation of the page."""
    return {
        "content-security-policy": policy(page),
        "cross-origin-opener-policy": "same-origin",
        "cross-origin-embedder-policy": "require-corp",
        "cross-origin-resource-policy": "same-origin",
        "x-content-type-options": "nosniff",
        "referrer-policy": "no-referrer",
        "cache-control": "no-cache",
    }


class Admission:
    """ASGI middleware that refuses foreign hosts, origins and tokens, and large bodies.

    Parameters
    ----------
    app : ASGI application
        What answers those who are let in.
    port : int
        Where the server listens on this machine.
    token : str
        What the address holds that struck printed.
    sent : mapping
        Headers of every answer.
    """

    def __init__(self, app: ASGIApp, *, port: int, token: str, sent: Mapping[str, str]) -> None:
        self._app = app
        self._token = token
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._origins = {f"http://{host}" for host in self._hosts}
        self._cookie = f"struck_{port}"  # cookies are shared by all ports of a machine
        self._sent = [(name.encode(), value.encode()) for name, value in sent.items()]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer an HTTP request of the admitted browser, or refuse it."""
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request_headers = _headers(scope)

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *self._sent]
            await send(message)

        answer = self._refuse(scope, request_headers) or self._welcome(scope, request_headers)
        if answer is None or answer.status_code < 400:
            scope["state"]["admit"]()
        try:
            await (answer or self._app)(scope, _limit_body(receive), send_with_headers)
        except TooLarge:
            await _too_large()(scope, receive, send_with_headers)

    def _refuse(self, scope: Scope, request_headers: Mapping[str, str]) -> Response | None:
        """Return the refusal of a request from elsewhere, or of too many bytes."""
        host, origin = request_headers.get("host", ""), request_headers.get("origin")
        if host not in self._hosts:
            return PlainTextResponse(
                f"The host {host!r} is not this server: open the address that struck printed.\n",
                400,
            )
        if origin not in self._origins and not (origin is None and scope["method"] in _SAFE):
            return PlainTextResponse(
                f"The origin {origin!r} is not this server: open the address that struck "
                "printed.\n",
                403,
            )
        length = request_headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > LARGEST_BODY:
            return _too_large()
        return None

    def _welcome(self, scope: Scope, request_headers: Mapping[str, str]) -> Response | None:
        """Return the answer to a browser that brings the token, or neither token nor cookie."""
        tokens = parse_qs(scope["query_string"].decode("ascii", "replace")).get("token", [])
        if scope["path"] == "/" and any(self._is_token(token) for token in tokens):
            # A redirect belongs to the page that led here, and where that is a file browsers send
            # no strict cookie with it: so the step to the room is taken by a page of this server.
            is_typed = request_headers.get("sec-fetch-site", "none") == "none"
            answer = RedirectResponse("/", 303) if is_typed else HTMLResponse(_STEP)
            answer.set_cookie(self._cookie, self._token, httponly=True, samesite="strict", path="/")
            return answer
        try:
            cookie = SimpleCookie(request_headers.get("cookie", "")).get(self._cookie)
        except CookieError:
            cookie = None
        if cookie is None or not self._is_token(cookie.value):
            return PlainTextResponse(
                "This page belongs to who started struck: open the address that struck printed, "
                "with its token. Each start has a new one.\n",
                403,
            )
        return None

    def _is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self._token.encode())


def _headers(scope: Scope) -> dict[str, str]:
    """Return a request's headers; values of a repeated one are joined, so that neither passes."""
    values: dict[str, str] = {}
    for name, value in scope["headers"]:
        key, text = name.decode("latin-1"), value.decode("latin-1")
        values[key] = f"{values[key]}, {text}" if key in values else text
    return values


def _limit_body(receive: Receive) -> Receive:
    """Return a `receive` that refuses bodies above `LARGEST_BODY` bytes, also without a length."""
    got = 0

    async def bounded() -> Message:
        nonlocal got
        message = await receive()
        got += len(message.get("body", b""))
        if got > LARGEST_BODY:
            raise TooLarge
        return message

    return bounded


def _too_large() -> Response:
    return PlainTextResponse(f"A request has at most {LARGEST_BODY} bytes.\n", 413)
