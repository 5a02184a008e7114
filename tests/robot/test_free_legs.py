"""A robot with free legs: it goes and turns where its performer does, on a floor, within its limits, on no servos."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from followers import dimensions
from hardware.clock import VirtualClock
from messages import refuses
from recordings import mock_bus, record
from retarget.errors import ConfigError, UsageError
from retarget.frames import JointTracks, SensorFrames
from retarget.ik.support_polygon import plant
from retarget.model.human_dimensions import POINTS
from retarget.model.robot import RobotBody, load_robot
from retarget.recording.read_run import read_run
from retarget.recording.replay import replay
from retarget.report.findings import findings
from retarget.report.measure import measure
from retarget.robot.free_legs import SPOT, FreeFoot, FreeLegs
from retarget.robot.landmarks import LandmarkMap, limb_scale
from retarget.rotations import from_axis_angle, multiply, rotate
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from retarget.sources.open import open_source
from retarget.types import Carrying, FloatArray
from sim.performer import synthetic_performer

SPEED, TURN = np.array([0.6, 0.3, 0.0]), 0.5
"""[m/s], [rad/s] at which the performer is carried along and turned."""


def carried(frames: SensorFrames) -> SensorFrames:
    """The same performer, who is carried along and turned meanwhile."""
    turned = from_axis_angle(np.array([0.0, 0.0, 1.0]), TURN * frames.time)[:, None]
    assert frames.joints is not None
    gone = frames.time[:, None, None] * SPEED
    return replace(
        frames,
        position=rotate(turned, frames.position) + gone,
        orientation=multiply(turned, frames.orientation),
        joints=JointTracks(frames.joints.names, rotate(turned, frames.joints.position) + gone),
    )


@dataclass(frozen=True)
class Walked:
    """A run, its robot, what was sent, and the heights (T,) m of the lowest corner of a sole in that."""

    run: RunResult
    robot: RobotBody
    q: FloatArray
    lowest: FloatArray

    def points(self, *names: str) -> FloatArray:
        """Where frames of the robot were while it followed, (T, k, 3) m."""
        return self.robot.points(self.q[self.run.record.following], names)


def followed(frames: SensorFrames) -> Walked:
    options = RunOptions(robot="op3", legs="free")
    with prepare(lambda: frames, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        run = prepared.run()
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    links, local = robot.sole_corners
    corners = robot.kinematics.points(np.ascontiguousarray(sent.q), links, local)
    return Walked(run, robot, sent.q, corners[..., 2].min(axis=1))


def test_it_goes_as_far_as_its_legs_are_long_on_the_floor_and_within_limits() -> None:
    walked = followed(carried(synthetic_performer().cut(0.0, 3.0)))
    run, record, report = walked.run, walked.run.record, measure(walked.run)
    hips = record.human_joints[record.following][:, [record.human_joint_names.index(f"{s}_hip") for s in "lr"]]
    rest = dict(zip(POINTS, run.human.dimensions.standing(), strict=True))
    scale = limb_scale(walked.robot.profile.landmarks["pelvis"], rest)
    performer = scale * (hips.mean(axis=1) - hips[0].mean(axis=0))[-1, :2]
    pelvis = walked.points("pelvis")[:, 0, :2]
    assert np.linalg.norm(performer) > 0.3
    np.testing.assert_allclose(np.linalg.norm(pelvis[-1] - pelvis[0]), np.linalg.norm(performer), atol=0.03)
    turned = report.turned_deg
    assert turned.robot is not None and turned.performer is not None  # both seen through a slow low pass
    assert turned.robot > 50.0 and turned.robot == pytest.approx(turned.performer, abs=6.0)
    assert walked.lowest.min() > -1e-6
    assert report.penetrating_frames == 0 and not any(vars(report.limit_violations).values())


def test_soles_of_a_performer_who_stays_do_not_slide_away() -> None:
    """Crouches that a robot in balance would not get down to: its feet stay within 15 mm."""
    walked = followed(synthetic_performer().cut(0.0, 4.0))
    soles = walked.points("l_sole", "r_sole")[..., :2]
    assert walked.lowest.min() > -1e-6 and np.linalg.norm(soles - soles[0], axis=-1).max() < 0.015


def test_soles_stay_under_a_performer_who_turns_to_and_fro(shared: Path) -> None:
    """The trunk of a boxer turns by 50 degrees, and their ankles move by 9 mm in the robot's size."""
    walked = followed(open_source(str(shared / "mocap/cmu_asfamc/02_05.amc"), rate=120.0).cut(0.0, 4.0))
    soles = walked.points("l_sole", "r_sole")[..., :2]
    assert np.linalg.norm(soles - np.median(soles, axis=0), axis=-1).max() < 0.012
    assert "soles" in [one.name for one in findings(walked.run, measure(walked.run))]


def test_a_foot_that_carries_stays_on_its_spot_until_the_performer_s_is_far() -> None:
    rest = dict(zip(POINTS, dimensions(synthetic_performer()).standing(), strict=True))
    feet = [FreeFoot(row, name, row, (0.0, 0.0, -0.03)) for row, name in enumerate(("l_sole", "r_sole"))]
    legs = FreeLegs(feet, 0.25, dimensions(synthetic_performer()), rest)
    leg = 0.25 * float(rest["l_hip"][2] - rest["l_ankle"][2])

    def step(x: float, carrying: Carrying) -> float:
        return legs.spots([(x, 0.1, 0.0), (0.0, -0.1, 0.0)], carrying, 0.01)[0][0]

    assert step(0.0, Carrying.BOTH) == 0.0
    assert step(0.9 * SPOT * leg, Carrying.BOTH) == 0.0
    assert step(0.5 * leg, Carrying.BOTH) == pytest.approx((0.5 - SPOT) * leg)  # drawn along by one that slides
    assert step(0.5 * leg, Carrying.RIGHT) > (0.5 - SPOT) * leg
    for _ in range(100):
        lifted = step(0.5 * leg, Carrying.RIGHT)
    assert lifted == pytest.approx(0.5 * leg, abs=1e-4)
    legs.restart()
    assert step(0.5 * leg, Carrying.BOTH) == 0.5 * leg


def test_a_walk_is_a_walk(shared: Path) -> None:
    """Feet pass each other, and the robot does not fall behind: a frozen or a planted robot fails."""
    walked = followed(open_source(str(shared / "mocap/cmu_asfamc/02_01.amc"), rate=120.0))
    soles, pelvis = walked.points("l_sole", "r_sole"), walked.points("pelvis")[:, 0, 0]
    ahead = soles[:, 0, 0] - soles[:, 1, 0]
    assert walked.lowest.min() > -1e-6
    assert ahead.max() > 0.05 and ahead.min() < -0.05 and np.count_nonzero(np.diff(np.sign(ahead))) >= 4
    likeness = measure(walked.run).likeness_deg
    assert likeness is not None and likeness["thighs"].mean < 14.0 and likeness["shanks"].mean < 16.0
    assert pelvis[-1] - pelvis[0] > 0.75


def test_a_recording_of_it_is_replayed_to_the_bit_and_exported_where_it_went(tmp_path: Path) -> None:
    recorded = record(tmp_path / "run.mcap", options=RunOptions(robot="op3", legs="free"), seconds=0.4)
    assert recorded.read().session.options.legs == "free"
    assert replay(recorded.read()).difference.none
    sent = recorded.result.record.robot
    assert sent is not None
    np.testing.assert_allclose(read_run(tmp_path / "run.mcap").q[:, :3], sent.q[:, :3], atol=1e-6)


REFUSED: list[tuple[dict[str, Any], str]] = [
    *(({"bus": bus}, f"--bus {bus}") for bus in ("emulator", "physics", "physics+wire", "profile", "/dev/ttyUSB0")),
    ({"parts": "upper"}, "--parts"),
    ({"steps": "walk"}, "--steps"),
    ({"robot": "human"}, "--legs"),
    ({"legs": "fre"}, "Did you mean free"),
    ({"legs": "planted"}, "free"),
]


def test_what_cannot_have_free_legs_is_refused() -> None:
    for given, fact in REFUSED:
        with refuses(UsageError, fact):
            RunOptions(**{"robot": "op3", "legs": "free"} | given)


def test_a_robot_that_floats_does_not_stand_and_needs_soles_that_follow() -> None:
    for bus in ("mock", "none"):
        assert RunOptions(robot="op3", bus=bus, legs="free").root == "floating"
    robot = load_robot("op3", root="floating")
    floats, marks = plant(robot, robot.profile.postures.stand), dict(robot.profile.landmarks)
    assert robot.on_floor and not robot.stands and not floats.soles
    assert load_robot("op3").stands and not load_robot("op3").floats
    del marks["l_sole"]
    size = dimensions(synthetic_performer().cut(0.0, 0.1))
    with refuses(ConfigError, "landmarks", "a sole for each ankle"):
        LandmarkMap(robot.profile.model_copy(update={"landmarks": marks}), size, floats, None, floats=True)
