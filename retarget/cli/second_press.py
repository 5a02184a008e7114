"""Whether a key was pressed twice: a key that is held repeats, and is not."""

__all__ = ["AFTER_S", "PAUSE_S", "SecondPress"]

AFTER_S = 1.2
"""From its first press on; keyboards let the first repeat come up to 1 s after it."""
PAUSE_S = 0.2
"""Without the key before its second press. Slow keyboards repeat every 0.09 s."""


class SecondPress:
    """Of one key."""

    def __init__(self) -> None:
        self._first: float | None = None
        self._last = 0.0

    def pressed(self, count: int, now: float) -> bool:
        """Whether the key that came `count` times by `now`, s, since the last look was pressed again. Several times in
        one look are repeats: of a key that is held, read late."""
        if not count:
            return False
        first, pause, self._last = self._first, now - self._last, now
        if first is None:
            self._first = now
            return False
        return count == 1 and now - first >= AFTER_S and pause > PAUSE_S
