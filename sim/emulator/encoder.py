"""How a 2.0 servo counts its position: homing offset, reverse mode, folding to one turn.

Source: e-Manual, Present Position (132), Homing Offset (20), Drive Mode (10).
"""

from hardware.servo import HOMING_REACH
from sim.emulator.motion import Shaft
from sim.emulator.registers import Memory
from sim.emulator.rules import POSITION, goal_bounds

TURN = 4096
REVERSE = 0x01  # bit of Drive Mode


class Encoder:
    """Keeps the position of `shaft` counted as the registers in `memory` say: actual position plus offset."""

    def __init__(self, memory: Memory, shaft: Shaft) -> None:
        self._memory = memory
        self._shaft = shaft
        self._offset = 0  # part of the position
        self.reversed = False

    def place(self, position: float) -> None:
        """Put the shaft where the present position reads `position` (tick) with the present settings."""
        self._offset = self._honoured()
        self.reversed = self._reverse()
        self._shaft.position = position

    def fold(self) -> None:
        """Count the actual position within one turn again."""
        actual = (self._shaft.position - self._offset) % TURN
        self._offset = self._honoured()
        self._shaft.position = actual + self._offset

    def follow_settings(self) -> None:
        """Count anew when offset or direction have changed; the offset keeps its sign in reverse mode."""
        if self._reverse() != self.reversed:
            self.reversed = not self.reversed
            self._shaft.position = 2 * self._offset - self._shaft.position
            if self._memory.value("operating_mode") == POSITION:
                self.fold()
        offset = self._honoured()
        self._shaft.position += offset - self._offset
        self._offset = offset

    def clear_turns(self) -> None:
        """Fold to one turn; the goal register goes along as far as its limits let it."""
        before = self._shaft.position
        self.fold()
        low, high = goal_bounds(self._memory, "goal_position")
        goal = self._memory.value("goal_position") + round(self._shaft.position - before)
        self._memory.put("goal_position", min(max(goal, low), high))

    def _reverse(self) -> bool:
        return bool(self._memory.value_or("drive_mode", 0) & REVERSE)

    def _honoured(self) -> int:
        offset = self._memory.value("homing_offset")
        ignored = self._memory.value("operating_mode") == POSITION and abs(offset) > HOMING_REACH
        return 0 if ignored else offset
