"""Actions: their keys and numbers, and a run that follows them on virtual time."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

import numpy as np
import pytest

from hardware.clock import VirtualClock
from messages import refuses, shows
from recordings import mock_bus
from retarget.errors import InputError, UsageError
from retarget.ik.support_polygon import plant, support_distance
from retarget.lerobot.actions import Actions, action_names, read_action
from retarget.lerobot.robot import STALE_MS, Wiring, following_actions
from retarget.model.observers import contacts, robot_observers
from retarget.model.robot import load_robot, plant_root
from retarget.report.motion_metrics import LimitViolations, limit_violations
from retarget.robot.follower import stance_angles
from retarget.run.loop import Ending, Operator, RunObserver, Tick
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared
from retarget.run.supervisor import LONGEST_HOLD_S, OperatorInput
from retarget.types import FloatArray, RunState

NAMES = action_names(("lift", "swing"))
FPS = 30.0
ROBOT = load_robot("op3")
STANCE = ROBOT.posture(stance_angles(ROBOT))[ROBOT.servo_columns]
APPROACH = ROBOT.profile.safety.speed_caps.approach


class NeedsGradient:
    """Refuses to be an array as a tensor of PyTorch does that needs its gradient."""

    def __array__(self, *_: object, **__: object) -> FloatArray:
        raise RuntimeError("Can't call numpy() on Tensor that requires grad. Use tensor.detach().numpy() instead.")

    def __repr__(self) -> str:
        return "tensor(0.5, requires_grad=True)"


@pytest.mark.parametrize(
    "value",
    [float("nan"), float("inf"), "1.0", None, True, [1.0, 2.0], -180.0, 1.7e308, NeedsGradient()],
    ids=repr,
)
def test_an_action_that_is_no_angle_is_named(value: object) -> None:
    with refuses(InputError, "swing.pos", "finite"):
        read_action({"lift.pos": 0.5, "swing.pos": value}, NAMES)


def following(clock: VirtualClock, **options: float) -> AbstractContextManager[tuple[Prepared, Actions]]:
    wiring = Wiring(make_bus=mock_bus, operator=lambda prepared: Operator(), notify=lambda text: None)
    return following_actions(ROBOT, RunOptions(robot="op3"), wiring, clock=clock, **options)


def test_the_target_is_the_newest_action_whatever_came_before() -> None:
    clock = VirtualClock()
    with following(clock) as (_, actions):
        for value in (1.7e308, -1.7e308, 0.1, 0.3):
            with np.errstate(over="ignore"):
                actions.put(np.full_like(STANCE, value))
                clock.sleep_until(clock.now() + 0.15)
                actions.poll()
            assert (actions.target() == value).all()


def test_an_action_without_a_joint_is_refused_and_other_keys_are_left_alone() -> None:
    with refuses(InputError, "swing.pos"):
        read_action({"lift.pos": 0.5}, NAMES)
    wide = {"swing.pos": np.float32(0.25), "lift.pos": np.array([1]), "gripper.pos": float("nan")}
    assert read_action(wide, NAMES).tolist() == [1.0, 0.25]


Script = Callable[[float, Actions], FloatArray | None]


@dataclass
class Scripted(Operator, RunObserver):
    """Sends actions at 30 Hz of virtual time, as a script says, and keeps what the robot does."""

    clock: VirtualClock
    script: Script
    seconds: float
    actions: Actions | None = None
    began: float | None = None
    sent: float = -1.0
    time: list[float] = field(default_factory=list)
    states: list[RunState] = field(default_factory=list)
    goals: list[FloatArray] = field(default_factory=list)
    q: list[FloatArray] = field(default_factory=list)

    def poll(self, state: RunState | None) -> OperatorInput:
        assert self.actions is not None
        now = self.clock.now()
        if state is RunState.FOLLOW and self.began is None:
            self.began = now
        at = 0.0 if self.began is None else now - self.began
        if now - self.sent >= 1.0 / FPS - 1e-9:
            target = self.script(at, self.actions)
            if target is not None:
                self.actions.put(target)
                self.sent = now
        return OperatorInput(stop="enough" if at > self.seconds else None)

    def see(self, tick: Tick) -> None:
        assert tick.output is not None
        if tick.output.goal is not None:
            self.time.append(tick.given.now - (self.began if self.began is not None else np.inf))
            self.states.append(tick.output.run_state)
            self.goals.append(tick.output.goal.posture)
            self.q.append(tick.output.state.commanded.q)

    def between(self, start: float, end: float) -> FloatArray:
        """The goals (T, n), rad, from s to s after following began."""
        time = np.array(self.time)
        return np.array(self.goals)[(time >= start) & (time < end)]

    def state_at(self, time: float) -> RunState:
        return self.states[int(np.searchsorted(self.time, time))]


def follow(script: Script, seconds: float, *, stops: bool = False) -> tuple[Ending, Scripted]:
    """A run to its end, which is that of the script unless it stops before."""
    clock = VirtualClock()
    seen = Scripted(clock, script, seconds)
    with following(clock) as (prepared, seen.actions):
        ending = prepared.loop(seen, [seen]).run()
    assert not seen.failure and stops is (ending.reason != "enough")
    goals = np.array(seen.goals)
    assert limit_violations(goals, ROBOT.limits, prepared.samples.dt) == LimitViolations(0, 0, 0)
    return ending, seen


def moved(**by: float) -> FloatArray:
    target = STANCE.copy()
    for joint, angle in by.items():
        target[ROBOT.joint_map.joints.index(joint)] += angle
    return target


def speeds(goals: FloatArray) -> FloatArray:
    """Share of its greatest speed that the fastest joint uses, (T,)."""
    moved = np.abs(np.diff(goals, axis=0)) * ROBOT.profile.safety.rate_hz
    return np.asarray((moved / ROBOT.limits.max_velocity).max(axis=1))


def test_a_far_target_is_approached_slowly_and_then_followed_closely() -> None:
    def swings(at: float) -> FloatArray:
        return moved(l_sho_pitch=0.8 + 0.4 * np.sin(3.0 * at), r_el=0.3 * np.sin(2.0 * at))

    _, seen = follow(lambda at, _: swings(at), 8.0)
    assert speeds(seen.between(0.0, 0.6)).max() < 2.0 * APPROACH  # its offset fades while the target moves
    goals, time = seen.between(4.0, 8.0), np.array([at for at in seen.time if 4.0 <= at < 8.0])
    errors = [np.abs(goals - np.array([swings(at - lag) for at in time])).max() for lag in np.arange(0.0, 0.3, 0.01)]
    assert min(errors) < 0.02 and 0.01 * int(np.argmin(errors)) < 0.16
    assert {state for at, state in zip(seen.time, seen.states, strict=True) if 0.0 < at < 8.0} == {RunState.FOLLOW}


def test_without_actions_it_holds_and_then_goes_to_rest() -> None:
    target = moved(l_sho_pitch=0.5)
    ending, seen = follow(lambda at, _: target if at < 2.0 else None, 30.0, stops=True)
    limit = 1e-3 * STALE_MS
    assert seen.state_at(2.0 + limit - 0.05) is RunState.FOLLOW and seen.state_at(2.0 + limit + 0.05) is RunState.HOLD
    assert seen.state_at(2.0 + limit + LONGEST_HOLD_S + 1.0) in (RunState.RETURN_TO_STANCE, RunState.GO_TO_REST)
    assert ending.state is RunState.OFF
    shows(ending.reason, STALE_MS, LONGEST_HOLD_S)
    rest = ROBOT.posture(ROBOT.profile.postures.rest)[ROBOT.servo_columns]
    np.testing.assert_allclose(seen.goals[-1], rest, atol=1e-6)


def test_after_a_gap_it_stands_and_comes_back_slowly() -> None:
    def gap(at: float, _: Actions) -> FloatArray | None:
        if 1.0 < at < 3.0:
            return None
        return moved(l_sho_pitch=0.2 if at <= 1.0 else 0.9)

    _, seen = follow(gap, 7.0)
    held = seen.between(2.0, 3.0)
    assert (held == held[0]).all() and seen.state_at(2.5) is RunState.HOLD
    back = seen.between(3.0, 7.0)
    assert speeds(back).max() < 1.05 * APPROACH
    np.testing.assert_allclose(back[-1], gap(7.0, seen.actions), atol=1e-3)  # type: ignore[arg-type]


def test_a_jump_is_made_slowly() -> None:
    def jumps(at: float, _: Actions) -> FloatArray:
        return moved(l_sho_pitch=0.0 if at < 1.0 else 1.4, head_pan=0.0 if at < 1.0 else -0.6)

    _, seen = follow(jumps, 5.0)
    assert seen.state_at(1.5) is RunState.FOLLOW
    assert speeds(seen.between(1.0, 5.0)).max() < 1.05 * APPROACH
    np.testing.assert_allclose(seen.between(1.0, 5.0)[-1], jumps(5.0, seen.actions), atol=1e-3)  # type: ignore[arg-type]


def test_a_refused_action_holds_the_robot_until_a_good_one_comes() -> None:
    def refuses_once(at: float, actions: Actions) -> FloatArray | None:
        if 1.0 < at < 2.0:
            bad = dict.fromkeys(action_names(ROBOT.joint_map.joints), np.nan)
            try:
                read_action(bad, action_names(ROBOT.joint_map.joints))
            except InputError as error:
                actions.refuse(f"the last action was refused: {error.problems[0].what}")
            return None
        return moved(l_sho_pitch=0.3 * at)

    _, seen = follow(refuses_once, 4.0)
    assert seen.state_at(1.1) is RunState.HOLD and seen.state_at(3.5) is RunState.FOLLOW
    held = seen.between(1.6, 2.0)
    assert np.isfinite(held).all() and (held == held[0]).all()


def test_the_clutch_holds_without_a_limit() -> None:
    def let_go(at: float, actions: Actions) -> FloatArray:
        actions.clutch(engaged=not 1.0 < at < 9.0)
        return moved(l_sho_pitch=0.5 if at < 2.0 else 0.1)

    _, seen = follow(let_go, 12.0)
    assert seen.state_at(8.9) is RunState.HOLD and seen.state_at(11.9) is RunState.FOLLOW
    assert speeds(seen.between(9.0, 12.0)).max() < 1.05 * APPROACH


@pytest.mark.parametrize("by", [{"l_sho_roll": 1.5, "l_el": 1.2, "r_sho_roll": -1.5}, {"l_hip_roll": -0.5}])
def test_a_target_in_the_body_is_not_reached(by: dict[str, float]) -> None:
    target = moved(**by)
    _, seen = follow(lambda at, _: target, 6.0)
    assert np.abs(seen.between(5.0, 6.0)[-1] - target).max() > 0.05
    observers = robot_observers(ROBOT)
    assert not any(contacts(ROBOT.body, observers, None, q) for q in seen.q[::10])


def test_a_target_that_would_tip_the_robot_is_followed_only_as_far_as_it_stands() -> None:
    target = moved(l_ank_pitch=0.5, r_ank_pitch=-0.5)
    _, seen = follow(lambda at, _: target, 6.0)
    assert np.abs(seen.between(5.0, 6.0)[-1] - target).max() > 0.1
    edges = plant(ROBOT, ROBOT.profile.postures.stand).edges(0.0)
    follows = np.array(seen.q)[(np.array(seen.time) > 0.0) & (np.array(seen.time) < 6.0)]
    com = ROBOT.kinematics.centre_of_mass(np.ascontiguousarray(follows[::10]))
    assert min(float(support_distance(point, edges)) for point in com) > 0.0
    unbalanced = seen.q[0].copy()
    unbalanced[ROBOT.servo_columns] = target
    plant_root(ROBOT, seen.q[0], unbalanced)
    tipped = ROBOT.kinematics.centre_of_mass(unbalanced[None])[0]
    assert float(support_distance(tipped, edges)) < 0.0


@pytest.mark.parametrize("stale_ms", [0.0, -1.0, float("nan"), 1e5])
def test_an_impossible_freshness_limit_is_refused(stale_ms: float) -> None:
    with refuses(UsageError, "stale_ms"), following(VirtualClock(), stale_ms=stale_ms):
        pass
