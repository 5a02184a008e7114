"""What a NatNet session sends and when, on virtual time."""

import numpy as np
import pytest

from messages import Facts, shows
from natnet_packets import (
    VERSIONS,
    Body,
    Catalogue,
    Motion,
    Pose,
    datagram,
    definitions,
    frame,
    server_info,
)
from retarget.live.stream_report import natnet_problems
from retarget.rotations import angle_between
from retarget.sources.streams.natnet_decoder import NatnetDecoder
from retarget.sources.streams.natnet_session import KEEP_ALIVE_S, UNNAMED_S, NatnetSession
from retarget.sources.streams.natnet_wire import (
    MessageId,
    Version,
    connect_message,
    message,
    split,
)
from retarget.sources.streams.stream_frame import StreamFrame
from sim.performer import synthetic_performer

V41, V44 = Version(4, 1), Version(4, 4)
DEFINITIONS_REQUEST, KEEP_ALIVE = message(MessageId.DEFINITIONS_REQUEST), message(MessageId.KEEP_ALIVE)
GROUP = ("239.255.42.99", 1511)
CATALOGUE = definitions(Catalogue(bodies=[Body("Quad", 1)]), V41)
FRAME = frame(Motion(), V41)
OTHER_PORT = server_info(V41, multicast=True, port=1600)


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
    assert [session.poll(now) for now in (0.0, 0.5, 1.0)] == [[connect_message()], [], [connect_message()]]
    session.receive(2.1, server_info(V41))
    assert [session.poll(now) for now in (2.1, 3.05)] == [[DEFINITIONS_REQUEST, KEEP_ALIVE], []]


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


def test_signs_of_life_come_by_time_and_not_by_frames_and_never_in_a_group() -> None:
    session, group = answered(), answered(multicast=True, version=V44)
    sent = list[bytes]()
    for i in range(1, 2401):
        session.receive(i / 240, FRAME)
        group.receive(i / 240, FRAME)
        sent += session.poll(i / 240)
        assert KEEP_ALIVE not in group.poll(i / 240)
    assert sent.count(KEEP_ALIVE) == pytest.approx(10 / KEEP_ALIVE_S, abs=1)


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


def started(transport: str, answer: bytes = b"") -> NatnetSession:
    session = NatnetSession(group=GROUP if transport == "multicast" else None)
    session.poll(0.0)
    session.receive(0.0, answer)
    return session


@pytest.mark.parametrize(
    ("mine", "answer", "quiet", "until", "facts"),
    [
        ("unicast", b"", 2.9, 3.0, ("10.0.0.2", "UDP", 1510)),
        ("multicast", FRAME, None, 3.0, ()),
        ("unicast", server_info(Version(2, 10)), None, 0.1, ("2.10", "3.1", "3.0 to 4.x", "Update Motive")),
        ("unicast", server_info(Version(5, 0)), None, 0.1, ("5.0", "3.1", "3.0 to 4.x", "choose a 4.x bitstream")),
        ("unicast", server_info(V41, multicast=True), 1.9, 2.0, ("unicast", "239.255.42.99, port 1511")),
        ("multicast", server_info(V41), 1.9, 2.0, "multicast"),
        ("unicast", server_info(V41), None, 2.5, "firewall lets UDP"),
        ("multicast", server_info(V41, multicast=True), None, 2.5, "239.255.42.99 was joined"),
        (
            "multicast",
            OTHER_PORT,
            None,
            2.5,
            ("239.255.42.99, port 1600", "natnet://10.0.0.2:1600?multicast=239.255.42.99"),
        ),
    ],
    ids=range(9),
)
def test_what_is_wrong_is_said_in_one_message(
    mine: str, answer: bytes, quiet: float | None, until: float, facts: Facts
) -> None:
    session = started(mine, answer)
    assert quiet is None or said(session, quiet) == []
    (text,) = said(session, until)
    shows(text, facts)


def test_definitions_that_do_not_come_are_missed_until_they_come() -> None:
    session = started("unicast", server_info(V41))
    for i in range(40):
        session.poll(i / 10)
        session.receive(i / 10, FRAME)
    (text,) = said(session, 4.0)
    shows(text)
    session.receive(4.0, CATALOGUE)
    assert said(session, 4.0) == []


# A whole conversation with a Motive server that was made up, on virtual time.

STEP_S, CLOCK_HZ, LATENCY_S = 1 / 200, 10_000_000, 0.0055
MOTION = synthetic_performer(0)
RATE_HZ = MOTION.rate_hz or 0.0


class Lab:
    """Session and decoder on one wire with a server that streams MOTION as rigid bodies, again and again; its clock is
    1000 s ahead. answering: it is switched on. streaming: it is live, and not paused."""

    def __init__(self, version: Version) -> None:
        self.version, self.session, self.decoder = version, NatnetSession(), NatnetDecoder()
        self.now, self.asked, self.answering, self.streaming = 10.0, -np.inf, True, True
        wxyz = np.nan_to_num(MOTION.orientation)
        wxyz[..., 0] += (wxyz == 0.0).all(axis=-1)
        self.wire = np.nan_to_num(MOTION.position[..., [1, 2, 0]]).tolist(), wxyz[..., [2, 3, 1, 0]].tolist()

    def answers(self, sent: bytes) -> list[bytes]:
        kind = (split(sent) or (-1, b""))[0]
        if kind in (MessageId.CONNECT, MessageId.KEEP_ALIVE):
            self.asked = self.now
        if kind == MessageId.DEFINITIONS_REQUEST:
            bodies = [Body(name, number, markers=1) for number, name in enumerate(MOTION.names, start=1)]
            return [definitions(Catalogue(bodies, crowd=False), self.version)]
        return [server_info(self.version, clock_hz=CLOCK_HZ)] if kind == MessageId.CONNECT else []

    def frame(self, index: int) -> bytes:
        row, exposed = index % len(MOTION.time), index / RATE_HZ
        columns = zip(*(part[row] for part in self.wire), MOTION.valid[row], strict=True)
        bodies = [Pose(n, place, turn, int(valid)) for n, (place, turn, valid) in enumerate(columns, start=1)]
        at = [round((1000.0 + exposed + later) * CLOCK_HZ) for later in (0.0, 0.5 * LATENCY_S, LATENCY_S)]
        ticks = (at[0], at[1], at[2])
        return frame(Motion(index, bodies, timestamp=exposed, ticks=ticks, crowd=False), self.version)

    def run(self, seconds: float) -> list[StreamFrame]:
        frames = []
        for _ in range(round(seconds / STEP_S)):
            arrives = [got for sent in self.session.poll(self.now) if self.answering for got in self.answers(sent)]
            newest, before = (int((time - LATENCY_S) * RATE_HZ) for time in (self.now, self.now - STEP_S))
            if self.answering and self.streaming and self.now - self.asked < 10.0:
                arrives += [self.frame(index) for index in range(before + 1, newest + 1)]
            for got in arrives:
                self.session.receive(self.now, got)
                frames += self.decoder.decode(got)
            self.now += STEP_S
        return frames


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_the_motion_arrives_as_it_was(version: Version) -> None:
    lab = Lab(version)
    frames = lab.run(1.0)
    assert len(frames) == pytest.approx(RATE_HZ, abs=3)
    named = [one for one in frames if one.names[0].startswith("rigid://h")]
    assert len(frames) - len(named) <= 1
    for one in named:
        assert one.number is not None and one.stamp is not None
        row = one.number % len(MOTION.time)
        assert one.names == tuple(f"rigid://{name}" for name in MOTION.names)
        np.testing.assert_allclose(one.position, MOTION.position[row], atol=1e-6)
        assert float(angle_between(one.orientation, MOTION.orientation[row]).max()) < 1e-6
        assert one.stamp == pytest.approx(1000.0 + one.number / RATE_HZ, abs=1e-6)
    assert lab.decoder.dropped.count == 0
    assert said(lab.session, lab.now) == []


def test_a_server_that_starts_late_and_pauses() -> None:
    lab = Lab(V41)
    lab.answering = False
    assert lab.run(5.0) == []
    shows(said(lab.session, lab.now)[0])
    lab.answering = True
    assert len(lab.run(2.0)) > 100
    lab.streaming = False
    lab.run(3.0)
    shows(said(lab.session, lab.now)[0])
    lab.streaming = True
    assert len(lab.run(1.0)) > 100
    assert said(lab.session, lab.now) == []
