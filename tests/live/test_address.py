"""Addresses of streams, and one message with the next step for every mistake."""

from dataclasses import replace
from ipaddress import IPv4Network
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.errors import UsageError
from retarget.live.address import ANY_ADDRESS, KINDS, StreamAddress, parse_address

HOST = (IPv4Network("192.168.1.5"),)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("vmc://:39539", StreamAddress("", "vmc", "127.0.0.1", 39539)),
        ("vmc://", StreamAddress("", "vmc", "127.0.0.1", 39539)),
        ("VMC://localhost/", StreamAddress("", "vmc", "127.0.0.1", 39539)),
        ("vmc://127.0.0.2:5", StreamAddress("", "vmc", "127.0.0.2", 5)),
        ("vmc://:1?allow=127.0.0.1", StreamAddress("", "vmc", "127.0.0.1", 1, (IPv4Network("127.0.0.1"),))),
        ("vmc://0.0.0.0?allow=any", StreamAddress("", "vmc", "0.0.0.0", 39539)),
        (
            "vmc://192.168.1.7:1?allow=192.168.1.5,10.0.0.0/8",
            StreamAddress("", "vmc", "192.168.1.7", 1, (*HOST, IPv4Network("10.0.0.0/8"))),
        ),
        ("vrchat://:9000", StreamAddress("", "vrchat", "127.0.0.1", 9000)),
        ("vrchat://", StreamAddress("", "vrchat", "127.0.0.1", 9000)),
        ("mvn://", StreamAddress("", "mvn", "127.0.0.1", 9763)),
        ("json://:7000", StreamAddress("", "json", "127.0.0.1", 7000)),
        ("natnet://192.168.1.5", StreamAddress("", "natnet", "0.0.0.0", 0, HOST, host="192.168.1.5")),
        (
            "natnet://192.168.1.5?interface=192.168.1.7",
            StreamAddress("", "natnet", "192.168.1.7", 0, HOST, "192.168.1.5", interface="192.168.1.7"),
        ),
        (
            "natnet://192.168.1.5?multicast=239.255.42.99",
            StreamAddress("", "natnet", "239.255.42.99", 1511, HOST, "192.168.1.5", "239.255.42.99"),
        ),
        (
            "natnet://192.168.1.5:9?multicast=239.255.42.99&interface=192.168.1.7",
            StreamAddress("", "natnet", "239.255.42.99", 9, HOST, "192.168.1.5", "239.255.42.99", "192.168.1.7"),
        ),
        (
            "natnet://192.168.1.5?up=z&bones=local",
            StreamAddress("", "natnet", "0.0.0.0", 0, HOST, "192.168.1.5", up="z", bones="local"),
        ),
        ("replay://a?up=z", StreamAddress("", "replay", path=Path("a"), up="z")),
        ("replay://a?kind=vmc", StreamAddress("", "replay", path=Path("a"), recorded="vmc")),
        ("replay://a/walk.raw", StreamAddress("", "replay", path=Path("a/walk.raw"))),
        ("replay:///a?b.raw?speed=1.5", StreamAddress("", "replay", path=Path("/a?b.raw"), speed=1.5)),
    ],
)
def test_each_address_is_parsed(text: str, expected: StreamAddress) -> None:
    interface = "127.0.0.1" if expected.kind == "natnet" and expected.host == "127.0.0.1" else expected.interface
    assert parse_address(text) == replace(expected, text=text, interface=interface)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "no address of a stream"),
        ("natnet://192.168.1.5?up=x", "y or z"),
        ("natnet://192.168.1.5?bones=here", "global or local"),
        ("vmc://:39539?up=z", "unknown option"),
        ("walk.bvh", "no address of a stream"),
        ("vmc:39539", "this is no address of a stream"),
        ("vmc:39539", "Did you mean vmc://:39539?"),
        ("VMC://39539?allow=any", "Did you mean vmc://:39539?allow=any?"),
        ("natnet:1510", "Write vmc://:39539"),
        ("vmc://\x1b[31m", r"vmc://\x1b[31m: this is no address"),
        ("vmc://" + "1" * 5000, "no address of a stream"),
        ("vcm://:39539", "Did you mean vmc?"),
        ("http://x", "allowed: vmc, vrchat, natnet, mvn, json, web, replay"),
        ("vmc://:0", "this is no port; found 0; allowed: 1 to 65535"),
        ("vmc://:65536", "this is no port"),
        ("vmc://:٣", "this is no port"),
        ("vmc://:-1", "this is no port"),
        ("vmc://:", "the port is missing"),
        ("vmc://studio", "this is no address of a computer; found studio"),
        ("vmc://010.0.0.1", "this is no address of a computer"),
        ("vmc://[::1]:39539", "IPv6 is not supported"),
        ("vmc://::1", "IPv6 is not supported"),
        ("vmc://239.1.1.1?allow=any", "a group cannot be listened on"),
        ("vmc://0.0.0.0:39539", "vmc://0.0.0.0:39539?allow=192.168.1.20"),
        ("json://192.168.1.7:7000", "others on the network could move the robot"),
        ("vmc://0.0.0.0?allow=", "'allow' cannot be empty"),
        ("vmc://0.0.0.0?allow", "'allow' cannot be empty"),
        ("vmc://0.0.0.0?allow=0.0.0.0/0", "'allow' cannot be read"),
        ("vmc://0.0.0.0?allow=192.168.1.5/24", "'allow' cannot be read"),
        ("vmc://0.0.0.0?allow=1.2.3.4,", "'allow' cannot be read"),
        ("vmc://0.0.0.0?allow=any,1.2.3.4", "'allow' cannot be read"),
        ("vmc://0.0.0.0?allow=239.1.1.1", "'allow' cannot be read"),
        ("vmc://0.0.0.0?allow=" + ",".join(["1.2.3.4"] * 65), "up to 64"),
        ("vmc://:1?alow=any", "Did you mean allow?"),
        ("vmc://:1?speed=2", "unknown option; found speed; allowed: allow"),
        ("vmc://:1?", "unknown option"),
        ("vmc://:1?allow=any&allow=any", "given twice"),
        ("natnet://", "the computer with Motive is missing"),
        ("natnet://239.255.42.99", "Write natnet://HOST?multicast=239.255.42.99"),
        ("natnet://0.0.0.0", "not the address of one computer"),
        ("natnet://1.2.3.4?multicast=10.0.0.1", "239.255.42.99"),
        ("natnet://1.2.3.4?interface=eth0", "address of an interface of this machine: 127.0.0.1 (lo)"),
        ("natnet://1.2.3.4?interface=0.0.0.0", "IPv4 address of an interface"),
        ("natnet://1.2.3.4?allow=any", "unknown option"),
        ("mvn://239.1.1.1?allow=10.0.0.2", "a group cannot be listened on"),
        ("json://", "the port is missing"),
        ("replay://", "the file is missing"),
        ("replay://?speed=1", "the file is missing"),
        ("replay://a?speed=0", "1 to 100"),
        ("replay://a?speed=0.5", "1 to 100 (slower, frames are too old"),
        ("replay://a?speed=nan", "1 to 100"),
        ("replay://a?speed=1e9", "1 to 100"),
        ("replay://a?speed=101", "1 to 100"),
        ("replay://a?kind=replay", "allowed: vmc, vrchat, natnet, mvn, json"),
    ],
)
def test_a_mistake_is_one_message(text: str, part: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_address(text)
    message = str(caught.value)
    assert part in message and message.endswith((".", "?")) and message.isprintable() and len(message) < 900
    assert len(caught.value.problems) == 1 and caught.value.problems[0].where


TEXTS = st.builds(
    "".join,
    st.lists(
        st.sampled_from(["vmc", "natnet", "mvn", "replay", "json", "://", ":", "?", "&", "=", "allow", "any"])
        | st.sampled_from(["127.0.0.1", "0.0.0.0", "10.0.0.2", "239.1.1.1", "/24", "9", "multicast", "speed", "1", "."])
        | st.text(max_size=3),
        max_size=12,
    ),
)


@given(TEXTS)
def test_no_text_lets_others_send_without_an_allow_list(text: str) -> None:
    try:
        address = parse_address(text)
    except UsageError:
        return
    assert 0 <= address.port <= 65_535 and address.kind in KINDS
    if not address.bind.startswith("127."):
        assert "allow=" in text or address.allow != (ANY_ADDRESS,)
