"""How rough a bus is: in what share of the last cycles answers came damaged, and had to be asked for more than once."""

from collections import deque

WINDOW_S = 0.05
"""[s] that are looked back."""
FEWEST = 4
"""Cycles that it is taken to hold at least."""
RETRIES = 3
"""Repeated requests of one port that make a cycle a rough one, where at least one answer came damaged."""


class Roughness:
    """Of the cycles of one bus. share: of the rough ones among the last, 0 to 1."""

    def __init__(self) -> None:
        self.share = 0.0
        self._cycles: deque[tuple[float, bool]] = deque()  # time and whether it was rough
        self._rough = 0

    def note(self, now: float, *, retries: int, spoiled: int) -> None:
        """A cycle ended at `now`, s, with so many repeated requests, and so many whose answers came damaged."""
        rough = retries >= RETRIES and spoiled > 0
        self._cycles.append((now, rough))
        self._rough += rough
        while self._cycles[0][0] < now - WINDOW_S:
            self._rough -= self._cycles.popleft()[1]
        self.share = self._rough / max(len(self._cycles), FEWEST)
