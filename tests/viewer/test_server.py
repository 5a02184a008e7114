"""Who may use the page of a run, and who may not."""

import http.client
import socket
from collections.abc import Iterator
from http import HTTPStatus
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from retarget.viewer.server import AccessToken, Refused, close_server, open_server

KEY = "k" * 32
HERE = {"Host": "127.0.0.1:8080"}


def judge(path: str = f"/{KEY}/", **headers: str) -> str | Refused:
    named = HERE | {name.title(): value for name, value in headers.items()}
    return AccessToken(8080, key=KEY).judge(path, named.get)


def test_the_address_opens_the_page_and_all_of_it() -> None:
    assert AccessToken(8080, key=KEY).address == f"http://127.0.0.1:8080/{KEY}/"
    assert judge() == "/" and judge(f"/{KEY}") == "/" and judge(f"/{KEY}/?x=1") == "/"
    assert judge(f"/{KEY}/assets/index.js") == "/assets/index.js"
    for origin in ("http://127.0.0.1:8080", "http://localhost:8080"):
        assert judge(upgrade="websocket", origin=origin) == "/"


@pytest.mark.parametrize(
    "path", ["/", "", "//", f"//{KEY}/", f"/{KEY[:-1]}/", f"/x/{KEY}/", f"/?key={KEY}", f"/{KEY}x/"]
)
def test_without_the_key_nothing_is_served(path: str) -> None:
    judged = judge(path, cookie=f"key={KEY}")
    assert isinstance(judged, Refused) and judged.status is HTTPStatus.UNAUTHORIZED


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "https://127.0.0.1:8080", "http://127.0.0.1:8081", "null", "", "http://127.0.0.1"]
)
def test_another_page_may_not_use_it_even_with_the_key(origin: str) -> None:
    for headers in ({}, {"upgrade": "websocket"}, {"upgrade": "h2c, websocket"}):
        judged = judge(origin=origin, **headers)
        assert isinstance(judged, Refused) and judged.status is HTTPStatus.FORBIDDEN


@pytest.mark.parametrize(
    "host", ["evil.example:8080", "127.0.0.1", "127.0.0.1:8081", "", "127.0.0.1:8080.evil.example"]
)
def test_a_foreign_name_that_resolves_here_is_refused(host: str) -> None:
    assert isinstance(AccessToken(8080, key=KEY).judge(f"/{KEY}/", {"Host": host}.get), Refused)


ANY = st.characters(codec=None, categories=("L", "N", "P", "S", "Z", "C"))


@given(st.text(ANY, max_size=80), st.text(ANY, max_size=40))
def test_whatever_is_sent_is_judged(path: str, origin: str) -> None:
    if KEY not in path:
        assert isinstance(judge(path, origin=origin), Refused)
        assert isinstance(judge(path), Refused)


# The page as browsers and others see it: over sockets, with and without what opens it.

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
    for origin, offered in (("http://evil.example", key), (None, key), (here, ""), (here, key + "x")):
        with pytest.raises(InvalidStatus), dial(page, origin=origin, key=offered):
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
