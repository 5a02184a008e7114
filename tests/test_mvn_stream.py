"""The TCP stream of MVN: the same datagrams however it is cut, and found again after damage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mutated import mutated
from mvn_packets import meta, mvn, quaternions, scale, standing
from retarget.sources.mvn_stream import MOST_SKIPS, MvnStream
from retarget.sources.stream_frame import MAX_DATAGRAM

SENT = [
    quaternions(standing(), sample=1),
    meta("name:Ann\n"),
    scale([("Pelvis", (0, 0, 1))]),
    quaternions(standing(), sample=2),
]
WHOLE = b"".join(SENT)


@given(st.lists(st.integers(0, len(WHOLE)), max_size=20))
def test_any_cutting(places: list[int]) -> None:
    stream, found = MvnStream(), []
    for begin, end in zip([0, *sorted(places)], [*sorted(places), len(WHOLE)], strict=True):
        found += stream.feed(WHOLE[begin:end])
    assert found == SENT
    assert stream.held == 0 and stream.dropped.count == 0


def test_byte_by_byte() -> None:
    stream = MvnStream()
    assert [datagram for byte in WHOLE for datagram in stream.feed(bytes([byte]))] == SENT


def test_rubbish_before_a_datagram_is_skipped_and_counted_once() -> None:
    stream = MvnStream()
    rubbish = b"MXT" + bytes(100) + b"MXTPxx" + bytes(100) + b"MX"
    found = [datagram for byte in rubbish + WHOLE for datagram in stream.feed(bytes([byte]))]
    assert found == SENT
    assert stream.dropped.reasons == {"bytes that are no datagram": 1}


def test_a_chunk_of_headers_that_are_none_is_thrown_away_and_not_looked_through() -> None:
    stream = MvnStream()
    few, many = b"MXTPxx" * (MOST_SKIPS // 2), b"MXTPxx" * (4 * MOST_SKIPS)
    assert stream.feed(few + WHOLE) == SENT
    assert stream.feed(many + WHOLE) == [] and stream.held < 24
    assert stream.feed(WHOLE) == SENT and stream.dropped.count == 2


@pytest.mark.parametrize("cut", range(5))
def test_a_header_that_begins_at_the_end_of_rubbish_is_kept(cut: int) -> None:
    for length in range(30, 60):
        stream = MvnStream()
        assert stream.feed(bytes(length) + SENT[0][:cut]) == []
        assert stream.feed(SENT[0][cut:]) == [SENT[0]]


def test_a_size_that_cannot_be_true_swallows_nothing() -> None:
    lie = mvn("02", b"", items=23, size=60_000)
    stream = MvnStream()
    assert stream.feed(lie + WHOLE) == SENT
    assert stream.dropped.count == 1


def test_lost_bytes_cost_what_they_hit() -> None:
    stream = MvnStream()
    assert stream.feed(SENT[0][:300] + SENT[0][310:] + 5 * SENT[3])[-3:] == 3 * [SENT[3]]


def test_it_never_holds_more_than_a_datagram() -> None:
    stream = MvnStream()
    for _ in range(50):
        stream.feed(mvn("20", b"", size=65_000) + bytes(10_000))
        assert stream.held <= MAX_DATAGRAM
    stream = MvnStream()
    for _ in range(50):
        stream.feed(b"M" * 10_000)
        assert stream.held < 24


@given(st.lists(st.one_of(st.binary(max_size=60), st.just(b"MXTP02"), st.sampled_from(SENT)), max_size=12))
def test_any_bytes(chunks: list[bytes]) -> None:
    stream = MvnStream()
    for chunk in chunks:
        assert all(datagram.startswith(b"MXTP") for datagram in stream.feed(chunk))
        assert stream.held <= MAX_DATAGRAM


@pytest.mark.long
def test_a_million_datagrams() -> None:
    generator, stream = np.random.default_rng(7), MvnStream()
    whole = 0
    for _ in range(1_000_000):
        whole += len(stream.feed(mutated(generator, SENT)))
        assert stream.held <= MAX_DATAGRAM
    assert whole > 200_000  # the rest was damaged, or beside what was
