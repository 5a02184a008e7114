"""What happens now and then: said once, with the cycle in which it was, and kept as a line of a log."""

from collections import deque
from dataclasses import dataclass
from enum import IntEnum

from retarget.recording.cdr import CdrBuilder

__all__ = ["MOST_EVENTS", "Event", "Events", "Level", "log_message"]

MOST_EVENTS = 10_000
"""So many wait to be written, no more."""
MAX_TEXT = 2000


class Level(IntEnum):
    """Of rcl_interfaces/msg/Log."""

    INFO = 20
    WARN = 30
    ERROR = 40


@dataclass(frozen=True)
class Event:
    """time: s, on the run's clock. who: guard, bus, stream, ... cycle: in which it was."""

    time: float
    cycle: int
    level: Level
    who: str
    text: str


class Events:
    """Events on their way to the file. lost: those for which there was no room."""

    def __init__(self) -> None:
        self.lost = 0
        self._waiting: deque[Event] = deque()

    def add(self, event: Event) -> None:
        """Take one; never waits."""
        if len(self._waiting) >= MOST_EVENTS:
            self.lost += 1
        else:
            self._waiting.append(event)

    def take(self) -> list[Event]:
        """All that wait."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]


def log_message(event: Event, *, stamp_ns: int) -> bytes:
    """The event as rcl_interfaces/msg/Log in CDR; its `line` is the cycle."""
    builder = CdrBuilder().time().scalar("level", "uint8").text(event.who).text(event.text[:MAX_TEXT])
    layout = builder.text("").text("").scalar("line", "uint32").build()
    row = layout.rows(1)
    row["stamp.sec"], row["stamp.nanosec"] = divmod(stamp_ns, 10**9)
    row["level"], row["line"] = event.level, max(event.cycle, 0)
    return row.tobytes()
