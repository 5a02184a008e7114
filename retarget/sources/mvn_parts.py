"""Putting a sample together that the MVN streamer split over several datagrams (fingers make it do so)."""

from retarget.sources.mvn_wire import MvnHeader
from retarget.sources.stream_frame import MAX_DATAGRAM, Dropped

__all__ = ["SampleParts"]


class SampleParts:
    """The parts of the latest sample of one type. A part of another sample gives the present one up.

    It holds at most MAX_DATAGRAM bytes in at most 128 parts.
    """

    def __init__(self, dropped: Dropped) -> None:
        self._dropped = dropped
        self._sample: int | None = None
        self._parts: dict[int, bytes] = {}
        self._count: int | None = None

    def add(self, header: MvnHeader, payload: bytes) -> bytes | None:
        """The whole payload, in the order of the parts, when this was the part that was missing; else None."""
        if header.sample != self._sample:
            if self._parts:
                self._dropped.note("sample with a part missing")
            self._clear()
            self._sample = header.sample
        if header.part in self._parts:
            self._dropped.note("part sent twice")
            return None
        self._parts[header.part] = payload
        if header.last:
            self._count = header.part + 1
        if sum(map(len, self._parts.values())) > MAX_DATAGRAM or max(self._parts) >= (self._count or 128):
            self._dropped.note("parts that make no sample")
            self._clear()
            return None
        if len(self._parts) != self._count:
            return None
        whole = b"".join(self._parts[part] for part in sorted(self._parts))
        self._clear()
        return whole

    def _clear(self) -> None:
        self._sample, self._count = None, None
        self._parts.clear()
