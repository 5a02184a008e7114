"""Reports on a stream: its errors, messages while it runs, hold reasons, and the report after a run."""

import json
from contextlib import closing
from dataclasses import replace
from ipaddress import IPv4Network
from pathlib import Path

import numpy as np
import pytest

from hardware.clock import VirtualClock
from live_rig import ClockedSender, LiveRig, five, live_stream
from live_rig import five as five_sensors
from messages import refuses, shows
from mvn_packets import quaternions, standing
from natnet_packets import FakeMotive, MotiveSettings
from retarget.errors import InputError
from retarget.live.address import StreamAddress, parse_address
from retarget.live.admission import TOO_LONG, TOO_MANY, Admission, Datagram, Source, admission_for
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.performer import TOO_SHORT, LivePerformer
from retarget.live.raw_recording import RawTap
from retarget.live.receivers import NatnetReceiver, UdpReceiver
from retarget.live.stream import LiveStream
from retarget.live.stream_report import (
    Holds,
    LiveReport,
    StreamNews,
    StreamProblems,
    TimePercentiles,
    refuse_version,
    unusable,
)
from retarget.report.findings import stream_line
from retarget.report.measure import measure
from retarget.sources.streams.mvn import MvnDecoder
from retarget.sources.streams.natnet_wire import Version
from retarget.sources.streams.raw_record import RawWriter
from retarget.types import FloatArray
from sim.faults.sender import FakeSender, SenderFault, frozen, lost, silent
from sim.performer import synthetic_performer


@pytest.mark.long
def test_a_run_reports_on_its_stream() -> None:
    sender = FakeSender(faults=[silent(5.8, 6.6), lost("l_wrist", 7.3, 7.8)])
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=5.8))
    with rig.prepared() as prepared:
        result, performer = prepared.run(), prepared.samples
    assert isinstance(performer, LivePerformer)
    rig.stream.decoder.dropped.note("not JSON")
    rig.stream.clock_map.dropped.note("late")
    rig.stream.playout.dropped.note("older than what is kept")
    live = performer.report(address="json://:7000", person="anna")
    assert live.dropped["late"] == live.dropped["older than what is kept"] == 1
    assert live.holds.count >= 1 and 0.5 < live.holds.s < 2.5
    assert set(live.lost_s) >= {"l_wrist"} and 0.0 < live.playout_delay_ms < 200.0
    assert live.frames == rig.stream.frames > 100 and live.dropped["not JSON"] == 1 and not live.refused
    report = measure(replace(result, live=live))
    given = json.loads(report.as_json())
    assert given["source"] == given["live"]["address"] == "json://:7000" and given["live"]["person"] == "anna"
    assert given["live"]["holds"]["count"] == live.holds.count and measure(result).live is None


def test_the_summary_has_a_line_of_it() -> None:
    assert stream_line(None) == ""
    good = LiveReport(
        "vmc://:1", 300, 310, {}, (), {}, Holds(0, 0.0), 35.4, "off", {"goal": TimePercentiles(4.0, 9.4)}, None
    )
    assert stream_line(good) == "300 frames in 310 datagrams, played 35 ms late; from run to goals 4 ms (p99 9)"
    bad = replace(
        good, dropped={"late": 3}, refused=("10.0.0.2: a second source",), lost_s={"head": 1.0}, holds=Holds(2, 3.0)
    )
    assert stream_line(bad).split("; ")[2:] == [
        "not used: late (3)",
        "lost: head 1.0 s",
        "held 2 times, 3.0 s",
        "refused senders: 10.0.0.2: a second source",
    ]


def now_and_then(first: float, last: float) -> SenderFault:
    """From `first` on, s of the sender, the sender sends for 0.1 s of every 0.4 s; nothing from `last` on."""
    return lambda time, poses: None if time >= first and (time >= last or (time - first) % 0.4 < 0.3) else poses


def test_what_arrives_instead_is_reported_of_a_short_silence_too() -> None:
    stream = live_stream(FakeSender(), five_sensors())
    problems = StreamProblems(stream)
    for now in (1.0, 3.0):  # the second time what came in the first does not count
        stream.last = now
        assert not problems.look(now) and not problems.look(now + 0.06)
        assert problems.briefly(now + 0.2, 0.14) == "nothing arrived"
        stream.arrived += 1
        stream.decoder.dropped.note("not JSON")
        assert problems.briefly(now + 0.2, 0.14) == "what arrived was unusable: not JSON (1)"


def flying(name: str, first: float) -> SenderFault:
    """From `first` on, s of the sender, a sensor is at another place in every frame."""
    chance = np.random.default_rng(4)
    return lambda time, poses: (
        poses | {name: np.array([*chance.uniform(-5.0, 5.0, 2), 1.0])} if time >= first else poses
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        (frozen("r_ankle", 6.0, 60.0), "r_ankle: frozen"),
        (now_and_then(6.0, 9.7), f"{TOO_SHORT}, at last: nothing arrived"),
        (flying("l_wrist", 7.0), f"{TOO_SHORT}, at last: l_wrist: jumped"),
    ],
)
def test_the_hold_reason_is_the_reason_of_the_stop(fault: SenderFault, cause: str) -> None:
    rig = LiveRig(FakeSender(faults=[fault]), options=LiveOptions(countdown=0.5, duration=12.0))
    with rig.prepared() as prepared:
        result = prepared.run()
    assert result.stop is not None
    assert f"({cause}) for 4.81 s, allowed 4.8 s" in result.stop.reason


OTHER: Source = ("10.9.8.7", 50_000)


def polled(stream: LiveStream, said: list[str], *, seconds: float = 1.5) -> None:
    """Poll the stream, with a look after each poll."""
    news = StreamNews(stream, said.append)
    for tick in range(round(100 * seconds)):
        stream.poll(0.01 * tick, moving=True)
        news.look()


NEW_PORTS = [lambda since, until: [Datagram(until, ("127.0.0.1", 1024 + round(1e3 * until)), b"{}")]]


@pytest.mark.parametrize(
    ("sender", "reason", "step"),
    [
        (ClockedSender(lambda time: 1e3 * time), "looks like milliseconds", "its time in seconds"),
        (FakeSender(faults=[lambda time, poses: poses if time < 0.1 else None]), "a new socket", "keep one socket"),
    ],
)
def test_a_mistake_in_every_datagram_is_reported_with_its_step(sender: FakeSender, reason: str, step: str) -> None:
    if "socket" in step:
        sender.others = NEW_PORTS
    stream, said = live_stream(sender, five()), list[str]()
    problems = StreamProblems(stream)
    for tick in range(300):
        stream.poll(0.01 * tick, moving=True)
        said.append(problems.look(0.01 * tick))
    (text,) = filter(None, said)
    assert reason in text and step in text
    late = unusable(stream, ["head"], 3.0, where="json://:14150", now=3.0)
    assert reason in str(late) and step in str(late)


@pytest.mark.parametrize(
    ("allow", "message"),
    [
        ("0.0.0.0/0", "10.9.8.7:50000 sends too, and is ignored: 127.0.0.1:40000 was first"),
        ("127.0.0.1/32", "10.9.8.7:50000 sends too, and is ignored: not on the allow-list (?allow=)"),
    ],
)
def test_another_sender_is_reported_once(allow: str, message: str) -> None:
    sender, said = FakeSender(), list[str]()
    sender.others = [lambda since, until: [Datagram(until, OTHER, b"{}")] if since > 0.5 else []]
    stream = live_stream(sender, five())
    stream.admission = Admission(allow=[IPv4Network(allow)])
    polled(stream, said)
    assert said == [message] and stream.admission.refused.count > 90


def test_a_clock_that_jumps_is_reported_once_for_each_direction() -> None:
    said: list[str] = []
    stamps = ClockedSender(lambda time: 1000.0 + time + (3600.0 if 0.5 < time < 1.5 or time > 2.5 else 0.0))
    stream = live_stream(stamps, five())
    polled(stream, said, seconds=3.5)
    assert said == [f"the sender's clock jumped {way} by 3600.00 s" for way in ("forward", "back")]
    assert stream.clock_map.jumps == 3


def test_refused_datagrams_of_the_owner_are_reported_once_there_are_many() -> None:
    said: list[str] = []
    stream = live_stream(FakeSender(), five())
    news = StreamNews(stream, said.append)
    for reason, few, many in ((TOO_LONG, 0, 1), (TOO_MANY, 4_999, 5_000)):
        stream.admission.refused.reasons[reason] = few
        news.look()
        assert not said
        stream.admission.refused.reasons[reason] = many
        for _ in range(3):
            news.look()
            stream.admission.refused.reasons[reason] += 1
        assert len(said) == 1
        said.clear()


def test_losses_of_the_kernel_are_reported_from_the_first_look_on() -> None:
    said: list[str] = []
    stream = live_stream(FakeSender(), five())
    with closing(UdpReceiver(replace(parse_address("json://:14150"), port=0))) as receiver:
        stream.receiver = receiver
        news = StreamNews(stream, said.append)
        for lost in (70, 70, 71, 90):
            receiver.overflowed = lost
            news.look()
            assert len(said) == (lost > 70)
    assert said == ["datagrams were lost in this computer: they came faster than they were fetched"]


@pytest.mark.parametrize(("failure", "part"), [("No space left on device", "has ended.*No space"), ("", "too slow")])
def test_a_recording_that_ends_early_is_reported_in_the_run_and_at_its_end(
    failure: str, part: str, tmp_path: Path
) -> None:
    said, ended = list[str](), list[str]()
    writer = RawWriter(tmp_path / "a.raw", url="json://")
    stream = live_stream(FakeSender(), five())
    with RawTap(writer, notify=ended.append) as tap:
        stream.tap = tap
        news = StreamNews(stream, said.append)
        news.look()
        assert not said
        writer.lost, writer.error = 7, failure
        news.look()
        news.look()
        assert len(said) == 1
    reason = failure or "the disk was too slow"
    assert ended == [f"the recording is not whole: {reason}; 7 datagrams are missing"]
    assert part.split(".*", maxsplit=1)[0] in said[0] and part.rsplit(".*", maxsplit=1)[-1] in said[0]


DT = 0.01
HERE = "natnet://127.0.0.1"


def refused(sender: FakeSender, *, decoder: MvnDecoder | None = None, where: str = "here") -> str:
    """Why a run with this sender does not begin."""
    stream = live_stream(sender, five())
    if decoder is not None:
        stream.decoder = decoder
    options, said = LiveOptions(countdown=0.0, patience=1.0), list[str]()
    with pytest.raises(InputError) as refusal:
        begin_live(stream, options, clock=VirtualClock(), rate_hz=100.0, where=where, notify=said.append)
    return str(refusal.value)


def garbled(payload: bytes, first: float = 0.0, last: float = 1e9) -> FakeSender:
    """A sender that sends something else for a while."""
    sender = FakeSender()
    sender.garbles.append(lambda time, datagram: [payload] if first <= time < last else [datagram])
    return sender


def test_what_arrives_instead_is_named() -> None:
    text = refused(garbled(quaternions(standing())), where="json://:7000")
    shows(text, "MVN", "mvn://:7000", 9763)
    text = refused(FakeSender(), decoder=MvnDecoder(), where="mvn://:7000")
    shows(text, "JSON", "json://:7000")


def test_a_stream_that_has_ended_is_reported_as_such() -> None:
    text = refused(FakeSender(faults=[lost("l_wrist", 0.0, 1e9), silent(0.05, 1e9)]))
    shows(text, "1.0")
    shows(text.lower())


def test_lengths_in_another_unit_are_reported_as_such() -> None:
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


def test_a_recording_that_is_too_short_is_reported_as_such() -> None:
    stream = live_stream(Short(faults=[silent(2.0, 1e9)]), five())
    messages = looks(stream, 0.0, 4.0)
    assert [text for _, text in messages] == ["the recording was over 1.0 s ago. Take a longer one"]
    shows(str(unusable(stream, [], 1.0, where="here", now=5.0)), "3.0")


def looks(stream: LiveStream, first: float, last: float) -> list[tuple[float, str]]:
    """The messages with their times, from one time to the next."""
    problems, messages = StreamProblems(stream), list[tuple[float, str]]()
    for tick in range(round(first / DT), round(last / DT)):
        stream.poll(DT * tick, moving=True)
        text = problems.look(DT * tick)
        if text:
            messages.append((DT * tick, text))
    return messages


def test_silence_while_it_runs_is_reported_once_and_again_when_it_comes_again() -> None:
    sender = FakeSender(faults=[silent(2.0, 5.0), silent(7.0, 8.5), silent(9.0, 9.5)])
    messages = looks(live_stream(sender, five()), 0.0, 11.0)
    assert [round(time, 1) for time, _ in messages] == [3.0, 8.0]
    assert all(text.startswith("nothing has arrived for 1.0 s. See that the sender runs") for _, text in messages)


class Motive:
    """A stream of Motive, without a network. Its session is asked as if a server had answered."""

    def __init__(self, version: Version) -> None:
        receiver = NatnetReceiver(parse_address(HERE))
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


def test_a_wrong_version_is_refused_and_reported_once() -> None:
    motive = Motive(Version(2, 9))
    try:
        with refuses(InputError, "NatNet", found="2.9"):
            refuse_version(motive.stream, 0.1)
        assert "2.9" in str(unusable(motive.stream, [], 10.0, where=HERE, now=10.0))
        problems = StreamProblems(motive.stream)
        assert "2.9" in problems.look(0.1) and problems.foreign
        assert problems.look(0.2) == "" and problems.foreign
    finally:
        motive.close()


def test_a_readable_version_is_no_problem() -> None:
    motive = Motive(Version(4, 1))
    try:
        refuse_version(motive.stream, 0.1)
        motive.stream.last = 0.0
        problems = StreamProblems(motive.stream)
        assert problems.look(0.1) == "" and not problems.foreign
        messages = [text for tick in range(500) if (text := problems.look(DT * tick))]
        assert len(messages) == 1
        shows(messages[0])
        motive.stream.admission.refused.note("cut")
        assert messages[0].endswith("lets UDP from Motive in.")
        shows(problems.why(9.0), 1)
    finally:
        motive.close()


def test_datagrams_of_others_are_reported_as_the_reason() -> None:
    sender = FakeSender(faults=[silent(2.0, 9.0)])
    other = FakeSender(source=("127.0.0.1", 50000))

    def others(before: float, now: float) -> list[Datagram]:
        return other.poll(now) if now > 2.5 else []

    sender.others.append(others)
    messages = looks(live_stream(sender, five()), 0.0, 4.0)
    assert len(messages) == 1
    shows(messages[0][1], "127.0.0.1:40000")


def test_a_sender_that_is_not_on_the_list_is_to_be_named_there() -> None:
    stream = live_stream(FakeSender(source=("192.168.1.20", 40000)), five())
    where = "json://0.0.0.0:14150?allow=192.168.1.21"
    stream.admission = admission_for(parse_address(where))
    for tick in range(20):
        stream.poll(DT * tick, moving=False)
    text = str(unusable(stream, [], 10.0, where=where, now=10.0))
    shows(text)
    assert text.endswith("?allow=192.168.1.20."), text


def test_where_nothing_arrives_at_a_socket_its_address_and_reach_are_named() -> None:
    stream = live_stream(FakeSender(faults=[silent(0.0, 1e9)]), five())
    stream.receiver = receiver = UdpReceiver(StreamAddress("vmc://", "vmc"))
    try:
        port = receiver.bound[1]
        text = str(unusable(stream, [], 10.0, where="vmc://:39539", now=10.0))
    finally:
        receiver.close()
    assert port > 0
    shows(text, "127.0.0.1", "UDP", port, f"vmc://0.0.0.0:{port}?allow=ITS_ADDRESS", "`retarget doctor vmc://:39539`")


def test_a_page_is_advised_as_a_page() -> None:
    stream = live_stream(FakeSender(faults=[silent(2.0, 9.0)]), five())
    stream.kind = "web"
    messages = looks(stream, 0.0, 4.0)
    assert len(messages) == 1
    shows(messages[0][1])
    shows(StreamProblems(stream).briefly(4.0, 0.2))
    stream.decoder.dropped.note("picture without a person")
    stream.arrived = 5
    stream.frames = 0
    shows(str(unusable(stream, ["head"], 10.0, where="web://", now=4.0)), "picture without a person")


def test_a_page_whose_pictures_stall_has_no_clock_that_jumps() -> None:
    said: list[str] = []
    stamps = ClockedSender(lambda time: 1000.0 + time + (0.15 if 0.5 < time < 1.5 else 0.0))
    stream = live_stream(stamps, five())
    stream.kind = "web"
    polled(stream, said, seconds=2.5)
    assert not said
