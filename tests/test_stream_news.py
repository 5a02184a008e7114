"""What a stream does while it runs is told once each, and only once."""

from dataclasses import replace
from ipaddress import IPv4Network
from pathlib import Path

import pytest

from live_rig import LiveRig, five, live_stream
from retarget.live.address import parse_address
from retarget.live.admission import TOO_LONG, TOO_MANY, Admission
from retarget.live.begin import LiveOptions
from retarget.live.datagram import Datagram, Source
from retarget.live.performer import LivePerformer
from retarget.live.raw_tap import RawTap
from retarget.live.stream import LiveStream
from retarget.live.stream_news import StreamNews
from retarget.live.udp import UdpReceiver
from retarget.sources.raw_record import RawWriter
from sim.faults.sender import FakeSender

STRANGER: Source = ("10.9.8.7", 50_000)


def heard(stream: LiveStream, said: list[str], *, seconds: float = 1.5) -> None:
    """Listened to, with a look after each time."""
    news = StreamNews(stream, said.append)
    for tick in range(round(100 * seconds)):
        stream.listen(0.01 * tick, moving=True)
        news.look()


@pytest.mark.parametrize(
    ("allow", "told"),
    [
        ("0.0.0.0/0", "10.9.8.7:50000 sends too, and is not listened to: 127.0.0.1:40000 was first"),
        ("127.0.0.1/32", "10.9.8.7:50000 sends too, and is not listened to: not on the allow-list (?allow=)"),
    ],
)
def test_who_else_sends_is_told_once(allow: str, told: str) -> None:
    sender, said = FakeSender(), list[str]()
    sender.others = [lambda since, until: [Datagram(until, STRANGER, b"{}")] if since > 0.5 else []]
    stream = live_stream(sender, five())
    stream.admission = Admission(allow=[IPv4Network(allow)])
    heard(stream, said)
    assert said == [told] and stream.admission.refused.count > 90


def test_a_clock_that_leaps_is_told_once_for_each_way() -> None:
    said: list[str] = []
    stamps = FakeSender(stamp=lambda time: 1000.0 + time + (3600.0 if 0.5 < time < 1.5 or time > 2.5 else 0.0))
    stream = live_stream(stamps, five())
    heard(stream, said, seconds=3.5)
    assert said == [f"the sender's clock leapt {way} by 3600.00 s" for way in ("forward", "back")]
    assert stream.clock_map.jumps == 3


def test_a_performer_that_is_listened_to_tells_it() -> None:
    """Also who sent while the performer was measured."""
    sender = FakeSender()
    other: Source = ("127.0.0.1", 50001)
    sender.others = [lambda since, until: [Datagram(until, other, b"{}")] if since < 2.0 else []]
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=1.0))
    with rig.prepared() as prepared:
        assert isinstance(prepared.samples, LivePerformer)
        for _ in range(50):
            rig.clock.advance(0.01)
            prepared.samples.listen()
    assert sum("50001 sends too" in text for text in rig.said) == 1


def test_refused_datagrams_of_the_owner_are_told_once_there_are_many() -> None:
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


def test_losses_of_the_kernel_are_told_from_the_first_look_on() -> None:
    said: list[str] = []
    stream = live_stream(FakeSender(), five())
    with UdpReceiver(replace(parse_address("json://:14150"), port=0)) as receiver:
        stream.receiver = receiver
        news = StreamNews(stream, said.append)
        for lost in (70, 70, 71, 90):
            receiver.overflowed = lost
            news.look()
            assert len(said) == (lost > 70)
    assert said == ["datagrams were lost in this computer: they came faster than they were fetched"]


@pytest.mark.parametrize(("trouble", "told"), [("No space left on device", "has ended.*No space"), ("", "too slow")])
def test_a_recording_that_breaks_off_is_told_in_the_run_and_at_its_end(trouble: str, told: str, tmp_path: Path) -> None:
    said, ended = list[str](), list[str]()
    writer = RawWriter(tmp_path / "a.raw", url="json://")
    stream = live_stream(FakeSender(), five())
    with RawTap(writer, tell=ended.append) as tap:
        stream.tap = tap
        news = StreamNews(stream, said.append)
        news.look()
        assert not said
        writer.lost, writer.trouble = 7, trouble
        news.look()
        news.look()
        assert len(said) == 1
    reason = trouble or "the disk was too slow"
    assert ended == [f"the recording is not whole: {reason}; 7 datagrams are missing"]
    assert told.split(".*", maxsplit=1)[0] in said[0] and told.rsplit(".*", maxsplit=1)[-1] in said[0]


def test_a_whole_recording_is_no_news(tmp_path: Path) -> None:
    said: list[str] = []
    with RawTap(RawWriter(tmp_path / "a.raw", url="json://"), tell=said.append) as tap:
        tap.take(Datagram(1.0, ("127.0.0.1", 5), b"x"))
        assert tap.news() == ""
    assert said == []
