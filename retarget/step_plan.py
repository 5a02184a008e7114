"""When a robot lifts a foot because its performer did: its mass goes over the other first, or the foot stays.

    BOTH -- the performer lifts a foot --> SHIFT -- the mass is over the other, held --> SWING
    SHIFT -- the performer's foot is down again: too fast, declined --> BACK
    SWING -- the performer's foot is down --> the robot's is put down --> BACK -- the mass is between them --> BOTH

In flight nobody's mass is over a foot: a robot on the floor stays planted.
"""

from dataclasses import dataclass
from enum import Enum

from retarget.carrying_feet import Carrying

__all__ = ["Sight", "StepPlan", "StepState", "StepTally"]

OVER_M = 0.003
"""How far (m) inside the region over one sole the balance is before the other may lift."""
HELD_S = 0.15
"""So long it has been there by then: servos are behind their goals."""
UNFELT_S = 1.0
"""So long (s) a sole that is in its place, and does not feel the floor, is waited for."""

_STANDS_ON = {Carrying.LEFT: 0, Carrying.RIGHT: 1}


class StepState(Enum):
    """What the feet of the robot do."""

    BOTH = "both soles planted, the mass between them"
    SHIFT = "both soles planted, the mass on its way over one"
    SWING = "on one sole"
    BACK = "both soles planted, the mass on its way back"


@dataclass
class StepTally:
    """How often the performer lifted a foot, and how often the robot did; declined: how often it could not in time, and
    stayed planted."""

    asked: int = 0
    made: int = 0

    @property
    def declined(self) -> int:
        """All that was asked and not made."""
        return self.asked - self.made


@dataclass(frozen=True)
class Sight:
    """What is seen in a tick. performer: which feet of theirs carry. over: how far (m) the robot's balance is inside
    the region over its left sole, and over its right one; settled: whether its mass is where standing on both asks for
    it. down: whether the foot that swings is in its place on the floor. felt: whether the left sole presses on it, and
    the right one, as far as anybody feels that."""

    performer: Carrying
    over: tuple[float, float]
    settled: bool
    down: bool
    felt: tuple[bool, bool] = (True, True)


class StepPlan:
    """`state`; `onto`: the foot, 0 left or 1 right, that carries or is to carry alone, None where none is; `lowers`:
    whether the foot that swings is to come down. Deterministic; one `look` per tick."""

    def __init__(self) -> None:
        self.tally = StepTally()
        self.restart()

    def restart(self) -> None:
        """Planted; what was counted stays."""
        self.state, self.onto, self.lowers = StepState.BOTH, None, False
        self._performer, self._pending, self._held, self._unfelt = Carrying.BOTH, False, 0.0, 0.0

    state: StepState
    onto: int | None

    @property
    def feet(self) -> tuple[bool, bool]:
        """Whether the left sole is locked to the floor, and the right one."""
        return (True, True) if self.state is not StepState.SWING else (self.onto == 0, self.onto == 1)

    def return_weight(self) -> None:
        """Bring the mass back between both feet, of a robot that was stopped where standing does not have it."""
        if self.state is StepState.BOTH:
            self.state, self.onto = StepState.BACK, None

    def look(self, sight: Sight, dt: float) -> None:
        """Go on by `dt` s."""
        self._count(sight.performer)
        wanted = _STANDS_ON.get(sight.performer)
        if self.state is StepState.SWING:
            self._swing(sight, wanted, dt)
        elif wanted is not None:
            self._shift(sight, wanted, dt)
        elif self.state is not StepState.BOTH:
            self.onto, self._held = None, 0.0
            self.state = StepState.BOTH if sight.settled else StepState.BACK

    def _count(self, performer: Carrying) -> None:
        """A lift of the performer's is asked for until it is made or over."""
        if performer is self._performer:
            return
        self._pending = performer in _STANDS_ON
        self.tally.asked += self._pending
        self._performer = performer

    def _shift(self, sight: Sight, wanted: int, dt: float) -> None:
        if self.state is not StepState.SHIFT or self.onto != wanted:
            self.state, self.onto, self._held = StepState.SHIFT, wanted, 0.0
        self._held = self._held + dt if sight.over[wanted] > OVER_M and sight.felt[wanted] else 0.0
        if self._held > HELD_S and self._pending:
            self.state, self.lowers = StepState.SWING, False
            self._pending = False
            self.tally.made += 1

    def _swing(self, sight: Sight, wanted: int | None, dt: float) -> None:
        """A foot that is on its way down goes on to the floor, whatever is asked meanwhile."""
        self.lowers = self.lowers or wanted != self.onto
        self._unfelt = self._unfelt + dt if self.lowers and sight.down else 0.0
        if self._unfelt > 0.0 and (all(sight.felt) or self._unfelt > UNFELT_S):
            self.state, self.lowers, self._held = StepState.BACK, False, 0.0
            self.onto = None
