"""Who may use the page: whoever has the address with its key, from the page itself; nobody else, whatever they know.

A server on loopback is open to every page that any browser of this machine shows: a script of such a page can connect,
by address or by a name that it lets lead here. So the first request must bring the key; the browser is given it as a
cookie that no other site is sent; and every request must name this server as its host and, where it says so, as origin.
"""

import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

__all__ = ["PORT", "Admitted", "Door", "Refused"]

PORT = 8080
"""Where a page is, unless somebody says otherwise."""
COOKIE = "retarget_view"
KEY_BYTES = 24
HOSTS = ("127.0.0.1", "localhost", "[::1]")

Header = Callable[[str], str | None]
"""The value of a header, None where there is none."""


@dataclass(frozen=True)
class Refused:
    """A request that is not answered. status: of HTTP; why: in words."""

    status: HTTPStatus
    why: str


@dataclass(frozen=True)
class Admitted:
    """cookie: to be set, with a redirect to the page without its key; None: the request goes on as it is."""

    cookie: str | None = None


class Door:
    """Guards one page. port: where it is served; key: None draws one."""

    def __init__(self, port: int, *, key: str | None = None) -> None:
        self.port = port
        self._key = key or secrets.token_urlsafe(KEY_BYTES)
        self._hosts = frozenset(f"{host}:{port}" for host in HOSTS)
        self._cookie = f"{COOKIE}_{port}"  # cookies know no ports: two pages must not take each other's

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://127.0.0.1:{self.port}/?key={self._key}"

    def judge(self, path: str, header: Header) -> Admitted | Refused:
        """Whether a request may be answered. path: with its query; header: those of the request."""
        if header("Host") not in self._hosts:
            return Refused(HTTPStatus.FORBIDDEN, "this page has another address")
        origin = header("Origin")
        upgrade = (header("Upgrade") or "").lower() == "websocket"
        if origin is None and upgrade:
            return Refused(HTTPStatus.FORBIDDEN, "who connects has to say from which page")
        if origin is not None and origin.removeprefix("http://") not in self._hosts:
            return Refused(HTTPStatus.FORBIDDEN, "another page may not use this one")
        if self._is_key(self._cookie_of(header("Cookie"))):
            return Admitted()
        given = parse_qs(urlsplit(path).query).get("key", [""])
        if not upgrade and self._is_key(given[0]):
            return Admitted(f"{self._cookie}={self._key}; Path=/; HttpOnly; SameSite=Strict")
        return Refused(HTTPStatus.UNAUTHORIZED, "open the whole address that was printed, with its key")

    def _is_key(self, text: str) -> bool:
        return hmac.compare_digest(text.encode(), self._key.encode())

    def _cookie_of(self, text: str | None) -> str:
        try:
            found = SimpleCookie(text or "").get(self._cookie)
        except CookieError:
            return ""
        return "" if found is None else found.value
