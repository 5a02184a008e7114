"""What a robot's goals pass last."""

import pytest

from followers import DT, follower, op3
from retarget.robot.deflection_compensation import CompensatedGoals
from retarget.run.prepare import make_gate
from retarget.safety.gate import Gate, PassThroughGate
from retarget.schema.priorities import load_priorities


@pytest.mark.parametrize(("name", "kind"), [("servo", Gate), ("balanced", CompensatedGoals)])
def test_priorities_say_whether_the_robot_is_held_up(name: str, kind: type) -> None:
    last = make_gate(op3(), follower(priorities=name), load_priorities(name), gate=True, dt=DT)
    assert type(last.goals) is kind and last.clearance is not None
    last.goals.seed(op3().posture(op3().profile.postures.stand)[op3().servo_columns])
    assert last.passes is not None and last.passes(last.goals.position)
    assert not last.passes(last.goals.position + 1.0)


def test_without_a_gate_goals_are_postures() -> None:
    last = make_gate(op3(), follower(priorities="balanced"), load_priorities("balanced"), gate=False, dt=DT)
    assert type(last.goals) is PassThroughGate and last.passes is None and last.clearance is None


def test_compensated_goals_are_checked_for_collision() -> None:
    """An arm that is lowered into the hip is refused before it is there."""
    last = make_gate(op3(), follower(priorities="balanced"), load_priorities("balanced"), gate=True, dt=DT)
    assert last.clearance is not None and last.passes is not None
    goal = op3().posture(op3().profile.postures.stand)[op3().servo_columns]
    joints = op3().joint_map
    shoulder, elbow = joints.joints.index("l_sho_roll"), joints.joints.index("l_el")
    last.goals.seed(goal)
    last.clearance.begin(op3().posture(op3().profile.postures.stand), goal)
    passed = []
    for _ in range(400):
        goal[shoulder] = min(goal[shoulder] + 0.002, joints.upper[shoulder])
        goal[elbow] = max(goal[elbow] - 0.003, joints.lower[elbow])
        passed.append(last.passes(goal))
        last.goals.admit(goal)
        goal = last.goals.position
    assert passed[0] and not passed[-1]
