"""Where one cycle ends and the next begins: the same rule for who records and for who replays."""

from collections.abc import Callable

__all__ = ["Boundary"]


class Boundary:
    """A cycle holds one look at the servos (of a human alone: one posture). What comes before the next look and is not
    part of the tick any more belongs to the next cycle. turn: called where one begins."""

    def __init__(self, turn: Callable[[], None]) -> None:
        self._turn = turn
        self._looked = False

    def before(self) -> None:
        """Somebody does what is done between ticks: waits, or is asked for a stop."""
        if self._looked:
            self._looked = False
            self._turn()

    def look(self) -> None:
        """The servos are read."""
        self.before()
        self._looked = True
