"""Whole runs that are stopped at any time: the robot goes to rest, slowly, clear of what moves, and stays there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from hardware.guard import CheckedGoal
from messages import shows
from retarget.cli.buses import PhysicsBench
from retarget.human.samples import Playback
from retarget.ik.hierarchy import SceneObstacles
from retarget.model.robot import RobotBody, load_robot
from retarget.report import motion_metrics
from retarget.robot.follower import Follower
from retarget.run.loop import Watch
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from retarget.run.supervisor import STATES
from retarget.safety.gate import Gate
from retarget.types import FloatArray, Notify, RunState
from sim.mock_bus import MockBus
from sim.performer import synthetic_performer
from sim.physics.witness import Witness


def angles(robot: RobotBody, name: str) -> FloatArray:
    return robot.posture(getattr(robot.profile.postures, name))[robot.servo_columns]


def stopped(
    name: str,
    after: int,
    *,
    start: str,
    scene: Path | None = None,
    end: float = 1.0,
    notify: Notify = lambda text: None,
) -> tuple[RunResult, SceneObstacles | None]:
    """A run on a mock bus, of a robot in the posture `start`, that is stopped after so many ticks."""

    def bus(robot: RobotBody, clock: Clock) -> ServoBus:
        return MockBus(robot.joint_map.servos, clock, start=robot.joint_map.to_ticks(angles(robot, start)))

    asked = RunOptions(
        robot=name,
        bus="mock",
        priorities="balanced",
        scene=None if scene is None else str(scene),
        playback=Playback(end=end),
    )
    ticks, clock = iter(range(10**6)), VirtualClock()
    with prepare(synthetic_performer, asked, clock=clock, make_bus=bus, goes_to_rest=True, notify=notify) as prepared:
        run = prepared.run(Watch(stop_asked=lambda: next(ticks) >= after))
        return run, prepared.scene_obstacles


RETURN_S = 4.0
"""Longest return to stance in place of that of a run, so that what is refused takes less time."""


@pytest.mark.parametrize("passed", [0, 60])
def test_a_refused_return_to_stance_times_out_and_the_way_to_rest_keeps_the_soles(
    passed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a crouch, and from halfway: the robot holds for as long as it may, says so, and goes to rest from there."""
    check, returned, return_to_stance = Gate.check, list[FloatArray](), Follower.return_to_stance

    def to_stance(self: Follower, dt: float) -> FloatArray | None:
        q = return_to_stance(self, dt)
        returned.extend([] if q is None else [q[self._robot.servo_columns]])
        return q

    def walled(self: Gate, target: FloatArray | None) -> CheckedGoal | None:
        is_return = target is not None and bool(returned) and np.array_equal(target, returned[-1])
        return None if is_return and len(returned) > passed else check(self, target)

    monkeypatch.setattr(Follower, "return_to_stance", to_stance)
    monkeypatch.setattr(Gate, "check", walled)
    monkeypatch.setitem(STATES, RunState.RETURN_TO_STANCE, replace(STATES[RunState.RETURN_TO_STANCE], limit_s=RETURN_S))
    notes: list[str] = []
    run, _ = stopped("op3", 900, start="stand", end=8.0, notify=notes.append)
    assert run.record is not None and run.record.robot is not None and run.robot is not None
    dt = 1.0 / run.robot.profile.safety.rate_hz
    assert len(returned) * dt == pytest.approx(RETURN_S, abs=3 * dt), "what is refused is no arrival"
    shows(notes)
    assert np.abs(run.record.robot.goals[-1] - angles(run.robot, "rest")).max() < 0.1
    way = run.record.robot.q[900 + len(returned) :]
    soles = motion_metrics.soles_of(run.robot, way)
    corners = [motion_metrics.sole_corners(sole) for sole in soles]
    assert max(float(motion_metrics.sole_tilt(sole).max()) for sole in soles) < np.deg2rad(0.2)
    assert max(float(np.ptp(one[..., 2], axis=0).max()) for one in corners) < 5e-3, "neither sole is lifted"
    com = run.robot.body.solver_body().centre_of_mass(np.ascontiguousarray(way))
    assert (motion_metrics.support_margin(com, np.concatenate(corners, axis=1)) > 0.0).all()


def test_a_stop_after_it_followed_ends_in_rest_within_four_seconds() -> None:
    run, _ = stopped("op3", 10**6, start="stand")
    assert run.record is not None and run.record.robot is not None and run.robot is not None
    goals, dt = run.record.robot.goals, 1.0 / run.robot.profile.safety.rate_hz
    assert (len(goals) - run.record.following.stop) * dt < 4.0
    assert np.abs(goals[-1] - angles(run.robot, "rest")).max() < 0.1


@pytest.mark.parametrize("name", ["op3", "poppy", "wolfgang"])
def test_a_robot_at_rest_stays_there_when_torque_goes_off(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """ToddlerBot does not: its ankles have no stop within reach, and next to no friction."""
    witnesses: list[Witness] = []
    see_it_out = Witness.see_it_out

    def kept(witness: Witness) -> None:
        witnesses.append(witness)
        see_it_out(witness)

    monkeypatch.setattr(Witness, "see_it_out", kept)
    asked = RunOptions(robot=name, bus="physics", playback=Playback(end=0.2))
    bench = PhysicsBench(asked, lambda text: None)
    with prepare(
        synthetic_performer, asked, clock=VirtualClock(), make_bus=bench.make_bus, goes_to_rest=True
    ) as prepared:
        run = prepared.run(Watch(stop_asked=bench.watching(lambda: False, prepared)))
    run = bench.seen(run)
    assert run.physics is not None and run.physics.fall is None and run.physics.toppled is None
    robot = load_robot(name)
    legs = [column for column, joint in zip(robot.servo_columns, robot.joint_map.joints, strict=True) if "nee" in joint]
    now = witnesses[-1].state.q[legs]
    assert np.abs(now - robot.posture(robot.profile.postures.rest)[legs]).max() < 0.2
