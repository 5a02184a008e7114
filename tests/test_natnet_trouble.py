"""What is wrong with a NatNet session, said so that somebody in a lab can mend it."""

import pytest

from natnet_packets import Body, Catalogue, Motion, definitions, frame, server_info
from retarget.sources.natnet_session import NatnetSession, SessionSettings
from retarget.sources.natnet_trouble import natnet_problems
from retarget.sources.natnet_wire import Version
from support.messages import shows

V41 = Version(4, 1)
FRAME = frame(Motion(), V41)
CATALOGUE = definitions(Catalogue(bodies=[Body("Quad", 1)]), V41)


def said(session: NatnetSession, now: float) -> list[str]:
    return [problem.render() for problem in natnet_problems(session, now, host="10.0.0.2")]


def started(transport: str = "unicast") -> NatnetSession:
    session = NatnetSession(SessionSettings(transport="unicast" if transport == "unicast" else "multicast"))
    session.poll(0.0)
    return session


def test_no_answer() -> None:
    session = started()
    assert said(session, 2.9) == []
    (text,) = said(session, 3.0)
    assert "10.0.0.2" in text
    shows(text, "UDP", 1510)


def test_frames_but_no_answer() -> None:
    session = started("multicast")
    session.receive(1.0, FRAME)
    (text,) = said(session, 3.0)
    shows(text)


@pytest.mark.parametrize(
    ("version", "cure"), [(Version(2, 10), "Update Motive"), (Version(5, 0), "choose a 4.x bitstream")]
)
def test_a_version_that_cannot_be_read(version: Version, cure: str) -> None:
    session = started()
    session.receive(0.1, server_info(version))
    (text,) = said(session, 0.1)
    shows(text, str(version), "3.1")
    assert "3.0 to 4.x" in text and cure in text


@pytest.mark.parametrize("mine", ["unicast", "multicast"])
def test_the_other_way_of_streaming(mine: str) -> None:
    session = started(mine)
    session.receive(0.0, server_info(V41, multicast=mine == "unicast"))
    assert said(session, 1.9) == []
    (text,) = said(session, 2.0)
    shows(text, mine)
    assert ("239.255.42.99, port 1511" in text) == (mine == "unicast")


@pytest.mark.parametrize(
    ("mine", "hint"), [("unicast", "firewall lets UDP"), ("multicast", "239.255.42.99 was joined")]
)
def test_no_frames(mine: str, hint: str) -> None:
    session = started(mine)
    session.receive(0.0, server_info(V41, multicast=mine == "multicast"))
    (text,) = said(session, 2.5)
    shows(text)
    assert hint in text


def test_no_definitions() -> None:
    session = started()
    session.receive(0.0, server_info(V41))
    for i in range(40):
        session.poll(i / 10)
        session.receive(i / 10, FRAME)
    (text,) = said(session, 4.0)
    shows(text)
    session.receive(4.0, CATALOGUE)
    assert said(session, 4.0) == []


def test_nothing_is_wrong() -> None:
    session = started()
    session.receive(0.0, server_info(V41))
    session.poll(0.0)
    session.receive(0.0, CATALOGUE)
    session.receive(0.0, FRAME)
    assert said(session, 1.0) == []
