"""A key of the terminal that is held, as far as its repeats tell: a terminal shows no release."""

__all__ = ["LET_GO_S", "NEEDED", "HeldKey"]

LET_GO_S = 0.15
"""So long after its last repeat a key is let go. Slow keyboards repeat every 0.09 s."""
NEEDED = 4
"""Repeats without a longer pause between them after which a key is held: a tap is not, and a pasted text neither."""


class HeldKey:
    """One key. Held: from its fourth repeat (so half a second after it went down, as keyboards are set) to 0.15 s after
    its last. Another key that goes down ends the repeats, hence the hold."""

    def __init__(self, key: str) -> None:
        self.key = key
        self.lost = ""
        self._last = float("-inf")
        self._run = 0

    @property
    def told(self) -> str:
        """What a person is to hold."""
        return f"{self.key!r} (it must repeat)"

    def held(self, pressed: str, now: float) -> bool:
        """Whether it is held at `now`, s, of whom `pressed` came since the last look."""
        if pressed.strip(self.key):  # another one: nobody holds this one any more, or a text is pasted
            self._run, self._last = 0, now
        elif pressed:
            self._run = self._run + 1 if now - self._last <= LET_GO_S else 1
            self._last = now
        return self._run >= NEEDED and now - self._last <= LET_GO_S

    def close(self) -> None:
        """Nothing is open."""
