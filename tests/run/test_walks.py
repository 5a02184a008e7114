"""Runs of a robot that walks: stops and holds in the middle of a step, and what is refused before it begins."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from followers import op3
from hardware.clock import VirtualClock
from hardware.errors import RetargetError
from messages import refuses, shows
from retarget.errors import ConfigError, UsageError
from retarget.human.samples import Playback
from retarget.model.robot import load_robot
from retarget.pictures.solid import PITCH, moving
from retarget.report.findings import RunFigures
from retarget.report.measure import measure
from retarget.report.motion_metrics import limit_use, standing_of
from retarget.robot.walking.gait import with_steps
from retarget.robot.walking.pattern import Request
from retarget.run.loop import Operator, RunObserver, Tick
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare
from retarget.run.run_result import RunResult
from retarget.run.supervisor import OperatorInput
from retarget.schema.priorities import load_priorities
from retarget.types import FloatArray, RunState
from sim.mock_bus import mock_bus
from sim.performer import strolling_performer, synthetic_performer

FORWARD, STAND = Request(forward=0.1), Request()


class Stick(RunObserver):
    """Asks for a velocity from the time on that following begins, and notes states and whether it walks."""

    def __init__(self, asked: Callable[[float], Request]) -> None:
        self._asked, self._begun = asked, 0.0
        self.velocity, self.t = STAND, 0.0  # t: s since following began
        self.prepared: Prepared
        self.states, self.walked = list[RunState](), list[bool]()

    def see(self, tick: Tick) -> None:
        assert tick.output is not None and self.prepared.machine is not None
        legs = self.prepared.machine.follower.legs
        assert legs is not None
        self.states.append(tick.output.run_state)
        self.walked.append(legs.walks)
        if RunState.FOLLOW in self.states:
            self._begun = self._begun or tick.given.now
            self.t = tick.given.now - self._begun
            self.velocity = self._asked(self.t)


class Steers(Operator):
    """Asks for the velocity of a stick, and for a stop from a time on, s since following began."""

    def __init__(self, stick: Stick, after: float) -> None:
        self._stick, self._after = stick, after

    def requested(self) -> OperatorInput:
        stop = "it is enough" if self._stick.t > self._after else None
        return OperatorInput(stop, velocity=self._stick.velocity)


def run(stick: Stick, *, end: float = 8.0, stops: float = np.inf, lost: tuple[float, float] = (0.0, 0.0)) -> RunResult:
    """A run of OP3 without mass. lost: from when until when, s of the performance, its performer cannot be followed."""
    options = RunOptions(robot="op3", steps="walk", playback=Playback(end=end))
    with prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        stick.prepared, samples = prepared, prepared.samples
        sample = samples.sample
        vars(samples)["sample"] = lambda tick: None if lost[0] < tick * samples.dt < lost[1] else sample(tick)
        return prepared.run(Steers(stick, stops), [stick])


def soles(result: RunResult, row: int) -> FloatArray:
    """Places (2, 3) m of both soles in a row, seen from the left one."""
    return np.asarray(op3().points(result.record.q[row][None], ("l_sole", "r_sole"))[0])


def stands(result: RunResult, row: int = -1) -> bool:
    """Whether both soles are on the floor, side by side."""
    left, right = soles(result, row)
    apart = float(np.linalg.norm((left - right)[:2]))
    return abs(left[2] - right[2]) < 1e-4 and abs(apart - 0.095) < 1e-3


def gone(result: RunResult, first: int = 0) -> float:
    """How far ahead the left sole is of where it was in a row, m."""
    return float(soles(result, -1)[0, 0] - soles(result, first)[0, 0])


def walks_on(t: float) -> Request:
    return FORWARD if t > 0.3 else STAND


def test_it_walks_and_stands_again() -> None:
    stick = Stick(lambda t: FORWARD if 0.5 < t < 4.5 else STAND)
    result = run(stick)
    walked = np.array(stick.walked)
    assert result.state == RunState.OFF.value and result.stop is None
    assert result.tally.walk is not None and result.tally.walk.steps >= 4
    assert walked.any() and not walked[-1]
    assert gone(result) > 0.15 and stands(result)
    refused = result.record.gated[: len(walked)][walked[: len(result.record.gated)]]
    assert refused.mean() < 0.1, "arms alone are held back now and then"


@pytest.mark.parametrize("after", [1.2, 1.9, 2.5, 2.7, 2.9, 3.1])
def test_a_stop_in_the_middle_of_a_step_ends_on_both_feet(after: float) -> None:
    """The way to a first step, the step that is under way, one more, and the end of the pattern."""
    stick = Stick(walks_on)
    result = run(stick, stops=after)
    assert result.state == RunState.OFF.value and stands(result)
    assert 0 < stick.states.count(RunState.STOPPING) * 0.008 < 0.5 + 2 * 0.6 + 0.7


def test_a_hold_in_the_middle_of_a_step_is_a_stand_and_then_it_walks_on() -> None:
    stick = Stick(walks_on)
    result = run(stick, end=13.0, lost=(3.0, 6.0))
    last = np.flatnonzero([state is RunState.HOLD for state in stick.states])[-1]
    assert stands(result, last) and gone(result, last) > 0.05, "it goes on from there"


def test_a_short_hold_does_not_end_in_the_air() -> None:
    """The robot finishes its way to a stand, and only then walks on."""
    result = run(Stick(walks_on), end=10.0, lost=(3.0, 3.2))
    moved = np.diff(result.record.q[:, op3().servo_columns], axis=0)
    limits = op3().joint_map
    assert (np.abs(moved) <= limits.max_velocity * 0.008 + 1e-6).all()
    assert (np.abs(np.diff(moved, axis=0)) <= limits.max_acceleration * 0.008**2 + 1e-6).all()
    assert gone(result) > 0.1


@pytest.mark.parametrize(
    ("robot", "why"),
    [("op3", ()), ("wolfgang", ()), ("toddlerbot", ("left_hip_roll", "1.36", "76%")), ("poppy", "3.3 mm off")],
)
def test_a_robot_that_cannot_stand_on_one_leg_stays_planted_and_says_so(robot: str, why: str | tuple[str, ...]) -> None:
    """ToddlerBot's hips are too weak; Poppy's ankles do not roll, so its mass does not get over one sole."""
    priorities, notes = with_steps(load_priorities("balanced_sustained"), load_robot(robot), "walk", parts="whole")
    assert priorities.steps == ("planted" if why else "walk") and len(notes) == bool(why)
    if why:
        shows(notes[0], *([why] if isinstance(why, str) else why))


@pytest.mark.parametrize(
    ("steps", "root", "parts", "fault"),
    [
        ("follow", "free", "whole", "walk"),
        ("walk", "suspended", "whole", "follow"),
        ("walk", "free", "upper", "whole"),
    ],
)
def test_what_a_robot_cannot_do_is_refused(steps: Any, root: Any, parts: Any, fault: str) -> None:
    robot = load_robot("op3", root=root)
    with refuses(UsageError, "--steps", fault):
        with_steps(load_priorities("balanced"), robot, steps, parts=parts)
    written = load_priorities("balanced").model_copy(update={"steps": steps})
    with refuses(ConfigError, "priorities", fault):
        with_steps(written, robot, None, parts=parts)


def test_a_walk_needs_servos_whose_load_is_known() -> None:
    with refuses(ConfigError, "servo", "deflection_compensation"):
        with_steps(load_priorities("servo"), op3(), "walk", parts="whole")


def test_options_are_checked_before_any_file() -> None:
    for options, facts in (
        ({"steps": "hop"}, ("hop", "planted, walk, follow")),
        ({"steps": "shift"}, ("shift", "planted, walk, follow")),
        ({"steps": "walk", "parts": "upper"}, "--parts upper"),
    ):
        with refuses(RetargetError, facts):
            RunOptions(robot="op3", **options)  # type: ignore[arg-type]
    with refuses(UsageError):
        RunOptions(robot="human", steps="walk")


@cache
def strolled() -> RunResult:
    """OP3 walks with the strolling performer."""
    options = RunOptions(robot="op3", steps="walk")
    with prepare(strolling_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        return prepared.run()


def test_hands_of_a_robot_that_has_turned_are_seen_from_where_it_is() -> None:
    """They follow a performer who stands as well as those of a robot that stands."""
    result = run(Stick(lambda t: Request(turn=0.3) if 0.5 < t < 7.0 else STAND), end=9.0)
    tally, hands = result.tally.walk, measure(result).reachable_hands_mm
    assert tally is not None and tally.turned_deg > 60.0
    assert hands is not None and hands["worse"] < 60.0


def test_it_keeps_step_with_the_performer() -> None:
    """From its third step on, the same foot is ahead, and legs look alike."""
    result = strolled()
    record = result.record[result.record.following]
    left, right = (record.human_joints[:, record.human_joint_names.index(f"{side}_ankle"), 0] for side in "lr")
    ahead = op3().points(record.q, ("l_sole", "r_sole"))[:, :, 0]
    steps = slice(round(4.0 / 0.008), round(10.0 / 0.008))
    assert np.corrcoef((left - right)[steps], (ahead[:, 0] - ahead[:, 1])[steps])[0, 1] > 0.8
    likeness = measure(result).likeness_deg
    assert likeness is not None and likeness["thighs"].mean < 14.0 and likeness["shanks"].mean < 14.0


def test_the_floor_of_a_walk_is_seen_to_go_by() -> None:
    """Marks go back as far as the robot goes on, all alike; a body that stays has none."""
    drawn = moving(strolled())["op3"]
    assert drawn.marks is not None
    moved = np.diff(drawn.marks, axis=0)[..., :2] / PITCH
    moved -= np.round(moved)
    np.testing.assert_allclose(moved - moved[:, :1], 0.0, atol=1e-9)
    assert np.abs(moved).max() > 0.01
    options = RunOptions(robot="op3", playback=Playback(end=0.3))
    with prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        assert moving(prepared.run())["op3"].marks is None


def test_the_report_of_a_walk_judges_postures_and_says_how_far_it_went() -> None:
    """Of the strolling performer: whose soles go elsewhere do not slide, and whose goals hold torque may jump."""
    result = strolled()
    report, use = measure(result), limit_use(result)
    walk = report.walk
    assert walk is not None and walk.steps > 8
    assert report.soles is None and report.foot_slide_mm is None and report.com_margin_mm is not None
    for used in (use.velocity, use.acceleration):
        assert used is not None and used.share <= 1.0 + 1e-6
    prints = standing_of(op3(), result.record.q).footprints()
    assert abs(len(prints) - (2 + walk.steps)) <= 2, "one for each sole at first, and one for each step"
    went = float(np.linalg.norm((prints[-1] - prints[0]).mean(axis=0)[:2]))
    assert went == pytest.approx(walk.walked_m, abs=0.1)
    seen = RunFigures(result, report)
    assert seen.left_behind_m is None and seen.walk_missing == pytest.approx(1.0 - walk.walked_m / walk.asked_m)
