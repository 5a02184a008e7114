"""Who may use the page of a run, and who may not."""

from http import HTTPStatus

import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.viewer.door import Admitted, Door, Refused

KEY = "k" * 32
HERE = {"Host": "127.0.0.1:8080"}


def judge(path: str = "/", **headers: str) -> Admitted | Refused:
    named = HERE | {name.replace("_", "-").title(): value for name, value in headers.items()}
    return Door(8080, key=KEY).judge(path, named.get)


def cookie() -> str:
    judged = judge(f"/?key={KEY}")
    assert isinstance(judged, Admitted) and judged.cookie is not None
    assert "HttpOnly" in judged.cookie and "SameSite=Strict" in judged.cookie
    return judged.cookie.split(";")[0]


def test_the_address_opens_the_page_and_its_cookie_everything_after() -> None:
    assert judge("/", cookie=cookie()) == Admitted()
    assert judge("/assets/index.js", cookie="other=1; " + cookie()) == Admitted()
    assert judge("/", cookie=cookie(), upgrade="websocket", origin="http://127.0.0.1:8080") == Admitted()
    assert judge("/", cookie=cookie(), upgrade="websocket", origin="http://localhost:8080") == Admitted()


def test_without_the_key_nobody_gets_anything() -> None:
    for path in ("/", "/?key=", f"/?key={KEY[:-1]}", f"/?Key={KEY}", "/assets/index.js"):
        judged = judge(path)
        assert isinstance(judged, Refused) and judged.status is HTTPStatus.UNAUTHORIZED
    assert isinstance(judge("/", cookie="retarget_view_8080=x"), Refused)
    assert isinstance(judge("/", cookie=cookie().replace("8080", "8081")), Refused)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "https://127.0.0.1:8080", "http://127.0.0.1:8081", "null", "", "http://127.0.0.1"]
)
def test_another_page_may_not_use_it_whatever_it_has(origin: str) -> None:
    for upgrade in ("", "websocket"):
        judged = judge(f"/?key={KEY}", cookie=cookie(), origin=origin, upgrade=upgrade)
        assert isinstance(judged, Refused) and judged.status is HTTPStatus.FORBIDDEN


def test_who_connects_says_from_where_and_has_the_cookie() -> None:
    assert isinstance(judge("/", cookie=cookie(), upgrade="WebSocket"), Refused)
    judged = judge(f"/?key={KEY}", upgrade="websocket", origin="http://127.0.0.1:8080")
    assert isinstance(judged, Refused), "the key alone is for the page, not for a connection"


@pytest.mark.parametrize(
    "host", ["evil.example:8080", "127.0.0.1", "127.0.0.1:8081", "", "127.0.0.1:8080.evil.example"]
)
def test_a_name_that_somebody_lets_lead_here_is_refused(host: str) -> None:
    assert isinstance(Door(8080, key=KEY).judge(f"/?key={KEY}", {"Host": host}.get), Refused)


@given(st.text(max_size=80), st.text(max_size=80), st.text(max_size=40))
def test_whatever_is_sent_is_judged(path: str, jar: str, origin: str) -> None:
    if KEY not in path + jar:
        assert isinstance(judge(path, cookie=jar, origin=origin), Refused)


def test_every_page_has_its_own_key() -> None:
    assert len({Door(8080).address for _ in range(10)}) == 10
    assert len(Door(8080).address.partition("key=")[2]) >= 32
