"""The command governor: as much of what is asked as the gate passes, and never less than the stop allows."""

from collections.abc import Callable

import numpy as np
import pytest

from followers import DT, op3
from gates import as_clearance
from hardware.guard import CheckedGoal
from retarget.ik.support_polygon import Stance, plant
from retarget.ik.whole_body_stop import StopPath, WholeBodyStop
from retarget.robot.following_limits import following_limits, servo_limits
from retarget.robot.landmarks import standing_dofs
from retarget.safety.gate import Gate, PassThroughGate
from retarget.safety.governor import CommandGovernor
from retarget.safety.standing import SOLE_M, StandingCheck
from retarget.types import FloatArray

JOINTS = op3().joint_map.joints
LEGS = standing_dofs(op3())


def stance() -> Stance:
    return plant(op3(), op3().profile.postures.stand)


class Governed:
    """OP3 in its stance. passes: of a path (k, n) and the one that is followed else. slid: m that its soles are off."""

    def __init__(self, passes: Callable[[FloatArray, FloatArray], bool] | None = None, *, slid: float = 0.0) -> None:
        where, robot = stance(), op3()
        self.standing = StandingCheck(robot, where, dt=DT)
        self.gate = Gate(robot.joint_map, dt=DT, standing=self.standing, clearance=as_clearance(passes))
        self.governor = CommandGovernor(robot, self.gate, self.standing, LEGS)
        self.plans = WholeBodyStop(robot.body, following_limits(robot, where), servo_limits(robot), where, LEGS)
        self.q, self.goal = where.q + slid * np.eye(1, op3().body.nq)[0], self.gate.begin(where.q[robot.servo_columns])

    def asked(self, **displacement: float) -> StopPath:
        """The stop from where joints get by this displacement, rad."""
        dq = np.zeros(op3().body.nv)
        for joint, by in displacement.items():
            dq[op3().body.dof_index(joint)] = by
        return self.plans.path(op3().kinematics.integrate(self.q, dq), dq / DT, DT)

    def check(self, stop: StopPath) -> tuple[CheckedGoal, StopPath] | None:
        return self.governor.check(self.goal, stop, self.q)


def of(goal: CheckedGoal, joint: str) -> float:
    return float(goal.posture[JOINTS.index(joint)] - stance().q[op3().servo_columns][JOINTS.index(joint)])


def test_what_passes_is_taken_whole() -> None:
    governed = Governed()
    stop = governed.asked(l_sho_pitch=0.001, l_el=0.001)
    found = governed.check(stop)
    assert found is not None and found[1] is stop and found[0].passed
    np.testing.assert_array_equal(found[0].stop, governed.standing.joints(stop.postures[1:]))


def test_legs_go_as_far_as_soles_allow_and_arms_all_the_way() -> None:
    """A leg that moves alone drags its sole: the share is the one at which it is off by a millimetre, or nearly."""
    governed = Governed(slid=-8e-4)
    found = governed.check(governed.asked(l_hip_pitch=0.002, l_el=0.001))
    assert found is not None and found[0].passed
    assert of(found[0], "l_el") == pytest.approx(0.001, abs=1e-9)
    assert 0.0 < of(found[0], "l_hip_pitch") < 0.0019
    assert 0.9 * SOLE_M < governed.standing.losses(found[1]).slip <= SOLE_M


def test_the_share_changes_evenly_with_what_is_asked() -> None:
    """No cliff: two nearby requests give nearby goals, refused or not."""
    governed, taken = Governed(slid=-8e-4), list[float]()
    for by in np.linspace(0.0002, 0.0025, 60):
        found = governed.check(governed.asked(l_hip_pitch=float(by), l_el=0.001))
        assert found is not None
        taken.append(of(found[0], "l_hip_pitch"))
    assert np.abs(np.diff(taken)).max() < 1e-4 and max(taken) > 2.0 * taken[0] and taken[-1] < 0.002


def test_arms_go_on_where_the_way_of_the_legs_is_not_clear() -> None:
    knee, elbow = JOINTS.index("l_knee"), JOINTS.index("l_el")
    start = stance().q[op3().servo_columns]
    governed = Governed(lambda path, instead: bool((np.abs(path[:, knee] - start[knee]) < 1e-9).all()))
    found = governed.check(governed.asked(l_knee=1e-4, l_el=0.001))
    assert found is not None
    assert found[0].posture[knee] == start[knee] and found[0].posture[elbow] == pytest.approx(start[elbow] + 0.001)


def test_legs_go_on_where_the_way_of_the_arms_is_not_clear() -> None:
    knee, elbow = JOINTS.index("l_knee"), JOINTS.index("l_el")
    start = stance().q[op3().servo_columns]
    governed = Governed(lambda path, instead: bool((np.abs(path[:, elbow] - start[elbow]) < 1e-9).all()))
    found = governed.check(governed.asked(l_knee=1e-4, l_el=0.001))
    assert found is not None
    assert found[0].posture[elbow] == start[elbow] and found[0].posture[knee] == pytest.approx(start[knee] + 1e-4)


def test_where_nothing_is_clear_nothing_passes_and_it_is_tried_only_so_often() -> None:
    looks = list[FloatArray]()

    def refuses(path: FloatArray, instead: FloatArray) -> bool:
        looks.append(path)
        return False

    governed = Governed(refuses)
    assert governed.check(governed.asked(l_el=0.001)) is None
    assert 2 <= len(looks) <= 8


def test_without_limits_a_robot_still_stops_as_its_planner_says() -> None:
    governed = Governed()
    gate = PassThroughGate(op3().joint_map, dt=DT, standing=governed.standing)
    stop = governed.asked(l_sho_pitch=0.05, l_knee=0.02)  # faster than its servos
    goal = gate.check(gate.begin(governed.goal.joints), governed.standing.joints(stop.postures)[0], stop=stop)
    assert goal is not None and len(goal.stop) > 3
    np.testing.assert_array_equal(goal.stop, governed.standing.joints(stop.postures[1:]))


@pytest.mark.parametrize("seed", range(5))
def test_every_goal_that_passes_is_the_gates_own_and_can_be_stopped(seed: int) -> None:
    governed, random, passed = Governed(), np.random.default_rng(seed), 0
    most = op3().joint_map.max_acceleration * DT**2
    for _ in range(15):
        joints = random.choice(len(JOINTS), 4, replace=False)
        asked = {JOINTS[k]: float(random.uniform(-1.5, 1.5) * most[k]) for k in joints}
        stop = governed.asked(**asked)
        found = governed.check(stop)
        if found is None:
            continue
        (goal, path), passed = found, passed + 1
        rows = np.vstack([governed.goal.posture, goal.posture, goal.stop])
        moved = np.diff(rows, axis=0, append=rows[-1:])
        assert (np.abs(np.diff(moved, axis=0, prepend=0.0)) <= most + 1e-8).all()
        assert governed.standing.losses(path).slip <= SOLE_M and governed.standing.losses(path).shortfall <= 0.0
    assert passed > 10
