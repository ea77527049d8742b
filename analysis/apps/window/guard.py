"""Access to the window: host names, token and headers (docs/decisions/0046-threats.md)."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from dataclasses import dataclass, field
from pathlib import Path

from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rigs.errors import FileError, UseError
from rigs.files import read_text

COOKIE = "rig_window"
LOGIN = "/login"
_LEAST_TOKEN = 16
_MOST_TOKEN = 1024
_LOOPBACK = ("localhost", "127.0.0.1", "::1", "[::1]")
_HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


def token_of(file: Path) -> str:
    try:
        token = read_text(file, _MOST_TOKEN).strip()
    except OSError as error:
        raise FileError.of_os(file, error, "give a file with the token", code="file.unreadable") from None
    if len(token) < _LEAST_TOKEN or not token.isascii() or not token.isprintable() or " " in token:
        problem = f"contains no token: one is a word of at least {_LEAST_TOKEN} letters, digits and signs"
        remedy = "create a token: openssl rand -hex 24 > FILE, and chmod 600 FILE"
        raise FileError(str(file), problem, remedy, code="file.invalid")
    return token


def is_loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        remedy = "give an address of this computer, such as 192.168.1.5, or 0.0.0.0 for all addresses"
        raise UseError("--listen", f"{address!r} is not an IP address", remedy, code="address.invalid") from None


@dataclass(frozen=True)
class Gate:
    names: tuple[str, ...]
    """Host names permitted in addition to those of this computer."""
    token: str | None = None
    secret: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    """Secret of this process: field of each control form, and cookie of a browser that has sent the token."""

    def is_open_to(self, request: HTTPConnection) -> bool:
        """True if a request has the token or the cookie, if a token is required."""
        bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
        return self.token is None or is_equal(bearer, self.token) or self.is_own(request.cookies.get(COOKIE, ""))

    def is_own(self, secret: str) -> bool:
        return is_equal(secret, self.secret)

    def middleware(self) -> list[Middleware]:
        return [
            Middleware(_Access, self),
            Middleware(TrustedHostMiddleware, allowed_hosts=[*_LOOPBACK, *self.names], www_redirect=False),
        ]


def is_equal(text: str, secret: str) -> bool:
    """Compare in constant time."""
    return hmac.compare_digest(text.encode(), secret.encode())


class _Access:
    def __init__(self, app: ASGIApp, gate: Gate) -> None:
        self._app, self._gate = app, gate

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                present = {name.decode().lower() for name, _ in message["headers"]}
                added = [(k.encode(), v.encode()) for k, v in _HEADERS.items() if k not in present]
                message = {**message, "headers": [*message["headers"], *added]}
            await send(message)

        app = self._app
        if scope["type"] == "http":
            request = HTTPConnection(scope)
            if not self._gate.is_open_to(request) and not scope["path"].startswith(("/static/", LOGIN)):
                is_page = scope["method"] == "GET" and "text/html" in request.headers.get("accept", "")
                app = RedirectResponse(LOGIN, 303) if is_page else PlainTextResponse("The token is needed.", 401)
        await app(scope, receive, send_with_headers)
