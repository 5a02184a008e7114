"""The SDK's handlers over a byte port: stuffing, deadlines, echo, no spinning, never stuck."""

import pytest
from dynamixel_sdk import COMM_RX_CORRUPT, COMM_RX_TIMEOUT, COMM_SUCCESS
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.sdk_port import SLACK, MendedProtocol2, SdkPort, packet_handler
from hardware.errors import BusError
from scripted_port import ScriptedPort, always, in_turn

READ = protocol2.read(1, 132, 4)
STATUS = bytes.fromhex("FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0")


def _sdk(port: ScriptedPort) -> SdkPort:
    return SdkPort(port, return_delay=0.0005)


def test_a_read_as_the_manual_prints_it() -> None:
    port = ScriptedPort(always(STATUS))
    value, result, error = packet_handler(2).read4ByteTxRx(_sdk(port), 1, 132)
    assert (value, result, error) == (166, COMM_SUCCESS, 0)
    assert port.sent == [READ]


def test_protocol_1_as_the_manual_prints_it() -> None:
    port = ScriptedPort(always(bytes.fromhex("FF FF 01 03 00 20 DB")))
    assert packet_handler(1).read1ByteTxRx(_sdk(port), 1, 43) == (32, COMM_SUCCESS, 0)
    assert port.sent == [protocol1.read(1, 43, 1)]


@settings(max_examples=50, deadline=None)
@given(st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x55]), max_size=24))
@example([0xFF, 0xFF, 0xFD, 0xFF])
@example([0xFF, 0xFF, 0xFD, 0xFD, 0xFF, 0xFF, 0xFD])
def test_stuffing_reaches_the_wire_and_comes_off_again(data: list[int]) -> None:
    port = ScriptedPort(always(protocol2.status(1, 0, bytes(data))))
    handler, sdk = packet_handler(2), _sdk(port)
    assert handler.writeTxRx(sdk, 1, 116, len(data), data) == (COMM_SUCCESS, 0)
    assert port.sent == [protocol2.write(1, 116, bytes(data))]
    assert handler.readTxRx(sdk, 1, 116, len(data)) == (data, COMM_SUCCESS, 0)


def test_stuffing_is_undone_in_place() -> None:
    packet = list(protocol2.frame(1, 3, b"\x00\xff\xff\xfd"))
    plain = [*packet[:5], packet[5] - 1, *packet[6:12], *packet[13:]]
    assert MendedProtocol2().removeStuffing(packet) is packet
    assert packet == plain
    assert MendedProtocol2().addStuffing(packet) is packet
    assert packet == list(protocol2.frame(1, 3, b"\x00\xff\xff\xfd"))


@pytest.mark.parametrize("baud", [9_600, 57_600, 4_500_000])
def test_silence_costs_what_bytes_adapter_and_servo_need(baud: int) -> None:
    port = ScriptedPort(always(), baud=baud)
    _, result, _ = packet_handler(2).read4ByteTxRx(_sdk(port), 1, 132)
    assert result == COMM_RX_TIMEOUT
    needed = 10 * (len(READ) + len(STATUS)) / baud + 0.0005 + port.latency
    assert needed + SLACK <= port.now() <= needed + SLACK + 80 / baud + 1e-9


def test_waiting_does_not_spin() -> None:
    port = ScriptedPort(always())
    packet_handler(2).read4ByteTxRx(_sdk(port), 1, 132)
    assert port.looks <= 3


def test_an_answer_in_drops_is_put_together() -> None:
    port = ScriptedPort(lambda request: [(0.0005 + 2e-5 * at, bytes((byte,))) for at, byte in enumerate(STATUS)])
    assert packet_handler(2).read4ByteTxRx(_sdk(port), 1, 132)[:2] == (166, COMM_SUCCESS)


def test_an_answer_cut_short_is_damaged() -> None:
    port = ScriptedPort(always(STATUS[:-1]))
    assert packet_handler(2).read4ByteTxRx(_sdk(port), 1, 132)[1] == COMM_RX_CORRUPT


def test_what_arrived_while_we_were_away_is_still_read() -> None:
    """The machine slept past the deadline: the answer lies there, and is not thrown away unread."""
    port = ScriptedPort(always(STATUS))
    sdk, handler = _sdk(port), packet_handler(2)
    assert handler.readTx(sdk, 1, 132, 4) == COMM_SUCCESS
    port.clock.advance(1.0)
    assert handler.readRx(sdk, 1, 4) == (list(STATUS[9:13]), COMM_SUCCESS, 0)


def test_a_line_that_never_falls_silent_is_left() -> None:
    foreign = protocol2.status(9)
    port = ScriptedPort(lambda request: [(1e-4 * at, foreign) for at in range(1000)])
    assert packet_handler(2).read4ByteTxRx(_sdk(port), 1, 132)[1] == COMM_RX_TIMEOUT
    assert port.now() < 0.02


@pytest.mark.parametrize("stale", [b"\x00", STATUS, b"\xff\xff\xfd\x00\x01"])
def test_stale_bytes_are_dropped_before_sending(stale: bytes) -> None:
    port = ScriptedPort(always(protocol2.status(1, 0, b"\x07\0\0\0")))
    sdk = _sdk(port)
    port.feed(stale)
    assert packet_handler(2).read4ByteTxRx(sdk, 1, 132)[0] == 7


@pytest.mark.parametrize("protocol", [1, 2])
def test_an_echo_is_dropped(protocol: int) -> None:
    codec = protocol1 if protocol == 1 else protocol2
    answer = protocol1.status(1, 0, b"\x20") if protocol == 1 else protocol2.status(1, 0, b"\x20")
    port = ScriptedPort(lambda request: [(0.0001, request), (0.0008, answer)])
    sdk = _sdk(port)
    assert packet_handler(protocol).read1ByteTxRx(sdk, 1, 43) == (32, COMM_SUCCESS, 0)
    assert sdk.echoed
    assert sdk.heard == len(answer)
    assert port.sent == [codec.read(1, 43, 1)]


def test_an_echo_alone_is_no_answer() -> None:
    """A 1.0 ping of a missing servo reads like a servo that complains about its voltage."""
    port = ScriptedPort(lambda request: [(0.0001, request)])
    sdk = _sdk(port)
    assert packet_handler(1).ping(sdk, 1)[1] == COMM_RX_TIMEOUT
    assert sdk.echoed
    assert sdk.heard == 0


def test_an_answer_that_begins_like_the_instruction_is_an_answer() -> None:
    port = ScriptedPort(in_turn(protocol1.status(1), protocol1.status(1, 0, b"\x1d\x00")))
    sdk = _sdk(port)
    assert packet_handler(1).ping(sdk, 1) == (29, COMM_SUCCESS, 0)
    assert not sdk.echoed
    assert port.now() < 0.003


def test_an_exception_leaves_nothing_stuck() -> None:
    port = ScriptedPort(always(STATUS))
    sdk = _sdk(port)
    port.broken = True
    with pytest.raises(BusError):
        packet_handler(2).read4ByteTxRx(sdk, 1, 132)
    port.broken = False
    assert packet_handler(2).read4ByteTxRx(sdk, 1, 132)[:2] == (166, COMM_SUCCESS)


@settings(max_examples=100, deadline=None)
@given(
    st.sampled_from([1, 2]),
    st.lists(
        st.one_of(st.binary(max_size=20), st.sampled_from([STATUS, b"\xff\xff\xfd\x00\x01\x00\x00\x55"])), max_size=4
    ),
)
def test_no_garbage_gets_past(protocol: int, garbage: list[bytes]) -> None:
    port = ScriptedPort(always(*garbage))
    handler, sdk = packet_handler(protocol), _sdk(port)
    handler.readTxRx(sdk, 1, 132, 4)
    assert port.now() < 0.1
