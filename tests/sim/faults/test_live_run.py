"""A live performer through the whole pipeline on virtual time: followed, held, without any jump; with three sensors.

What a row of the fault table runs, and judges by its bytes, is not here.
"""

import numpy as np
import pytest

from live_rig import LiveRig
from messages import refuses, shows
from retarget.errors import InputError
from retarget.human.samples import Parts
from retarget.live.begin import LiveOptions
from retarget.report.measure import measure
from retarget.run.options import RunOptions
from retarget.run.run_result import RunResult
from sim.faults.sender import FakeSender, Poses, SenderFault, lost, silent, swapped


def run(rig: LiveRig) -> RunResult:
    with rig.prepared() as prepared:
        return prepared.run()


def check_motion(result: RunResult) -> None:
    """Inside every limit, whatever the sender did."""
    assert result.robot is not None and result.record.robot is not None
    violations = measure(result).limit_violations
    assert (violations.position, violations.velocity, violations.acceleration) == (0, 0, 0)


def test_a_performer_is_followed_and_the_robot_goes_to_rest() -> None:
    rig = LiveRig(FakeSender())
    result = run(rig)
    check_motion(result)
    report = measure(result)
    assert any("m tall" in text for text in rig.said)
    shows(rig.said)
    assert (
        report.likeness_deg is not None
        and report.likeness_deg["forearms"].mean < 40.0
        and report.hand_path_ratio is not None
    )
    assert result.stop is None and not rig.bus.torque_on
    robot, sent = result.robot, result.record.robot
    assert robot is not None and sent is not None
    rest = robot.posture(robot.profile.postures.rest)
    np.testing.assert_allclose(sent.q[-1, robot.servo_columns], rest[robot.servo_columns], atol=1e-6)


def test_sides_that_are_swapped_are_held_and_then_followed_by_a_blend() -> None:
    rig = LiveRig(
        FakeSender(faults=[swapped("l_ankle", "r_ankle", 5.5, 99.0)]),
        options=LiveOptions(countdown=0.5, duration=4.5),
    )
    result = run(rig)
    check_motion(result)
    assert rig.said.count("the performer is not followed: the robot holds") == 1
    assert rig.said.count("the performer is followed") == 2
    shows(rig.said, "l_ankle, r_ankle", "jumped")
    assert result.stop is None


def dancing(time: float, poses: Poses) -> Poses:
    aside = np.array([0.0, 0.1 * np.sin(9.0 * time), 0.0])
    return {name: at + aside for name, at in poses.items()}


@pytest.mark.parametrize(
    ("fault", "fact"),
    [(silent(0.0, 99.0), "json://:7000"), (lost("head", 0.0, 99.0), "head"), (dancing, "cm")],
    ids=["nothing arrives", "a sensor is missing", "does not stand still"],
)
def test_a_performer_who_cannot_be_measured_is_refused(fault: SenderFault, fact: str) -> None:
    rig = LiveRig(FakeSender(faults=[fault]), options=LiveOptions(countdown=0.5, patience=2.0))
    with refuses(InputError, fact):
        run(rig)


# Head and both hands alone.

WORN = ("head", "l_wrist", "r_wrist")


def only_these(time: float, poses: Poses) -> Poses:
    return {name: at for name, at in poses.items() if name in WORN}


def three(parts: Parts, *faults: SenderFault, duration: float) -> LiveRig:
    made = LiveRig(
        FakeSender(faults=[only_these, *faults]), options=LiveOptions(countdown=0.2, duration=duration, person="ida")
    )
    made.run_options = RunOptions(robot="op3", performer="three", parts=parts)
    return made


@pytest.mark.parametrize("parts", ["whole", "upper"])
def test_head_and_hands_are_followed(parts: Parts, tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    live = three(parts, duration=2.5)
    result = run(live)
    report = measure(result)
    violations = report.limit_violations
    assert (violations.position, violations.velocity, violations.acceleration) == (0, 0, 0)
    assert live.said[-1] == "the performer is followed" and result.stop is None
    assert live.stream.roles.sensors == WORN
    robot, sent = result.robot, result.record.robot
    assert robot is not None and sent is not None
    follows = (result.record.time >= 0.0) & (result.record.time < 2.4)
    moved = {
        joint: float(np.ptp(sent.q[follows][:, robot.body.joint_qpos[robot.body.joint_index(joint)]]))
        for joint in ("l_knee", "r_hip_pitch", "l_el", "r_el")
    }
    assert (max(moved["l_knee"], moved["r_hip_pitch"]) < 1e-6) == (parts == "upper"), moved
    assert max(moved["l_el"], moved["r_el"]) > 0.05, moved
