"""The page as browsers and others see it: over sockets, with and without what opens it."""

import http.client
import socket
from collections.abc import Iterator
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from retarget.viewer.server import close_server, open_server

viser = pytest.importorskip("viser", reason="the viewer's extra is not installed")


@pytest.fixture(scope="module")
def page() -> Iterator[tuple[int, str]]:
    server, address = open_server(0, title="test")
    yield int(address.split(":")[2].split("/")[0]), address.split("/")[3]
    server.stop()


def answer(port: int, path: str, **headers: str) -> http.client.HTTPResponse:
    link = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
    link.request("GET", path, headers=headers)
    return link.getresponse()


def dial(page: tuple[int, str], *, origin: str | None, key: str) -> Any:
    port, _ = page
    return connect(
        f"ws://127.0.0.1:{port}/{key}",
        origin=None if origin is None else Origin(origin),
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
        open_timeout=10.0,
    )


def test_the_key_opens_it_and_nothing_else(page: tuple[int, str]) -> None:
    port, key = page
    for path in ("/", "/wrong/", "//[", f"/?key={key}", "/%ff"):
        assert answer(port, path).status == 401
    assert answer(port, f"/{key}/", Origin="http://evil.example").status == 403
    assert answer(port, f"/{key}/", Host="evil.example").status == 403
    opened = answer(port, f"/{key}/")
    assert opened.status == 200 and opened.headers["X-Frame-Options"] == "DENY" and b"<html" in opened.read()
    assert opened.headers["Set-Cookie"] is None
    assert answer(port, f"/{key}/../../pyproject.toml").status == 404


def test_another_origin_cannot_connect(page: tuple[int, str]) -> None:
    port, key = page
    here = f"http://127.0.0.1:{port}"
    for origin, given in (("http://evil.example", key), (None, key), (here, ""), (here, key + "x")):
        with pytest.raises(InvalidStatus), dial(page, origin=origin, key=given):
            pass
    with dial(page, origin=here, key=key) as link:
        assert link.recv(timeout=10.0)


def test_only_this_machine_reaches_it(page: tuple[int, str]) -> None:
    """Linux has all of 127.0.0.0/8: who listens everywhere listens there, too."""
    with socket.socket() as other, pytest.raises(ConnectionRefusedError):
        other.connect(("127.0.0.2", page[0]))


def test_where_a_port_is_taken_the_next_free_one_is_used() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        server, address = open_server(port, title="test")
        assert server.get_port() > port and f":{server.get_port()}/" in address
        close_server(server)


def test_it_is_not_shared() -> None:
    server, _ = open_server(0, title="test")
    assert server.request_share_url() is None
    server.stop()


def test_it_ends_without_a_word(capsys: pytest.CaptureFixture[str]) -> None:
    server, _ = open_server(0, title="test")
    close_server(server)
    assert capsys.readouterr() == ("", "")
