"""Admission of datagrams: the receiver protocol, the allow-list, and the one source that owns a stream.

Datagrams and times go in, decisions come out, without sockets or clocks. A refused datagram never reaches a decoder.
"""

from collections.abc import Iterable
from ipaddress import IPv4Network
from socket import inet_aton
from typing import Literal, NamedTuple, Protocol

from retarget.live.address import ANY_ADDRESS, StreamAddress
from retarget.sources.streams.stream_frame import MAX_DATAGRAM, Dropped

MOST_PER_POLL = 128  # datagrams of one poll: 12,800 a second at 100 Hz
MOST_BYTES_PER_POLL = 2**20  # bytes of one poll

Source = tuple[str, int]  # address (as numbers) and port of a sender


class Datagram(NamedTuple):
    """One datagram. arrival: s of the clock of `poll`; payload: 1 to 65,536 bytes."""

    arrival: float
    source: Source
    payload: bytes


class Receiver(Protocol):
    """A source of datagrams. `now` is s of the monotonic clock of the run."""

    dropped: Dropped

    @property
    def finished(self) -> bool:
        """True if nothing will arrive any more, as at the end of a recording."""
        ...

    def poll(self, now: float) -> list[Datagram]:
        """Return what has arrived until `now` (s), oldest first, bounded in number and bytes. Never blocks or
        raises."""
        ...

    def close(self) -> None:
        """Close what is open. A second call has no effect."""
        ...


RELEASE_AFTER_S = 5.0  # silence after which another source may own the stream of a robot at rest
MOST_NAMED_SOURCES = 16  # refused sources that are reported by address; more are only counted

NOT_ALLOWED = "sender not on the allow-list"
SECOND_SOURCE = "a second source"
NEW_SOCKETS = "the sender opens a new socket for each datagram"
# So many refused ports of the owner's computer in this time are new sockets of one sender.
MANY_PORTS, PORTS_WITHIN_S = 4, 1.0
TOO_LONG = "datagram empty or longer than 64 KiB"
TOO_MANY = "more datagrams than can be decoded in time"


class Admission:
    """Decides which datagrams reach the decoder.

    The first source of a frame that can be decoded owns the stream, until it is silent for RELEASE_AFTER_S while
    nothing moves. `moving` is True from the measurement of a performer on, holds included. refused: counts by reason.
    """

    def __init__(
        self, *, allow: Iterable[IPv4Network] = (ANY_ADDRESS,), source: Literal["port", "computer"] = "port"
    ) -> None:
        """source: Motive answers from one port and sends frames from another, so its computer counts as one source."""
        self.refused = Dropped()
        self._networks = tuple((int(net.network_address), int(net.netmask)) for net in allow)
        self._by_port = source == "port"
        self.owner: Source | None = None  # owns the stream; None until one has sent a frame
        self._last_frame = 0.0  # [s] of the owner
        self._ports = list[tuple[int, float]]()  # of the owner's computer: the last that were refused, and when [s]
        self._named: dict[tuple[str, str], None] = {}
        self._news: list[tuple[Source, str]] = []

    @property
    def named(self) -> tuple[tuple[str, str], ...]:
        """Refused addresses, each once per reason, the first MOST_NAMED_SOURCES."""
        return tuple(self._named)

    def admit(self, datagram: Datagram, *, now: float, moving: bool) -> bool:
        """True if a datagram may be decoded at `now`, s."""
        source = datagram.source
        if source != self.owner:
            if not self._allowed(source[0]):
                return self._refuse(NOT_ALLOWED, source)
            if not self._may_own(source, now, moving):
                return self._refuse(self._second(source, now), source)
        if not 0 < len(datagram.payload) <= MAX_DATAGRAM:
            self.refused.note(TOO_LONG)
            return False
        return True

    def confirm(self, source: Source, *, now: float, moving: bool) -> bool:
        """Note that an admitted datagram of `source` held a frame, and let it own the stream. True if the frame may be
        used."""
        if source != self.owner:
            if not self._may_own(source, now, moving):
                return self._refuse(self._second(source, now), source)
            self.owner, self._ports = source, []
        self._last_frame = now
        return True

    def news(self) -> tuple[tuple[Source, str], ...]:
        """Sources refused since the last call, each once per reason."""
        news, self._news = tuple(self._news), []
        return news

    def _second(self, source: Source, now: float) -> str:
        if self.owner is None or source[0] != self.owner[0]:
            return SECOND_SOURCE
        others = [(port, at) for port, at in self._ports if port != source[1] and now - at < PORTS_WITHIN_S]
        self._ports = [*others[1 - MANY_PORTS :], (source[1], now)]
        return NEW_SOCKETS if len(self._ports) == MANY_PORTS else SECOND_SOURCE

    def _may_own(self, source: Source, now: float, moving: bool) -> bool:
        if self.owner is None or (not self._by_port and source[0] == self.owner[0]):
            return True
        return not moving and now - self._last_frame > RELEASE_AFTER_S

    def _allowed(self, address: str) -> bool:
        try:
            number = int.from_bytes(inet_aton(address))
        except OSError:
            return False
        return any(number & mask == network for network, mask in self._networks)

    def _refuse(self, reason: str, source: Source) -> bool:
        self.refused.note(reason)
        key = (source[0], reason)
        if key not in self._named and len(self._named) < MOST_NAMED_SOURCES:
            self._named[key] = None
            self._news.append((source, reason))
        return False


def admission_for(address: StreamAddress) -> Admission:
    """The admission rules of an address."""
    return Admission(allow=address.allow, source="port" if address.host is None else "computer")
