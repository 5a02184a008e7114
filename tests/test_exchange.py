"""Group reads: golden requests, answers out of noise, and no waiting beyond what answers take."""

import numpy as np
import pytest

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.exchange import SLACK, TURNAROUND, Ask, Kind, collect
from hardware.dynamixel.packets import Status
from scripted_port import ScriptedPort

IDS = (1, 2, 3)
FAST = Ask(Kind.FAST, IDS, 126, 10)
SYNC = Ask(Kind.SYNC, IDS, 126, 10)
GOLDEN = "ff ff fd 00 fe 0a 00 {code} 7e 00 0a 00 01 02 03"


def data(device: int) -> bytes:
    return bytes([device]) * 10


def statuses(*ids: int) -> list[bytes]:
    return [protocol2.status(device, 0, data(device)) for device in ids]


def fast_reply(*ids: int) -> bytes:
    """Of some ids, in order; the length is that of all three."""
    length = 1 + 3 * (1 + 1 + 10 + 2)
    frame = protocol2.HEADER + b"\xfe" + length.to_bytes(2, "little") + b"\x55"
    for device in ids:
        frame += b"\0" + bytes([device]) + data(device)
        frame += protocol2.crc(frame).to_bytes(2, "little")
    return frame


def crc(body: bytes) -> bytes:
    register = 0
    for byte in body:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ (0x8005 if register & 0x8000 else 0)) & 0xFFFF
    return register.to_bytes(2, "little")


@pytest.mark.parametrize(("ask", "code"), [(FAST, "8a"), (SYNC, "82")])
def test_the_request_for_ids_1_to_3(ask: Ask, code: str) -> None:
    body = bytes.fromhex(GOLDEN.format(code=code))
    assert ask.request() == body + crc(body)


def test_requests_of_protocol_1() -> None:
    bulk = bytes.fromhex("ff ff fe 09 92 00 08 01 24 08 02 24")
    assert Ask(Kind.BULK1, (1, 2), 36, 8).request() == bulk + bytes([~sum(bulk[2:]) & 0xFF])
    single = bytes.fromhex("ff ff 03 04 02 24 08")
    assert Ask(Kind.SINGLE1, (3,), 36, 8).request() == single + bytes([~sum(single[2:]) & 0xFF])


def run(ask: Ask, *pieces: bytes, gap: float = 0.0) -> tuple[list[Status], bool, float, int]:
    """Answers, noise, time taken and looks at the port."""
    port = ScriptedPort(lambda request: [(0.0005 + gap * k, piece) for k, piece in enumerate(pieces)])
    port.write(ask.request())
    answers, noise = collect(port, ask, 0.0, ask.timeouts(port, 0.0))
    return answers.statuses, noise, port.now(), port.looks


@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize(("ask", "reply"), [(FAST, [fast_reply(*IDS)]), (SYNC, statuses(*IDS))])
def test_whole_answers_are_not_waited_for_further(ask: Ask, reply: list[bytes], echo: bool) -> None:
    pieces = [ask.request(), *reply] if echo else reply
    answers, noise, took, looks = run(ask, *pieces, gap=0.0002)
    assert [(answer.id, answer.data) for answer in answers] == [(device, data(device)) for device in IDS]
    assert not noise
    assert took == pytest.approx(0.0005 + 0.0002 * (len(pieces) - 1))
    assert looks <= 2 * len(pieces) + 1


@pytest.mark.parametrize("ask", [FAST, SYNC])
def test_silence_ends_after_the_first_timeout(ask: Ask) -> None:
    answers, noise, took, looks = run(ask)
    port = ScriptedPort(lambda request: [])
    assert (answers, noise) == ([], False)
    sending = 10 * (len(ask.request()) + ask.bytes_of(1)) / port.baud  # an adapter may hand over whole answers
    assert took == pytest.approx(sending + TURNAROUND + port.latency + SLACK)
    assert looks == 0


def test_answers_count_each_by_itself() -> None:
    first, second, third = statuses(*IDS)
    for pieces, expected in (((first, third), [1, 3]), ((second,), [2]), ((third, first), [3, 1])):
        answers, noise, _, _ = run(SYNC, *pieces)
        assert [answer.id for answer in answers] == expected
        assert not noise
    broken = bytearray(second)
    broken[12] ^= 4
    answers, noise, _, _ = run(SYNC, first, bytes(broken), third)
    assert [answer.id for answer in answers] == [1, 3]
    assert noise


def test_a_fast_reply_cut_short_keeps_its_head() -> None:
    whole = fast_reply(*IDS)
    for count in range(len(whole)):
        answers, _, _, _ = run(FAST, whole[:count])
        complete = (count - 8) // 14 if count >= 8 else 0
        assert [answer.id for answer in answers] == list(IDS[:complete]), count


def test_damage_spoils_a_fast_reply_from_there_on() -> None:
    whole = fast_reply(*IDS)
    for at in range(len(whole)):
        bad = bytearray(whole)
        bad[at] ^= 0x20
        answers, noise, took, _ = run(FAST, bytes(bad))
        assert [answer.id for answer in answers] == list(IDS[: max(0, (at - 8) // 14)]), at
        assert noise
        assert took == pytest.approx(0.0005)


@pytest.mark.parametrize("ask", [FAST, SYNC])
def test_strangers_and_other_sizes_are_no_answer(ask: Ask) -> None:
    stranger = protocol2.status(9, 0, data(9))
    short = protocol2.status(1, 4, b"")
    answers, _, _, _ = run(ask, stranger, short)
    assert answers == []


def test_the_first_of_two_answers_counts() -> None:
    again = protocol2.status(1, 0, data(7))
    answers, _, _, _ = run(SYNC, statuses(1)[0], again, *statuses(2, 3))
    assert [answer.data for answer in answers] == [data(1), data(2), data(3)]


def test_a_stream_that_never_ends_is_left() -> None:
    port = ScriptedPort(lambda request: [(k * 0.0004, bytes([k % 251])) for k in range(2000)])
    port.write(SYNC.request())
    timeouts = SYNC.timeouts(port, 0.0)
    answers, noise = collect(port, SYNC, 0.0, timeouts)
    assert (answers.statuses, noise) == ([], True)
    assert port.now() <= timeouts.whole + 0.0004


def test_protocol_1_answers() -> None:
    ask = Ask(Kind.BULK1, (1, 2), 36, 8)
    reply = [protocol1.status(device, 0, bytes([device] * 8)) for device in (1, 2)]
    answers, noise, _, _ = run(ask, ask.request(), *reply)
    assert [(answer.id, answer.data) for answer in answers] == [(1, b"\1" * 8), (2, b"\2" * 8)]
    assert not noise


@pytest.mark.parametrize("baud", [57_600, 1_000_000, 4_000_000])
@pytest.mark.parametrize("kind", [Kind.FAST, Kind.SYNC])
def test_timeouts_grow_with_bytes_and_delays(kind: Kind, baud: int) -> None:
    port = ScriptedPort(lambda request: [], baud=baud)
    few, many = Ask(kind, IDS, 126, 10), Ask(kind, tuple(range(1, 21)), 126, 10)
    for ask in (few, many):
        slow, quick = ask.timeouts(port, 500e-6), ask.timeouts(port, 0.0)
        assert slow.first - quick.first == pytest.approx(500e-6)
        assert slow.whole - quick.whole == pytest.approx(500e-6 * ask.delays)
        assert quick.whole >= 10 * (len(ask.request()) + ask.reply_bytes) / baud + port.latency
    growth = many.timeouts(port, 0.0).whole - few.timeouts(port, 0.0).whole
    assert growth >= 10 * (many.reply_bytes - few.reply_bytes) / baud
    assert np.diff([ask.reply_bytes for ask in (few, many)])[0] == 17 * (14 if kind is Kind.FAST else 21)
