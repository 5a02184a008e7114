"""What came while nobody listened: it is taken before anybody judges how the stream is now."""

from retarget.live.stream import LiveStream

__all__ = ["RECENT_S", "CatchingUp"]

RECENT_S = 0.05
"""What arrived within so long is of now."""
LONGEST_S = 1.0
"""So long is waited at most; a sender that is not understood may go on for ever."""
MOST_POLLS = 100


class CatchingUp:
    """A robot's power costs about a second in which nobody listens: what a stream sends in it is more than a tick may
    decode, and is taken over several."""

    def __init__(self, stream: LiveStream) -> None:
        self._stream = stream
        self._arrived = -1
        self._since: float | None = None  # [s]
        self._done = False

    def at_once(self, now: float) -> None:
        """Take all that has arrived until `now`, s, however long that takes: where nothing has torque yet."""
        for _ in range(MOST_POLLS):
            before = self._stream.arrived
            self._stream.listen(now, moving=True)
            if self._stream.arrived == before:
                return

    def step(self, now: float) -> bool:
        """Once in every tick after it was listened, at `now`, s: whether there is more to take. Once there is not, it
        stays so."""
        if self._done:
            return False
        stream = self._stream
        self._since = now if self._since is None else self._since
        recent, silent = now - stream.last <= RECENT_S, stream.arrived == self._arrived
        self._done = recent or silent or now - self._since > LONGEST_S
        self._arrived = stream.arrived
        return not self._done
