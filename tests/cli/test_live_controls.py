"""Controls of a live run, carried out in whole runs of OP3: dead-man, pause, heading, stops, control socket."""

import errno
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from unittest.mock import Mock, create_autospec

import numpy as np
import pytest

from hardware.guard_state import StopCause
from live_rig import LiveRig
from messages import shows
from operators import Asks
from retarget.cli.controls import (
    GRIPS,
    SPACE,
    STOPPED_BY,
    Control,
    ControlRequest,
    ControlSocket,
    Keyboard,
    StopFile,
)
from retarget.cli.exit import StopRequest
from retarget.cli.operator import LONGEST_S, REMINDER_S, TOO_SOON, Announcer, RunOperator
from retarget.cli.stick import KeyStick
from retarget.cli.stop import connect_to
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.robot.walking.gait import LONGEST_STOP_S
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared
from retarget.run.record import Phase
from retarget.run.rest_trajectory import EndPlan
from retarget.run.run_result import RunResult
from retarget.run.supervisor import AT_RISK, LONGEST_HOLD_S, End, OperatorInput
from retarget.run.tick import Machine
from retarget.types import FloatArray, RunState
from rig import Rig, play
from sim.faults.sender import FakeSender

DT = 0.008
LET_GO = ((2.0, 2.7), (6.0, 11.4))
SECONDS = 10.0


class Script:
    """A control that asks by itself: what is due at each poll."""

    def __init__(self, due: Callable[[int], Sequence[tuple[ControlRequest, str]]]) -> None:
        self._due, self._polls = due, count(1)

    def poll(self, now: float) -> Iterator[tuple[ControlRequest, str]]:
        yield from self._due(next(self._polls))


class Typed(Keyboard):
    """A keyboard that types by itself, by the number of the look."""

    def __init__(self, keys: Mapping[int, str], *, stick: KeyStick | None = None) -> None:
        super().__init__(stick=stick)
        self._keys, self._looks = keys, count(1)

    def pressed(self) -> str:
        return self._keys.get(next(self._looks), "")


def grip(held: Callable[[int], bool]) -> Script:
    """A dead-man control that is held by a script, over the polls."""
    return Script(lambda poll: [GRIPS[held(poll)]] if held(poll) is not (poll > 1 and held(poll - 1)) else [])


def rigged(seconds: float = 1.0) -> LiveRig:
    return LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=seconds))


def operator_of(rig: LiveRig, prepared: Prepared, *controls: Control, dead_man: bool = False) -> RunOperator:
    return RunOperator(prepared, StopRequest(), controls=controls, notify=rig.said.append, dead_man=dead_man)


def played(
    *controls: Control,
    seconds: float = 5.0,
    each: Callable[[int, Machine], object] = lambda look, machine: None,
    dead_man: bool = False,
) -> tuple[LiveRig, RunResult, list[str]]:
    """The run, and its state before every tick. each: called before every look."""
    rig, states = rigged(seconds), list[str]()
    with rig.prepared() as prepared:
        operator, machine = operator_of(rig, prepared, *controls, dead_man=dead_man), prepared.machine
        assert machine is not None
        said = Announcer(machine, operator.stop, notify=rig.said.append)

        class Watched(Operator):
            def poll(self, state: RunState | None) -> OperatorInput:
                assert state is not None and prepared.machine is not None
                if state in AT_RISK:
                    states.append(state.value)
                    each(len(states), prepared.machine)
                return operator.poll(state)

        return rig, prepared.run(Watched(), [said]), states


def goals_of(result: RunResult) -> FloatArray:
    """Goals sent, (T, n) rad."""
    assert result.record.robot is not None and result.robot is not None
    return result.record.robot.q[:, result.robot.servo_columns]


@pytest.mark.long
def test_nothing_moves_before_it_is_held() -> None:
    stop = Script(lambda poll: [(ControlRequest.STOP, "enough")] if poll * DT > 2.0 else [])
    _, result, states = played(stop, seconds=1.0, dead_man=True)
    goals = goals_of(result)[result.record.phase == Phase.APPROACH]
    assert len(goals) > 1.9 / DT and np.abs(goals - goals[0]).max() == 0.0
    assert set(states) == {"approach", "hold"}
    assert not (result.record.phase == Phase.FOLLOW).any()


@pytest.mark.long
def test_a_key_walks_and_a_dead_man_that_is_let_go_ends_the_walk_within_two_steps() -> None:
    rig, stick, let_go = rigged(12.0), KeyStick(), 1250
    rig.run_options = RunOptions(robot="op3", steps="walk")
    keys = Typed(dict.fromkeys(range(1, 4000, 5), "w"), stick=stick)
    walks, steps, words = list[bool](), list[int](), list[tuple[str, str]]()
    with rig.prepared() as prepared:
        machine, control = prepared.machine, grip(lambda poll: poll < let_go)
        assert machine is not None and machine.follower.legs is not None
        legs = machine.follower.legs
        operator = RunOperator(prepared, StopRequest(), controls=[keys, control], dead_man=True, stick=stick)

        class Watched(Operator):
            def poll(self, state: RunState | None) -> OperatorInput:
                walks.append(legs.walks)
                steps.append(legs.tally().steps)
                words.append(operator.state_and_reason())
                return operator.poll(state)

        result = prepared.run(Watched(), [])
    moved = np.abs(np.diff(goals_of(result), axis=0)).max(axis=1)
    stood = slice(let_go + round(LONGEST_STOP_S / DT), let_go + round((LONGEST_STOP_S + 0.5) / DT))
    assert walks[let_go - 1] and steps[let_go] >= 3 and moved[let_go : let_go + 20].max() > 0.0
    assert moved[stood].max() == 0.0 and steps[-1] == steps[let_go], "it begins no other step"
    assert result.tally.walk is not None and result.tally.walk.asked_m > 0.3
    shows(words[let_go - 10][1])


def test_let_go_it_holds_within_two_ticks_taken_up_again_it_moves_slowly_and_the_run_goes_on() -> None:
    """Let go during the approach, and for longer than a hold may last while it follows."""
    held = grip(lambda poll: not any(begun <= (poll - 1) * DT < ended for begun, ended in LET_GO))
    rig, result, states = played(held, seconds=SECONDS, dead_man=True)
    goals, robot, sent, phases = goals_of(result), result.robot, result.record.robot, result.record.phase
    assert robot is not None and sent is not None
    steps = np.abs(np.diff(goals, axis=0)).max(axis=1)
    for begun, ended in LET_GO:
        first = round(begun / DT)
        assert steps[first - 3 : first].max() > 1e-4, "it moved"
        assert "hold" in states[first : first + 4], states[first - 1 : first + 8]
        still = slice(first + round(0.35 / DT), first + round((ended - begun) / DT) - 1)
        assert steps[still].max() == 0.0, begun
    velocity = np.diff(goals, axis=0) / DT
    acceleration = np.diff(velocity, axis=0) / DT
    assert (np.abs(velocity) <= robot.joint_map.max_velocity * 1.001).all()
    assert (np.abs(acceleration) <= robot.joint_map.max_acceleration * 1.001).all()
    # Back on the way of the approach slowly: no faster than it was laid out.
    slowly = robot.profile.safety.speed_caps.approach * robot.joint_map.max_velocity * 1.05
    back = slice(round(LET_GO[0][1] / DT), round(LET_GO[0][1] / DT) + 40)
    assert (np.abs(velocity[back]) <= slowly).all()
    again = round(LET_GO[1][1] / DT)
    assert steps[again : again + round(0.49 / DT)].max() == 0.0
    assert steps[again + round(0.5 / DT) :].max() > 0.0
    assert result.stop is None and LET_GO[1][1] - LET_GO[1][0] > LONGEST_HOLD_S
    assert rig.said.count(GRIPS[False][1]) == 2 and rig.said.count(GRIPS[True][1]) == 3
    assert (phases[: round(LET_GO[0][0] / DT)] == Phase.APPROACH).all() and (phases == Phase.FOLLOW).any()
    assert not sent.gated[phases == Phase.APPROACH].any()


def test_held_on_purpose_for_too_long_it_is_to_stop() -> None:
    rig = rigged()
    with rig.prepared() as prepared:
        asked = {2: ControlRequest.HOLD, 4: ControlRequest.PAUSE, 5: ControlRequest.PAUSE}
        operator = operator_of(rig, prepared, Script(lambda poll: [(asked[poll], "")] if poll in asked else []))
        seen = []
        for seconds in (0.0, 0.0, LONGEST_S - 1.0, 0.0, 0.0, LONGEST_S - 1.0, 1.1):
            rig.clock.advance(seconds)
            seen.append(operator.poll(None).stop)
        assert seen[:-1] == [None] * 6
        shows(seen[-1])


@pytest.mark.parametrize("held", [True, False])
def test_a_pause_counts_whatever_is_held(held: bool) -> None:
    rig = rigged()
    with rig.prepared() as prepared:
        keys = Typed({2: "p", 3: "p"})
        operator = operator_of(rig, prepared, grip(lambda poll: held), keys, dead_man=True)
        assert isinstance(prepared.samples, LivePerformer)
        seen = []
        for _ in range(3):
            operator.poll(None)
            seen.append((operator.engaged, prepared.samples.engagement.engaged))
        assert seen == [(held, held), (False, False), (held, held)]
        shows(rig.said[-1])


def test_the_space_bar_stops_and_the_robot_goes_to_rest() -> None:
    rig, result, _ = played(Typed({500: " "}))
    assert result.stop is not None and result.stop.reason == SPACE
    shows(rig.said)
    assert not rig.bus.torque_on
    robot, sent = result.robot, result.record.robot
    assert robot is not None and sent is not None
    rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    away = np.abs(sent.q[:, robot.servo_columns] - rest).max(axis=1)
    braking = np.flatnonzero(result.record.phase == Phase.BRAKE)
    braking = braking[braking > 500 - 10]
    assert away[-1] < 1e-6 < away[braking[0]] and len(braking) * result.clip.dt <= 4.0


@pytest.mark.long
def test_the_space_bar_again_switches_torque_off_at_once_and_a_held_one_does_not() -> None:
    """Held: repeats 30 times a second after half a second, and two that are read at once."""
    _, once, _ = played(Typed({500: " "}))
    rig, twice, _ = played(Typed({500: " ", 660: " "}))
    assert len(twice.record) < 660 < len(once.record) - 60
    assert not rig.bus.torque_on and twice.stop is not None
    shows(twice.stop.reason)
    rig, held, _ = played(Typed({500: " ", 502: "  "} | dict.fromkeys(range(562, 1000, 4), " ")))
    assert len(held.record) == len(once.record) and sum("stopping" in text for text in rig.said) == 1
    assert held.stop is not None and held.stop.reason == SPACE
    assert rig.said.count(TOO_SOON) == 1 and TOO_SOON in played(Typed({500: " ", 520: " "}))[0].said


def test_a_file_that_appears_stops_the_robot(tmp_path: Path) -> None:
    file = tmp_path / "stop"
    rig, result, _ = played(StopFile(file), each=lambda look, machine: file.touch() if look == 551 else None)
    shows(rig.said, file)
    assert result.stop is not None and result.reason == result.stop.reason == f"{file} is there"


@pytest.mark.long
def test_a_file_that_cannot_be_looked_for_stops_the_robot_as_well() -> None:
    """It brakes and goes to rest as ever, and checks that fail meanwhile switch no torque off."""
    file = create_autospec(Path("stop"), __str__=lambda file: "stop")
    failed = OSError(errno.EIO, os.strerror(errno.EIO))

    def each(look: int, machine: Machine) -> None:
        file.lstat.side_effect = failed if look > 530 else FileNotFoundError

    _, result, _ = played(StopFile(file), each=each)
    _, asked, _ = played(Typed({532: " "}))
    assert result.stop is not None and abs(len(result.record) - len(asked.record)) < 10
    assert result.stop.reason == f"stop cannot be looked for ({os.strerror(errno.EIO)})"


@pytest.mark.long
def test_why_the_robot_stops_is_reported_while_it_does() -> None:
    """Once, of a servo that reports an error, without a key pressed."""

    def each(look: int, machine: Machine) -> None:
        if look == 450:
            machine.guard.latch(StopCause.SERVO_ALERT, "servo reports overload: l_knee (id 11)")

    rig, _, _ = played(each=each)
    (line,) = [text for text in rig.said if "stopping" in text]
    shows(line)


@pytest.mark.parametrize("gone", [False, True])
def test_how_torque_goes_off_is_said_again_while_a_robot_stands_and_a_lost_terminal_keeps_no_press(gone: bool) -> None:
    rig, notify = Rig(np.zeros((10, 20)), goes_to_rest=True), Mock(side_effect=BrokenPipeError if gone else None)
    rig.machine = replace(rig.machine, waits=True, end_plan=EndPlan(End.STANDING, why="for this test"))

    def held() -> bool:
        supervisor = rig.supervisor
        return supervisor.state is RunState.STANDING and rig.clock.now() - supervisor.since >= 2.1 * REMINDER_S

    announcer = Announcer(rig.machine, StopRequest(), notify=notify)
    ending = play(rig, Asks(torque_off=held), announcer)
    assert ending.state is RunState.OFF and not rig.bus.torque_on
    assert notify.call_count == 3
    shows(notify.call_args.args[0])


def test_a_stop_is_requested_before_anything_is_reported() -> None:
    """Also where the terminal is gone."""
    rig = rigged()
    with rig.prepared() as prepared:
        stop = StopRequest()
        operator = RunOperator(prepared, stop, controls=[Typed({1: " p"})], notify=Mock(side_effect=BrokenPipeError))
        assert operator.poll(None) == OperatorInput(SPACE, fault=(StopCause.SOURCE, "BrokenPipeError"))
        assert stop.why == SPACE and not operator.engaged


def test_a_control_that_fails_hides_no_other() -> None:
    rig = rigged()
    broken = Mock(poll=Mock(side_effect=OSError("gone")))
    socket = Script(lambda poll: [(ControlRequest.TORQUE_OFF, "cut it")])
    with rig.prepared() as prepared:
        asked = operator_of(rig, prepared, broken, socket).poll(RunState.STANDING)
    assert asked == OperatorInput("cut it", torque_off=True, fault=(StopCause.SOURCE, "gone"))


@pytest.mark.long
def test_a_socket_holds_stops_and_answers_and_gives_no_motion(tmp_path: Path) -> None:
    answers: dict[int, str] = {}
    words = {550: "status", 560: "hold", 580: "resume", 590: "status", 700: "stop"}
    rig = rigged(5.0)
    with rig.prepared() as prepared:
        machine = prepared.machine
        assert machine is not None
        server = ControlSocket(tmp_path / "control", status=lambda: operator.status())
        operator, looks = operator_of(rig, prepared, server), 0
        with connect_to(server.path) as client:

            class Watched(Operator):
                def poll(self, state: RunState | None) -> OperatorInput:
                    nonlocal looks
                    looks += 1
                    if looks in words:
                        client.sendall(words[looks].encode() + b"\n")
                    if looks - 1 in words:
                        answers[looks - 1] = client.recv(500).decode()
                    return operator.poll(state)

            result = prepared.run(Watched())
        server.close()
    assert json.loads(answers[550]) == {"state": "follow", "followed": True, "let_go": False, "stop": None}
    assert answers[560] == "ok holding\n" and answers[700] == "ok stopping\n"
    assert answers[580].startswith("error: found 'resume', allowed: stop, torque_off, hold, status")
    assert json.loads(answers[590]) == {"state": "hold", "followed": False, "let_go": True, "stop": None}
    shows(rig.said)
    assert rig.said.count("the performer is followed") == 1
    assert result.stop is not None and result.stop.reason == STOPPED_BY and not rig.bus.torque_on
