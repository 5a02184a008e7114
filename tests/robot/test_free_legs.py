"""A robot with free legs: it goes and turns where its performer does, on a floor, within its limits, on no servos."""

from dataclasses import replace
from pathlib import Path

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

UP = np.array([0.0, 0.0, 1.0])
SPEED = np.array([0.6, 0.3, 0.0])
"""[m/s] At which the performer is carried along."""
TURN = 0.5
"""[rad/s] At which they are turned."""


def carried(frames: SensorFrames, speed: FloatArray, turn: float) -> SensorFrames:
    """The same performer, who is carried along and turned meanwhile."""
    turned, gone = from_axis_angle(UP, turn * frames.time)[:, None], (frames.time[:, None] * speed)[:, None]
    assert frames.joints is not None
    return replace(
        frames,
        position=rotate(turned, frames.position) + gone,
        orientation=multiply(turned, frames.orientation),
        joints=JointTracks(frames.joints.names, rotate(turned, frames.joints.position) + gone),
    )


def followed(frames: SensorFrames) -> RunResult:
    options = RunOptions(robot="op3", legs="free")
    with prepare(lambda: frames, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        return prepared.run()


def lowest(run: RunResult) -> FloatArray:
    """Heights (T,) m of the lowest corner of a sole in what was sent."""
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    links, local = robot.sole_corners
    return np.asarray(robot.kinematics.points(np.ascontiguousarray(sent.q), links, local)[..., 2].min(axis=1))


def leg_scale(robot: RobotBody, run: RunResult) -> float:
    rest = dict(zip(POINTS, run.human.dimensions.standing(), strict=True))
    return limb_scale(robot.profile.landmarks["pelvis"], rest)


@pytest.fixture(scope="module")
def run() -> RunResult:
    return followed(carried(synthetic_performer().cut(0.0, 3.0), SPEED, TURN))


def test_it_goes_as_far_as_its_legs_are_long(run: RunResult) -> None:
    robot, sent, following = run.robot, run.record.robot, run.record.following
    assert robot is not None and sent is not None
    hips = run.record.human_joints[following][:, [run.record.human_joint_names.index(f"{s}_hip") for s in "lr"]]
    performer = leg_scale(robot, run) * (hips.mean(axis=1) - hips[0].mean(axis=0))[:, :2]
    pelvis = robot.points(sent.q[following], ("pelvis",))[:, 0, :2]
    gone = pelvis - pelvis[0]
    assert np.linalg.norm(performer[-1]) > 0.3
    np.testing.assert_allclose(np.linalg.norm(gone[-1]), np.linalg.norm(performer[-1]), atol=0.03)
    turned = measure(run).turned_deg
    assert turned.robot is not None and turned.performer is not None  # both seen through a slow low pass
    assert turned.robot > 50.0 and turned.robot == pytest.approx(turned.performer, abs=6.0)


def test_no_sole_is_below_the_floor_and_limits_are_kept(run: RunResult) -> None:
    assert lowest(run).min() > -1e-6
    report = measure(run)
    assert report.penetrating_frames == 0 and not any(vars(report.limit_violations).values())


def test_soles_of_a_performer_who_stays_do_not_slide_away() -> None:
    """Crouches that a robot in balance would not get down to: its feet stay within 15 mm."""
    run = followed(synthetic_performer().cut(0.0, 4.0))
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None and lowest(run).min() > -1e-6
    soles = robot.points(sent.q[run.record.following], ("l_sole", "r_sole"))[..., :2]
    assert np.linalg.norm(soles - soles[0], axis=-1).max() < 0.015


def test_soles_stay_under_a_performer_who_turns_to_and_fro(shared: Path) -> None:
    """The trunk of a boxer turns by 50 degrees, and their ankles move by 9 mm in the robot's size."""
    run = followed(open_source(str(shared / "mocap/cmu_asfamc/02_05.amc"), rate=120.0).cut(0.0, 4.0))
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    soles = robot.points(sent.q[run.record.following], ("l_sole", "r_sole"))[..., :2]
    assert np.linalg.norm(soles - np.median(soles, axis=0), axis=-1).max() < 0.012
    assert "soles" in [one.name for one in findings(run, measure(run))]


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
    run = followed(open_source(str(shared / "mocap/cmu_asfamc/02_01.amc"), rate=120.0))
    robot, sent, following = run.robot, run.record.robot, run.record.following
    assert robot is not None and sent is not None and lowest(run).min() > -1e-6
    soles = robot.points(sent.q[following], ("l_sole", "r_sole"))
    ahead = soles[:, 0, 0] - soles[:, 1, 0]
    assert ahead.max() > 0.05 and ahead.min() < -0.05 and np.count_nonzero(np.diff(np.sign(ahead))) >= 4
    likeness = measure(run).likeness_deg
    assert likeness is not None and likeness["thighs"].mean < 14.0 and likeness["shanks"].mean < 16.0
    pelvis = robot.points(sent.q[following], ("pelvis",))[:, 0]
    assert pelvis[-1, 0] - pelvis[0, 0] > 0.75


def test_a_recording_of_it_is_replayed_to_the_bit_and_exported_where_it_went(tmp_path: Path) -> None:
    recorded = record(tmp_path / "run.mcap", options=RunOptions(robot="op3", legs="free"), seconds=0.4)
    assert recorded.read().session.options.legs == "free"
    assert replay(recorded.read()).difference.none
    sent = recorded.result.record.robot
    assert sent is not None
    np.testing.assert_allclose(read_run(tmp_path / "run.mcap").q[:, :3], sent.q[:, :3], atol=1e-6)


REFUSED = {
    "emulated servos": ({"bus": "emulator"}, "--bus emulator"),
    "mass": ({"bus": "physics"}, "--bus physics"),
    "mass and a wire": ({"bus": "physics+wire"}, "--bus physics+wire"),
    "the profile's servos": ({"bus": "profile"}, "--bus profile"),
    "a port": ({"bus": "/dev/ttyUSB0"}, "--bus /dev/ttyUSB0"),
    "still legs": ({"parts": "upper"}, "--parts"),
    "steps": ({"steps": "walk"}, "--steps"),
    "a human": ({"robot": "human"}, "--legs"),
    "other legs": ({"legs": "fre"}, "Did you mean free"),
    "legs of the profile": ({"legs": "planted"}, "free"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_have_free_legs_is_refused(case: str) -> None:
    given, fact = REFUSED[case]
    with refuses(UsageError, fact):
        RunOptions(**{"robot": "op3", "legs": "free"} | given)  # type: ignore[arg-type]


@pytest.mark.parametrize("bus", ["mock", "none"])
def test_buses_without_servos_have_it(bus: str) -> None:
    assert RunOptions(robot="op3", bus=bus, legs="free").root == "floating"


def test_a_robot_that_floats_does_not_stand() -> None:
    robot = load_robot("op3", root="floating")
    assert robot.on_floor and not robot.stands and not plant(robot, robot.profile.postures.stand).soles
    assert load_robot("op3").stands and not load_robot("op3").floats


def test_a_profile_without_soles_that_follow_is_refused() -> None:
    robot = load_robot("op3", root="floating")
    stance, marks = plant(robot, robot.profile.postures.stand), dict(robot.profile.landmarks)
    del marks["l_sole"]
    size = dimensions(synthetic_performer().cut(0.0, 0.1))
    with refuses(ConfigError, "landmarks", "a sole for each ankle"):
        LandmarkMap(robot.profile.model_copy(update={"landmarks": marks}), size, stance, None, floats=True)
