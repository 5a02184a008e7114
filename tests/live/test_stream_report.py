"""Reports on a stream: its errors, messages while it runs, hold reasons, and the report after a run."""

import json
import re
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from ipaddress import IPv4Network
from pathlib import Path

import numpy as np
import pytest

from hardware.clock import VirtualClock
from live_rig import ClockedSender, LiveRig, five, live_stream
from messages import refuses, shows
from mvn_packets import quaternions, standing
from natnet_packets import server_info
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
from sim.faults.sender import FakeSender, Poses, SenderFault, frozen, lost, silent


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
    assert stream_line(bad).split("; ", maxsplit=2)[2] == (
        "not used: late (3); lost: head 1.0 s; held 2 times, 3.0 s; refused senders: 10.0.0.2: a second source"
    )


def in_bursts(first: float, last: float) -> SenderFault:
    """From `first` on, s of the sender, the sender sends for 0.1 s of every 0.4 s; nothing from `last` on."""
    return lambda time, poses: None if time >= first and (time >= last or (time - first) % 0.4 < 0.3) else poses


def test_what_arrives_instead_is_reported_of_a_short_silence_too() -> None:
    stream = live_stream(FakeSender(), five())
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
    places = np.random.default_rng(4).uniform([-5.0, -5.0, 1.0], [5.0, 5.0, 1.0], (1000, 3))
    return lambda time, poses: poses | ({name: places[round(100 * (time - first))]} if time >= first else {})


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        (frozen("r_ankle", 6.0, 60.0), "r_ankle: frozen"),
        (in_bursts(6.0, 9.7), f"{TOO_SHORT}, at last: nothing arrived"),
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
DT = 0.01  # [s]
HERE = "natnet://127.0.0.1"


def polled(stream: LiveStream, *, seconds: float = 1.5) -> list[str]:
    """The messages of a stream that is polled, with a look after each poll."""
    said: list[str] = []
    news = StreamNews(stream, said.append)
    for tick in range(round(100 * seconds)):
        stream.poll(DT * tick, moving=True)
        news.look()
    return said


def new_sockets(since: float, until: float) -> list[Datagram]:
    return [Datagram(until, ("127.0.0.1", 1024 + round(1e3 * until)), b"{}")]


@pytest.mark.parametrize(
    ("sender", "reason", "step"),
    [
        (ClockedSender(lambda time: 1e3 * time), "looks like milliseconds", "its time in seconds"),
        (FakeSender(faults=[silent(0.1)], others=[new_sockets]), "a new socket", "keep one socket"),
    ],
)
def test_a_mistake_in_every_datagram_is_reported_with_its_step(sender: FakeSender, reason: str, step: str) -> None:
    stream = live_stream(sender, five())
    ((_, text),) = looks(stream, 3.0)
    late = unusable(stream, ["head"], 3.0, where="json://:14150", now=3.0)
    for message in (text, str(late)):
        assert reason in message and step in message


@pytest.mark.parametrize(
    ("allow", "message"),
    [
        ("0.0.0.0/0", "10.9.8.7:50000 sends too, and is ignored: 127.0.0.1:40000 was first"),
        ("127.0.0.1/32", "10.9.8.7:50000 sends too, and is ignored: not on the allow-list (?allow=)"),
    ],
)
def test_another_sender_is_reported_once(allow: str, message: str) -> None:
    sender = FakeSender()
    sender.others = [lambda since, until: [Datagram(until, OTHER, b"{}")] if since > 0.5 else []]
    stream = live_stream(sender, five())
    stream.admission = Admission(allow=[IPv4Network(allow)])
    assert polled(stream) == [message] and stream.admission.refused.count > 90


def test_a_clock_that_jumps_is_reported_once_for_each_direction() -> None:
    stamps = ClockedSender(lambda time: 1000.0 + time + (3600.0 if 0.5 < time < 1.5 or time > 2.5 else 0.0))
    stream = live_stream(stamps, five())
    said = [f"the sender's clock jumped {direction} by 3600.00 s" for direction in ("forward", "back")]
    assert polled(stream, seconds=3.5) == said and stream.clock_map.jumps == 3


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
    assert re.search(part, said[0])


def refused(sender: FakeSender, *, decoder: MvnDecoder | None = None, where: str = "here") -> str:
    """Why a run with this sender does not begin."""
    stream = live_stream(sender, five())
    if decoder is not None:
        stream.decoder = decoder
    options, said = LiveOptions(countdown=0.0, patience=1.0), list[str]()
    with pytest.raises(InputError) as refusal:
        begin_live(stream, options, clock=VirtualClock(), rate_hz=100.0, where=where, notify=said.append)
    return str(refusal.value)


def test_the_reason_why_a_run_does_not_begin_is_named() -> None:
    def instead(payload: bytes) -> FakeSender:
        return FakeSender(garbles=[lambda time, datagram: [payload]])

    def millimetres(time: float, poses: Poses) -> Poses:
        return {name: 1000.0 * point for name, point in poses.items()}

    shows(refused(instead(quaternions(standing())), where="json://:7000"), "MVN", "mvn://:7000", 9763)
    shows(refused(FakeSender(), decoder=MvnDecoder(), where="mvn://:7000"), "JSON", "json://:7000")
    shows(refused(FakeSender(faults=[lost("l_wrist"), silent(0.05)])), "1.0")
    text = refused(FakeSender(faults=[millimetres]))
    shows(text)
    assert "Wear" not in text


def looks(stream: LiveStream, seconds: float) -> list[tuple[float, str]]:
    """The messages with their times, to a tenth of a second."""
    problems, messages = StreamProblems(stream), list[tuple[float, str]]()
    for tick in range(round(seconds / DT)):
        stream.poll(DT * tick, moving=True)
        if text := problems.look(DT * tick):
            messages.append((round(DT * tick, 1), text))
    return messages


class Short(FakeSender):
    """A recording of two seconds."""

    @property
    def finished(self) -> bool:
        return self._polled >= 2.0


def test_every_silence_is_reported_once_with_its_reason() -> None:
    sender = FakeSender(faults=[silent(2.0, 5.0), silent(7.0, 8.5), silent(9.0, 9.5)])
    messages = looks(live_stream(sender, five()), 11.0)
    assert [time for time, _ in messages] == [3.0, 8.0]
    assert all(text.startswith("nothing has arrived for 1.0 s. See that the sender runs") for _, text in messages)
    sender, other = FakeSender(faults=[silent(2.0, 9.0)]), FakeSender(source=("127.0.0.1", 50000))
    sender.others.append(lambda before, now: other.poll(now) if now > 2.5 else [])
    ((_, message),) = looks(live_stream(sender, five()), 4.0)
    shows(message, "127.0.0.1:40000")
    stream = live_stream(Short(faults=[silent(2.0)]), five())
    assert [text for _, text in looks(stream, 4.0)] == ["the recording was over 1.0 s ago. Take a longer one"]
    shows(str(unusable(stream, [], 1.0, where="here", now=5.0)), "3.0")


@contextmanager
def motive(version: Version) -> Iterator[LiveStream]:
    """A stream of Motive, whose session is as if a server had answered."""
    stream = live_stream(FakeSender(), five())
    with closing(NatnetReceiver(parse_address(HERE))) as receiver:
        stream.receiver = receiver
        receiver.session.poll(0.0)
        receiver.session.receive(0.0, server_info(version))
        yield stream


def test_a_wrong_version_is_refused_and_reported_once() -> None:
    with motive(Version(2, 9)) as stream:
        with refuses(InputError, "NatNet", found="2.9"):
            refuse_version(stream, 0.1)
        assert "2.9" in str(unusable(stream, [], 10.0, where=HERE, now=10.0))
        problems = StreamProblems(stream)
        assert "2.9" in problems.look(0.1) and problems.foreign
        assert problems.look(0.2) == "" and problems.foreign


def test_a_readable_version_is_no_problem() -> None:
    with motive(Version(4, 1)) as stream:
        refuse_version(stream, 0.1)
        stream.last = 0.0
        problems = StreamProblems(stream)
        assert problems.look(0.1) == "" and not problems.foreign
        (message,) = [text for tick in range(500) if (text := problems.look(DT * tick))]
        shows(message)
        assert message.endswith("lets UDP from Motive in.")
        stream.admission.refused.note("cut")
        shows(problems.why(9.0), 1)


def test_the_allow_list_names_a_sender_that_is_not_on_it_and_a_socket_without_arrivals_its_address() -> None:
    stream = live_stream(FakeSender(source=("192.168.1.20", 40000)), five())
    where = "json://0.0.0.0:14150?allow=192.168.1.21"
    stream.admission = admission_for(parse_address(where))
    for tick in range(20):
        stream.poll(DT * tick, moving=False)
    text = str(unusable(stream, [], 10.0, where=where, now=10.0))
    shows(text)
    assert text.endswith("?allow=192.168.1.20."), text
    stream = live_stream(FakeSender(), five())
    with closing(UdpReceiver(StreamAddress("vmc://", "vmc"))) as receiver:
        stream.receiver, port = receiver, receiver.bound[1]
        text = str(unusable(stream, [], 10.0, where="vmc://:39539", now=10.0))
    shows(text, "127.0.0.1", "UDP", port, f"vmc://0.0.0.0:{port}?allow=ITS_ADDRESS", "`retarget doctor vmc://:39539`")


def test_a_page_is_advised_as_a_page_and_pictures_that_stall_are_no_jump_of_a_clock() -> None:
    stream = live_stream(FakeSender(faults=[silent(2.0, 9.0)]), five())
    stream.kind = "web"
    ((_, message),) = looks(stream, 4.0)
    shows(message)
    shows(StreamProblems(stream).briefly(4.0, 0.2))
    stream.decoder.dropped.note("picture without a person")
    stream.arrived, stream.frames = 5, 0
    shows(str(unusable(stream, ["head"], 10.0, where="web://", now=4.0)), "picture without a person")
    stream = live_stream(ClockedSender(lambda time: 1000.0 + time + (0.15 if 0.5 < time < 1.5 else 0.0)), five())
    stream.kind = "web"
    assert polled(stream, seconds=2.5) == []
