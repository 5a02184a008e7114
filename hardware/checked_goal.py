"""`CheckedGoal`: a goal that the gate has passed. Only a gate makes one, and the guard's `write` takes nothing else."""

from dataclasses import dataclass, field

from hardware.arrays import FloatArray


class _Seal:
    """One gate's proof that a goal is its own: only `retarget.safety.gate` imports it (tests/test_arrows.py)."""


@dataclass(frozen=True, eq=False, slots=True)
class CheckedGoal:
    """A goal of one tick. number: counts the goals of a gate, so that none is written twice or late.

    joints (n,): rad, servo order, what is sent. posture (n,): rad, in which these goals hold the joints under their
    load; the same without deflection compensation. passed: the goal is the target that was checked, not the next
    posture of the braking trajectory. Raises TypeError when anything but a gate makes one.
    """

    joints: FloatArray
    posture: FloatArray
    passed: bool
    number: int
    seal: _Seal = field(repr=False)

    def __post_init__(self) -> None:
        if type(self.seal) is not _Seal:
            raise TypeError("a CheckedGoal is made by a gate alone: call Gate.check, Gate.brake or Gate.begin")
