"""Who lets go of a robot, and what it does then: in whole runs of OP3, with a pedal that is pressed and let go."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from live_rig import LiveRig
from retarget.cli.clutch import LONGEST_S, Clutch
from retarget.cli.interrupt import StopRequest
from retarget.cli.keys import Keys
from retarget.cli.live_controls import LiveControls
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.pipeline import Watch
from retarget.record import Phase
from retarget.rotations import FloatArray
from retarget.run_result import RunResult
from sim.faults.sender import FakeSender

DT = 0.008
LONGEST_HOLD_S = 1.0
"""Of a hold that nobody wanted, here."""
LET_GO = ((0.3, 1.0), (3.0, 4.4))
SECONDS = 6.0


class FakePedal:
    """Held as it is told, by the time of the run."""

    told = "a pedal"

    def __init__(self, held: Callable[[float], bool]) -> None:
        self._held, self.lost = held, ""
        self.begun: float | None = None

    def held(self, pressed: str, now: float) -> bool:
        """Whether it is pressed now."""
        self.begun = now if self.begun is None else self.begun
        return self._held(now - self.begun)

    def close(self) -> None:
        """Nothing is open."""


class NoKeys(Keys):
    """A keyboard that nobody touches."""

    def __init__(self) -> None:
        """No terminal."""

    def pressed(self) -> str:
        """Nothing."""
        return ""


def played(
    held: Callable[[float], bool], seconds: float, *, most: float = np.inf
) -> tuple[LiveRig, RunResult, list[str]]:
    """The run, and the guard's state before every tick. most: s, after which somebody stops it."""
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=seconds))
    states: list[str] = []
    with rig.prepared() as prepared:
        performer, stop = prepared.samples, StopRequest()
        assert isinstance(performer, LivePerformer) and prepared.side is not None
        guard = prepared.side.guard
        guard.limits = replace(guard.limits, max_hold=LONGEST_HOLD_S)
        clutch = Clutch(performer, clock=rig.clock, tell=rig.said.append, guard=guard, dead_man=FakePedal(held))
        controls = LiveControls(NoKeys(), stop, performer, clutch, tell=rig.said.append, guard=guard)

        def look() -> bool:
            states.append(guard.state.value)
            return controls.look() or len(states) * DT > most

        return rig, prepared.run(Watch(stop_asked=look, cut_asked=controls.insisted)), states


def goals_of(result: RunResult) -> FloatArray:
    """Goals sent, (T, n) rad."""
    assert result.record.robot is not None and result.robot is not None
    return result.record.robot.q[:, result.robot.servo_columns]


@cache
def clutched() -> tuple[LiveRig, RunResult, list[str]]:
    """Let go during the approach, and for longer than a hold may last while it follows."""
    return played(lambda time: not any(begun <= time < ended for begun, ended in LET_GO), SECONDS)


def test_nothing_moves_before_it_is_held() -> None:
    _, result, states = played(lambda time: False, 1.0, most=2.0)
    goals = goals_of(result)[result.record.phase == Phase.APPROACH]
    assert len(goals) > 1.9 / DT and np.abs(goals - goals[0]).max() == 0.0
    assert not {"moving", "holding"} & set(states)
    assert not (result.record.phase == Phase.FOLLOW).any()


def test_let_go_it_holds_within_two_ticks_and_stands_soon() -> None:
    _, result, states = clutched()
    steps = np.abs(np.diff(goals_of(result), axis=0)).max(axis=1)
    for begun, ended in LET_GO:
        first = round(begun / DT)
        assert steps[first - 3 : first].max() > 1e-4, "it moved"
        assert "holding" in states[first : first + 4], states[first - 1 : first + 8]
        still = slice(first + round(0.35 / DT), first + round((ended - begun) / DT) - 1)
        assert steps[still].max() == 0.0, begun


def test_taken_up_again_it_moves_within_limits_and_not_at_once() -> None:
    _, result, _ = clutched()
    goals, robot = goals_of(result), result.robot
    assert robot is not None and result.record.robot is not None
    joints = robot.joint_map
    velocity = np.diff(goals, axis=0) / DT
    acceleration = np.diff(velocity, axis=0) / DT
    assert (np.abs(velocity) <= joints.max_velocity * 1.001).all()
    assert (np.abs(acceleration) <= joints.max_acceleration * 1.001).all()
    # Back on the way of the approach slowly: no faster than it was laid out.
    share = robot.profile.safety.speed_caps.approach
    back = slice(round(LET_GO[0][1] / DT), round(LET_GO[0][1] / DT) + 40)
    assert (np.abs(velocity[back]) <= share * joints.max_velocity * 1.05).all()
    steps = np.abs(np.diff(goals, axis=0)).max(axis=1)
    again = round(LET_GO[1][1] / DT)
    assert steps[again : again + round(0.49 / DT)].max() == 0.0
    assert steps[again + round(0.5 / DT) :].max() > 0.0


def test_a_hold_on_purpose_does_not_end_the_run_and_the_approach_is_gone_to_its_end() -> None:
    rig, result, states = clutched()
    assert result.stop is None and states.count("stopping") == 0
    assert rig.said.count("let go: the robot holds") == 2 and rig.said.count("held") == 3
    phases = result.record.phase
    assert (phases[: round(0.3 / DT)] == Phase.APPROACH).all() and (phases == Phase.FOLLOW).any()
    assert result.record.robot is not None
    assert not result.record.robot.gated[phases == Phase.APPROACH].any()


def test_a_pedal_that_is_gone_is_let_go_and_said_once() -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))
    with rig.prepared() as prepared:
        assert isinstance(prepared.samples, LivePerformer) and prepared.side is not None
        pedal = FakePedal(lambda time: not pedal.lost)
        guard = prepared.side.guard
        clutch = Clutch(prepared.samples, clock=rig.clock, tell=rig.said.append, guard=guard, dead_man=pedal)
        seen = [(guard.paused, clutch.engaged)]
        for reason in ("", *3 * ("event7: No such device",)):
            pedal.lost = reason
            clutch.look("")
            seen.append((guard.paused, clutch.engaged))
        assert seen == [(True, False), (False, True), *3 * ((True, False),)]
        assert len([text for text in rig.said if "No such device" in text]) == 1


def test_let_go_for_too_long_it_is_to_stop() -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))
    with rig.prepared() as prepared:
        assert isinstance(prepared.samples, LivePerformer)
        clutch = Clutch(prepared.samples, clock=rig.clock, tell=rig.said.append)
        seen = [clutch.expired]
        for seconds, act in (
            (0.0, clutch.pause),
            (LONGEST_S - 1.0, clutch.pause),
            (1.1, clutch.pause),
            (0.0, clutch.unpause),
        ):
            rig.clock.advance(seconds)
            act()
            seen.append(clutch.expired)
        assert seen == [False, False, False, True, False]


@pytest.mark.parametrize("held", [True, False])
def test_a_pause_counts_whatever_is_held(held: bool) -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))
    with rig.prepared() as prepared:
        assert isinstance(prepared.samples, LivePerformer)
        clutch = Clutch(prepared.samples, clock=rig.clock, tell=rig.said.append, dead_man=FakePedal(lambda time: held))
        clutch.look("")
        seen = []
        for act in (clutch.pause, clutch.unpause):
            act()
            seen.append((clutch.engaged, prepared.samples.engagement.wanted))
        assert seen == [(False, False), (held, held)]
