"""No gate: every finite goal passes. For servos that do not exist, to see what the gate would have held back."""

import numpy as np

from hardware.arrays import FloatArray
from hardware.errors import HardwareError, describe

__all__ = ["OpenGate"]


class OpenGate:
    """A `hardware.goal_filter.GoalFilter` without limits. It still brakes within `max_acceleration` (n,) rad/s^2."""

    def __init__(self, max_acceleration: FloatArray, *, dt: float) -> None:
        self._change = np.asarray(max_acceleration) * dt**2
        self._position = np.zeros_like(self._change)
        self._displacement = np.zeros_like(self._change)

    @property
    def position(self) -> FloatArray:
        """Posture returned last, rad (n,)."""
        return self._position.copy()

    @property
    def sent(self) -> FloatArray:
        """The same: goals are postures."""
        return self.position

    @property
    def at_rest(self) -> bool:
        """Whether nothing is left to brake."""
        return not self._displacement.any()

    def seed(self, position: FloatArray) -> None:
        """Start at rest at `position`, rad (n,). Raises HardwareError if not finite."""
        self._position = self._finite(position)
        self._displacement = np.zeros_like(self._position)

    def admit(self, goal: FloatArray) -> FloatArray:
        """Return `goal`, rad (n,). Raises HardwareError if not finite."""
        goal = self._finite(goal)
        self._displacement = goal - self._position
        self._position = goal
        return goal.copy()

    def brake(self) -> FloatArray:
        """Return the next posture under full deceleration, rad (n,)."""
        slower = np.maximum(np.abs(self._displacement) - self._change, 0.0)
        self._displacement = np.copysign(slower, self._displacement)
        self._position = self._position + self._displacement
        return self._position.copy()

    def _finite(self, posture: FloatArray) -> FloatArray:
        posture = np.array(posture, dtype=np.float64)
        if posture.shape != self._change.shape or not np.isfinite(posture).all():
            raise HardwareError(
                describe(what="a goal that no servo can take", where="no gate", found=posture, allowed="finite angles")
            )
        return posture
