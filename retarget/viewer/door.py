"""Who may use the page: whoever has its address, from the page itself; nobody else, whatever they know.

A server on loopback is open to every page that any browser of this machine shows: a script of such a page can connect,
by address or by a name that it lets lead here. So every path begins with a key that nobody can guess, and every request
must name this server as its host and, where it says so, as its origin. A cookie would not do: browsers send those of
one port of this machine to every other, also to that of somebody else.
"""

import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus

__all__ = ["PORT", "Door", "Refused"]

PORT = 8080
"""Where a page is, unless somebody says otherwise."""
KEY_BYTES = 24
HOSTS = ("127.0.0.1", "localhost", "[::1]")

Header = Callable[[str], str | None]
"""The value of a header, None where there is none."""


@dataclass(frozen=True)
class Refused:
    """A request that is not answered. status: of HTTP; why: in words."""

    status: HTTPStatus
    why: str


class Door:
    """Guards one page. port: where it is served; key: None draws one."""

    def __init__(self, port: int, *, key: str | None = None) -> None:
        self.port = port
        self._key = key or secrets.token_urlsafe(KEY_BYTES)
        self._hosts = frozenset(f"{host}:{port}" for host in HOSTS)

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://127.0.0.1:{self.port}/{self._key}/"

    def judge(self, path: str, header: Header) -> str | Refused:
        """The path without the key (it begins with a slash) of a request that may be answered; else why not.

        path: as requested; header: those of the request.
        """
        if header("Host") not in self._hosts:
            return Refused(HTTPStatus.FORBIDDEN, "this page has another address")
        origin = header("Origin")
        if origin is None and header("Upgrade") is not None:
            return Refused(HTTPStatus.FORBIDDEN, "who connects has to say from which page")
        if origin is not None and origin.removeprefix("http://") not in self._hosts:
            return Refused(HTTPStatus.FORBIDDEN, "another page may not use this one")
        given, _, rest = path.removeprefix("/").partition("?")[0].partition("/")
        if not hmac.compare_digest(given.encode(errors="replace"), self._key.encode()):
            return Refused(HTTPStatus.UNAUTHORIZED, "open the whole address that was printed")
        return f"/{rest}"
