"""What a person is told of a stream while it runs, each once: who else sends, what is lost, a clock that leapt."""

from collections.abc import Callable

from retarget.live.admission import NOT_ALLOWED, SECOND_SOURCE, TOO_LONG, TOO_MANY
from retarget.live.clock_jump import JumpKind
from retarget.live.datagram import Source
from retarget.live.natnet_receiver import NatnetReceiver
from retarget.live.stream import LiveStream
from retarget.live.udp import UdpReceiver

__all__ = ["StreamNews"]

_JUMPS = {
    JumpKind.RESTARTED: "the sender's clock began anew: it was started again",
    JumpKind.FORWARD: "the sender's clock leapt forward by {:.2f} s",
    JumpKind.BACK: "the sender's clock leapt back by {:.2f} s",
}
_NOT_USED = {
    TOO_LONG: (1, "datagrams that are empty or longer than 64 KiB are not used"),
    TOO_MANY: (5_000, "the sender sends more datagrams than are taken: the rest is not used"),
}
"""From so many on it is told: what waited in the kernel while a bus was opened comes at once, and is no flood."""


class StreamNews:
    """Looks at a stream in every tick. What it can say is little, and bounded however much a stranger sends."""

    def __init__(self, stream: LiveStream, tell: Callable[[str], object]) -> None:
        """tell: hears a sentence each."""
        self._stream, self._tell = stream, tell
        self._told = set[str]()
        self._jumps = stream.clock_map.jumps  # those before somebody follows it are of a sender that starts
        self._refused = 0
        self._overflowed: int | None = None

    def look(self) -> None:
        """Tell what has happened since the last look."""
        admission, clock = self._stream.admission, self._stream.clock_map
        if admission.refused.count != self._refused:
            self._refused = admission.refused.count
            for source, reason in admission.news():
                self._tell(_refusal(source, reason, admission.owner))
            for reason, (count, text) in _NOT_USED.items():
                if admission.refused.reasons[reason] >= count:
                    self._once(text)
        if clock.jumps != self._jumps and clock.last_jump is not None:
            self._jumps = clock.jumps
            jump = clock.last_jump
            self._once(_JUMPS[jump.kind].format(abs(jump.shift)), key=jump.kind)
        overflowed = _overflowed(self._stream)
        if self._overflowed is None:  # nobody listened while a bus was opened
            self._overflowed = overflowed
        if overflowed > self._overflowed:
            self._once("datagrams were lost in this computer: they came faster than they were fetched")
        tap = self._stream.tap
        if tap is not None and (news := tap.news()):
            self._tell(news)

    def _once(self, text: str, *, key: str = "") -> None:
        if (key or text) not in self._told:
            self._told.add(key or text)
            self._tell(text)


def _refusal(source: Source, reason: str, owner: Source | None) -> str:
    who = f"{source[0]}:{source[1]}"
    if reason == SECOND_SOURCE and owner is not None:
        return f"{who} sends too, and is not listened to: {owner[0]}:{owner[1]} was first"
    if reason == NOT_ALLOWED:
        return f"{who} sends too, and is not listened to: not on the allow-list (?allow=)"
    return f"{who} sends too, and is not listened to: {reason}"


def _overflowed(stream: LiveStream) -> int:
    receiver = stream.receiver
    return receiver.overflowed if isinstance(receiver, UdpReceiver | NatnetReceiver) else 0
