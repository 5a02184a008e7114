"""Head and both hands alone: measured, followed, held when the head is lost; with the legs still too."""

import numpy as np
import pytest

from live_rig import LiveRig
from retarget.human.samples import Parts
from retarget.live.begin import LiveOptions
from retarget.report.measure import measure
from retarget.run.options import RunOptions
from retarget.run.run_result import RunResult
from sim.faults.sender import FakeSender, Poses, SenderFault, lost

WORN = ("head", "l_wrist", "r_wrist")


def only_these(time: float, poses: Poses) -> Poses:
    return {name: at for name, at in poses.items() if name in WORN}


def run(live: LiveRig) -> RunResult:
    with live.prepared() as prepared:
        return prepared.run()


def rig(parts: Parts, *faults: SenderFault, duration: float) -> LiveRig:
    made = LiveRig(
        FakeSender(faults=[only_these, *faults]), options=LiveOptions(countdown=0.2, duration=duration, person="ida")
    )
    made.run_options = RunOptions(robot="op3", performer="three", parts=parts)
    return made


@pytest.mark.parametrize("parts", ["whole", "upper"])
def test_head_and_hands_are_followed(parts: Parts, tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    live = rig(parts, duration=2.5)
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


def test_without_the_head_the_robot_holds() -> None:
    live = rig("upper", lost("head", 7.0, 7.7), duration=4.0)
    result = run(live)
    assert live.said.count("the performer is not followed: the robot holds") == 1
    assert result.stop is None
