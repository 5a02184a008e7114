"""Who may use the page of a run, and who may not."""

from http import HTTPStatus

import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.viewer.server import AccessToken, Refused

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


@pytest.mark.parametrize("upgrade", ["websocket", "WebSocket", "h2c, websocket", "websocket/13", ""])
def test_who_connects_says_from_where(upgrade: str) -> None:
    assert isinstance(judge(upgrade=upgrade), Refused)


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


def test_every_page_has_its_own_key() -> None:
    keys = {AccessToken(8080).address.split("/")[3] for _ in range(10)}
    assert len(keys) == 10 and all(len(key) >= 32 for key in keys)
