"""What stands between a goal and the bus: the guard sends nothing that has not passed through a `GoalFilter`."""

from typing import Protocol

from hardware.arrays import FloatArray


class GoalFilter(Protocol):
    """The last word on a goal. It can always stop: from every posture it returns, it knows a braking trajectory within
    the limits.

    Postures are joint positions in rad, (n,), in the profile's servo order.
    """

    @property
    def position(self) -> FloatArray:
        """The posture returned last, rad; a copy. A filter that sets goals beside postures, for servos that give way
        under a load, tells the posture."""
        ...

    @property
    def sent(self) -> FloatArray:
        """What was returned last, rad; a copy. It is what keeps the limits of the servos."""
        ...

    @property
    def at_rest(self) -> bool:
        """Whether the posture returned last equals the one before it, so that nothing is left to brake."""
        ...

    def seed(self, position: FloatArray) -> None:
        """Start at rest at the robot's present `position`, which may lie beyond a limit. Raises HardwareError if not
        finite."""
        ...

    def admit(self, goal: FloatArray) -> FloatArray:
        """Return what to send this tick: `goal`, or the next posture of the last verified braking trajectory."""
        ...

    def brake(self) -> FloatArray:
        """Return the next posture of the last verified braking trajectory; once at rest, the same posture for ever."""
        ...
