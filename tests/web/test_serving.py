"""Who may use the page of a run, and who may not."""

import http.client
import queue
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("websockets", reason="the extra view is not installed")
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from retarget.web.serving import AccessToken, Refused, serve_files

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
    assert isinstance(judge(host=host), Refused)


ANY = st.characters(codec=None, categories=("L", "N", "P", "S", "Z", "C"))


@given(st.text(ANY, max_size=80), st.text(ANY, max_size=40))
def test_whatever_is_sent_is_judged(path: str, origin: str) -> None:
    if KEY not in path:
        assert isinstance(judge(path, origin=origin), Refused)
        assert isinstance(judge(path), Refused)


# The page as browsers and others see it: over sockets, with and without what opens it.


@contextmanager
def served(port: int = 0) -> Iterator[tuple[int, str]]:
    """A page in a thread of its own: its port and key."""
    over, addresses = threading.Event(), queue.Queue[str]()
    files = {"": b"<html></html>", "player.js": b"export {};"}
    kept = {"opened": addresses.put, "over": over.is_set}
    thread = threading.Thread(target=serve_files, args=(files, port), kwargs=kept)
    thread.start()
    try:
        address = addresses.get(timeout=10.0)
        yield int(address.split(":")[2].split("/")[0]), address.split("/")[3]
    finally:
        over.set()
        thread.join(10.0)


@pytest.fixture(scope="module")
def page() -> Iterator[tuple[int, str]]:
    with served() as one:
        yield one


def answer(port: int, path: str, **headers: str) -> http.client.HTTPResponse:
    link = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
    link.request("GET", path, headers=headers)
    return link.getresponse()


def test_the_key_opens_it_and_nothing_else(page: tuple[int, str]) -> None:
    port, key = page
    for path in ("/", "/wrong/", "//[", f"/?key={key}", "/%ff"):
        assert answer(port, path).status == 401
    assert answer(port, f"/{key}/", Origin="http://evil.example").status == 403
    assert answer(port, f"/{key}/", Host="evil.example").status == 403
    opened = answer(port, f"/{key}/")
    assert opened.status == 200 and b"<html" in opened.read() and opened.headers["Content-Type"] == "text/html"
    assert "frame-ancestors 'none'" in opened.headers["Content-Security-Policy"]
    assert opened.headers["Referrer-Policy"] == "no-referrer" and opened.headers["Set-Cookie"] is None
    assert answer(port, f"/{key}/player.js").headers["Content-Type"] == "text/javascript"
    for place in ("../../pyproject.toml", "page.css", "ws"):
        assert answer(port, f"/{key}/{place}").status == 404


def test_a_page_of_files_has_no_socket(page: tuple[int, str]) -> None:
    port, key = page
    own = f"http://127.0.0.1:{port}"
    for origin, offered in (("http://evil.example", key), (None, key), (own, key + "x"), (own, key)):
        where = f"ws://127.0.0.1:{port}/{offered}/ws"
        with pytest.raises(InvalidStatus), connect(where, origin=None if origin is None else Origin(origin)):
            pass


def test_only_this_machine_reaches_it(page: tuple[int, str]) -> None:
    """Linux has all of 127.0.0.0/8: a server on all addresses answers there, too."""
    with socket.socket() as other, pytest.raises(ConnectionRefusedError):
        other.connect(("127.0.0.2", page[0]))


def test_where_a_port_is_taken_the_next_free_one_is_used(page: tuple[int, str]) -> None:
    with served(page[0]) as (port, key):
        assert page[0] < port and answer(port, f"/{key}/").status == 200
