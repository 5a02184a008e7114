"""The referee: our own run has the figures of our report in every layout, and each planted fault loses its own line."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hardware.clock import VirtualClock
from messages import shows
from recordings import mock_bus
from retarget.frames import SensorFrames
from retarget.model.robot import RobotBody, load_robot
from retarget.recording.exports.formats import FORMATS, export_motion
from retarget.recording.exports.reader import read_motion
from retarget.recording.motion import Motion, followed, resampled
from retarget.recording.npz import write_npz
from retarget.recording.read_run import motion_of
from retarget.report.judge import Judgement, judge
from retarget.report.measure import measure
from retarget.report.motion_metrics import beyond_limits, shake_share, zero_moment_points
from retarget.report.report import Report
from retarget.rotations import from_axis_angle, multiply, rotate
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.sources.open import SAMPLE, open_source

SECONDS = 6.0
LAYOUTS = ("csv", "npz", "beyondmimic", "holosoma", "unitree", "gmr-npz", "bones")
ALONE = {
    *("joint positions", "joint speeds", "joint accelerations", "its own links", "the floor"),
    *("soles slide", "soles float", "soles sink", "balance", "jerk", "shake", "frozen"),
}
"""The lines of a robot that stands, without a performer."""


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return load_robot("op3")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Report]:
    """A saved run, and its report while it followed."""
    with prepare(performer, RunOptions(robot="op3"), clock=VirtualClock(), make_bus=mock_bus) as prepared:
        result = prepared.run()
    path = tmp_path_factory.mktemp("judged") / "run.npz"
    write_npz(result, path)
    kept = result.record[result.record.following]
    return path, measure(replace(result, record=replace(kept, start=kept.goals[0], from_start=False)))


@pytest.fixture(scope="module")
def motion(run: tuple[Path, Report], robot: RobotBody) -> Motion:
    return read_motion(run[0], robot)[1]


@cache
def performer() -> SensorFrames:
    return open_source(SAMPLE).cut(0.0, SECONDS)


def lost(found: Judgement) -> set[str]:
    assert found.lost or found.verdict.startswith("The motion keeps all")
    return {line.name for line in found.lost}


def beside(motion: Motion, robot: RobotBody) -> Judgement:
    return judge(motion, robot, layout="run", source=performer())


def agrees(found: Judgement, report: Report, *, degrees: float, mm: float) -> None:
    """The figures of a judgement are those of the report of the run."""
    seen = found.report
    assert seen is not None and report.likeness_deg and seen.likeness_deg and seen.trunk_lean_deg
    for limb, spread in report.likeness_deg.items():
        assert seen.likeness_deg[limb].mean == pytest.approx(spread.mean, abs=degrees), limb
    assert report.trunk_lean_deg and seen.trunk_lean_deg.mean == pytest.approx(report.trunk_lean_deg.mean, abs=degrees)
    for landmark, spread in report.tracking_mm.items():
        assert seen.tracking_mm[landmark].mean == pytest.approx(spread.mean, abs=mm), landmark
    assert report.reachable_hands_mm and seen.reachable_hands_mm
    assert seen.reachable_hands_mm["mean"] == pytest.approx(report.reachable_hands_mm["mean"], abs=3.0 * mm)
    assert seen.lag_s == pytest.approx(report.lag_s, abs=0.01)
    assert found.clearance["self"].clearance_mm == pytest.approx(report.min_clearance_mm.self, abs=mm)
    assert found.clearance["ground"].clearance_mm == pytest.approx(report.min_clearance_mm.ground, abs=mm)
    assert found.feet is not None and found.feet.slide_mm == pytest.approx(report.foot_slide_mm, abs=0.1)
    assert not lost(found)


def test_a_run_has_the_figures_of_its_report(run: tuple[Path, Report], motion: Motion, robot: RobotBody) -> None:
    found = beside(motion, robot)
    agrees(found, run[1], degrees=0.01, mm=0.05)
    assert found.jerk_p95 == pytest.approx(run[1].jerk_p95)
    assert {line.name for line in found.lines} >= ALONE | {"following", "likeness", "tracking", "lag"}
    shows(found.verdict)


@pytest.mark.long
@pytest.mark.parametrize("name", LAYOUTS)
def test_its_exports_have_them_too(
    name: str, run: tuple[Path, Report], motion: Motion, robot: RobotBody, tmp_path: Path
) -> None:
    form = FORMATS[name]
    fps = form.conventions.fps
    path = tmp_path / f"run{form.ending}"
    export_motion(motion if fps is None else resampled(motion, fps), form, path)
    layout, read = read_motion(path, robot, fps=fps if name in ("unitree", "bones") else None)
    assert layout == ("npz" if name == "beyondmimic" else name)
    agrees(beside(read, robot), run[1], degrees=1.0, mm=1.5)


def test_the_place_and_heading_of_the_whole_do_not_matter(motion: Motion, robot: RobotBody) -> None:
    turn, moved = from_axis_angle(np.array([0.0, 0.0, 1.0]), 2.0), motion.q.copy()
    moved[:, :3] = rotate(turn, motion.q[:, :3]) + np.array([3.0, -1.0, 0.0])
    moved[:, 3:7] = multiply(turn, motion.q[:, 3:7])
    first, second = beside(motion, robot).report, beside(replace(motion, q=moved), robot).report
    assert first is not None and second is not None
    assert first.likeness_deg and second.likeness_deg
    for one, other in ((first.tracking_mm, second.tracking_mm), (first.likeness_deg, second.likeness_deg)):
        assert {name: spread.mean for name, spread in one.items()} == pytest.approx(
            {name: spread.mean for name, spread in other.items()}, abs=1e-6
        )


def test_feet_of_a_walk_are_compared_as_its_performer_s_carry(robot: RobotBody, shared: Path) -> None:
    """A sole stays on its spot for as long as the foot carries, and is then where the performer's is."""
    walk = open_source(str(shared / "mocap/cmu_asfamc/02_01.amc"), rate=60.0)  # half as fast: legs keep up
    options = RunOptions(robot="op3", legs="free")
    with prepare(lambda: walk, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        motion = followed(motion_of(prepared.run(), "walk"), found="nothing")
    report = judge(motion, robot, layout="run", source=walk).report
    assert report is not None
    assert max(report.tracking_mm[f"{side}_sole"].mean for side in "lr") < 12.0


def with_fault(fault: str, motion: Motion) -> Motion:
    q, half = motion.q.copy(), len(motion) // 2
    columns = dict(zip(motion.joint_names, range(7, q.shape[1]), strict=True))
    match fault:
        case "jumps":
            q[half:, columns["head_pan"]] += 0.8
        case "penetrates":
            q[:, columns["l_hip_roll"]] = 0.6
            q[:, 2] += 0.1
        case "slides":
            q[:, 0] += np.linspace(0.0, 0.04, len(q))
        case "floats":
            q[:, 2] += 0.03
        case "sinks":
            q[:, 2] -= 0.012
        case "shakes":
            shaken = ("head_pan", "head_tilt", "l_el", "r_el", "l_sho_roll", "r_sho_roll")
            q[:, [columns[name] for name in shaken]] += 0.03 * np.sin(20.0 * np.pi * motion.time)[:, None]
        case "bends":
            q[:, columns["head_tilt"]] = 3.0
        case "stands":
            q[:] = q[0]
    return replace(motion, q=q)


# Faults, each planted in the motion of a run that keeps every line.


FAULTS: dict[str, tuple[set[str], set[str]]] = {
    "jumps": ({"joint speeds"}, {"joint accelerations", "shake"}),
    "penetrates": ({"its own links"}, {"soles float"}),
    "slides": ({"soles slide"}, set()),
    "floats": ({"soles float"}, set()),
    "sinks": ({"soles sink"}, set()),
    "shakes": ({"shake"}, {"joint accelerations", "joint speeds"}),
    "bends": ({"joint positions"}, {"its own links"}),
    "stands": ({"frozen"}, set()),
}
"""The line that such a motion loses, and others that it may lose."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_loses_its_line(fault: str, motion: Motion, robot: RobotBody) -> None:
    named, too = FAULTS[fault]
    assert lost(judge(motion, robot, layout="run")) == set()
    found = judge(with_fault(fault, motion), robot, layout="run")
    assert named <= lost(found) <= named | too
    shows(found.verdict)


@pytest.mark.parametrize("tremble", [0.0, 0.01])
def test_a_robot_that_is_frozen_loses_beside_its_performer(tremble: float, motion: Motion, robot: RobotBody) -> None:
    """Also one that trembles, as that is not following."""
    q = np.tile(motion.q[0], (len(motion), 1))
    q[:, 7:] += tremble * np.random.default_rng(0).standard_normal(q[:, 7:].shape)
    found = beside(replace(motion, q=q), robot)
    assert {"frozen", "following"} <= lost(found)
    assert found.frozen_share is not None and found.frozen_share > 0.95 and ("shake" in lost(found)) == bool(tremble)


def test_between_two_rows_nothing_goes_through_a_wall(motion: Motion, robot: RobotBody, tmp_path: Path) -> None:
    wall = tmp_path / "scene.yaml"
    wall.write_text(
        "name: wall\ndescription: For a test\nobstacles:\n"
        "  wall: {shape: {box: {pos: [1.0, 0.0, 0.3], size: [0.01, 1.0, 0.3]}}, influence: 0.05}\n"
    )
    slow = resampled(motion, 10.0)
    q = np.tile(slow.q[0], (len(slow), 1))
    clear = judge(replace(slow, q=q), robot, layout="run", scene=str(wall)).clearance["scene"]
    q[len(q) // 2 :, 0] += 2.0
    swept = judge(replace(slow, q=q), robot, layout="run", scene=str(wall)).clearance["scene"]
    assert clear.clearance_mm is not None and clear.clearance_mm > 500.0 and clear.deep_share == 0.0
    assert swept.clearance_mm is not None and swept.clearance_mm < -5.0 and 0.0 < swept.deep_share < 0.1


# The measures that a run has not.


def test_the_zero_moment_point_of_a_body_that_sways() -> None:
    """p = c - z c'' / g of a sine is that sine, larger."""
    dt, high, fast = 0.005, 0.5, 4.0
    time = dt * np.arange(1000)
    com = np.column_stack([0.02 * np.sin(fast * time), np.zeros(1000), np.full(1000, high)])
    found = zero_moment_points(com, dt)
    known = np.flatnonzero(np.isfinite(found).all(axis=1))
    assert known.size > 970 and known[0] > 0 and known[-1] < 999
    np.testing.assert_allclose(found[known, 0], com[known, 0] * (1.0 + high * fast**2 / 9.81), atol=5e-4)
    falls = np.column_stack([com[:, :2], high - 0.5 * 9.9 * time**2])
    assert np.isnan(zero_moment_points(falls, dt)).all()


def test_a_share_of_speed_above_the_band_of_people() -> None:
    time = np.arange(2000) / 200.0
    slow, fast = np.sin(2.0 * np.pi * time), 0.1 * np.sin(2.0 * np.pi * 10.0 * time)
    assert shake_share(slow[:, None], 0.005) == pytest.approx(0.0, abs=1e-3)
    # Equal speeds: half of the power.
    assert shake_share((slow + fast)[:, None], 0.005) == pytest.approx(0.5, abs=0.01)
    assert shake_share(slow[::20, None], 0.1) is None and shake_share(np.zeros((500, 1)), 0.02) is None


def test_the_joint_that_is_beyond_most_often_is_named(robot: RobotBody) -> None:
    limits, dt = robot.limits, 0.02
    q = np.zeros((11, len(limits.lower)))
    q[5:, 2] = 1.5 * limits.max_velocity[2] * dt
    found = beyond_limits(robot.joint_map.joints, q, limits, dt, tolerance=1e-6)
    assert found["position"].share == 0.0 and found["position"].joint is None
    assert found["velocity"].share == found["velocity"].joint_share == 0.1
    assert found["velocity"].joint == robot.joint_map.joints[2]
