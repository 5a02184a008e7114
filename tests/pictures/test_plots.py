"""Pictures are made, are PNG files of a sensible size, and are left out where there is nothing to show."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.clock import VirtualClock
from retarget.pictures.plots import PICTURES, figures_of, plot_poses, plot_tracking, write_plots
from retarget.report.tracking import performer_facing, turned
from retarget.rotations import multiply
from retarget.run.loop import Operator, run_human
from retarget.run.run_result import RunResult
from rig import Rig, StubReconstructor, person, result, short_clip


@pytest.fixture(scope="module")
def run() -> RunResult:
    rig, human, clip = Rig(np.zeros((51, 20))), person(), short_clip()
    ending = rig.loop(clip).run()
    return result(ending, clip, human, rig.robot)


@pytest.fixture(scope="module")
def human_run() -> RunResult:
    human, clip = person(), short_clip(rate_hz=None)
    ending = run_human(clip, StubReconstructor(human), Operator(), VirtualClock())
    return result(ending, clip, human, None)


@pytest.mark.long
def test_all_pictures_of_a_robot(run: RunResult, tmp_path: Path) -> None:
    written = write_plots(figures_of(run), tmp_path / "new" / "folder")
    assert [path.stem for path in written] == [name for name in PICTURES if name != "pressure"]  # it has no mass
    for path in written:
        content = path.read_bytes()
        assert content.startswith(b"\x89PNG") and 10_000 < len(content) < 1_000_000


def test_poses_show_the_moment_that_is_least_alike(run: RunResult) -> None:
    """The one at which the robot's elbow is bent and the performer's is not, however short."""
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    tick = run.record.following.start + run.ticks_followed // 3
    q = sent.q.copy()
    q[tick, robot.body.joint_qpos[robot.body.joint_index("l_el")]] += 1.5
    figure = plot_poses(replace(run, record=replace(sent, q=q)))
    assert figure is not None
    labels = [text.get_text() for text in figure.axes[0].texts]
    assert [label for label in labels if "alike" in label] == [f"{run.record.time[tick]:.1f} s\nleast alike"]


def test_poses_show_every_part_of_a_motion_that_repeats_itself(run: RunResult) -> None:
    """Eight waves, of which nine equal steps would show one phase."""
    record, following = run.record, run.record.following
    phase = 8.0 * (np.arange(len(record)) - following.start) / (run.ticks_followed - 1)
    joints = record.human_joints.copy()
    joints[:, record.human_joint_names.index("r_wrist"), 2] += 0.5 * np.sin(2.0 * np.pi * phase)
    waves = replace(record, human_joints=joints, time=1e3 * record.time)
    figure = plot_poses(replace(run, record=waves))
    assert figure is not None
    times = [float(text.get_text().split()[0]) for text in figure.axes[0].texts]
    shown = np.searchsorted(waves.time, np.array(times) - 1.0)
    assert len(shown) == 9 and (np.diff(shown) > 2).all() and shown[0] <= following.start + 2
    heights = joints[shown, record.human_joint_names.index("r_wrist"), 2]
    assert np.ptp(heights) > 0.9


def test_poses_are_spread_and_one_that_is_marked_is_among_them(run: RunResult) -> None:
    """The performer jumps about in a fifth of the time, in which all that is least alike would be."""
    record, following = run.record, run.record.following
    joints = record.human_joints.copy()
    part = slice(following.start + 10, following.start + 10 + run.ticks_followed // 5)
    joints[part] += np.random.default_rng(5).normal(0.0, 0.5, joints[part].shape)
    figure = plot_poses(replace(run, record=replace(record, human_joints=joints, time=1e3 * record.time)))
    assert figure is not None
    labels = [text.get_text().split() for text in figure.axes[0].texts]
    times = 1e-3 * np.array([float(label[0]) for label in labels])
    assert len(times) == 9 and sum("alike" in label for label in labels) == 1
    assert np.diff(times).min() > 0.4 * (record.time[following][-1] - record.time[following.start]) / 9


def test_a_performer_is_drawn_facing_as_the_robot_does(human_run: RunResult) -> None:
    """Whatever the world axes: turned by 130 degrees, the same skeleton is drawn."""
    angle = np.deg2rad(130.0)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    record = human_run.record
    q = record.human_q.copy()
    q[:, :3] = q[:, :3] @ turn.T
    q[:, 3:7] = multiply(np.array([np.cos(angle / 2.0), 0.0, 0.0, np.sin(angle / 2.0)]), q[:, 3:7])
    other = replace(record, human_q=q, human_joints=record.human_joints @ turn.T)
    away = replace(human_run, record=other)
    facing = performer_facing(away)
    np.testing.assert_allclose(facing, np.tile([np.cos(angle), np.sin(angle)], (len(facing), 1)), atol=1e-9)
    following = human_run.record.following
    followed = other.human_joints[following]
    np.testing.assert_allclose(turned(followed, facing) @ turn.T, followed, atol=1e-9)


def test_a_run_of_one_tick_has_no_pictures(human_run: RunResult) -> None:
    assert not figures_of(replace(human_run, record=human_run.record[:1]))


def test_tracking_shows_what_was_sent_and_where_the_servos_stood(run: RunResult) -> None:
    figure, unanswered = plot_tracking(run), plot_tracking(replace(run, setup=replace(run.setup, has_bus=False)))
    assert figure is not None and unanswered is not None
    assert [line.get_label() for line in figure.axes[0].lines] == ["desired", "sent", "servos"]
    assert [line.get_label() for line in unanswered.axes[0].lines] == ["desired", "sent"]
    sent, servos = (line.get_ydata() for line in figure.axes[0].lines[1:])
    assert np.shape(sent) == np.shape(servos) and np.isfinite(np.asarray(servos, dtype=float)).all()


def test_tracking_of_a_human_has_every_sensor_and_no_empty_panel(human_run: RunResult) -> None:
    worn = human_run.sensors
    assert len(worn) == 5
    figure = plot_tracking(human_run)
    assert figure is not None and len(figure.axes) == 4 * len(worn)
    joints = human_run.record.human_joints.copy()
    names = human_run.record.human_joint_names
    columns = [names.index(human_run.setup.performer.sensors[sensor].joint) for sensor in worn]
    joints[:, columns] = human_run.sensors_desired
    figure = plot_tracking(replace(human_run, record=replace(human_run.record, human_joints=joints)))
    assert figure is not None and len(figure.axes) == 3 * len(worn)


def test_poses_say_that_a_performer_travels_where_the_robot_stays(run: RunResult) -> None:
    assert run.robot is not None
    joints = run.record.human_joints.copy()
    joints[..., 0] += np.linspace(0.0, 2.0, len(joints))[:, None]
    still, travelling = plot_poses(run), plot_poses(replace(run, record=replace(run.record, human_joints=joints)))
    assert still is not None and travelling is not None
    title, longer = still.get_suptitle(), travelling.get_suptitle()
    assert len(title.splitlines()) == 1 and longer.startswith(title) and len(longer.splitlines()) == 2
