"""Advice about what arrives at the wrong address."""

import pytest

from retarget.live.address import KINDS
from retarget.live.mix_ups import SENDERS, advice_for
from retarget.sources.datagram_kinds import Recognised


def test_every_kind_of_stream_has_a_sender() -> None:
    assert SENDERS.keys() == KINDS.keys() - {"replay"}


@pytest.mark.parametrize("kind", SENDERS)
@pytest.mark.parametrize("other", SENDERS)
def test_each_at_the_address_of_each(kind: str, other: str) -> None:
    advice = advice_for(kind, Recognised(other, other.upper()), port=5000)
    assert (not advice) if kind == other else f"{other}://" in advice


@pytest.mark.parametrize(
    ("kind", "got", "part"),
    [
        ("mvn", Recognised("mvn", "MVN", "type 05, Unity poses"), "Quaternion"),
        ("mvn", Recognised("mvn", "MVN", "type 12, names"), ""),
        ("json", Recognised("json", "poses as JSON", "no axes"), "rep103, unity"),
        ("vmc", Recognised("vmc", "VMC", "bones only"), "--performer avatar"),
        ("vmc", Recognised("vmc", "VMC", "no poses"), "Load an avatar"),
        ("natnet", Recognised("natnet", "NatNet", "connect"), "another client"),
        ("vmc", Recognised("", "mocopi"), "MCP2VMCP"),
        ("vmc", Recognised("", "damaged OSC", "x"), "VMC output"),
        ("vmc", Recognised("", "an unknown protocol"), "which program"),
    ],
)
def test_the_cure_is_named(kind: str, got: Recognised, part: str) -> None:
    advice = advice_for(kind, got, port=1)
    assert part in advice and bool(part) == bool(advice)


def test_another_kind_in_a_recording_is_read_as_that() -> None:
    advice = advice_for("vrchat", Recognised("vmc", "VMC"), port=0, recording="walk.raw")
    assert advice == "Read it as replay://walk.raw?kind=vmc"
