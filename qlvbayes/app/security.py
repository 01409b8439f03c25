"""Decide which requests are answered, and what the browser may do with the answer.

A page of another site can make the browser send requests to this server. It cannot read the token,
set its own header without permission, or hide its origin: therefore all three are checked.
"""

from __future__ import annotations

import secrets
import socket
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from qlvbayes.app.failures import error_content

CHANGING = "x-qlvbayes"
"""Header of requests that change something; no form sends it."""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; font-src 'self'; form-action 'none'; base-uri 'none'; "
    "frame-ancestors 'none'"
)
UPLOAD_LIMIT = 64 * 2**20  # most bytes of an upload: an hour of three columns at 1 kHz as text
BODY_LIMIT = 2**20  # most bytes of any other request
_HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
_SAFE = ("GET", "HEAD")
_HERE = {"localhost", "127.0.0.1"}
_EVERYWHERE = {"0.0.0.0", "::"}


class TooLargeError(Exception):
    """Exception for a request that is longer than allowed."""


@dataclass(frozen=True)
class Address:
    """Address of the server: its Host headers and origins, and the name of its cookie.

    ``secure`` is whether it is reached by https only, through a proxy.
    """

    hosts: frozenset[str]
    origins: frozenset[str]
    cookie: str
    secure: bool = False

    @classmethod
    def from_host(cls, host: str, port: int, behind: str | None = None) -> Address:
        """Return the address of a bound host and port, or of a proxy in front of it."""
        if behind is not None:
            parts = urlsplit(behind)
            origin = f"{parts.scheme}://{parts.netloc}"
            secure = parts.scheme == "https"
            return cls(frozenset({parts.netloc}), frozenset({origin}), f"qlvbayes-{port}", secure)
        names = {host}
        names |= _HERE if host in _HERE | _EVERYWHERE else set()
        names |= _own_names() if host in _EVERYWHERE else set()
        hosts = frozenset(f"[{name}]:{port}" if ":" in name else f"{name}:{port}" for name in names)
        return cls(hosts, frozenset(f"http://{one}" for one in hosts), f"qlvbayes-{port}")


class RequestFilter:
    """Filter of requests: those with the token and from the server's own page pass."""

    def __init__(self, app: ASGIApp, *, token: str, address: Address) -> None:
        self.app = app
        self.token = token
        self.address = address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            raise RuntimeError("only http is served")

        async def answered(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        refused = self._refused(scope)
        if refused is not None:
            await refused(scope, receive, answered)
            return
        limit = UPLOAD_LIMIT if scope["path"] == "/api/upload" else BODY_LIMIT
        await self.app(scope, _limited(receive, limit), answered)

    def _refused(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        if headers.get("host", "") not in self.address.hosts:
            return _refusal("this server is not called so", "use the address that it printed")
        origin = headers.get("origin")
        if origin is not None and origin not in self.address.origins:
            return _refusal("the request comes from another page", "use the page itself")
        if scope["method"] not in _SAFE and headers.get(CHANGING) != "1":
            return _refusal("the request lacks its header", f"send {CHANGING}: 1")
        query = dict(parse_qsl(scope["query_string"].decode("latin-1")))
        given = query.pop("token", None)
        if given is not None and scope["method"] == "GET" and self._right(given):
            return self._entered(scope["path"], query)
        if self._right(self._shown(headers)):
            return None
        return _refusal("the token is missing or wrong", "open the address that the server printed")

    def _right(self, token: str) -> bool:
        return secrets.compare_digest(token.encode(), self.token.encode())

    def _shown(self, headers: Headers) -> str:
        word, _, token = headers.get("authorization", "").partition(" ")
        if word == "Bearer":
            return token
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(self.address.cookie)
        except CookieError:
            return ""
        return "" if cookie is None else cookie.value

    def _entered(self, path: str, query: dict[str, str]) -> Response:
        """Redirect to the same address without the token, so that the browser does not keep it."""
        # one slash: two would name another host
        target = "/" + path.lstrip("/\\") + (f"?{urlencode(query)}" if query else "")
        answer = RedirectResponse(target, status_code=303)
        answer.set_cookie(
            self.address.cookie, self.token, httponly=True, samesite="strict",
            secure=self.address.secure,
        )  # fmt: skip
        return answer


def _own_names() -> set[str]:
    """Return names and addresses of this machine, as it knows them itself."""
    name = socket.gethostname()
    try:
        _, aliases, addresses = socket.gethostbyname_ex(name)
    except OSError:
        aliases, addresses = [], []
    return {name, socket.getfqdn(), *aliases, *addresses}


def _limited(receive: Receive, limit: int) -> Receive:
    taken = 0

    async def limited() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        if taken > limit:
            raise TooLargeError
        return message

    return limited


def _refusal(message: str, remedy: str) -> Response:
    return JSONResponse({"error": error_content(message, remedy)}, status_code=403)
