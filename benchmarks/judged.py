"""`python -m benchmarks.judged FILE...`: `retarget judge` on two motions of one performer, side by side.

Ours is a run on the mock bus. The other is what many tools do, written here in its plainest form: each frame by itself
is the weighted least-squares fit to the same landmarks, within the ranges of the joints, and nothing else: no limits of
speed, no collisions, no balance. Both are judged at the same rate.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from benchmarks.table import add_docs, show_table
from hardware.clock import VirtualClock
from retarget.ik.support_polygon import plant
from retarget.model.robot import RobotBody, load_robot
from retarget.recording.exports.reader import read_motion
from retarget.recording.motion import Motion, resampled
from retarget.recording.npz import write_npz
from retarget.report.judge import Judgement, judge
from retarget.robot.arm_branches import position_limits
from retarget.rotations import conjugate, from_rotation_vector, log, multiply
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.sources.open import SAMPLE, open_source
from retarget.types import FloatArray
from sim.mock_bus import mock_bus

FPS = 30.0
FEET, FLAT_M, TO_STAND_M = 5.0, 0.5, 0.05
"""Weights beside 1 of the other landmarks: of soles; m for a rad of a sole; m for a rad of a joint from where the robot
stands. Tried by hand: with a weaker one of the last, joints flip from frame to frame."""


def ours(source: str, robot: str, folder: Path) -> Path:
    """The motion of a run, as it is saved."""
    path = folder / "ours.npz"
    frames = open_source(source)
    with prepare(lambda: frames, RunOptions(robot=robot), clock=VirtualClock(), make_bus=mock_bus) as prepared:
        write_npz(prepared.run(), path)
    return path


def keyframes(robot: RobotBody, run: Motion, folder: Path) -> Path:
    """The fit to the landmarks that the run was asked for, `FPS` times a second, as a GMR twin."""
    assert run.landmarks_asked is not None, "a run of a robot"
    asked = resampled(run, FPS)
    fitted = fit(robot, asked.landmarks_asked, run.landmark_names)
    path, joints = (
        folder / "keyframes.npz",
        robot.body.joint_qpos[[robot.body.joint_index(name) for name in run.joint_names]],
    )
    turn = fitted[:, [4, 5, 6, 3]]  # xyzw
    np.savez(path, fps=FPS, root_pos=fitted[:, :3], root_rot=turn, dof_pos=fitted[:, joints])
    return path


def fit(robot: RobotBody, asked: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """Postures (T, nq), each from the one before, for landmarks (T, k, 3) m."""
    stance, marks, step = plant(robot, robot.profile.postures.stand), robot.landmark_frames(names), 1e-6
    soles = tuple(foot.frame for foot in robot.profile.feet.values())
    weights = np.array([FEET if mark in soles else 1.0 for mark in marks])
    flat = robot.orientations(stance.q[None], soles)
    low, high = (limit[6:] for limit in position_limits(robot))

    def posture(x: FloatArray, base: FloatArray) -> FloatArray:
        """q (n, nq) of steps x (n, nv) of the root, and joints: the root from `base`."""
        q = np.empty((len(x), robot.body.nq))
        q[:, :3], q[:, 3:7] = base[:3] + x[:, :3], multiply(from_rotation_vector(x[:, 3:6]), base[3:7])
        q[:, 7:] = x[:, 6:]
        return q

    def residuals(x: FloatArray, base: FloatArray, goal: FloatArray) -> FloatArray:
        q = posture(x, base)
        off = (weights[:, None] * (robot.points(q, marks) - goal)).reshape(len(q), -1)
        tilted = log(multiply(robot.orientations(q, soles), conjugate(flat))).reshape(len(q), -1)
        return np.hstack([off, FLAT_M * tilted, TO_STAND_M * (x[:, 6:] - stance.q[7:])])

    found, base = [], stance.q
    for goal in asked:

        def slope(x: FloatArray, base: FloatArray = base, goal: FloatArray = goal) -> FloatArray:
            moved = residuals(np.vstack([x, x + step * np.eye(len(x))]), base, goal)
            return (moved[1:] - moved[0]).T / step

        start = np.concatenate([np.zeros(6), np.clip(base[7:], low + 1e-6, high - 1e-6)])
        bounds = (np.append(np.full(6, -np.inf), low), np.append(np.full(6, np.inf), high))
        solved = least_squares(
            lambda x, base=base, goal=goal: residuals(x[None], base, goal)[0],
            start,
            slope,
            bounds,
            xtol=1e-10,
            ftol=1e-10,
        )
        base = posture(solved.x[None], base)[0]
        found.append(base)
    return np.array(found)


FOLLOWS = {True: "yes", None: "in part", False: "no"}


def cells(found: Judgement) -> dict[str, str]:
    """The figures of a judgement, by what they are."""
    report, feet = found.report, found.feet
    assert report is not None and feet is not None, "a robot on feet beside a performer"
    limits, near = found.limits, found.clearance
    limbs = report.likeness_recorded_deg or report.likeness_deg or {}
    hands = report.reachable_hands_mm or {}
    return {
        "speeds beyond, % of ticks": f"{100 * limits['velocity'].share:.1f}",
        "accelerations beyond, %": f"{100 * limits['acceleration'].share:.1f}",
        "own links, mm apart, or inside": f"{near['self'].clearance_mm:.1f}",
        "more than 1 mm inside, %": f"{100 * near['self'].deep_share:.1f}",
        "soles slide, mm": f"{feet.slide_mm:.1f}",
        "soles sink, mm": f"{feet.sink_mm:.1f}",
        "would tip, %": f"{100 * (feet.zmp_outside_share or 0.0):.1f}",
        "jerk, rad/s³": f"{found.jerk_p95 or 0.0:.0f}",
        "shake, %": f"{100 * (found.shake_share or 0.0):.1f}",
        "frozen, %": f"{100 * (found.frozen_share or 0.0):.1f}",
        "upper arms, forearms, °": ", ".join(f"{limbs[limb].mean:.0f}" for limb in ("upper_arms", "forearms")),
        "thighs, shanks, °": ", ".join(f"{limbs[limb].mean:.0f}" for limb in ("thighs", "shanks")),
        "hands within reach, mm off": f"{hands['mean']:.0f}" if hands else "",
        "lag, ms": "" if report.lag_s is None else f"{1e3 * report.lag_s:.0f}",
        "follows": next(
            {True: "yes", None: "in part", False: "no"}[one.kept] for one in found.lines if one.name == "following"
        ),
        "lines lost": str(len(found.lost)),
    }


def main() -> None:
    """Both motions of every file."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.judged", description=__doc__)
    parser.add_argument("files", nargs="*", default=[SAMPLE])
    parser.add_argument("--robot", default="op3")
    add_docs(parser)
    asked = parser.parse_args()
    robot, columns = load_robot(asked.robot), {}
    for source in asked.files:
        with tempfile.TemporaryDirectory() as folder:
            path = ours(source, asked.robot, Path(folder))
            layout, run = read_motion(path, robot)
            fitted = read_motion(keyframes(robot, run, Path(folder)), robot)
            for who, (name, motion) in {"ours": (layout, resampled(run, FPS)), "fit": fitted}.items():
                found = judge(motion, robot, layout=name, source=open_source(source))
                print(f"{source}, {who}: {found.verdict}")
                columns[f"{Path(source).stem}, {who}"] = cells(found)
    names = list(next(iter(columns.values())))
    show_table(
        "judged", ["", *columns], [[name, *(of[name] for of in columns.values())] for name in names], docs=asked.docs
    )


if __name__ == "__main__":
    main()
