"""Datagrams and who may send them: an allow-list, the first source that makes sense and none after it, a bound on
rate and work.

Pure state: what arrives and when comes in, yes or no goes out. A datagram that is refused never reaches a decoder.
"""

from collections.abc import Iterable
from ipaddress import IPv4Network
from math import isfinite
from socket import inet_aton
from typing import Literal, NamedTuple, Protocol

from retarget.live.address import ANY_ADDRESS, StreamAddress
from retarget.sources.stream_frame import MAX_DATAGRAM, Dropped, StreamDecoder

__all__ = [
    "BURST",
    "MOST_BYTES_PER_POLL",
    "MOST_PER_POLL",
    "NOT_ALLOWED",
    "RATE",
    "RELEASE_AFTER_S",
    "SECOND_SOURCE",
    "TOO_LONG",
    "TOO_MANY",
    "WORK_PER_POLL",
    "Admission",
    "Datagram",
    "Receiver",
    "Source",
    "TokenBucket",
    "WorkBudget",
    "admission_for",
    "work_of",
]


# One datagram of a live stream, and what every receiver of them offers: sockets and recordings alike.

MOST_PER_POLL = 128
"""Datagrams that one poll returns at most; the rest waits. 12,800 a second at 100 Hz."""
MOST_BYTES_PER_POLL = 2**20
"""Bytes after which a poll takes no further datagram."""

Source = tuple[str, int]
"""Address (as numbers) and port of a sender."""


class Datagram(NamedTuple):
    """What arrived at once. arrival: s of the clock whose `now` was given to `poll`; payload: 1 to 65,536 bytes."""

    arrival: float
    source: Source
    payload: bytes


class Receiver(Protocol):
    """Where datagrams come from."""

    dropped: Dropped

    @property
    def finished(self) -> bool:
        """Whether nothing will arrive any more, as at the end of a recording."""
        ...

    def poll(self, now: float) -> list[Datagram]:
        """What has arrived until `now` (s), oldest first, bounded in number and bytes. Never blocks, never raises."""
        ...

    def close(self) -> None:
        """Let go of what is open; twice does no harm."""
        ...


# A bound on how often something may happen: a steady rate, and a burst above it. Reads no clock.


class TokenBucket:
    """Up to `burst` at once, `rate` a second over time: at most burst + rate * t of them in any t seconds."""

    def __init__(self, *, rate: float, burst: int) -> None:
        """Start full. Raises ValueError unless the rate is positive and finite, and the burst at least 1."""
        if not (rate > 0.0 and isfinite(rate) and burst >= 1):
            raise ValueError(f"a bucket needs a rate above 0 and a burst from 1; found {rate} and {burst}")
        self._rate, self._burst = rate, float(burst)
        self._tokens = self._burst
        self._filled: float | None = None

    def take(self, now: float) -> bool:
        """Whether one more may happen at `now`, s. A time that goes back counts as none passed."""
        if self._filled is not None and now > self._filled:
            self._tokens = min(self._burst, self._tokens + (now - self._filled) * self._rate)
        if self._filled is None or now > self._filled:
            self._filled = now
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True


RATE = 2_000.0
"""Datagrams a second: SlimeVR sends VMC at 232 Hz and VRChat OSC at 750 Hz, others a pose or two in each datagram."""
BURST = 200
"""Datagrams at once: what a link that hung for 0.25 s hands over of VRChat OSC."""
RELEASE_AFTER_S = 5.0
"""Silence after which a robot that does not move may have another source."""
MOST_NAMED = 16
"""Refused sources that are told; more are only counted."""

NOT_ALLOWED = "sender not on the allow-list"
SECOND_SOURCE = "a second source"
TOO_LONG = "datagram empty or longer than 64 KiB"
TOO_MANY = "more datagrams than the rate allows"


class Admission:
    """The gate in front of the decoder.

    The first source that sent a frame that could be decoded (`confirm`) owns the stream. It keeps it until it has sent
    no such frame for `release_after` seconds and nothing moves (`moving` is the caller's word: True as soon as
    somebody is being measured, and in every state in which the stream has a say in what the servos do, a hold
    included). refused: by reason.
    """

    def __init__(
        self,
        *,
        allow: Iterable[IPv4Network] = (ANY_ADDRESS,),
        release_after: float | None = RELEASE_AFTER_S,
        rate: float = RATE,
        burst: int = BURST,
        source: Literal["port", "computer"] = "port",
    ) -> None:
        """source: what counts as one. Another program on the sender's computer has another port; but Motive answers
        questions from one port and sends frames from another.

        `release_after` None: nothing frees the stream. Raises ValueError for a rate or burst that admits none,
        and for a negative time.
        """
        if release_after is not None and not release_after >= 0.0:
            raise ValueError(f"the silence that frees a stream is no negative time; found {release_after}")
        self.refused = Dropped()
        self._networks = tuple((int(net.network_address), int(net.netmask)) for net in allow)
        self._release_after = release_after
        self._by_port = source == "port"
        self._bucket = TokenBucket(rate=rate, burst=burst)
        self._owner: Source | None = None
        self._heard = 0.0
        self._named: dict[tuple[str, str], None] = {}
        self._news: list[tuple[Source, str]] = []

    @property
    def owner(self) -> Source | None:
        """The source that owns the stream; None until one has sent a frame."""
        return self._owner

    @property
    def named(self) -> tuple[tuple[str, str], ...]:
        """Addresses that were refused, each once per reason, the first MOST_NAMED in order."""
        return tuple(self._named)

    def admit(self, datagram: Datagram, *, now: float, moving: bool) -> bool:
        """Whether a datagram may be decoded at `now`, s. What others send costs the owner nothing of its rate."""
        source = datagram.source
        if source != self._owner:
            if not self._allowed(source[0]):
                return self._refuse(NOT_ALLOWED, source)
            if not self._may_own(source, now, moving):
                return self._refuse(SECOND_SOURCE, source)
        if not 0 < len(datagram.payload) <= MAX_DATAGRAM:
            self.refused.note(TOO_LONG)
            return False
        if not self._bucket.take(now):
            self.refused.note(TOO_MANY)
            return False
        return True

    def confirm(self, source: Source, *, now: float, moving: bool) -> bool:
        """Tell that an admitted datagram of `source` held a frame; whether that frame may be used.

        The source owns the stream from here on, unless another one does: of two that were admitted in one poll, the
        first to make sense has it.
        """
        if source != self._owner:
            if not self._may_own(source, now, moving):
                return self._refuse(SECOND_SOURCE, source)
            self._owner = source
        self._heard = now
        return True

    def news(self) -> tuple[tuple[Source, str], ...]:
        """Refused sources and why, each address once per reason, since the last call; for a message to the person."""
        news, self._news = tuple(self._news), []
        return news

    def _may_own(self, source: Source, now: float, moving: bool) -> bool:
        if self._owner is None or (not self._by_port and source[0] == self._owner[0]):
            return True
        return not moving and self._release_after is not None and now - self._heard > self._release_after

    def _allowed(self, address: str) -> bool:
        try:
            number = int.from_bytes(inet_aton(address))
        except OSError:
            return False
        return any(number & mask == network for network, mask in self._networks)

    def _refuse(self, reason: str, source: Source) -> bool:
        self.refused.note(reason)
        key = (source[0], reason)
        if key not in self._named and len(self._named) < MOST_NAMED:
            self._named[key] = None
            self._news.append((source, reason))
        return False


def admission_for(address: StreamAddress) -> Admission:
    """The gate that an address asks for."""
    return Admission(allow=address.allow, source="port" if address.host is None else "computer")


# How much of what arrived is decoded in one tick: work that is counted, so that a replay decides as the run did.

WORK_PER_POLL = 3_000.0
"""Of one poll, three eighths of a tick: the bus needs as much. A unit is about a microsecond: 12 datagrams of
SlimeVR; a tick has two."""
PER_DATAGRAM, PER_BYTE, PER_FRAME = 30.0, 1.0 / 40.0, 150.0
"""What every datagram counts, and each frame in it: clock, trust and playout cost more than its decoding."""


class WorkBudget:
    """What is left of one poll's work."""

    def __init__(self) -> None:
        self._left = WORK_PER_POLL

    @property
    def spent(self) -> bool:
        """Whether the next datagram has to wait for the next poll. The first one of a poll never has to."""
        return self._left <= 0.0

    def charge(self, payload: bytes, *, frames: int, work: float) -> None:
        """One datagram was decoded. work: units that its decoder counted for it."""
        self._left -= PER_DATAGRAM + PER_BYTE * len(payload) + PER_FRAME * frames + work


def work_of(decoder: StreamDecoder) -> float:
    """Units beyond their length that a decoder has counted for its datagrams so far; 0 for one that counts none."""
    # A look for a protocol would cost more than a decoded datagram.
    return float(getattr(decoder, "work", 0.0))
