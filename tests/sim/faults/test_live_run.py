"""A live performer through the whole pipeline on virtual time: followed, held, without any jump; with three sensors."""

from dataclasses import replace

import numpy as np
import pytest

from live_rig import LiveRig
from messages import refuses, shows
from operators import Asks
from retarget.errors import InputError
from retarget.human.samples import Parts
from retarget.human.sensor_intake import SLOW_INTAKE, IntakeTimes
from retarget.live import begin
from retarget.live.begin import LiveOptions
from retarget.model.robot import RobotBody
from retarget.report.measure import measure
from retarget.run.options import RunOptions
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.types import FloatArray, RunState
from sim.faults.sender import FakeSender, Poses, SenderFault, lost, silent, swapped


def run(rig: LiveRig) -> RunResult:
    with rig.prepared() as prepared:
        return prepared.run()


def check_motion(result: RunResult) -> tuple[RobotBody, FloatArray]:
    """The robot and the joints (T, nq) that were sent: inside every limit, whatever the sender did."""
    assert result.robot is not None and result.record.robot is not None
    violations = measure(result).limit_violations
    assert (violations.position, violations.velocity, violations.acceleration) == (0, 0, 0)
    return result.robot, result.record.robot.q


def test_a_performer_is_followed_and_the_robot_goes_to_rest() -> None:
    rig = LiveRig(FakeSender())
    result = run(rig)
    robot, sent = check_motion(result)
    report = measure(result)
    assert any("m tall" in text for text in rig.said)
    shows(rig.said)
    assert report.likeness_deg is not None and report.likeness_deg["forearms"].mean < 40.0
    assert report.hand_path_ratio is not None
    assert result.stop is None and not rig.bus.torque_on
    rest = robot.posture(robot.profile.postures.rest)
    np.testing.assert_allclose(sent[-1, robot.servo_columns], rest[robot.servo_columns], atol=1e-6)


def test_sides_that_are_swapped_are_held_and_then_followed_slowly() -> None:
    sender = FakeSender(faults=[swapped("l_ankle", "r_ankle", 5.5)])
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=4.5))
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


@pytest.mark.long
@pytest.mark.parametrize("parts", ["whole", "upper"])
def test_head_and_hands_are_followed(parts: Parts, tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    sender = FakeSender(faults=[lambda time, poses: {name: at for name, at in poses.items() if name in WORN}])
    rig = LiveRig(sender, options=LiveOptions(countdown=0.2, duration=2.5, person="ida"))
    rig.run_options = RunOptions(robot="op3", performer="three", parts=parts)
    result = run(rig)
    robot, sent = check_motion(result)
    assert rig.said[-1] == "the performer is followed" and result.stop is None
    assert rig.stream.roles.sensors == WORN
    follows = (result.record.time >= 0.0) & (result.record.time < 2.4)
    moved = {
        joint: float(np.ptp(sent[follows][:, robot.body.joint_qpos[robot.body.joint_index(joint)]]))
        for joint in ("l_knee", "r_hip_pitch", "l_el", "r_el")
    }
    assert (max(moved["l_knee"], moved["r_hip_pitch"]) < 1e-6) == (parts == "upper"), moved
    assert max(moved["l_el"], moved["r_el"]) > 0.05, moved


# A live robot follows a performer again slowly, waits on its approach while no sensor is valid, and never jumps.


def shares(result: RunResult) -> FloatArray:
    """Of its greatest speed, the fastest joint between rows (T - 1,)."""
    assert result.robot is not None and result.record.robot is not None
    q = result.record.robot.q[:, result.robot.servo_columns]
    speed = np.abs(np.diff(q, axis=0)) / result.clip.dt
    return np.asarray((speed / result.robot.joint_map.max_velocity).max(axis=1))


@pytest.mark.parametrize(("kind", "within"), [("silent", 0.15), ("late", 0.06)])
def test_on_the_approach_it_waits_while_no_sensor_is_valid(kind: str, within: float) -> None:
    sender, fault = FakeSender(), [0.0, 0.0]
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=1.0))

    def faulty() -> bool:
        return fault[0] <= rig.clock.now() < fault[1]

    sender.faults.append(lambda time, poses: None if kind == "silent" and faulty() else poses)
    seen: list[tuple[float, RunState]] = []
    with rig.prepared() as prepared:
        assert prepared.machine is not None
        supervisor, looks = prepared.machine.supervisor, 0

        def look() -> bool:
            nonlocal looks
            looks += 1
            seen.append((rig.clock.now(), supervisor.state))
            if looks == 20:
                fault[:] = rig.clock.now(), rig.clock.now() + 1.0
            if kind == "late" and faulty():
                rig.clock.advance(0.02)
            return False

        result = prepared.run(Asks(look))
    held = [time for time, state in seen if state is RunState.HOLD]
    assert held[0] - fault[0] <= within + 0.02
    went = [time for time, state in seen if state is RunState.APPROACH and time > held[0]]
    assert went[0] - fault[1] == pytest.approx(0.5, abs=0.05)
    assert result.stop is None and shares(result).max() < 0.5
    waits = [said for said in rig.said if said.startswith("the robot waits")]
    assert len(waits) == 1 and ("late" in waits[0]) == (kind == "late")
    shows(rig.said)
    rows = result.record.phase == Phase.FOLLOW
    assert np.count_nonzero(rows) == pytest.approx(result.clip.ticks, abs=2)


def lost_wrist(intake: IntakeTimes, monkeypatch: pytest.MonkeyPatch) -> tuple[LiveRig, RunResult]:
    """A wrist that is lost for 1.2 s while its arm is raised to the shoulder."""
    monkeypatch.setattr(begin, "SLOW_INTAKE", intake)
    base: Poses = {}

    def fault(time: float, poses: Poses) -> Poses:
        for name, point in poses.items():
            base.setdefault(name, point)
        noise = np.random.default_rng(int(time * 1000))
        sent = {name: point + noise.normal(0.0, 2e-4, 3) for name, point in base.items()}
        sent["head"] = sent["head"] + 0.01 * np.sin(2.0 * time)
        if time >= 6.8:
            sent["l_wrist"] = sent["l_wrist"] + np.array([0.15, 0.0, 0.6])
        if 6.0 <= time < 7.2:  # followed from 4.3 s on: the wrist has arrived since
            del sent["l_wrist"]
        return sent

    rig = LiveRig(FakeSender(faults=[fault]), options=LiveOptions(countdown=0.5, duration=5.5))
    return rig, run(rig)


@pytest.mark.long
def test_a_sensor_that_comes_back_is_blended_in_and_no_joint_goes_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, result = lost_wrist(SLOW_INTAKE, monkeypatch)
    shows(rig.said, "l_wrist")
    assert result.stop is None and result.record.robot is not None
    share = shares(result)
    assert 0.1 < share[result.record.following.start :].max() < 0.55
    _, longer = lost_wrist(replace(SLOW_INTAKE, fade=1.0), monkeypatch)
    assert longer.record.robot is not None
    assert not np.array_equal(longer.record.robot.goal_ticks, result.record.robot.goal_ticks)
