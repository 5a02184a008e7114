"""A warm servo in a whole run: half of the speed in time, by the goals that went onto the bus, and a message."""

import numpy as np
import pytest

from faulty_bus import FaultKind, FaultyBus, MockFault
from hardware.clock import Clock, VirtualClock
from messages import shows
from retarget.human.samples import Playback
from retarget.model.robot import RobotBody
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.types import FloatArray
from rig import Rig, short_clip
from sim.performer import synthetic_performer

FIRST = 450
"""Cycle of the bus in which the servo gets warm."""
TICK = 1.534e-3
"""[rad] of an XM430: goals are whole ones."""


def run(*faults: MockFault) -> tuple[RunResult, FloatArray, list[str]]:
    """Return the run, its goals (T, n) rad, and its messages."""
    messages: list[str] = []

    def make_bus(robot: RobotBody, clock: Clock) -> FaultyBus:
        stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
        return FaultyBus(robot.joint_map.servos, clock, start=robot.joint_map.to_ticks(stand), faults=faults)

    options = RunOptions(robot="op3", playback=Playback(speed=2.0, end=11.5))
    with prepare(
        synthetic_performer, options, clock=VirtualClock(), make_bus=make_bus, notify=messages.append
    ) as ready:
        result = ready.run()
    assert result.robot is not None and result.record.robot is not None
    return result, result.robot.joint_map.to_radians(result.record.robot.goal_ticks), messages


def test_its_begin_and_its_end_are_reported_once() -> None:
    result, goals, messages = run(MockFault(FaultKind.HOT, FIRST, 250, servo=3, value=61.0))
    assert result.robot is not None and result.state == "off"
    most, dt = result.robot.joint_map.max_velocity, 1.0 / result.robot.profile.safety.rate_hz
    steps = np.abs(np.diff(goals, axis=0))
    following = result.record.phase[1:] == Phase.FOLLOW
    slow = slice(FIRST + round(1.1 / dt), FIRST + 250)
    assert following[slow].all() and (steps[slow] <= 0.5 * most * dt + TICK).all()
    assert result.record.robot is not None and not result.record.robot.gated[following.argmax() + 1 :].any()
    assert len(messages) == 2
    shows(messages[0], 60, "l_sho_roll", 4, 61, "50%")
    assert messages[1].startswith("over: servo is hotter than 60 degrees Celsius: l_sho_roll (id 4)")


def approaching(slow: float) -> FloatArray:
    """Goals (T, n) rad of the way to where following begins, 0.8 rad from where the robot stands."""
    rig = Rig(np.zeros((60, 20)))
    inwards = (
        0.5 * (rig.robot.joint_map.lower + rig.robot.joint_map.upper) - rig.follower.stance.q[rig.robot.servo_columns]
    )
    rig.follower.script = np.tile(0.8 * np.sign(inwards), (60, 1))
    with pytest.MonkeyPatch.context() as patch:
        constant = property(lambda warnings: slow, lambda warnings, value: None)
        patch.setattr(type(rig.guard.health.warnings), "speed_override", constant, raising=False)
        record = rig.loop(short_clip(seconds=1.0)).run().record
    assert record.robot is not None
    return rig.robot.joint_map.to_radians(record.robot.goal_ticks[record.phase == Phase.APPROACH])


def test_the_way_to_where_following_begins_is_slowed_too_and_gone_to_its_end() -> None:
    usual, slow = approaching(1.0), approaching(0.5)
    assert 1.2 * len(usual) < len(slow) < 2 * len(usual), "rising to its speed takes as long"
    np.testing.assert_array_equal(slow[-1], usual[-1])
    fastest, half = (np.abs(np.diff(goals, axis=0)).max() for goals in (usual, slow))
    assert half <= 0.5 * fastest + 1.5 * TICK and fastest > 4.0 * TICK
