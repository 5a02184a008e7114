"""Samples split over datagrams: whole in any order of their parts, given up when one is missing, never growing."""

import itertools

from retarget.sources.mvn_parts import SampleParts
from retarget.sources.mvn_wire import MvnHeader
from retarget.sources.stream_frame import Dropped


def header(part: int, *, last: bool = False, sample: int = 1) -> MvnHeader:
    return MvnHeader(2, sample, part, last, 1, 0, 0, 4)


def test_any_order_of_parts() -> None:
    for order in itertools.permutations(range(3)):
        dropped = Dropped()
        parts = SampleParts(dropped)
        results = [parts.add(header(part, last=part == 2), b"abc"[part : part + 1]) for part in order]
        assert results == [None, None, b"abc"]
        assert dropped.count == 0


def test_a_missing_part_gives_the_sample_up() -> None:
    dropped = Dropped()
    parts = SampleParts(dropped)
    assert parts.add(header(0), b"a") is None
    assert parts.add(header(0, sample=2), b"c") is None
    assert parts.add(header(1, sample=2, last=True), b"d") == b"cd"
    assert dropped.reasons == {"sample with a part missing": 1}


def test_a_part_sent_twice_is_used_once() -> None:
    dropped = Dropped()
    parts = SampleParts(dropped)
    assert parts.add(header(0), b"a") is None
    assert parts.add(header(0), b"x") is None
    assert parts.add(header(1, last=True), b"b") == b"ab"
    assert dropped.reasons == {"part sent twice": 1}


def test_a_part_beyond_the_last() -> None:
    dropped = Dropped()
    parts = SampleParts(dropped)
    parts.add(header(3), b"d")
    assert parts.add(header(1, last=True), b"b") is None
    assert dropped.reasons == {"parts that make no sample": 1}


def test_it_holds_no_more_than_a_datagram() -> None:
    dropped = Dropped()
    parts = SampleParts(dropped)
    for part in range(5):
        assert parts.add(header(part), bytes(20_000)) is None
    assert dropped.reasons == {"parts that make no sample": 1}
