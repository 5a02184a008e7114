"""Cutting the MVN streamer's TCP bytes into datagrams: it puts them end to end, and only headers tell their sizes."""

from retarget.sources.mvn_wire import HEADER_BYTES, STRIDES, MvnHeader, read_header
from retarget.sources.stream_frame import MAX_DATAGRAM, Dropped

__all__ = ["MOST_SKIPS", "MvnStream"]

MAGIC = b"MXTP"
MOST_SKIPS = 256
"""Headers in one chunk that are none; then all of the chunk is thrown away, for looking at each costs a microsecond."""
MAX_PAYLOAD = MAX_DATAGRAM - HEADER_BYTES


class MvnStream:
    """Bytes in, whole datagrams out. What is no datagram is skipped up to the next "MXTP" and counted once.

    Between calls it holds less than one datagram.
    """

    def __init__(self) -> None:
        self.dropped = Dropped()
        self._buffer = bytearray()
        self._lost = False

    @property
    def held(self) -> int:
        """Bytes of the datagram that has not come whole yet."""
        return len(self._buffer)

    def feed(self, chunk: bytes) -> list[bytes]:
        """The datagrams that these bytes complete, in order."""
        buffer = self._buffer
        buffer += chunk
        at, skips, datagrams = 0, 0, []
        while len(buffer) - at >= HEADER_BYTES:
            header = read_header(buffer, at)
            if header is None or not _plausible(header):
                at, skips = self._skip(at), skips + 1
                if skips > MOST_SKIPS:
                    at = max(at, len(buffer) - len(MAGIC) + 1)
                continue
            self._lost = False
            end = at + HEADER_BYTES + header.size
            if end > len(buffer):
                break
            datagrams.append(bytes(buffer[at:end]))
            at = end
        del buffer[:at]
        return datagrams

    def _skip(self, at: int) -> int:
        """Where the next header may begin: the next whole "MXTP", or the last bytes, which may begin one."""
        if not self._lost:
            self.dropped.note("bytes that are no datagram")
        self._lost = True
        found = self._buffer.find(MAGIC, at + 1)
        return found if found >= 0 else len(self._buffer) - len(MAGIC) + 1


def _plausible(header: MvnHeader) -> bool:
    """Whether the size can be true: "MXTP" inside of a damaged datagram must not swallow what follows it."""
    stride = STRIDES.get(header.kind)
    return header.size <= MAX_PAYLOAD and (stride is None or header.items * stride == header.size)
