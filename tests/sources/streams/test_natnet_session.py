"""What a NatNet session sends and when, on virtual time."""

import numpy as np
import pytest

from messages import shows
from natnet_packets import (
    VERSIONS,
    Body,
    Catalogue,
    FakeMotive,
    Motion,
    MotiveSettings,
    datagram,
    definitions,
    frame,
    server_info,
)
from retarget.frames import SensorFrames
from retarget.live.stream_report import natnet_problems
from retarget.rotations import angle_between
from retarget.sources.streams.natnet_decoder import NatnetDecoder
from retarget.sources.streams.natnet_session import KEEP_ALIVE_S, UNNAMED_S, NatnetSession
from retarget.sources.streams.natnet_wire import (
    MessageId,
    Version,
    connect_message,
    message,
)
from retarget.sources.streams.stream_frame import StreamFrame
from sim.performer import synthetic_performer

V41, V44 = Version(4, 1), Version(4, 4)
DEFINITIONS_REQUEST, KEEP_ALIVE = message(MessageId.DEFINITIONS_REQUEST), message(MessageId.KEEP_ALIVE)
GROUP = ("239.255.42.99", 1511)
CATALOGUE = definitions(Catalogue(bodies=[Body("Quad", 1)]), V41)
FRAME = frame(Motion(), V41)


def answered(*, multicast: bool = False, version: Version = V41, now: float = 0.0) -> NatnetSession:
    """A session whose server answered, sent its definitions, and sent a frame."""
    session = NatnetSession(group=GROUP if multicast else None)
    session.poll(now)
    session.receive(now, server_info(version, multicast=multicast))
    session.poll(now)
    session.receive(now, CATALOGUE)
    session.receive(now, FRAME)
    return session


def test_it_asks_again_until_a_server_answers() -> None:
    session = NatnetSession()
    assert session.poll(0.0) == [connect_message()]
    assert session.poll(0.5) == []
    assert session.poll(1.0) == [connect_message()]
    session.receive(2.1, server_info(V41))
    assert session.poll(2.1) == [DEFINITIONS_REQUEST, KEEP_ALIVE]
    assert session.poll(3.05) == []


def test_definitions_are_asked_for_until_they_come() -> None:
    session = NatnetSession(group=GROUP)
    session.poll(0.0)
    session.receive(0.0, server_info(V41, multicast=True))
    assert session.poll(0.0) == [DEFINITIONS_REQUEST]
    session.receive(0.1, datagram(5, b"damaged"))
    assert session.poll(0.9) == []
    assert session.poll(1.0) == [DEFINITIONS_REQUEST]
    session.receive(1.1, CATALOGUE)
    session.receive(1.1, FRAME)
    assert session.poll(2.5) == []


def test_signs_of_life_come_by_time_and_not_by_frames() -> None:
    session = answered()
    sent = 0
    for i in range(1, 2401):
        now = i / 240
        session.receive(now, FRAME)
        sent += session.poll(now).count(KEEP_ALIVE)
    assert sent == pytest.approx(10 / KEEP_ALIVE_S, abs=1)


def test_multicast_needs_no_sign_of_life() -> None:
    session = NatnetSession(group=GROUP)
    assert session.poll(0.0) == [connect_message()]
    session.receive(0.0, server_info(V44, multicast=True))
    sent = [one for i in range(50) for one in session.poll(i / 10)]
    assert KEEP_ALIVE not in sent


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_every_version_is_asked_the_same(version: Version) -> None:
    session = NatnetSession()
    session.poll(0.0)
    session.receive(0.0, server_info(version))
    assert session.poll(0.0) == [DEFINITIONS_REQUEST, KEEP_ALIVE]


def test_changed_definitions_are_asked_for_once_and_not_per_frame() -> None:
    session = answered(multicast=True, now=0.0)
    changed = frame(Motion(flags=2), V41)
    sent = []
    for i in range(10, 25):
        session.receive(i / 10, changed)
        sent += session.poll(i / 10)
        if sent:
            session.receive(i / 10, CATALOGUE)
    assert sent == [DEFINITIONS_REQUEST]
    session.receive(2.5, FRAME)
    session.receive(2.6, changed)
    assert session.poll(2.6) == [DEFINITIONS_REQUEST]


def test_a_silent_server_is_asked_again_and_its_definitions_too_when_it_is_back() -> None:
    session = answered(multicast=True)
    assert session.poll(1.9) == []
    assert session.silent(2.0)
    assert session.poll(2.0) == [connect_message()]
    assert session.poll(2.5) == []
    session.receive(3.0, FRAME)
    assert not session.silent(3.0)
    assert session.poll(3.0) == [DEFINITIONS_REQUEST]


def test_names_that_are_missing_are_asked_for_and_not_too_often() -> None:
    session = answered(multicast=True)
    session.names_missing = lambda: True
    asked = []
    for tick in range(200):
        now = 1.0 + 0.1 * tick
        session.receive(now, FRAME)
        if DEFINITIONS_REQUEST in session.poll(now):
            asked.append(now)
            session.receive(now, definitions(Catalogue(), V44))  # it has no name for them
    assert asked[0] == 1.0
    np.testing.assert_allclose(np.diff(asked), UNNAMED_S, atol=0.11)
    session.names_missing = lambda: False
    for tick in range(100):
        session.receive(21.0 + 0.1 * tick, FRAME)
        assert DEFINITIONS_REQUEST not in session.poll(21.0 + 0.1 * tick)


def said(session: NatnetSession, now: float) -> list[str]:
    return [problem.render() for problem in natnet_problems(session, now, host="10.0.0.2")]


def started(transport: str = "unicast") -> NatnetSession:
    session = NatnetSession(group=GROUP if transport == "multicast" else None)
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


def test_another_group() -> None:
    session = started("multicast")
    session.receive(0.0, server_info(V41, multicast=True, port=1600))
    (text,) = said(session, 2.5)
    assert "239.255.42.99, port 1600" in text and "natnet://10.0.0.2:1600?multicast=239.255.42.99" in text


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


# The fake Motive against the session and the decoder: a whole conversation on virtual time.

STEP_S = 1 / 200


@pytest.fixture(scope="module")
def motion() -> SensorFrames:
    return synthetic_performer(0)


class Lab:
    """Server, session and decoder on one wire; `lost` datagrams to the server vanish."""

    def __init__(self, server: FakeMotive, session: NatnetSession, decoder: NatnetDecoder | None = None) -> None:
        self.server, self.session, self.decoder = server, session, decoder or NatnetDecoder()
        self.lost = False
        self.now = 10.0
        self.asked: list[bytes] = []

    def run(self, seconds: float) -> list[StreamFrame]:
        frames = []
        for _ in range(round(seconds / STEP_S)):
            asked = self.session.poll(self.now)
            self.asked += asked
            answers = [] if self.lost else [got for sent in asked for got in self.server.receive(self.now, sent)]
            for got in answers + self.server.due(self.now):
                self.session.receive(self.now, got)
                frames += self.decoder.decode(got)
            self.now += STEP_S
        return frames

    def problems(self) -> list[str]:
        return [problem.render() for problem in natnet_problems(self.session, self.now, host="lab")]


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_the_motion_arrives_as_it_was(version: Version, motion: SensorFrames) -> None:
    lab = Lab(FakeMotive(motion, MotiveSettings(version=version)), NatnetSession())
    frames = lab.run(1.0)
    assert motion.rate_hz is not None
    assert len(frames) == pytest.approx(motion.rate_hz, abs=3)
    named = [one for one in frames if one.names[0].startswith("rigid://h")]
    assert len(frames) - len(named) <= 1
    for one in named:
        assert one.number is not None and one.stamp is not None
        row = one.number % len(motion.time)
        assert one.names == tuple(f"rigid://{name}" for name in motion.names)
        np.testing.assert_allclose(one.position, motion.position[row], atol=1e-6)
        assert float(angle_between(one.orientation, motion.orientation[row]).max()) < 1e-6
        assert one.stamp == pytest.approx(1000.0 + one.number / motion.rate_hz, abs=1e-6)
    assert lab.decoder.dropped.count == 0
    assert lab.problems() == []


def test_a_server_that_starts_late_and_pauses(motion: SensorFrames) -> None:
    lab = Lab(FakeMotive(motion), NatnetSession())
    lab.server.answering = False
    assert lab.run(5.0) == []
    shows(lab.problems()[0])
    lab.server.answering = True
    assert len(lab.run(2.0)) > 100
    lab.server.streaming = False
    lab.run(3.0)
    shows(lab.problems()[0])
    lab.server.streaming = True
    assert len(lab.run(1.0)) > 100
    assert lab.problems() == []
