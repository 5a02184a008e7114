"""`retarget.Pipeline`: goals keep every limit whatever comes in, and are those of a run."""

import re
import runpy
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import groupby, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.clock import Clock, VirtualClock
from hardware.no_bus import NoBus
from messages import refuses, shows
from retarget import Pipeline, RunOptions, SensorSample, load_performer, load_robot
from retarget.errors import InputError, UsageError
from retarget.frames import SensorFrames
from retarget.human.calibration import calibrate
from retarget.human.samples import Clip, Performance, Playback, lay_on_ticks
from retarget.model.robot import RobotBody
from retarget.pipeline import Goal
from retarget.report.motion_metrics import LimitViolations, limit_violations
from retarget.robot.follower import Follower
from retarget.run.performers import SteppedPerformer
from retarget.run.prepare import prepare_for
from retarget.safety.clearance import PathClearance
from retarget.schema.performer import Performer
from retarget.types import FloatArray, HumanPosture, RobotPosture, RunState
from sim.performer import synthetic_performer

PAGE = Path(__file__).resolve().parent.parent / "docs/pipeline.md"
DT = 0.008
FIVE = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")


@cache
def frames() -> SensorFrames:
    return synthetic_performer(rate_hz=125.0).select(FIVE)


def still() -> SensorSample:
    return frames().sample(0.0)


def started() -> Pipeline:
    """A pipeline of OP3 whose robot follows a performer who stands still, at full speed."""
    pipeline = Pipeline("op3", performer="five", priorities="servo")
    pipeline.start(still())
    run_to(pipeline, RunState.FOLLOW, ticks=220)
    return pipeline


def run_to(pipeline: Pipeline, state: RunState, *, ticks: int = 1, most: int = 2000) -> list[Goal]:
    """Goals of a performer who stands still, until so many ticks in a row were of a state."""
    goals, seen = list[Goal](), 0
    while seen < ticks:
        goals.append(pipeline.step(still(), pipeline.dt))
        seen = seen + 1 if pipeline.state is state else 0
        assert len(goals) < most, f"still {pipeline.state.value}"
    return goals


def state_of(pipeline: Pipeline) -> str:
    return str(pipeline.state.value)


def keep_limits(goals: list[FloatArray]) -> bool:
    found = limit_violations(np.array(goals), load_robot("op3").limits, DT, from_rest=False)
    return found == LimitViolations(0, 0, 0)


def lost(sample: SensorSample, *names: str) -> SensorSample:
    return replace(sample, valid=sample.valid & ~np.isin(sample.names, names))


def moved(sample: SensorSample, by: float, *names: str) -> SensorSample:
    return replace(sample, position=sample.position + np.where(np.isin(sample.names, names), by, 0.0)[:, None])


def test_a_loop_of_a_dozen_lines_gives_joint_angles(tmp_path: Path) -> None:
    code = re.findall(r"```python\n(.+?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[0]
    assert len(code.strip().splitlines()) <= 12
    sent, ticks = list[dict[str, float]](), iter(range(20))
    robot = SimpleNamespace(
        read=lambda: np.zeros(20),
        is_on=lambda: next(ticks, None) is not None,
        send=lambda names, angles: sent.append(dict(zip(names, angles.tolist(), strict=True))),
    )
    poses = dict(zip(FIVE, still().position, strict=True))
    script = tmp_path / "loop.py"
    script.write_text(code, encoding="utf-8")
    runpy.run_path(str(script), {"tracker": SimpleNamespace(poses=lambda: poses), "robot": robot})
    assert len(sent) == 20 and sent[0].keys() == set(load_robot("op3").joint_map.joints)


@pytest.mark.parametrize("wrong", [(0, 1), "left", ((0, 0, 1), 2, 3), {}])
def test_a_sample_of_what_are_no_positions_is_refused(wrong: object) -> None:
    with refuses(UsageError, "SensorSample.of"):
        SensorSample.of({"head": (0, 0, 1.6), "pelvis": wrong})
    with refuses(UsageError, "SensorSample.of, orientations"):
        SensorSample.of({"head": (0, 0, 1.6)}, {"head": wrong})


@pytest.mark.parametrize("positions", ["head", "haed"])
def test_an_unknown_sensor_is_refused_with_the_nearest_name(positions: str) -> None:
    with refuses(UsageError, "'haed'", "Did you mean head?"):
        SensorSample.of({positions: (0, 0, 1.6)}, {"haed": (1, 0, 0, 0)})


def test_the_performer_is_followed() -> None:
    pipeline = started()
    goals = [pipeline.step(frames().sample(tick * DT), DT) for tick in range(250)]
    hands = [goals[0].landmark_names.index(name) for name in ("l_hand", "r_hand")]
    off = [np.linalg.norm(one.landmarks_asked - one.landmarks_reached, axis=1)[hands].max() for one in goals]
    assert np.median(off) < 0.04
    assert min(one.human.joint("head")[2] for one in goals) < goals[0].human.joint("head")[2] - 0.1
    assert np.ptp([one.joint_positions for one in goals], axis=0).max() > 0.5
    assert keep_limits([one.joint_positions for one in goals])


def test_smoothing_calms_goals_and_follows_all_the_same() -> None:
    """Noise of 5 mm in all sensors, the same for all; at rest and at the end of a motion."""

    def goals(smoothing: str) -> FloatArray:
        noise = np.random.default_rng(1)
        pipeline = Pipeline("op3", performer="five", priorities="servo", smoothing=smoothing)
        pipeline.start(still())
        run_to(pipeline, RunState.FOLLOW, ticks=220)
        times = [*np.zeros(60), *(DT * np.arange(180))]
        seen = [frames().sample(time) for time in times]
        return np.array(
            [
                pipeline.step(
                    replace(one, position=one.position + noise.normal(0.0, 0.005, (5, 3))), DT
                ).joint_positions
                for one in seen
            ]
        )

    off, light, strong = goals("off"), goals("light"), goals("strong")
    jerk = [float(np.diff(one[:60], 3, axis=0).std()) for one in (off, light, strong)]
    assert jerk[1] < 0.8 * jerk[0] and jerk[2] < 0.8 * jerk[1]
    assert np.abs(strong - off).max() < 0.35 and np.ptp(strong[60:], axis=0).max() > 0.5
    assert all(keep_limits(list(one)) for one in (off, light, strong))


def test_a_sensor_that_comes_back_is_not_smoothed_from_where_it_was_lost() -> None:
    pipelines = [Pipeline(None, performer="five", rate_hz=125, smoothing=name) for name in ("off", "strong")]
    for pipeline in pipelines:
        pipeline.start(still())
        pipeline.step(still(), DT)
        for _ in range(30):
            pipeline.step(lost(still(), "r_wrist"), DT)
    there = moved(still(), 0.1, "r_wrist")
    off, strong = (pipeline.step(there, DT).human for pipeline in pipelines)
    assert np.array_equal(off.q, strong.q)


class Stepped(SteppedPerformer):
    """Samples that come one by one, as a run takes them; then the performance is over."""

    def __init__(self, given: list[SensorSample | None], dt: float) -> None:
        assert given[0] is not None
        super().__init__(given[0])
        self._coming, self._time = iter(given), 0.0
        self.dt = self.motion_dt = dt
        self.ticks = self.kept = 2000
        self.over = False

    def poll(self) -> None:
        try:
            sample = next(self._coming)
        except StopIteration:
            self.over = True
        else:
            self._time += self.dt
            self.take(self._time, sample)

    def recorded(self) -> Clip:
        return lay_on_ticks(frames(), performer=load_performer("five"), playback=Playback(end=0.1), rate_hz=125.0)


def always_there(robot: RobotBody, clock: Clock) -> NoBus:
    """Servos that are always at their goals, and stand at first."""
    stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    return NoBus(clock, start=robot.joint_map.to_ticks(stand))


@pytest.mark.parametrize(
    ("robot", "priorities"),
    [
        ("op3", "servo"),
        pytest.param("op3", "balanced", marks=pytest.mark.long),
        pytest.param("wolfgang", "servo", marks=pytest.mark.long),
        ("wolfgang", "balanced"),
    ],
)
def test_goals_are_those_of_a_run(robot: str, priorities: str) -> None:
    """Through the approach, following, a hold in each of them, and the way back from it."""
    dt = 1.0 / load_robot(robot).profile.safety.rate_hz
    crouch, end = round(1.6 / dt), round(3.2 / dt)  # ticks of the motion
    begin = round(5.6 / dt)
    clip: list[SensorSample | None] = [frames().sample(max(0.0, (tick - begin) * dt)) for tick in range(begin + end)]
    lost = slice(round(0.8 / dt), round(0.9 / dt)), slice(begin + crouch, begin + crouch + round(0.24 / dt))
    for gone in lost:
        clip[gone] = [None] * len(clip[gone])
    size = calibrate(synthetic_performer())

    def perform(performer: Performer, robot: object) -> Performance:
        return Performance(Stepped(clip, dt), size)

    options = RunOptions(robot=robot, bus="none", priorities=priorities)
    with prepare_for(perform, options, clock=VirtualClock(), make_bus=always_there) as prepared:
        record = prepared.run().record.robot
    assert record is not None
    pipeline = Pipeline(robot, performer="five", priorities=priorities)
    pipeline.start(still(), present=record.start, calibration=size)
    states, goals = list[RunState](), list[Goal]()
    for sample in clip:
        goals.append(pipeline.step(sample, dt))
        states.append(pipeline.state)
    changes = [state for state, _ in groupby(states)]
    on_its_way = [RunState.APPROACH, RunState.HOLD, RunState.APPROACH, RunState.FOLLOW]
    assert changes[:4] == on_its_way and changes[-2:] == [RunState.HOLD, RunState.FOLLOW]
    count = len(clip)
    np.testing.assert_array_equal(np.array([one.joint_positions for one in goals]), record.goals[:count])
    assert [one.gated for one in goals] == record.gated[:count].tolist()


def wild() -> Iterator[st.SearchStrategy[object]]:
    """Samples of a hostile tracker: (kind, size)."""
    yield st.none()
    yield st.tuples(st.sampled_from(FIVE), st.sampled_from([0.1, 1.0, 30.0, 1e5, 1e300, np.inf, np.nan]))


@pytest.mark.long
@settings(max_examples=8, deadline=None)
@given(st.lists(st.tuples(st.one_of(*wild()), st.integers(1, 40), st.floats(0.0, 15.0)), min_size=1, max_size=3))
def test_wild_and_missing_samples_break_no_limit(pieces: list[tuple[tuple[str, float] | None, int, float]]) -> None:
    pipeline = wild_pipeline()
    goals = [pipeline.step(still(), DT).joint_positions]
    for what, ticks, begin in pieces:
        for tick in range(ticks):
            sample = frames().sample(begin + tick * DT)
            given_now = None if what is None else moved(sample, what[1], what[0])
            goals.append(pipeline.step(given_now, DT).joint_positions)
    pipeline.stop()
    while not pipeline.stands:
        goals.append(pipeline.step(None, DT).joint_positions)
        assert len(goals) < 1000
    assert np.isfinite(goals).all() and keep_limits(goals)
    pipeline.start(still())
    run_to(pipeline, RunState.FOLLOW, ticks=30)


@cache
def wild_pipeline() -> Pipeline:
    return started()


def test_without_samples_the_robot_brakes_holds_and_comes_back_slowly() -> None:
    pipeline = started()
    follow = [pipeline.step(frames().sample(tick * DT), DT).joint_positions for tick in range(120)]
    gone = [pipeline.step(None, DT).joint_positions for _ in range(650)]  # longer than a run would hold
    assert pipeline.stands and state_of(pipeline) == "hold"
    assert (np.abs(np.diff(gone, axis=0)[100:]).max(axis=1) == 0.0).all()
    sample = frames().sample(3.0)
    back = [pipeline.step(sample, DT) for _ in range(350)]
    assert state_of(pipeline) == "follow"
    speeds = np.abs(np.diff([one.joint_positions for one in back], axis=0)) / DT
    assert speeds[:60].max() == 0.0  # half a second of valid samples first
    assert speeds[:100].max() < 0.3 * load_robot("op3").limits.max_velocity.max()
    assert np.isnan(back[0].landmarks_asked).all() and np.isfinite(back[-1].landmarks_asked).all()
    assert keep_limits([*follow, *gone, *(one.joint_positions for one in back)])


@pytest.mark.long
def test_after_postures_that_no_solver_found_it_comes_back_as_after_any_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline, step, lost = started(), Follower.step, iter(range(5))

    def fails(self: Follower, human: HumanPosture, dt: float) -> RobotPosture:
        posture = step(self, human, dt)
        return posture if next(lost, None) is None else replace(posture, q=np.full_like(posture.q, np.nan))

    monkeypatch.setattr(Follower, "step", fails)
    states = []
    for _ in range(120):
        pipeline.step(moved(still(), 0.02, "l_wrist"), DT)
        states.append(pipeline.state)
    changes = sum(one is not other for one, other in pairwise(states))
    assert states[0] is RunState.FOLLOW and states.count(RunState.HOLD) * DT >= 0.5
    assert changes <= 2 + 2 * 4, "and it does not flap"


@pytest.mark.long
@pytest.mark.parametrize("by", [1e7, np.nan])
def test_a_wrist_that_is_nowhere_is_a_lost_wrist(by: float) -> None:
    assert ten_goals(moved(still(), by, "l_wrist")) == of_a_lost_wrist()


@cache
def of_a_lost_wrist() -> list[list[float]]:
    return ten_goals(lost(still(), "l_wrist"))


def ten_goals(sample: SensorSample) -> list[list[float]]:
    """Of ten ticks with the same sample."""
    pipeline = started()
    return [pipeline.step(sample, DT).joint_positions.tolist() for _ in range(10)]


CROSSED = {
    "r_sho_pitch": 0.07,
    "l_sho_pitch": 2.67,
    "r_sho_roll": -1.54,
    "l_sho_roll": 1.9,
    "r_el": -0.89,
    "l_el": -0.36,
}
"""Angles, rad, of arms that the straight way to the stance would bring into the body."""


def test_an_approach_that_is_refused_is_a_hold_with_a_reason_until_the_way_is_free(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot, pipeline = load_robot("op3"), Pipeline("op3", performer="five")
    present = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    for joint, angle in CROSSED.items():
        present[robot.joint_map.joints.index(joint)] = angle
    pipeline.start(still(), present=present)
    states, reasons = [], []
    for _ in range(1250):  # 10 s: a run would have stopped
        goal = pipeline.step(still(), pipeline.dt)
        states.append(pipeline.state)
        reasons.append(goal.hold_reason)
    assert states[-100:].count(RunState.HOLD) > 90 and set(states) == {RunState.APPROACH, RunState.HOLD}
    told = list(zip(states, reasons, strict=True))
    assert all("approach" in reason for state, reason in told if state is RunState.HOLD)
    assert not any(reason for state, reason in told if state is not RunState.HOLD)
    monkeypatch.setattr(PathClearance, "__call__", lambda self, path, instead, standing, walk=None: True)
    assert all(not one.hold_reason for one in run_to(pipeline, RunState.APPROACH, ticks=50)[-50:])


def noisy(time: float, chance: np.random.Generator) -> SensorSample:
    sample = frames().sample(time)
    return replace(sample, position=sample.position + chance.normal(0.0, 0.0005, sample.position.shape))


def test_wrists_and_head_that_jump_together_hold_the_robot_until_they_are_back() -> None:
    pipeline, chance = started(), np.random.default_rng(2)
    goals, states = list[Goal](), list[RunState]()
    for tick in range(400):
        sample = noisy(0.0, chance)
        if 50 <= tick < 100:  # 0.4 s
            sample = moved(sample, 0.4, "head", "l_wrist", "r_wrist")
        goals.append(pipeline.step(sample, DT))
        states.append(pipeline.state)
    held = [tick for tick, state in enumerate(states) if state is RunState.HOLD]
    assert 50 < held[0] <= 50 + 0.15 / DT and held[-1] == pytest.approx(100 + 0.5 / DT, abs=2)
    reasons = {goals[tick].hold_reason for tick in held if tick < 100}
    assert len(reasons) == 1 and all(
        f"{name}: jumped" in reasons.copy().pop() for name in ("head", "l_wrist", "r_wrist")
    )
    there = np.array([goal.joint_positions for goal in goals])
    assert np.abs(there - there[49]).max() < 0.1, "the jump is not followed at all"
    assert keep_limits([*there])


def test_a_tracker_that_is_slower_than_the_loop_does_not_jump() -> None:
    """A fast wrist, 8 m/s, at 10 Hz: its sample is repeated, and each new one is 0.8 m farther."""
    samples = SteppedPerformer(still())
    for tick in range(1, 200):
        at = DT * (tick // 13 * 13)
        given = moved(still(), 0.8 * (round(at / 0.1) % 2) / np.sqrt(3.0), "l_wrist")
        samples.take(DT * tick, given)
        assert samples.seen is not None and np.array_equal(samples.seen.position, given.position)
        assert samples.may_approach()


def test_a_hold_says_which_sensors_are_missing() -> None:
    pipeline = started()
    shows(pipeline.step(None, DT).hold_reason, "no sample")
    shows(pipeline.step(lost(still(), "l_ankle"), DT).hold_reason, "no valid l_ankle")
    pipeline.stop()
    assert pipeline.step(None, DT).hold_reason == ""


@pytest.mark.long
@pytest.mark.parametrize("names", [("l_ankle",), FIVE])
def test_a_lost_ankle_holds_the_robot_and_a_lost_wrist_does_not(names: tuple[str, ...]) -> None:
    pipeline = started()
    pipeline.step(lost(still(), "l_wrist"), DT)
    assert state_of(pipeline) == "follow"
    pipeline.step(lost(still(), *names), DT)
    assert state_of(pipeline) == "hold"


@pytest.mark.long
def test_a_stop_brakes_and_a_new_start_goes_on_from_there() -> None:
    pipeline = started()
    for tick in range(150):
        pipeline.step(frames().sample(tick * DT), DT)
    pipeline.stop()
    with refuses(UsageError, "Pipeline.start", "stop()"):
        pipeline.start(still())
    goals = [pipeline.step(None, DT).joint_positions]
    while not pipeline.stands:
        goals.append(pipeline.step(frames().sample(2.0), DT).joint_positions)
    assert keep_limits(goals) and len(goals) * DT < 1.0
    assert pipeline.step(still(), DT).joint_positions.tolist() == goals[-1].tolist()
    assert pipeline.state is RunState.OFF
    pipeline.start(still())
    assert np.abs(pipeline.step(still(), DT).joint_positions - goals[-1]).max() < 1e-3


def test_after_an_exception_the_robot_brakes(monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline = started()
    goals = [pipeline.step(frames().sample(tick * DT), DT).joint_positions for tick in range(120)]
    monkeypatch.setattr(Follower, "step", Mock(side_effect=ArithmeticError("planted")))
    goal = pipeline.step(frames().sample(120 * DT), DT)
    assert goal.hold_reason == "planted"
    goals.append(goal.joint_positions)
    monkeypatch.undo()
    assert not pipeline.stands
    while not pipeline.stands:
        goals.append(pipeline.step(frames().sample(120 * DT), DT).joint_positions)
        assert pipeline.state is RunState.STOPPING
    assert keep_limits(goals) and len(goals) < 240
    pipeline.step(still(), DT)
    assert state_of(pipeline) == "off"
    pipeline.start(still())
    assert state_of(pipeline) == "approach"


@pytest.mark.parametrize("robot", [None, "human"])
def test_the_human_alone(robot: str | None) -> None:
    pipeline = Pipeline(robot, rate_hz=100.0)
    pipeline.start(still())
    first = pipeline.step(still(), 0.01)
    assert first.joint_names == first.landmark_names == () and first.joint_positions.size == 0 and not first.gated
    for tick in range(120):
        goal = pipeline.step(frames().sample(0.01 * tick), 0.01)
    assert goal.human.joint("head")[2] < first.human.joint("head")[2] - 0.2
    assert pipeline.step(None, 0.01).human.q.tolist() == goal.human.q.tolist()


@pytest.mark.long
def test_what_cannot_be_used_is_refused_and_nothing_changes() -> None:
    pipeline = started()
    before = pipeline.step(still(), DT).joint_positions
    for dt in (0.01, 0.0, -DT, np.nan, np.inf):
        with refuses(UsageError, "Pipeline.step", "rate_hz"):
            pipeline.step(still(), dt)
    words: Any
    for name, words in (("dt", (still(), "0.01")), ("sample", ({"head": None}, DT))):
        with refuses(UsageError, f"Pipeline.step, {name}"):
            pipeline.step(*words)
    with refuses(UsageError, "l_ankle"):
        pipeline.step(SensorSample.of({"head": (0.0, 0.0, 1.6)}), DT)
    with refuses(UsageError, "SensorSample", "(5, 3)"):
        pipeline.step(replace(still(), position=still().position[:, :2]), DT)
    assert np.abs(pipeline.step(still(), DT).joint_positions - before).max() < 1e-3


@pytest.mark.long
def test_swapped_sides_and_a_mirrored_performer_are_refused() -> None:
    pipeline, stands = Pipeline("op3"), still()
    sides = [stands.names.index(name) for name in ("head", "r_wrist", "l_wrist", "l_ankle", "r_ankle")]
    assert stands.names == FIVE
    with refuses(InputError, found="are exchanged, as seen from the wrists"):
        pipeline.start(replace(stands, position=stands.position[sides]))
    known = calibrate(frames())
    with refuses(InputError, found="are exchanged, as seen from the wrists"):  # also of who is known
        pipeline.start(replace(stands, position=stands.position[sides]), calibration=known)
    back = stands.orientation.copy()
    back[stands.names.index("head")] = [0.0, 0.0, 0.0, 1.0]
    with refuses(InputError, found="your head faces backward"):
        pipeline.start(replace(stands, orientation=back))


@pytest.mark.long
def test_what_cannot_be_started_is_refused() -> None:
    with refuses(UsageError, "rate_hz"):
        Pipeline(None, rate_hz=np.nan)
    with refuses(UsageError, "op4"):
        Pipeline("op4")
    wrong: Any
    for wrong in ({}, 3):
        with refuses(UsageError, "Pipeline, robot", found=type(wrong).__name__):
            Pipeline(wrong)
        with refuses(UsageError, "Pipeline, performer", found=type(wrong).__name__):
            Pipeline("op3", performer=wrong)
    named = (
        ("priorities", "serv"),
        ("parts", "lower"),
        ("performer", "fife"),
        ("robot", "op4"),
        ("smoothing", "ligth"),
    )
    for name, wrong in (*named, ("priorities", 3), ("parts", None), ("rate_hz", "100")):
        with refuses(UsageError, f"Pipeline, {name}: ") as caught:
            Pipeline(**{"robot": "op3", name: wrong})
        assert "--" not in str(caught.value)
    pipeline = Pipeline("op3")
    assert pipeline.state is RunState.IDLE
    with refuses(UsageError, "start(sample)"):
        pipeline.step(still(), DT)
    with refuses(InputError, "Pipeline.start", "l_ankle"):
        pipeline.start(moved(still(), np.nan, *FIVE))
    with refuses(InputError):  # a crouch is no rest pose
        pipeline.start(moved(still(), -1.2, "head"))
    stands, wide = still(), still().position.copy()
    wide[stands.names.index("l_ankle")] += [0.0, 0.4, 0.0]
    with refuses(InputError, found="m apart", allowed="0.5 m"):
        pipeline.start(replace(stands, position=wide))
    for wrong in (np.full(20, np.nan), [0.0, 0.0], "stand"):
        with refuses(UsageError, "Pipeline.start, present"):
            pipeline.start(still(), present=wrong)
    with refuses(UsageError, "Pipeline.start, sample"):
        wrong = {"head": (0.0, 0.0, 1.6)}
        pipeline.start(wrong)
    with refuses(UsageError, "Pipeline.start, calibration"):
        wrong = "me"
        pipeline.start(still(), calibration=wrong)
    assert pipeline.state is RunState.IDLE


def test_a_present_posture_in_degrees_is_refused() -> None:
    pipeline = Pipeline("op3", performer="five", rate_hz=100)
    with refuses(UsageError):
        pipeline.start(synthetic_performer().sample(0.0), present=np.full(20, 90.0))
