"""Modes that change are counted, per second and by observer."""

import numpy as np
import pytest

from faulty_bus import FaultKind, MockFault
from hardware.clock import VirtualClock
from retarget.model.body import JointLimits
from retarget.report import motion_metrics, tracking
from retarget.report.measure import measure
from retarget.report.motion_metrics import jerk_p95, limit_violations, observer_activity
from retarget.report.report import Report
from retarget.report.tracking import Reachable
from retarget.run.loop import Operator, run_human
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.types import FloatArray
from rig import Rig, StubReconstructor, person, result, short_clip


def test_switches_are_counted_per_second_and_observer() -> None:
    modes = np.zeros((11, 3), dtype=np.uint8)
    modes[3:5, 1] = 1
    modes[7:, 1] = 2
    modes[:, 2] = 1
    found = observer_activity(modes, ("head", "l_arm", "r_arm"), dt=0.1)
    assert found is not None
    switches, reactive = found
    assert switches.worst == pytest.approx(3.0)
    assert switches.mean == pytest.approx(1.0)
    assert switches.name == "l_arm"
    assert reactive == pytest.approx(4 / 11)


# Metrics against cases made by hand.

DT = 0.008


def wave(ticks: int = 500, *, late: float = 0.0) -> FloatArray:
    """Two tracks (T, 2, 3) m that go round, `late` s late."""
    time = np.arange(ticks) * DT - late
    one = np.stack([0.1 * np.sin(3.0 * time), 0.2 * np.cos(2.0 * time), 0.05 * time], axis=-1)
    return np.stack([one, 2.0 * one], axis=1)


def limits(position: float = 1.0, velocity: float = 2.0, acceleration: float = 10.0, joints: int = 2) -> JointLimits:
    full = np.full(joints, 1.0)
    return JointLimits(-position * full, position * full, velocity * full, acceleration * full)


def counts(q: FloatArray, limits: JointLimits, *, to_rest: bool = False) -> tuple[int, int, int]:
    found = limit_violations(q, limits, DT, to_rest=to_rest)
    return found.position, found.velocity, found.acceleration


def test_a_frozen_robot_shows_zero_and_no_lag() -> None:
    asked = wave()
    frozen = np.repeat(asked[:1], len(asked), axis=0)
    assert tracking.path_ratio(asked, frozen) == 0.0
    assert tracking.excursion_ratio(asked[:, 0, 2], frozen[:, 0, 2]) == 0.0
    assert tracking.lag(asked, frozen, DT) is None
    assert tracking.path_ratio(asked, asked) == pytest.approx(1.0)
    assert tracking.path_ratio(frozen, asked) is None
    assert tracking.excursion_ratio(frozen[:, 0, 2], asked[:, 0, 2]) is None


def test_a_run_that_is_too_short_to_show_its_lag_has_none() -> None:
    assert tracking.lag(wave()[:60], wave(late=0.4)[:60], DT) is None


def test_ticks_with_unknown_values_take_no_part() -> None:
    asked, reached = wave(), wave()
    asked[3] = np.nan
    assert tracking.path_ratio(asked, reached) == pytest.approx(1.0)
    assert tracking.excursion_ratio(asked[:, 0, 2], reached[:, 0, 2]) == pytest.approx(1.0)
    assert tracking.path_ratio(asked * np.nan, reached) is None
    assert tracking.lag(asked * np.nan, reached, DT) is None


def test_one_bad_frame_is_no_range() -> None:
    asked, reached = wave(), wave()
    reached[200] += 5.0
    heights = asked[:, 0, 2], reached[:, 0, 2]
    assert tracking.excursion_ratio(*heights) == pytest.approx(1.0, abs=0.01)
    walked = np.stack([np.linspace(0.0, 4.0, 500), np.linspace(0.0, 3.0, 500)], axis=1)
    assert tracking.extent(walked) == pytest.approx(4.8) and tracking.extent(walked[:0]) == 0.0
    angle = np.linspace(0.0, 4.0 * np.pi, 500)
    turns = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert tracking.turn_extent(turns) == pytest.approx(0.96 * 4.0 * np.pi)


def test_feet_that_stay_have_not_gone_where_the_performer_went() -> None:
    """Two strides of 0.4 m and 0.2 m, while everything trembles by a millimetre."""
    chance = np.random.default_rng(3)
    asked = 0.0005 * chance.standard_normal((500, 2, 3))
    planted = asked[::-1].copy()
    asked[:, 0, 0] += 0.4 * np.clip((np.arange(500) - 100) / 50.0, 0.0, 1.0)
    asked[:, 1, 0] += 0.2 * np.clip((np.arange(500) - 300) / 50.0, 0.0, 1.0)
    assert tracking.foot_path_ratio(asked, planted, DT) == 0.0
    half = planted + 0.5 * (asked - planted)
    assert tracking.foot_path_ratio(asked, half, DT) == pytest.approx(0.5, abs=0.02)
    assert tracking.foot_path_ratio(planted, asked, DT) is None


def test_every_broken_limit_is_counted() -> None:
    time = np.arange(400) * DT
    smooth = np.stack([0.5 * (1.0 - np.cos(2.0 * time)), np.zeros_like(time)], axis=-1)
    assert limit_violations(smooth, limits(), DT) == limit_violations(smooth, limits(), DT, from_rest=False)
    assert counts(smooth, limits()) == (0, 0, 0)
    beyond = np.zeros((10, 2))
    beyond[5:7, 1] = 1.1
    assert counts(beyond, limits(velocity=1e6, acceleration=1e9)) == (2, 0, 0)
    fast = np.outer(np.arange(5) * 2.01 * DT, [1.0, 0.0])
    assert counts(fast, limits(acceleration=1e9)) == (0, 4, 0)
    # From rest into motion and back to rest: two changes of speed.
    kick = np.zeros((10, 2))
    kick[4:, 0] = 11.0 * DT**2
    assert counts(kick, limits()) == (0, 0, 2)


def test_a_motion_that_is_cut_has_not_kept_its_limits() -> None:
    # Half of 8 rad/s^2 for 10 ticks: no limit is broken on the way, but nothing slows it down.
    cut = np.outer(4.0 * (np.arange(11) * DT) ** 2, [1.0, 0.0])
    assert counts(cut, limits()) == (0, 0, 0)
    assert counts(cut, limits(), to_rest=True) == (0, 0, 1)
    standing_outside, loose = np.array([[0.0], [1.1]]), limits(velocity=1e6, acceleration=1e9, joints=1)
    assert counts(standing_outside, loose, to_rest=True)[0] == 1


def square(at: tuple[float, float, float] = (0.0, 0.0, 0.0), ticks: int = 3) -> FloatArray:
    """Corners of a sole of 20 cm by 10 cm."""
    outline = np.array([[0.1, 0.05, 0.0], [-0.1, 0.05, 0.0], [-0.1, -0.05, 0.0], [0.1, -0.05, 0.0]])
    return np.tile(outline + at, (ticks, 1, 1))


def test_the_margin_of_the_centre_of_mass() -> None:
    corners = square()
    com = np.array([[0.0, 0.0, 0.3], [0.0, 0.04, 0.3], [0.0, 0.07, 0.3]])
    assert motion_metrics.support_margin(com, corners) == pytest.approx([0.05, 0.01, -0.02], abs=1e-5)


def test_a_lifted_foot_carries_nothing() -> None:
    corners = np.concatenate([square((0.0, 0.1, 0.0)), square((0.0, -0.1, 0.02))], axis=1)
    com = np.zeros((3, 3))
    assert motion_metrics.support_margin(com, corners) == pytest.approx([-0.05] * 3, abs=1e-5)
    assert np.isnan(motion_metrics.support_margin(com, square((0.0, 0.0, 0.5)))).all()


@pytest.fixture(scope="module")
def report() -> Report:
    """A robot that jumps once, which the gate holds back."""
    script = np.zeros((51, 20))
    script[30:, 3] = 1.0
    return reported(Rig(script))[0]


def test_the_report_of_a_held_robot(report: Report) -> None:
    assert 51 < report.ticks < 180 and report.frames == 49
    assert report.gated_frames == 21 and report.duration_s == pytest.approx(51 * DT)
    assert (report.limit_violations.position, report.limit_violations.velocity) == (0, 0)
    assert report.limit_violations.acceleration == 0
    assert report.reachable_share is not None and report.reachable_hands_mm is not None
    assert list(report.reachable_share) == ["l_hand", "r_hand"]
    assert list(report.reachable_hands_mm) == ["l_hand", "r_hand", "mean", "worse"]
    assert report.tracking_mm["l_hand"].max > 50.0 and report.tracking_mm["r_hand"].max < 1e-6
    assert report.hand_path_ratio == pytest.approx(0.0, abs=1e-9)
    assert report.pelvis_excursion_ratio is None
    assert report.com_outside_support_frames == 0 and report.foot_slide_mm == pytest.approx(0.0, abs=1e-9)
    assert report.penetrating_frames == 0
    assert report.bus is not None and report.bus.rate_hz == pytest.approx(125.0) and report.bus.faults == 0


def reported(rig: Rig) -> tuple[Report, RunResult]:
    human, clip = person(), short_clip()
    run = result(rig.loop(clip).run(), clip, human, rig.robot)
    return measure(run), run


def swing() -> FloatArray:
    script = np.zeros((51, 20))
    script[:, 0] = 0.15 * (1.0 - np.cos(2.0 * np.pi * np.arange(51) / 50.0))
    return script


def test_a_run_that_is_cut_while_it_moves_breaks_a_limit() -> None:
    whole, _ = reported(Rig(swing()))
    assert whole.limit_violations.acceleration == 0
    cut, _ = reported(Rig(swing(), faults=(MockFault(FaultKind.READ_FAILS, first=130, cycles=1000),)))
    assert cut.stop.state == "fault" and cut.limit_violations.acceleration > 0


def test_ticks_in_which_the_robot_braked_unasked_are_counted_and_those_of_a_stop_are_not() -> None:
    moving = np.zeros((51, 20))
    moving[:, 0] = 4.0 * (np.arange(51) * DT) ** 2  # at the clip's end
    report, run = reported(Rig(moving))
    assert report.gated_frames == report.no_command_frames == 0
    assert np.count_nonzero(run.record.phase == Phase.BRAKE) > 1
    moving[20] = np.nan
    report, run = reported(Rig(moving))
    assert report.no_command_frames == 1


def test_the_approach_takes_no_part_in_the_jerk() -> None:
    far = swing() + 0.4 * (np.arange(20) > 9)
    report, run = reported(Rig(far))
    assert run.robot is not None
    following = run.record.q[run.record.following][:, run.robot.servo_columns]
    assert len(run.record) > 2 * len(following)
    assert report.jerk_p95 == jerk_p95(following, run.clip.dt)


def test_the_worse_hand_is_reported_with_the_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mean counts each hand by its ticks within reach."""
    found = {"l_hand": Reachable(1.0, 0.04, 0.0), "r_hand": Reachable(0.5, 0.01, 0.3)}
    monkeypatch.setattr("retarget.report.measure.reachable_hands", lambda robot, asked, reached: found)
    hands = reported(Rig(np.zeros((51, 20))))[0].reachable_hands_mm
    assert hands == pytest.approx({"l_hand": 40.0, "r_hand": 10.0, "mean": 30.0, "worse": 40.0})


def test_the_report_of_a_human_has_no_robots_values() -> None:
    human, clip = person(), short_clip(rate_hz=None)
    ending = run_human(clip, StubReconstructor(human), Operator(), VirtualClock())
    report = measure(result(ending, clip, human, None))
    assert report.robot == "human" and list(report.tracking_mm) == list(clip.frames.names)
    unknown = ("gated_frames", "no_command_frames", "com_outside_support_frames", "bus", "retarget_us")
    assert [getattr(report, name) for name in unknown] == [None] * 5
    assert report.unsensed_mm is not None
    joints = {name: value for name, value in report.unsensed_mm.items() if name != "mean"}
    assert set(joints) == {*("pelvis", "neck", "l_knee", "r_knee", "l_elbow", "r_elbow", "l_shoulder", "r_shoulder")}
    assert report.unsensed_mm["mean"] == pytest.approx(np.mean(list(joints.values())))
