"""For how long nobody has led the robot."""

__all__ = ["LED_S", "Unled"]

LED_S = 0.5
"""So long it must have been led without a break, s, before earlier holds count no more: one goal between two of them,
again and again, leads nowhere."""


class Unled:
    """Counts the time in which nobody knew a goal, from one tick to the next."""

    def __init__(self) -> None:
        self._since: float | None = None  # [s] since when, but for what was shorter than LED_S
        self._led_since: float | None = None  # [s] since when there has been a goal in every tick

    def led(self, now: float) -> None:
        """A tick at `now`, s, had a goal."""
        if self._led_since is None:
            self._led_since = now
        if now - self._led_since >= LED_S:
            self._since = None

    def lasted(self, now: float, *, on_purpose: bool) -> float:
        """A tick at `now`, s, has none: for how long, s. on_purpose: somebody holds the robot; that is not counted."""
        self._led_since = None
        if on_purpose or self._since is None:
            self._since = now
        return now - self._since
