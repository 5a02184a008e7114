"""The tick loop: rows, timing, gating, stops. Stages are stand-ins; bus, guard and gate are real."""

import numpy as np
import pytest

from hardware.errors import BusError, RetargetError
from retarget.follow import RobotPosture
from retarget.human_posture import HumanPosture
from retarget.pipeline import INTERRUPTED, Ending, Pipeline, Watch
from retarget.rotations import FloatArray
from rig import Rig, StubReconstructor, person, short_clip
from sim.mock_faults import FaultKind, MockFault

TICKS = 51


def still() -> FloatArray:
    return np.zeros((TICKS, 20))


def swing(size: float) -> FloatArray:
    """Joint 0 goes there and back smoothly."""
    script = still()
    script[:, 0] = size * 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(TICKS) / (TICKS - 1)))
    return script


def play(rig: Rig, watch: Watch | None = None) -> Ending:
    clip = short_clip(seconds=0.4)
    assert len(clip) == TICKS
    return Pipeline(clip=clip, reconstructor=StubReconstructor(person()), robot=rig.side).run(watch)


def test_every_tick_has_a_row() -> None:
    rig = Rig(swing(0.1))
    ending = play(rig)
    robot = ending.record.robot
    assert robot is not None
    assert (ending.state, ending.reason) == ("idle", None)
    assert len(ending.record) == len(robot.q) == len(ending.record.human.q) == TICKS
    assert np.isfinite(robot.q).all() and np.isfinite(ending.record.human.joints).all()
    assert np.isfinite(robot.landmarks_asked).all() and np.isfinite(robot.present).all()
    assert ending.record.time == pytest.approx(np.arange(TICKS) / 125.0)
    assert not robot.gated.any() and robot.goal_ticks.min() >= 0
    assert not rig.bus.torque_on


def test_what_is_kept_is_what_was_sent() -> None:
    rig = Rig(swing(0.1))
    robot = play(rig).record.robot
    assert robot is not None
    sent = robot.q[:, rig.robot.servo_columns]
    np.testing.assert_array_equal(rig.robot.joint_map.to_ticks(sent), robot.goal_ticks)
    stand = rig.follower.stance.q[rig.robot.servo_columns]
    np.testing.assert_allclose(sent - stand, swing(0.1), atol=1e-12)
    # The servos follow, late: what they say at the start of a tick is not yet the goal of that tick.
    assert 0.03 < np.abs(robot.present[:, 0] - stand[0]).max() <= 0.1


def test_times_are_counted() -> None:
    timing = play(Rig(still())).record.timing
    assert (timing.cycle > 0.0).all() and (timing.retarget > 0.0).all() and (timing.reconstruct > 0.0).all()
    assert (timing.cycle >= 0.0).all()


def test_a_jump_is_gated_and_the_follower_is_told() -> None:
    script = still()
    script[10:, 3] = 1.0
    rig = Rig(script)
    robot = play(rig).record.robot
    assert robot is not None
    assert robot.gated[10:].all() and not robot.gated[:10].any()
    assert len(rig.follower.reseeded) == np.count_nonzero(robot.gated)
    np.testing.assert_array_equal(rig.follower.reseeded[0], robot.q[10, rig.robot.servo_columns])
    assert np.abs(np.diff(robot.q[:, rig.robot.servo_columns], axis=0)).max() < 0.01


def test_a_goal_that_is_not_finite_stops_nothing_and_is_not_sent() -> None:
    script = still()
    script[20] = np.nan
    robot = play(Rig(script)).record.robot
    assert robot is not None
    assert robot.gated.tolist() == [tick == 20 for tick in range(TICKS)]
    assert np.isfinite(robot.q).all()


def test_a_servo_alert_stops_with_a_reason_and_keeps_the_braking() -> None:
    fault = MockFault(FaultKind.ALERT, first=30, cycles=1, servo=4, alert=0x04)
    rig = Rig(swing(0.3), faults=(fault,))
    ending = play(rig)
    robot = ending.record.robot
    assert robot is not None
    assert ending.state == "stopped"
    assert ending.reason is not None and "OVERHEATING" in ending.reason
    assert 10 < len(ending.record) < TICKS
    assert robot.gated[-1] and robot.faults[-1] == 1
    assert np.isfinite(robot.q).all()
    assert not rig.bus.torque_on


def test_a_lost_bus_stops() -> None:
    rig = Rig(still(), faults=(MockFault(FaultKind.READ_FAILS, first=20, cycles=1000),))
    ending = play(rig)
    assert ending.state == "stopped" and ending.reason is not None and "no answer" in ending.reason
    assert len(ending.record) < TICKS


def test_an_exception_in_a_stage_stops_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(swing(0.3))

    def fail(human: HumanPosture, dt: float) -> RobotPosture:
        if rig.follower.tick == 12:
            raise ArithmeticError("the stage broke")
        return follow(human, dt)

    follow = rig.follower.step
    monkeypatch.setattr(rig.follower, "step", fail)
    ending = play(rig)
    assert ending.state == "stopped" and ending.reason == "the stage broke"


def test_asking_to_stop_brakes() -> None:
    asked = iter([False] * 15 + [True] * 1000)
    rig = Rig(swing(0.3))
    ending = play(rig, Watch(stop_asked=lambda: next(asked)))
    robot = ending.record.robot
    assert robot is not None
    assert ending.state == "stopped" and ending.reason == INTERRUPTED
    steps = np.abs(np.diff(robot.q[:, rig.robot.servo_columns], axis=0)).max(axis=1)
    assert steps[13] > 1e-4 and steps[-1] == pytest.approx(0.0, abs=1e-3)


def test_nothing_starts_on_a_robot_that_is_not_well() -> None:
    rig = Rig(still(), faults=(MockFault(FaultKind.MISSING, first=0, cycles=10, servo=2),))
    with pytest.raises(RetargetError, match="r_sho_roll"):
        play(rig)
    assert not rig.bus.torque_on


def test_the_robot_walks_slowly_to_where_following_begins() -> None:
    script = still() + 0.4
    rig = Rig(script)
    robot = play(rig).record.robot
    assert robot is not None
    np.testing.assert_allclose(robot.start, rig.follower.stance.q[rig.robot.servo_columns] + 0.4, atol=1e-9)
    assert not robot.gated.any()
    fastest = 0.2 * 4.5
    assert rig.clock.now() - TICKS * rig.dt > 1.8 * 0.4 / fastest


def test_the_human_alone_needs_no_robot() -> None:
    clip = short_clip(seconds=0.3, rate_hz=None)
    reconstructor = StubReconstructor(person())
    done: list[int] = []
    ending = Pipeline(clip=clip, reconstructor=reconstructor).run(Watch(done.append, every=10))
    assert ending.record.robot is None and ending.state is None and ending.reason is None
    assert len(ending.record) == clip.source_frames == 37
    assert done[0] == 1 and done[-1] == 37
    assert set(reconstructor.calls) == {1.0 / 120.0}


def test_slow_motion_keeps_the_performers_clock() -> None:
    clip = short_clip(seconds=0.2, speed=0.5)
    assert len(clip) == TICKS
    reconstructor = StubReconstructor(person())
    Pipeline(clip=clip, reconstructor=reconstructor).run()
    assert reconstructor.calls == pytest.approx([0.5 / 125.0] * (TICKS - 1))


def test_a_failure_outside_a_tick_stops_the_robot_too() -> None:
    rig = Rig(swing(0.1))

    def broken(_tick: int) -> None:
        raise OSError("no terminal")

    with pytest.raises(OSError, match="no terminal"):
        play(rig, Watch(broken))
    assert rig.guard.stop_reason is not None and "no terminal" in rig.guard.stop_reason.reason
    assert rig.gate.at_rest and not rig.bus.torque_on


def test_torque_that_cannot_be_switched_off_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(still())
    torque = rig.bus.torque

    def stuck(on: bool) -> None:
        if not on:
            raise BusError("no answer")
        torque(on)

    monkeypatch.setattr(rig.bus, "torque", stuck)
    ending = play(rig)
    assert ending.state == "stopped"
    assert ending.reason is not None and "cut the power" in ending.reason
