"""Access control for pages: check the host, origin, token and size of each request first.

A browser sends requests on behalf of any open page. The host name of a request must therefore be a name of the window:
foreign names that resolve to this computer are refused. Requests from other sites are refused. Control requests must
come from a page of the window and contain the secret of the process.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import secrets
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rigs.errors import FileError, UseError
from rigs.files import read_text

COOKIE = "rig_window"
LOGIN = "/login"
MOST_BODY = 4096
"""Maximum size of a form in bytes. A label with all fields has about 300."""
_BODY_S = 5.0
_LEAST_TOKEN = 16
_MOST_TOKEN = 1024
_OPEN = ("/static/", LOGIN)
_LOOPBACK = ("localhost", "127.0.0.1", "::1")
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}


def token_of(file: Path) -> str:
    """Read the token from a file. Raises FileError if the file is unreadable or the token too short."""
    try:
        token = read_text(file, _MOST_TOKEN).strip()
    except OSError as error:
        raise FileError(str(file), error.strerror or str(error), "give a file with the token") from None
    if len(token) < _LEAST_TOKEN or not token.isascii() or not token.isprintable() or " " in token:
        problem = f"contains no token: one is a word of at least {_LEAST_TOKEN} letters, digits and signs"
        raise FileError(str(file), problem, "create a token: openssl rand -hex 24 > FILE, and chmod 600 FILE")
    if file.stat().st_mode & 0o007:
        raise FileError(str(file), "is readable for every user of this computer", f"chmod 600 {file}")
    return token


def is_loopback(address: str) -> bool:
    """Return whether an address is reachable only from this computer. Raises UseError if it is invalid."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        remedy = "give an address of this computer, such as 192.168.1.5, or 0.0.0.0 for all addresses"
        raise UseError("--listen", f"{address!r} is not an IP address", remedy) from None


@dataclass(frozen=True)
class Gate:
    """Access rules.

    names: permitted host names. token: None if not required. secret: secret of this process in control forms.
    """

    names: frozenset[str]
    token: str | None = None
    secret: str = field(default_factory=lambda: secrets.token_urlsafe(32))

    @classmethod
    def of(cls, names: Iterable[str], token: str | None) -> Gate:
        """Return the gate of a window with these names and the local names."""
        return cls(frozenset(name.lower() for name in (*_LOOPBACK, *names)), token)

    @property
    def pass_(self) -> str:
        """Value of the cookie for a browser that presented the token.

        It does not reveal the token and expires with the process.
        """
        return hmac.new(self.secret.encode(), (self.token or "").encode(), "sha256").hexdigest()

    def is_token(self, token: str) -> bool:
        """Compare with the token in constant time."""
        return self.token is not None and _are_equal(token, self.token)

    def is_let_in(self, headers: Mapping[str, str]) -> bool:
        """Return whether a request contains the token or the cookie."""
        if self.token is None:
            return True
        kind, _, credentials = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer" and self.is_token(credentials.strip()):
            return True
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return False
        return cookie is not None and _are_equal(cookie.value, self.pass_)

    def is_own_form(self, form: Mapping[str, str]) -> bool:
        """Return whether a form was created by this process."""
        return _are_equal(form.get("secret", ""), self.secret)

    def wrong(self, scope: Scope) -> tuple[int, str]:
        """Return status and reason for refusing a request; 0 and empty if it is permitted."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        name = (urlsplit(f"//{host}").hostname or "").lower()  # remove the port and the brackets of IPv6
        if name not in self.names:
            return 421, "This host name is not allowed; add it with rig window --name NAME."
        origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
        is_own = urlsplit(origin).netloc == host if origin else site in ("same-origin", "none")
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return 405, "Only GET and POST are supported."
        if scope["method"] == "POST" and not origin and "sec-fetch-site" not in headers:
            return 403, "A form must come from a page of this window."
        if not is_own or site == "cross-site" or (scope["method"] == "POST" and not origin):
            return 403, "A different site has asked for this; type the address of the window instead."
        if int(headers.get("content-length", "0") or 0) > MOST_BODY:
            return 413, f"A request may have at most {MOST_BODY} bytes."
        return 0, ""


class Guard:
    """Middleware that forwards permitted requests and adds security headers to the responses."""

    def __init__(self, app: ASGIApp, gate: Gate) -> None:
        self._app, self._gate = app, gate

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Respond to a request or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return

        async def send_held(message: Message) -> None:
            if message["type"] == "http.response.start":
                present = {name.lower() for name, _ in message.get("headers", [])}
                added = {"content-security-policy": _POLICY, **_HEADERS}
                missing = [(k.encode(), v.encode()) for k, v in added.items() if k.encode() not in present]
                message = {**message, "headers": [*message.get("headers", []), *missing]}
            await send(message)

        app, status, why = self._app, 426, "Only HTTP is answered."
        if scope["type"] == "http":
            try:
                status, why = self._gate.wrong(scope)
            except ValueError:
                status, why = 400, "The request is not valid."
        if status:
            app = PlainTextResponse(why, status)
        elif not self._gate.is_let_in(Headers(scope=scope)) and not scope["path"].startswith(_OPEN):
            is_page = "text/html" in Headers(scope=scope).get("accept", "") and scope["method"] == "GET"
            app = RedirectResponse(LOGIN, 303) if is_page else PlainTextResponse("The token is needed.", 401)
        await app(scope, receive, send_held)


async def form_of(request: Request) -> dict[str, str]:
    """Return the fields of a form.

    Raises ValueError for an oversized or invalid form, and TimeoutError for a slow client.
    """
    body = b""
    async with asyncio.timeout(_BODY_S):
        async for piece in request.stream():
            body += piece
            if len(body) > MOST_BODY:
                raise ValueError(f"a form may have at most {MOST_BODY} bytes")
    return dict(parse_qsl(body.decode("utf-8"), max_num_fields=20, keep_blank_values=True))


def _are_equal(text: str, secret: str) -> bool:
    return hmac.compare_digest(text.encode("utf-8", "surrogateescape"), secret.encode())
