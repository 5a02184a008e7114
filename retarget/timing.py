"""Stages that go by steps of time: how long a condition has held, and the first-order low pass."""

from dataclasses import dataclass
from typing import TypeVar

from retarget.arithmetic import exp
from retarget.types import FloatArray

Value = TypeVar("Value", float, complex, FloatArray)


@dataclass(slots=True)
class Dwell:
    """How long a condition has held without a break, `held`, s: to be set to start anew.

    It is a sum of steps, rounded in each: five of 0.01 s may miss 0.05 s by a last bit, either way.
    """

    held: float = 0.0

    def step(self, dt: float, *, holds: bool) -> float:
        """`held` after another `dt` s in which the condition holds, or does not."""
        self.held = self.held + dt if holds else 0.0
        return self.held


def low_pass(value: Value, to: Value, times: float) -> Value:
    """A value that goes to another as a first-order low pass does, after `times` of its time constants; inf: at once.

    dv/dt = (to - v) / T, exact while `to` stands still: it closes the share 1 - exp(-dt / T) of the gap.
    """
    return value + (1.0 - exp(-times)) * (to - value)
