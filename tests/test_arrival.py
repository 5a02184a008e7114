"""Before the clip begins the robot goes to where the performer is, on its soles, and can be stopped on the way."""

from itertools import count
from pathlib import Path

import numpy as np
import pytest

from followers import DT, follower, postures
from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from retarget.arrival import ARRIVAL_S, RESTING_SPEED
from retarget.clip import Playback
from retarget.metrics import standing
from retarget.metrics.motion import LimitViolations, limit_violations
from retarget.options import RunOptions
from retarget.pipeline import Watch
from retarget.prepare import prepare
from retarget.record import Phase
from retarget.robot_body import RobotBody
from retarget.run_result import RunResult
from retarget.sources.open import open_source
from sim.mock_bus import MockBus
from sim.performer import synthetic_performer


def run_from(source: Path, start: float, watch: Watch | None = None) -> RunResult:
    """The OP3 from standing, following 0.2 s of a recording."""

    def make_bus(robot: RobotBody, clock: Clock) -> ServoBus:
        stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
        return MockBus(robot.joint_map.servos, clock, start=robot.joint_map.to_ticks(stand))

    options = RunOptions(robot="op3", playback=Playback(start=start, end=start + 0.2))
    with prepare(lambda: open_source(source), options, clock=VirtualClock(), make_bus=make_bus) as ready:
        return ready.run(watch or Watch())


def assert_well(run: RunResult) -> None:
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    assert not sent.gated.any()
    positions = np.vstack([sent.start, sent.q[:, robot.servo_columns]])
    assert limit_violations(np.vstack([positions, positions[-1:]]), robot.limits, run.clip.dt) == LimitViolations(
        0, 0, 0
    )
    for sole in standing.soles_of(robot, sent.q):
        corners = standing.sole_corners(sole)
        assert np.linalg.norm(corners - corners[0], axis=-1).max() < 0.003


@pytest.mark.parametrize(("trial", "start"), [("02_06", 2.0), ("02_06", 5.0), ("49_18", 0.0)])
def test_a_raised_hand_is_raised_when_following_begins(trial: str, start: float, shared: Path) -> None:
    """A hand that is chased from below while the clip runs stays 0.3 m behind for seconds."""
    run = run_from(shared / "mocap" / "cmu_asfamc" / f"{trial}.amc", start)
    sent = run.record.robot
    assert sent is not None and run.landmarks_reached is not None
    first = run.record.following.start
    off = np.linalg.norm(run.landmarks_reached[first] - sent.landmarks_asked[first], axis=-1)
    hands = [sent.landmark_names.index(name) for name in ("l_hand", "r_hand")]
    assert first > 50 and off[hands].max() < 0.06
    assert_well(run)


@pytest.mark.parametrize("tick", [20, 60, 110, 160])
def test_a_stop_on_the_way(tick: int, shared: Path) -> None:
    asked = count()
    watch = Watch(stop_asked=lambda: next(asked) >= tick)
    run = run_from(shared / "mocap" / "cmu_asfamc" / "02_06.amc", 2.0, watch)
    assert run.state == "stopped"
    phases = run.record.phase
    assert phases[0] == Phase.APPROACH and phases[-1] == Phase.BRAKE and not (phases == Phase.FOLLOW).any()
    assert_well(run)


def test_it_rests_where_it_arrives_and_takes_no_longer_than_it_may() -> None:
    human = postures(synthetic_performer())[250]
    robot = follower()
    robot.start(human)
    way = robot.arrive(human, DT)
    q = np.array([posture.q for posture in way])
    assert 10 < len(way) <= ARRIVAL_S / DT
    assert np.abs(np.diff(q[-5:], axis=0)).max() < RESTING_SPEED * DT
