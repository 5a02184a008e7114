"""The gate of a robot: what it compensates, and what it checks; which runs have deadlines."""

import numpy as np
import pytest

from followers import DT, follower, op3
from hardware.clock import VirtualClock
from retarget.human.samples import Playback
from retarget.run.loop import Watch
from retarget.run.options import RunOptions
from retarget.run.prepare import make_gate, prepare
from retarget.safety.gate import Gate
from retarget.schema.priorities import load_priorities
from retarget.types import FloatArray
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer


def standing() -> FloatArray:
    """Joints of the OP3 in its posture `stand`, rad (20,)."""
    return op3().posture(op3().profile.postures.stand)[op3().servo_columns]


@pytest.mark.parametrize(("name", "compensates"), [("servo", False), ("balanced", True)])
def test_priorities_say_whether_goals_are_compensated(name: str, compensates: bool) -> None:
    gate = make_gate(op3(), follower(priorities=name), load_priorities(name), checks=True, dt=DT)
    assert type(gate) is Gate and gate.clearance is not None
    present = standing()
    gate.clearance.begin(op3().posture(op3().profile.postures.stand), present)
    gate.begin(present)
    for _ in range(200):
        goal = gate.check(present)
        assert goal is not None and np.array_equal(goal.posture, present)
    assert gate.goal is not None and np.any(gate.goal.joints != present) == compensates
    assert gate.check(present + 1.0) is None


def test_compensated_goals_are_checked_for_collision() -> None:
    """An arm that is lowered into the hip is refused before it is there."""
    gate = make_gate(op3(), follower(priorities="balanced"), load_priorities("balanced"), checks=True, dt=DT)
    assert gate.clearance is not None
    present, joints = standing(), op3().joint_map
    shoulder, elbow = joints.joints.index("l_sho_roll"), joints.joints.index("l_el")
    gate.begin(present)
    gate.clearance.begin(op3().posture(op3().profile.postures.stand), present)
    passed = []
    for _ in range(400):
        target = present.copy()
        target[shoulder] = min(target[shoulder] + 0.002, joints.upper[shoulder])
        target[elbow] = max(target[elbow] - 0.003, joints.lower[elbow])
        goal = gate.check(target)
        passed.append(goal is not None)
        present = (goal or gate.brake()).posture
    assert passed[0] and not passed[-1]


@pytest.mark.parametrize(("bus", "reason"), [("mock", None), ("profile", "no tick for 0.3 s, allowed 0.08 s")])
def test_a_slow_host_stops_real_servos_and_no_simulated_robot(bus: str, reason: str | None) -> None:
    clock = VirtualClock()
    options = RunOptions(robot="op3", bus=bus, priorities="servo", playback=Playback(end=0.3))
    with prepare(synthetic_performer, options, clock=clock, make_bus=mock_bus) as prepared:
        run = prepared.run(Watch(on_row=lambda record, row: clock.advance(0.3) if row == 50 else None))
    assert (run.state, run.reason) == ("off", reason) and (run.ticks_followed > 1) == (reason is None)
