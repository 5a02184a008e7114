"""A small server of pages, with an access token, files, and WebSockets.

Any page in a browser of this machine can connect to a server on loopback, also by a name (DNS rebinding). So every path
begins with a secret key, and host and origin of a request must be this server. Browsers would send a cookie to all
ports of this machine.
"""

import asyncio
import hashlib
import hmac
import logging
import mimetypes
import secrets
import ssl
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Literal

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from retarget.errors import ConfigError
from retarget.live.address import EVERYWHERE, local_interfaces
from retarget.sources.streams.stream_frame import MAX_DATAGRAM

# Access.

KEY_BYTES = 24
"""Random bytes of a key: 192 bits cannot be guessed."""
HOSTS = ("127.0.0.1", "localhost", "[::1]")

Header = Callable[[str], str | None]
"""The value of a header, None if there is none."""


@dataclass(frozen=True)
class Refused:
    """The refusal of a request. status: of HTTP; why: in words."""

    status: HTTPStatus
    why: str


class AccessToken:
    """Guards one page. port: set once it is known. key: None draws one. hosts: of this server, the first one for
    `address`."""

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
        """The address for a browser."""
        return f"{self._scheme}://{self._hosts[0]}:{self.port}/{self._key}/"

    def judge(self, path: str, header: Header) -> str | Refused:
        """The path of a request without the key, with a leading slash, or the refusal."""
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


def only_value(values: list[str]) -> str | None:
    """The one value of a header. Several values become one that fails every check."""
    return values[0] if len(values) == 1 else None if not values else "\0several"


# Files, each with its policy for browsers.

POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self' blob:; connect-src 'self'; "
    "img-src 'self' data: blob:; style-src 'self'; media-src 'self' blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""Content security policy: the page connects to this server alone."""
HEADERS = {
    "Content-Security-Policy": POLICY,
    "Permissions-Policy": "camera=(self), xr-spatial-tracking=(self), microphone=(), geolocation=()",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".wasm": "application/wasm", ".svg": "image/svg+xml"}
SOCKET = "ws"
"""The place of the WebSocket under the key."""
NEXT_PORTS = 20
"""Number of ports that are tried, from the requested one on."""

FileOf = Callable[[str], Path | bytes | None]
"""The file at a place under the key, None if there is none."""


def file_response(name: str, body: bytes) -> Response:
    """Answer a request for a file."""
    kind = TYPES.get(Path(name).suffix) or mimetypes.guess_type(name)[0] or "application/octet-stream"
    return Response(
        HTTPStatus.OK, "OK", Headers({"Content-Type": kind, "Content-Length": str(len(body)), **HEADERS}), body
    )


class Pages:
    """Serves files to browsers that have the key. listen: on every interface, with HTTPS. talk: serves a WebSocket
    until it returns. notify: receives refusals."""

    def __init__(
        self,
        file_of: FileOf,
        *,
        listen: bool = False,
        talk: Callable[[ServerConnection], Awaitable[None]] | None = None,
        notify: Callable[[str], object] = lambda text: None,
    ) -> None:
        hosts = (*local_interfaces().values(), *HOSTS) if listen else HOSTS
        self._hosts = tuple(dict.fromkeys(sorted(hosts, key=HOSTS.__contains__)))
        self.access = AccessToken(hosts=self._hosts, scheme="https" if listen else "http")
        self.fingerprint = ""
        """SHA-256 of the certificate; "" without one."""
        self._file_of, self._listen, self._talk, self._notify = file_of, listen, talk, notify

    async def open(self, port: int) -> Server:
        """Serve on a port, or the next one that is free; 0 for any. Raises ConfigError if none is."""
        context = None
        if self._listen:
            context, self.fingerprint = certified(self._hosts)
        for at in range(port, port + NEXT_PORTS):
            try:
                listener = await serve(
                    self._talk or _hang_up,
                    EVERYWHERE if self._listen else HOSTS[0],
                    at,
                    ssl=context,
                    process_request=self.answer,
                    compression=None,
                    max_size=MAX_DATAGRAM,
                    ping_interval=2.0,
                    ping_timeout=4.0,
                    open_timeout=10.0,
                    close_timeout=1.0,
                    logger=_SILENT,
                )
                self.access.port = listener.sockets[0].getsockname()[1]
                return listener
            except OSError as error:
                refused = error
        raise ConfigError("the page cannot be served", where=f"port {port}", found=str(refused))

    async def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request with a file or a refusal. None opens a WebSocket."""
        judged = self.access.judge(request.path, lambda name: only_value(request.headers.get_all(name)))
        if isinstance(judged, Refused):
            self._notify(f"a page was refused: {judged.why}")
            return connection.respond(judged.status, f"{judged.why}\n")
        place = judged.removeprefix("/")
        if place == SOCKET and self._talk is not None:
            return None
        found = self._file_of(place)
        if found is None:
            return connection.respond(HTTPStatus.NOT_FOUND, "there is no such file\n")
        if isinstance(found, Path):
            return file_response(found.name, await asyncio.to_thread(found.read_bytes))  # of 10 MB, while poses come
        return file_response(place or "index.html", found)


async def _hang_up(connection: ServerConnection) -> None:
    """Close a connection that no page needs."""


def serve_files(
    files: Mapping[str, bytes], port: int, *, opened: Callable[[str], object], over: Callable[[], bool]
) -> None:
    """Serve files by their places, "" for the page, until `over` returns True. opened: receives the address. Raises
    ConfigError if no port is free."""

    async def served() -> None:
        pages = Pages(files.get)
        async with await pages.open(port):
            opened(pages.access.address)
            while not over():
                await asyncio.sleep(0.1)

    asyncio.run(served())


# HTTPS: without it, browsers give camera and headset to localhost alone.


def certified(hosts: Sequence[str]) -> tuple[ssl.SSLContext, str]:
    """A TLS context for names and IPv4 addresses, and the SHA-256 fingerprint of its certificate, which the
    user compares, since no authority vouches for it."""
    import trustme

    names = [host for host in hosts if ":" not in host]
    issued = trustme.CA(organization_name="retarget").issue_cert(*names, organization_name="retarget")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    issued.configure_cert(context)
    der = ssl.PEM_cert_to_DER_cert(issued.cert_chain_pems[0].bytes().decode())
    digest = hashlib.sha256(der).hexdigest().upper()
    return context, ":".join(digest[at : at + 2] for at in range(0, len(digest), 2))


_SILENT = logging.getLogger(__name__)
_SILENT.addHandler(logging.NullHandler())
_SILENT.propagate = False
"""Discards errors of connections that break off."""
