"""A viser server that only this machine reaches, and there only requests with its key (see `AccessToken`)."""

import hmac
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from http import HTTPStatus
from io import StringIO
from typing import TYPE_CHECKING, Any, Literal

from retarget.errors import ConfigError

if TYPE_CHECKING:
    import viser


# The access token: only a browser that was given the whole address may use the page, and only from the page itself.
#
# A server on loopback is open to every page that any browser of this machine shows: a script of such a page can
# connect, by address or by a name that it lets resolve to it. So every path begins with a key that cannot be guessed,
# and every request must name this server as its host and, if it has one, as its origin. A cookie would not do: browsers
# send those of one port of this machine to every other, also to that of another user.

PORT = 8080
"""Default port of a page."""
KEY_BYTES = 24
"""Random bytes of the key of a page: 192 bits cannot be guessed."""
HOSTS = ("127.0.0.1", "localhost", "[::1]")

Header = Callable[[str], str | None]
"""The value of a header, None where there is none."""


@dataclass(frozen=True)
class Refused:
    """A request that is not answered. status: of HTTP; why: in words."""

    status: HTTPStatus
    why: str


class AccessToken:
    """Guards one page. port: where it is served, known once the server has it; key: None draws one. hosts: names and
    addresses of this server, the first of which is told; scheme: http or https."""

    def __init__(
        self,
        port: int | None = None,
        *,
        key: str | None = None,
        hosts: Sequence[str] = HOSTS,
        scheme: Literal["http", "https"] = "http",
    ) -> None:
        self.port = port
        self._key = key or secrets.token_urlsafe(KEY_BYTES)
        self._hosts, self._scheme = tuple(hosts), scheme

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"{self._scheme}://{self._hosts[0]}:{self.port}/{self._key}/"

    def judge(self, path: str, header: Header) -> str | Refused:
        """The path without the key (it begins with a slash) of a request that may be answered; else why not.

        path: as requested; header: those of the request.
        """
        hosts = [f"{host}:{self.port}" for host in self._hosts]
        if header("Host") not in hosts:
            return Refused(HTTPStatus.FORBIDDEN, "this page has another address")
        origin = header("Origin")
        if origin is None and header("Upgrade") is not None:
            return Refused(HTTPStatus.FORBIDDEN, "a connection has to name the page that it comes from")
        if origin is not None and origin.removeprefix(f"{self._scheme}://") not in hosts:
            return Refused(HTTPStatus.FORBIDDEN, "another page may not use this one")
        given, _, rest = path.removeprefix("/").partition("?")[0].partition("/")
        if not hmac.compare_digest(given.encode(errors="replace"), self._key.encode()):
            return Refused(HTTPStatus.UNAUTHORIZED, "open the whole address that was printed")
        return f"/{rest}"


LOOPBACK = "127.0.0.1"


def open_server(port: int, *, title: str) -> tuple["viser.ViserServer", str]:
    """A page on a port of loopback, or the next one that is free, and its address with its key. 0: any free port.

    Raises ConfigError where viser is missing.
    """
    try:
        import viser
    except ImportError as error:
        raise ConfigError(
            "the viewer needs viser", found=str(error), next_step="Install it: pip install 'retarget[view]'"
        ) from error
    access = AccessToken()
    with _guarded(access), redirect_stdout(StringIO()):  # viser prints an address without the key
        server = viser.ViserServer(LOOPBACK, port, label=title, verbose=False)  # where it is taken, the next one
    access.port = server.get_port()
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]  # it stays on this machine
    server.gui.main_panel.dock_right()
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    return server, access.address


def close_server(server: "viser.ViserServer") -> None:
    """End the page, without the line that viser prints at that."""
    with redirect_stdout(StringIO()):
        server.stop()


@contextmanager
def _guarded(access: AccessToken) -> Iterator[None]:
    """While a viser server is made, check each of its requests by the token; viser has no setting for that."""
    from websockets.asyncio import server as sockets
    from websockets.http11 import Request, Response

    serve = sockets.serve

    def guarded(*given: Any, process_request: Any, **named: Any) -> Any:
        def ask(connection: sockets.ServerConnection, request: Request) -> Response | None:
            judged = access.judge(request.path, lambda name: only_value(request.headers.get_all(name)))
            if isinstance(judged, Refused):
                return connection.respond(judged.status, f"{judged.why}\n")
            response: Response | None = process_request(connection, replace(request, path=judged))
            if response is not None:
                response.headers["X-Frame-Options"] = "DENY"
                response.headers["Referrer-Policy"] = "no-referrer"
            return response

        return serve(*given, process_request=ask, **named)

    sockets.serve = guarded  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        sockets.serve = serve  # type: ignore[misc]


def only_value(values: list[str]) -> str | None:
    """The one value of a header; of several, one that no check passes."""
    return values[0] if len(values) == 1 else None if not values else "\0several"
