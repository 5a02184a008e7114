"""A viser server that only this machine reaches, and of it only whoever has the key (see `Door`)."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from io import StringIO
from typing import TYPE_CHECKING, Any

from retarget.errors import ConfigError, UsageError
from retarget.viewer.door import Door, Refused

if TYPE_CHECKING:
    import viser

__all__ = ["close_server", "open_server"]

LOOPBACK = "127.0.0.1"


def open_server(port: int, *, title: str, option: str = "--port") -> tuple["viser.ViserServer", str]:
    """A page on a port of loopback, and its address with its key. 0: any free port. option: by which it was chosen.

    Raises ConfigError where viser is missing, UsageError for a port that is taken.
    """
    try:
        import viser
    except ImportError as error:
        raise ConfigError(
            "the viewer needs viser", found=str(error), next_step="Install it: pip install 'retarget[view]'"
        ) from error
    door = Door(_free(port, option))
    with _guarded(door), redirect_stdout(StringIO()):  # viser prints an address that nobody may open
        server = viser.ViserServer(LOOPBACK, door.port, label=title, verbose=False)
    if server.get_port() != door.port:  # taken meanwhile: viser has the next one, of which the door knows nothing
        server.stop()
        raise _taken(door.port, option)
    server.request_share_url = _shares_nothing  # type: ignore[method-assign]
    server.gui.main_panel.dock_right()
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    return server, door.address


def close_server(server: "viser.ViserServer") -> None:
    """End the page, without the line that viser prints at that."""
    with redirect_stdout(StringIO()):
        server.stop()


def _shares_nothing(verbose: bool = True) -> None:
    """The page stays on this machine."""


def _free(port: int, option: str) -> int:
    """The port, or any that is free for 0. Raises UsageError."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except (OSError, OverflowError) as error:
            raise _taken(port, option) from error
        return int(probe.getsockname()[1])


def _taken(port: int, option: str) -> UsageError:
    return UsageError(
        "the port of the page cannot be had",
        where=option,
        found=f"{port}: taken, or not allowed",
        allowed="0 (any that is free), or 1024 to 65535",
        next_step=f"Close the other viewer, or give another port: {option} 0",
    )


@contextmanager
def _guarded(door: Door) -> Iterator[None]:
    """What viser serves meanwhile is asked through the door; it has no setting for that."""
    from websockets.asyncio import server as sockets
    from websockets.datastructures import Headers
    from websockets.http11 import Request, Response

    serve = sockets.serve

    def guarded(*given: Any, process_request: Any, **named: Any) -> Any:
        def ask(connection: sockets.ServerConnection, request: Request) -> Response | None:
            judged = door.judge(request.path, lambda name: _only(request.headers.get_all(name)))
            if isinstance(judged, Refused):
                body = f"{judged.why}\n".encode()
                kind = {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))}
                return Response(judged.status.value, judged.status.phrase, Headers(**kind), body)
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


def _only(values: list[str]) -> str | None:
    """The one value of a header; several are none that could be trusted."""
    return values[0] if len(values) == 1 else None if not values else "\0several"
