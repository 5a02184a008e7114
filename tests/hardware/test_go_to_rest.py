"""After a stop the robot goes to rest, unless it is at fault itself, as far as the gate lets it."""

from contextlib import suppress

import numpy as np
import pytest

from hardware.bus import ServoAlert
from hardware.errors import TorqueError
from hardware.guard_state import GuardState, StopCause
from retarget.run.loop import Watch
from retarget.run.rest_trajectory import SETTLE_S, rest_trajectories
from retarget.types import FloatArray
from rig import Rig, play
from sim.mock_bus import FaultKind, MockFault


def test_a_stop_ends_at_rest() -> None:
    script = np.zeros((60, 20))
    script[:, 0] = 0.1 * np.sin(np.arange(60) / 10.0)
    rig = Rig(script, goes_to_rest=True)
    rest = rig.robot.posture(rig.robot.profile.postures.rest)[rig.robot.servo_columns]
    play(rig, Watch())
    np.testing.assert_allclose(rig.gate.position, rest, atol=1e-9)
    assert rig.guard.state is GuardState.IDLE and not rig.bus.torque_on


def test_a_robot_that_cannot_go_to_rest_stays_where_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(np.zeros((40, 20)), goes_to_rest=True)
    admit, rest_ticks = rig.gate.admit, 0

    def walled(goal: FloatArray) -> FloatArray:
        nonlocal rest_ticks
        if rig.guard.state is GuardState.STOPPING:
            rest_ticks += 1
            if rest_ticks > 50:
                return rig.gate.brake()
        return admit(goal)

    monkeypatch.setattr(rig.gate, "admit", walled)
    play(rig, Watch())
    tries = len(list(rest_trajectories(rig.robot, dt=rig.dt)))
    assert 50 < rest_ticks < 60 + tries * (round(SETTLE_S / rig.dt) + 2)  # it waits before each
    assert rig.guard.state is GuardState.IDLE and not rig.bus.torque_on


@pytest.mark.parametrize("kind", [FaultKind.ALERT, FaultKind.MISSING])
@pytest.mark.parametrize("first", [20, 60])
def test_a_faulty_robot_does_not_go_to_rest(kind: FaultKind, first: int) -> None:
    """Before the end of the clip, or on the rest trajectory: the robot brakes and stands."""
    fault = MockFault(kind, first, 10**6, servo=12, alert=ServoAlert.OVERLOAD)
    rig = Rig(np.zeros((200, 20)), faults=(fault,), goes_to_rest=True)
    with suppress(TorqueError):
        play(rig)
    rest = rig.robot.posture(rig.robot.profile.postures.rest)[rig.robot.servo_columns]
    assert np.abs(rig.gate.position - rest).max() > 0.3
    assert rig.guard.stop_reason is not None
    assert rig.guard.stop_reason.cause in (StopCause.SERVO_ALERT, StopCause.SERVO_LOST)


def test_a_warm_robot_returns_to_stance_no_faster_than_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(np.zeros((40, 20)), goes_to_rest=True)
    monkeypatch.setattr(type(rig.guard.health), "speed_override", property(lambda self: 0.25))
    in_stance = iter([rig.follower.stance.q] * 5)
    monkeypatch.setattr(rig.follower, "return_to_stance", lambda dt: next(in_stance, None))
    play(rig)
    assert rig.follower.returns and set(rig.follower.overrides[-6:]) == {0.25}


@pytest.mark.parametrize("followed", [True, False])
def test_a_fault_during_the_return_to_stance_brakes_on_the_soles(
    monkeypatch: pytest.MonkeyPatch, followed: bool
) -> None:
    """The follower brakes the whole body there: each joint by itself would tip the robot."""
    fault = MockFault(FaultKind.ALERT, 120, 10**6, servo=12, alert=ServoAlert.OVERLOAD)
    rig = Rig(np.zeros((40, 20)), faults=(fault,), goes_to_rest=True)
    halts: list[int] = []

    def return_to_stance(dt: float) -> FloatArray | None:
        rig.side._started = followed
        q = rig.side._q.copy()
        q[rig.robot.servo_columns[0]] += 0.3 * dt
        return q

    def halt(dt: float) -> FloatArray | None:
        halts.append(len(halts))
        moved = rig.gate.velocity[0] * dt
        q = rig.side._q.copy()
        q[rig.robot.servo_columns[0]] += max(moved - 0.2 * rig.robot.joint_map.max_acceleration[0] * dt**2, 0.0)
        return q

    monkeypatch.setattr(rig.follower, "return_to_stance", return_to_stance)
    monkeypatch.setattr(rig.follower, "halt", halt)
    play(rig)
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.SERVO_ALERT
    assert 2 <= len(halts) < 50 and rig.gate.at_rest
    assert not rig.side._rest_trajectory._arrived
