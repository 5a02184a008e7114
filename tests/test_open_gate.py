"""No gate: finite goals pass as they are, others never, and it still brakes."""

import numpy as np
import pytest

from hardware.errors import HardwareError
from retarget.open_gate import OpenGate
from support.messages import refuses


def test_goals_pass_and_braking_ends_at_rest() -> None:
    gate = OpenGate(np.full(2, 10.0), dt=0.1)
    gate.seed(np.zeros(2))
    assert gate.at_rest
    np.testing.assert_array_equal(gate.admit(np.array([0.25, -5.0])), [0.25, -5.0])
    np.testing.assert_allclose(gate.brake(), [0.4, -9.9])
    for _ in range(100):
        gate.brake()
    assert gate.at_rest
    np.testing.assert_array_equal(gate.brake(), gate.position)


@pytest.mark.parametrize("goal", [[np.nan, 0.0], [np.inf, 0.0], [0.0]])
def test_what_no_servo_can_take(goal: list[float]) -> None:
    gate = OpenGate(np.full(2, 10.0), dt=0.1)
    with refuses(HardwareError):
        gate.admit(np.array(goal))
