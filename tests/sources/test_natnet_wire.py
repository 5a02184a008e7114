"""NatNet messages: golden bytes of what is sent, and what is read of a server's answers."""

from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from natnet_packets import server_info
from retarget.sources.natnet_wire import (
    MessageId,
    ServerInfo,
    Version,
    connect_message,
    message,
    read_server_info,
    split,
    text_until_zero,
)


def test_connect_without_a_version_has_the_size_and_version_of_the_real_one() -> None:
    sent = connect_message()
    assert len(sent) == 268
    assert sent[:4] == b"\x00\x00\x08\x01"
    assert sent[4:13] == b"retarget\0"
    assert sent[260:] == b"\x03\0\0\0\x03\0\0\0"


def test_connect_pins_a_version_at_bytes_265_to_268_of_its_payload() -> None:
    payload = connect_message(Version(4, 1))[4:]
    assert payload[264:269] == b"\x00\x04\x01\x00\x00"
    assert len(payload) == 270


def test_short_messages() -> None:
    assert message(MessageId.DEFINITIONS_REQUEST) == b"\x04\0\0\0"
    assert message(MessageId.KEEP_ALIVE) == b"\x0a\0\0\0"
    assert message(MessageId.COMMAND, b"Bitstream,4.1\0") == b"\x02\0\x0e\0Bitstream,4.1\0"


def test_a_server_is_read() -> None:
    parts = split(server_info(Version(4, 2), clock_hz=10_000_000, multicast=True, port=1600))
    assert parts is not None and parts[0] == MessageId.SERVER_INFO
    assert read_server_info(parts[1]) == ServerInfo(
        "Motive", (3, 1, 0, 0), Version(4, 2), 10_000_000, 1600, True, "239.255.42.99"
    )
    assert read_server_info(parts[1][:-1]) is None
    assert read_server_info(parts[1] + b"later") == read_server_info(parts[1])


@given(st.integers(0, 2**16 - 1), st.binary(max_size=40), st.binary(max_size=8))
def test_split_gives_what_the_header_says_and_refuses_less(kind: int, payload: bytes, more: bytes) -> None:
    whole = pack("<HH", kind, len(payload)) + payload
    assert split(whole + more) == (kind, payload)
    for end in range(len(whole)):
        assert split(whole[:end]) is None


@given(st.binary(max_size=700))
def test_text_from_outside_can_be_shown(raw: bytes) -> None:
    text = text_until_zero(raw)
    assert len(text) <= 128
    assert text.isprintable()


@pytest.mark.parametrize(("raw", "text"), [(b"a\x1b[2Jb\0c", "a[2Jb"), ("Günter".encode(), "Günter"), (b"", "")])
def test_text(raw: bytes, text: str) -> None:
    assert text_until_zero(raw) == text


def test_a_message_carries_its_size() -> None:
    assert message(MessageId.TEXT, b"abc") == b"\x08\0\x03\0abc"
