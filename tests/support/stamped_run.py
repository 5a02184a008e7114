"""`python stamped_run.py WORDS`: the command line, which prints at its end when a stop reached the emulated servos.

Time is unix time, as a browser has it, when the first goal after the guard's stop had been written.
"""

import sys
from datetime import UTC, datetime

from hardware.bus import ServoGoals
from hardware.dynamixel.bus import DynamixelBus
from hardware.guard import Guard
from hardware.guard_state import StopCause
from retarget.cli import main

STAMP = "first stopping goal at unix time"


def stamped() -> list[float]:
    """From now on goals are watched. Returns the list in which the time will be."""
    latch, write = Guard.latch, DynamixelBus.write
    asked: list[float] = []
    stamps: list[float] = []

    def latching(self: Guard, cause: StopCause, reason: str) -> None:
        asked.append(0.0)
        latch(self, cause, reason)

    def writing(self: DynamixelBus, goals: ServoGoals) -> None:
        write(self, goals)
        if asked and not stamps:
            stamps.append(datetime.now(UTC).timestamp())

    Guard.latch, DynamixelBus.write = latching, writing  # type: ignore[method-assign]
    return stamps


if __name__ == "__main__":
    found = stamped()
    try:
        main(sys.argv[1:])
    finally:
        sys.stderr.write(f"{STAMP} {found[0] if found else 'never':}\n")
