"""Why a stream cannot be used: refused with what to do at the start, said once while it runs."""

import pytest

from hardware.clock import VirtualClock
from live_rig import five, live_stream
from mvn_packets import mvn, quaternions, standing
from retarget.errors import InputError
from retarget.live.address import StreamAddress, parse_address
from retarget.live.admission import admission_for
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.datagram import Datagram
from retarget.live.natnet_receiver import NatnetReceiver, session_for
from retarget.live.stream import LiveStream
from retarget.live.stream_trouble import StreamTrouble, refuse_version, unusable
from retarget.live.udp import UdpReceiver
from retarget.rotations import FloatArray
from retarget.sources.mvn import MvnDecoder
from retarget.sources.natnet_wire import Version
from sim.fake_motive import FakeMotive, MotiveSettings
from sim.faults.sender import FakeSender, lost, silent
from sim.performer import synthetic_performer
from support.messages import refuses, shows

DT = 0.01
HERE = "natnet://127.0.0.1"


def refused(sender: FakeSender, *, decoder: MvnDecoder | None = None, where: str = "here") -> str:
    """Why a run with this sender does not begin."""
    stream = live_stream(sender, five())
    if decoder is not None:
        stream.decoder = decoder
    clock = VirtualClock()
    with pytest.raises(InputError) as refusal:
        begin_live(
            stream,
            LiveOptions(countdown=0.0, patience=1.0),
            clock=clock,
            rate_hz=100.0,
            where=where,
            tell=lambda text: None,
        )
    return str(refusal.value)


def garbled(payload: bytes, first: float = 0.0, last: float = 1e9) -> FakeSender:
    """A sender that sends something else for a while."""
    sender = FakeSender()
    sender.garbles.append(lambda time, datagram: [payload] if first <= time < last else [datagram])
    return sender


def test_nothing_arrives() -> None:
    text = refused(FakeSender(faults=[silent(0.0, 1e9)]))
    assert text.startswith("here: nothing arrives, waited 1 s.")
    shows(text)


def test_what_arrives_instead_is_named() -> None:
    text = refused(garbled(quaternions(standing())), where="json://:7000")
    shows(text, "MVN", "mvn://:7000", 9763)
    text = refused(FakeSender(), decoder=MvnDecoder(), where="mvn://:7000")
    shows(text, "JSON", "json://:7000")


def test_a_stream_that_has_ended_is_told_as_such() -> None:
    text = refused(FakeSender(faults=[lost("l_wrist", 0.0, 1e9), silent(0.05, 1e9)]))
    shows(text, "1.0")
    shows(text.lower())


def test_something_else_arrives() -> None:
    text = refused(garbled(b"hello"))
    shows(text)


@pytest.mark.parametrize(("kind", "told"), [("05", "Unity poses"), ("20", "joint angles"), ("99", "type unknown")])
def test_mvn_set_to_another_datagram(kind: str, told: str) -> None:
    text = refused(garbled(mvn(kind, bytes(32), items=1)), decoder=MvnDecoder())
    assert told in text and text.endswith("In MVN's network streamer choose Position + Orientation (Quaternion).")


def test_a_role_that_the_stream_does_not_have() -> None:
    text = refused(FakeSender(faults=[lost("l_wrist", 0.0, 1e9)]))
    shows(text, "l_wrist", "head")


def test_lengths_in_another_unit_are_told_as_such() -> None:
    def millimetres(time: float, poses: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return {name: 1000.0 * point for name, point in poses.items()}

    text = refused(FakeSender(faults=[millimetres]))
    shows(text)
    assert "Wear" not in text


class Short(FakeSender):
    """A recording that is over."""

    @property
    def finished(self) -> bool:
        """After two seconds."""
        return self._polled >= 2.0


def test_a_recording_that_is_too_short_is_told_as_such() -> None:
    stream = live_stream(Short(faults=[silent(2.0, 1e9)]), five())
    told = looks(stream, 0.0, 4.0)
    assert [text for _, text in told] == [
        "the recording was over 1.0 s ago. Take a longer one, or play it again and again: ?loop=1"
    ]
    shows(str(unusable(stream, [], 1.0, where="here", now=5.0)), "3.0")


def test_a_recording_of_another_kind_than_was_said_is_named() -> None:
    text = refused(garbled(quaternions(standing())), where="replay:///tmp/a.raw?kind=json")
    shows(text, "MVN", "replay:///tmp/a.raw?kind=mvn")


def looks(stream: LiveStream, first: float, last: float) -> list[tuple[float, str]]:
    """What is told, and when, from one time to the next."""
    trouble, told = StreamTrouble(stream), []
    for tick in range(round(first / DT), round(last / DT)):
        stream.listen(DT * tick, moving=True)
        text = trouble.look(DT * tick)
        if text:
            told.append((DT * tick, text))
    return told


def test_silence_while_it_runs_is_told_once_and_again_when_it_comes_again() -> None:
    sender = FakeSender(faults=[silent(2.0, 5.0), silent(7.0, 8.5), silent(9.0, 9.5)])
    told = looks(live_stream(sender, five()), 0.0, 11.0)
    assert [round(time, 1) for time, _ in told] == [3.0, 8.0]
    assert all(text.startswith("nothing has arrived for 1.0 s: see that the sender runs") for _, text in told)


def test_another_datagram_while_it_runs_is_told_once_with_the_reason() -> None:
    (time, text), *more = looks(live_stream(garbled(b"hello", 2.0), five()), 0.0, 6.0)
    assert time == pytest.approx(3.0, abs=0.05) and not more
    assert text.startswith("what arrives has been unusable for 1.0 s: ")
    shows(text)


class Motive:
    """A stream of Motive, without a network. Its session is asked as if a server had answered."""

    def __init__(self, version: Version) -> None:
        receiver = NatnetReceiver(parse_address(HERE), session_for(parse_address(HERE)))
        self.stream = live_stream(FakeSender(), five())
        self.stream.receiver = receiver
        self.server(version)

    def server(self, version: Version) -> None:
        """It answers."""
        receiver = self.stream.receiver
        assert isinstance(receiver, NatnetReceiver)
        fake = FakeMotive(synthetic_performer(), MotiveSettings(version=version))
        for question in receiver.session.poll(0.0):
            fake.receive(0.0, question)
        receiver.session.receive(0.0, fake._server_info())

    def close(self) -> None:
        """Close its sockets."""
        self.stream.receiver.close()


def test_a_wrong_version_is_refused_and_told_once() -> None:
    motive = Motive(Version(2, 9))
    try:
        with refuses(InputError, "NatNet", found="2.9"):
            refuse_version(motive.stream, 0.1)
        assert "2.9" in str(unusable(motive.stream, [], 10.0, where=HERE, now=10.0))
        trouble = StreamTrouble(motive.stream)
        assert "2.9" in trouble.look(0.1) and trouble.foreign
        assert trouble.look(0.2) == "" and trouble.foreign
    finally:
        motive.close()


def test_a_version_that_can_be_read_is_none_of_that_and_a_group_that_is_not_joined_is_told() -> None:
    motive = Motive(Version(4, 1))
    try:
        refuse_version(motive.stream, 0.1)
        motive.stream.last = 0.0
        trouble = StreamTrouble(motive.stream)
        assert trouble.look(0.1) == "" and not trouble.foreign
        assert isinstance(motive.stream.receiver, NatnetReceiver)
        motive.stream.receiver.trouble = "the group 239.1.2.3 cannot be joined"
        told = [text for tick in range(500) if (text := trouble.look(DT * tick))]
        assert len(told) == 1
        shows(told[0])
        motive.stream.admission.refused.note("cut")
        assert told[0].endswith("lets UDP from Motive in.")
        shows(trouble.why(9.0), 1)
        assert "239.1.2.3" in str(unusable(motive.stream, [], 10.0, where=HERE, now=0.5))
    finally:
        motive.close()


def test_datagrams_of_others_are_told_as_the_reason() -> None:
    sender = FakeSender(faults=[silent(2.0, 9.0)])
    other = FakeSender(source=("127.0.0.1", 50000))

    def others(before: float, now: float) -> list[Datagram]:
        return other.poll(now) if now > 2.5 else []

    sender.others.append(others)
    told = looks(live_stream(sender, five()), 0.0, 4.0)
    assert len(told) == 1
    shows(told[0][1], "127.0.0.1:40000")


def test_a_sender_that_sends_more_than_can_be_read_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.faults.sender.MOST_WAITING", 10_000)  # of a socket with a large buffer
    stream = live_stream(FakeSender(rate_hz=1900.0), five())
    trouble, told, brief = StreamTrouble(stream), list[str](), ""
    for tick in range(1500):
        stream.listen(DT * tick, moving=True)
        told += [text] if (text := trouble.look(DT * tick)) else []
        brief = trouble.briefly(DT * tick, 0.13)
    assert len(told) == 1 and told[0].startswith("what is read arrived 1.0 s ago: more arrives than can be read")
    assert told[0].endswith("30 to 240 a second are enough") and brief == "more arrived than can be read in time"


def test_a_sender_that_is_not_on_the_list_is_to_be_named_there() -> None:
    stream = live_stream(FakeSender(source=("192.168.1.20", 40000)), five())
    where = "json://0.0.0.0:14150?allow=192.168.1.21"
    stream.admission = admission_for(parse_address(where))
    for tick in range(20):
        stream.listen(DT * tick, moving=False)
    text = str(unusable(stream, [], 10.0, where=where, now=10.0))
    shows(text)
    assert text.endswith("?allow=192.168.1.20."), text


def test_where_nothing_arrives_at_a_socket_the_place_is_named_and_who_is_heard_there() -> None:
    stream = live_stream(FakeSender(faults=[silent(0.0, 1e9)]), five())
    stream.receiver = receiver = UdpReceiver(StreamAddress("vmc://", "vmc"))
    try:
        port = receiver.bound[1]
        text = str(unusable(stream, [], 10.0, where="vmc://:39539", now=10.0))
    finally:
        receiver.close()
    assert port > 0 and receiver.bound == ("", 0)
    shows(text, "127.0.0.1", "UDP", port, f"vmc://0.0.0.0:{port}?allow=ITS_ADDRESS", "`retarget doctor vmc://:39539`")
