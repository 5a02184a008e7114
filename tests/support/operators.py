"""Operators of runs in tests."""

from collections.abc import Callable
from dataclasses import dataclass

from retarget.run.loop import Operator
from retarget.run.supervisor import AT_RISK, OperatorInput
from retarget.types import RunState

ENOUGH = "enough"


@dataclass
class Asks(Operator):
    """Asks for what functions say: `stop` while the robot moves with the performer, `torque_off` from then on."""

    stop: Callable[[], bool] = lambda: False
    torque_off: Callable[[], bool] = lambda: False
    why: str = ENOUGH

    def poll(self, state: RunState | None) -> OperatorInput:
        if state is None or state in AT_RISK:
            return OperatorInput(stop=self.why if self.stop() else None)
        return OperatorInput(torque_off=self.torque_off())
