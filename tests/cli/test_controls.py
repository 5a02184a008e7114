"""Controls of a live run: dead-man key and pedal, pause, space bar, stop file, control socket, in whole runs of OP3."""

import errno
import io
import json
import os
import pty
import select
import socket
import sys
import termios
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.errors import HardwareError
from hardware.guard_state import StopCause
from hardware.key_device import EVENT
from live_rig import LiveRig
from messages import refuses, shows
from retarget.cli import main
from retarget.cli.controls import (
    LET_GO_S,
    LONGEST_S,
    NEEDED,
    SOCKET,
    SPACE,
    Clutch,
    HeldKey,
    Keys,
    LiveControls,
    LiveStatus,
    Oversight,
    live_state,
    open_dead_man,
    refuse_oversight,
    words_for,
)
from retarget.cli.exit import StopRequest
from retarget.errors import UsageError
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.run.control_socket import ControlSocket, connect_to
from retarget.run.loop import Watch
from retarget.run.prepare import Prepared
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.run.supervisor import LONGEST_HOLD_S
from retarget.types import FloatArray
from sim.faults.sender import FakeSender

DT = 0.008
LET_GO = ((2.0, 2.7), (6.0, 11.4))
SECONDS = 10.0


class FakePedal(HeldKey):
    """Held by a script, over the time of the run."""

    label = "a pedal"

    def __init__(self, held: Callable[[float], bool]) -> None:
        self._script, self.lost = held, ""
        self.begun: float | None = None

    def held(self, pressed: str, now: float) -> bool:
        """Whether it is pressed now."""
        self.begun = now if self.begun is None else self.begun
        return self._script(now - self.begun)

    def close(self) -> None:
        """Nothing is open."""


class NoKeys(Keys):
    """A keyboard without keys pressed."""

    def __init__(self) -> None:
        """No terminal."""

    def pressed(self) -> str:
        """Nothing."""
        return ""


def played(
    held: Callable[[float], bool], seconds: float, *, most: float = np.inf
) -> tuple[LiveRig, RunResult, list[str]]:
    """The run, and its state before every tick. most: s, after which it is stopped."""
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=seconds))
    states: list[str] = []
    with rig.prepared() as prepared:
        performer, stop = prepared.samples, StopRequest()
        assert isinstance(performer, LivePerformer) and prepared.machine is not None
        machine = prepared.machine
        clutch = Clutch(performer, clock=rig.clock, notify=rig.said.append, dead_man=FakePedal(held))
        controls = LiveControls(NoKeys(), stop, performer, clutch, notify=rig.said.append, machine=machine)

        def look() -> bool:
            states.append(machine.supervisor.state.value)
            return controls.look() or len(states) * DT > most

        return rig, prepared.run(Watch(stop_asked=look, torque_off_asked=controls.forced_stop)), states


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
    assert set(states) == {"approach", "hold"}
    assert not (result.record.phase == Phase.FOLLOW).any()


def test_let_go_it_holds_within_two_ticks_and_stands_soon() -> None:
    _, result, states = clutched()
    steps = np.abs(np.diff(goals_of(result), axis=0)).max(axis=1)
    for begun, ended in LET_GO:
        first = round(begun / DT)
        assert steps[first - 3 : first].max() > 1e-4, "it moved"
        assert "hold" in states[first : first + 4], states[first - 1 : first + 8]
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
    rig, result, _ = clutched()
    assert result.stop is None and LET_GO[1][1] - LET_GO[1][0] > LONGEST_HOLD_S
    assert (
        rig.said.count("dead-man control released: the robot holds") == 2
        and rig.said.count("dead-man control held") == 3
    )
    phases = result.record.phase
    assert (phases[: round(LET_GO[0][0] / DT)] == Phase.APPROACH).all() and (phases == Phase.FOLLOW).any()
    assert result.record.robot is not None
    assert not result.record.robot.gated[phases == Phase.APPROACH].any()


def test_a_pedal_that_is_gone_is_let_go_and_said_once() -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))
    with rig.prepared() as prepared:
        performer, pedal = prepared.samples, FakePedal(lambda time: not pedal.lost)
        assert isinstance(performer, LivePerformer)
        clutch = Clutch(performer, clock=rig.clock, notify=rig.said.append, dead_man=pedal)
        seen = [(performer.paused, clutch.engaged)]
        for reason in ("", *3 * ("event7: No such device",)):
            pedal.lost = reason
            clutch.look("")
            seen.append((performer.paused, clutch.engaged))
        assert seen == [(True, False), (False, True), *3 * ((True, False),)]
        assert len([text for text in rig.said if "No such device" in text]) == 1


def test_let_go_for_too_long_it_is_to_stop() -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))
    with rig.prepared() as prepared:
        assert isinstance(prepared.samples, LivePerformer)
        clutch = Clutch(prepared.samples, clock=rig.clock, notify=rig.said.append)
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
        clutch = Clutch(
            prepared.samples, clock=rig.clock, notify=rig.said.append, dead_man=FakePedal(lambda time: held)
        )
        clutch.look("")
        seen = []
        for act in (clutch.pause, clutch.unpause):
            act()
            seen.append((clutch.engaged, prepared.samples.engagement.wanted))
        assert seen == [(False, False), (held, held)]


def test_a_pedal_with_and_without_a_key(tmp_path: Path) -> None:
    path = tmp_path / "event3"
    os.mkfifo(path)
    fd = os.open(path, os.O_RDWR)
    for text, code, counts in (("", 57, True), ("#57", 57, True), ("#57", 30, False)):
        dead_man = open_dead_man(f"pedal:{path}{text}", terminal=False)
        assert not dead_man.held("", 0.0) and str(path) in dead_man.label
        os.write(fd, EVENT.pack(0, 0, 1, code, 1))
        assert dead_man.held("", 0.0) == counts and not dead_man.lost
        dead_man.close()
    dead_man = open_dead_man(f"pedal:{path}", terminal=False)
    os.close(fd)
    assert not dead_man.held("", 0.0) and f"{path}: " in dead_man.lost


def test_a_key_needs_a_terminal() -> None:
    assert "'b'" in open_dead_man("b", terminal=True).label
    with refuses(UsageError):
        open_dead_man("b", terminal=False)


@pytest.mark.parametrize(
    "text", ["", " ", "p", "h", "bb", "é", "\x1b", "pedal", "event5", "pedal:event5#a", "pedal:x#"]
)
def test_what_cannot_be_held_is_refused(text: str) -> None:
    with pytest.raises((UsageError, HardwareError)) as refused:
        open_dead_man(text, terminal=True)
    assert "--dead-man" in str(refused.value) or text == "pedal:x#"


HELD_KEY_DT = 0.01


def typed(times: list[float], until: float) -> list[bool]:
    """Whether it is held at every tick, of a key that comes at these times, s."""
    key, waiting = HeldKey("b"), sorted(times)
    found = []
    for tick in range(round(until / HELD_KEY_DT)):
        now = HELD_KEY_DT * tick
        came = "".join("b" for time in waiting if time <= now)
        waiting = [time for time in waiting if time > now]
        found.append(key.held(came, now))
    return found


def test_held_from_its_repeats_on_and_soon_let_go() -> None:
    times = [0.0, *(0.5 + 0.033 * n for n in range(31))]
    held = typed(times, 3.0)
    first, last = held.index(True), len(held) - 1 - held[::-1].index(True)
    assert 0.5 < HELD_KEY_DT * first < 0.65 and all(held[first : last + 1])
    assert times[-1] < HELD_KEY_DT * last <= times[-1] + LET_GO_S + HELD_KEY_DT


def test_a_tap_and_a_pasted_text_are_not_held() -> None:
    assert not any(typed([0.0, 0.4, 0.8, 1.2, 1.6], 2.0))
    assert not HeldKey("b").held("b" * 50, 0.0)
    assert not HeldKey("b").held("xyz", 0.0)


def test_another_key_lets_go_and_a_long_pasted_text_is_not_held() -> None:
    """A text comes in pieces of 64 characters, look after look, and most of them have the letter in them."""
    key = HeldKey("b")
    assert [key.held("b", 0.05 * look) for look in range(5)] == [False, False, False, True, True]
    assert not key.held("x", 0.25) and not key.held("b", 0.3) and not key.held("", 0.31)
    for look in range(20):
        assert not key.held("a robber grabbed a bob", 1.0 + HELD_KEY_DT * look)


def test_slow_keyboards_repeat_too() -> None:
    assert any(typed([0.09 * n for n in range(10)], 1.0))


@settings(max_examples=60)
@given(st.lists(st.floats(0.0, 3.0), max_size=40))
def test_never_held_without_repeats_just_before(times: list[float]) -> None:
    for tick, held in enumerate(typed(times, 3.5)):
        if held:
            now = HELD_KEY_DT * tick
            recent = [time for time in times if now - LET_GO_S - HELD_KEY_DT <= time <= now]
            assert recent and sum(time <= now for time in times) >= NEEDED


def test_keys_come_without_enter_and_the_terminal_is_as_it_was() -> None:
    master, terminal = pty.openpty()
    try:
        before = termios.tcgetattr(terminal)
        with Keys(terminal) as keys:
            assert keys.listens and keys.pressed() == ""
            os.write(master, b" p")
            assert keys.pressed() == " p"
            assert termios.tcgetattr(terminal) != before
        assert termios.tcgetattr(terminal) == before
        os.close(master)
        master = -1
        assert keys.pressed() == "" and keys.pressed() == ""
    finally:
        for fd in (master, terminal):
            if fd >= 0:
                os.close(fd)


def test_ctrl_s_is_a_key_and_holds_nothing_up() -> None:
    master, terminal = pty.openpty()
    try:
        with Keys(terminal) as keys:
            os.write(master, b"\x13")
            assert keys.pressed() == "\x13"
            os.write(terminal, b"text")
            assert select.select((master,), (), (), 1.0)[0] and os.read(master, 9) == b"text"
        assert termios.tcgetattr(terminal)[0] & termios.IXON
    finally:
        os.close(master)
        os.close(terminal)


def test_a_terminal_that_goes_away_is_no_error() -> None:
    master, terminal = pty.openpty()
    with Keys(terminal) as keys:
        os.close(master)
        assert keys.listens
    os.close(terminal)


def test_without_a_terminal_there_are_none() -> None:
    reading, writing = os.pipe()
    os.close(writing)
    with Keys() as keys:
        assert keys.pressed() == ""
    os.close(reading)


class Typed(Keys):
    """A keyboard that types by itself."""

    def __init__(self, keys: dict[int, str], *, terminal: bool = True) -> None:
        self._keys, self._looks, self._terminal = keys, 0, terminal

    @property
    def listens(self) -> bool:
        """Whether there is one."""
        return self._terminal

    def pressed(self) -> str:
        """What is due at this look."""
        self._looks += 1
        return self._keys.get(self._looks, "")


def live_controls_played(
    keys: dict[int, str],
    *,
    stop_file: Path | None = None,
    socket: ControlSocket | None = None,
    each: Callable[[int], None] = lambda look: None,
) -> tuple[LiveRig, RunResult]:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=5.0))
    with rig.prepared() as prepared:
        return rig, _run(rig, prepared, keys, stop_file, socket, each)


def _run(
    rig: LiveRig,
    prepared: Prepared,
    keys: dict[int, str],
    stop_file: Path | None,
    socket: ControlSocket | None,
    each: Callable[[int], None],
) -> RunResult:
    stop, performer = StopRequest(), prepared.samples
    assert isinstance(performer, LivePerformer)
    notify = rig.said.append
    clutch = Clutch(performer, clock=rig.clock, notify=notify)
    controls = LiveControls(
        Typed(keys),
        stop,
        performer,
        clutch,
        notify=notify,
        clock=rig.clock,
        machine=prepared.machine,
        stop_file=stop_file,
        socket=socket,
    )
    looks = 0

    def look() -> bool:
        nonlocal looks
        looks += 1
        each(looks)
        return controls.look()

    return prepared.run(Watch(stop_asked=look, torque_off_asked=controls.forced_stop, why=controls.why))


def test_the_space_bar_stops_and_the_robot_goes_to_rest() -> None:
    rig, result = live_controls_played({500: " "})
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


def test_the_space_bar_again_switches_torque_off_at_once() -> None:
    _, once = live_controls_played({500: " "})
    rig, twice = live_controls_played({500: " ", 660: " "})
    assert len(twice.record) < 660 < len(once.record) - 60
    assert not rig.bus.torque_on and twice.stop is not None
    shows(twice.stop.reason)


def test_a_space_bar_that_is_held_stops_once_and_torque_stays() -> None:
    """Repeats 30 times a second after half a second, and two that are read at once."""
    _, once = live_controls_played({500: " "})
    rig, held = live_controls_played({500: " ", 502: "  "} | dict.fromkeys(range(562, 1000, 4), " "))
    assert len(held.record) == len(once.record) and rig.said.count("stopping") == 1
    assert held.stop is not None and held.stop.reason == SPACE


def test_a_pause_holds_and_goes_on() -> None:
    rig, result = live_controls_played({450: "p", 550: "p"})
    assert rig.said.count("paused: the robot holds; p goes on") == rig.said.count("going on") == 1
    assert rig.said.count("the performer is followed") == 2
    assert result.stop is None


def test_a_new_heading_is_taken_without_a_jump() -> None:
    rig, result = live_controls_played({450: "h"})
    shows(rig.said)
    assert rig.said.count("the performer is followed") == 2
    steps = np.linalg.norm(np.diff(result.clip.frames.position, axis=0), axis=2)
    assert np.nanmax(steps) < 0.05 and result.stop is None


def test_a_file_that_appears_stops_the_robot(tmp_path: Path) -> None:
    file = tmp_path / "stop"

    def appear(look: int) -> None:
        if look == 451:
            file.touch()

    rig, result = live_controls_played({}, stop_file=file, each=appear)
    shows(rig.said, file)
    assert result.stop is not None and result.reason == result.stop.reason == f"{file} is there"


def test_where_the_file_is_there_at_the_first_look_nothing_gets_torque(tmp_path: Path) -> None:
    """It appeared while the performer was measured."""
    file = tmp_path / "stop"
    file.touch()
    rig, stop = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0)), StopRequest()
    with rig.prepared() as prepared:
        assert isinstance(prepared.samples, LivePerformer)
        clutch = Clutch(prepared.samples, clock=rig.clock, notify=rig.said.append)
        controls = LiveControls(Typed({}), stop, prepared.samples, clutch, notify=rig.said.append, stop_file=file)
        assert controls.look() and stop.why() == f"{file} is there"


def test_why_the_robot_stops_is_reported_while_it_does() -> None:
    """Once, of a servo that reports an error, without a key pressed."""
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=5.0))
    torque: list[bool] = []
    with rig.prepared() as prepared:
        stop, performer, machine = StopRequest(), prepared.samples, prepared.machine
        assert isinstance(performer, LivePerformer) and machine is not None

        def notify(text: str) -> None:
            rig.said.append(text)
            torque.append(rig.bus.torque_on)

        clutch = Clutch(performer, clock=rig.clock, notify=notify)
        controls = LiveControls(Typed({}), stop, performer, clutch, notify=notify, clock=rig.clock, machine=machine)
        looks = 0

        def look() -> bool:
            nonlocal looks
            looks += 1
            if looks == 450:
                machine.guard.latch(StopCause.SERVO_ALERT, "servo reports overload: l_knee (id 11)")
            return controls.look()

        rig.said.clear()
        prepared.run(Watch(stop_asked=look, torque_off_asked=controls.forced_stop, why=controls.why))
    line = "stopping: servo reports overload: l_knee (id 11)"
    assert rig.said.count(line) == 1 and torque[-1] and not rig.bus.torque_on
    assert not any("stopping: " in text for text in live_controls_played({500: " "})[0].said)


class Unreadable(type(Path())):  # type: ignore[misc]
    """A file of a drive that has failed, from some look on."""

    failed = False

    def lstat(self) -> os.stat_result:
        """Fail to look."""
        raise OSError(errno.EIO, os.strerror(errno.EIO)) if self.failed else FileNotFoundError


def test_a_file_that_cannot_be_looked_for_stops_the_robot_as_well() -> None:
    """It brakes and goes to rest as ever, and checks that fail meanwhile switch no torque off."""
    file = Unreadable("stop")

    def fail(look: int) -> None:
        file.failed = look > 430

    rig, result = live_controls_played({}, stop_file=file, each=fail)
    _, asked = live_controls_played({432: " "})
    note = f"stop cannot be looked for ({os.strerror(errno.EIO)}): stopping"
    assert rig.said.count(note) == 1 and result.stop is not None
    assert result.stop.reason == note.removesuffix(": stopping") and abs(len(result.record) - len(asked.record)) < 10


def test_a_file_in_a_place_that_cannot_be_reached_stops_the_robot(tmp_path: Path) -> None:
    """What `Path.exists` calls absent: its folder is gone, has become a file, or is a link that leads in a circle."""
    link, folder = tmp_path / "circle", tmp_path / "folder"
    link.symlink_to(link)
    folder.touch()
    for file, reason in (
        (link / "stop", os.strerror(errno.ELOOP)),
        (folder / "stop", os.strerror(errno.ENOTDIR)),
        (tmp_path / "gone" / "stop", "its folder is not there"),
    ):
        rig, stop = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0)), StopRequest()
        with rig.prepared() as prepared:
            assert isinstance(prepared.samples, LivePerformer)
            clutch = Clutch(prepared.samples, clock=rig.clock, notify=rig.said.append)
            controls = LiveControls(Typed({}), stop, prepared.samples, clutch, notify=rig.said.append, stop_file=file)
            for _ in range(5):
                controls.look()
        assert stop() and stop.why() == f"{file} cannot be looked for ({reason})"


def test_a_stop_is_requested_before_it_is_reported() -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))

    def gone(text: str) -> None:
        raise BrokenPipeError

    with rig.prepared() as prepared:
        assert isinstance(prepared.samples, LivePerformer)
        stop, clutch = StopRequest(), Clutch(prepared.samples, clock=rig.clock, notify=gone)
        controls = LiveControls(Typed({1: " "}), stop, prepared.samples, clutch, notify=gone, clock=rig.clock)
        with pytest.raises(BrokenPipeError):
            controls.look()
        assert stop() and not stop.forced_stop()


def test_a_socket_holds_stops_and_answers_and_gives_no_motion(tmp_path: Path) -> None:
    answers: dict[int, str] = {}
    asked = {450: "status", 460: "hold", 480: "resume", 490: "status", 600: "stop"}
    with ControlSocket(tmp_path / "control") as socket, connect_to(socket.path) as client:

        def each(look: int) -> None:
            if look in asked:
                client.sendall(asked[look].encode() + b"\n")
            if look - 1 in asked:
                answers[look - 1] = client.recv(500).decode()

        rig, result = live_controls_played({}, socket=socket, each=each)
        answers[600] = client.recv(500).decode()
    assert json.loads(answers[450]) == {"state": "follow", "followed": True, "let_go": False, "stop": None}
    assert answers[460] == "ok holding\n" and answers[600] == "ok stopping\n"
    assert answers[480].startswith("error: found 'resume', allowed: stop, torque_off, hold, status")
    assert json.loads(answers[490]) == {"state": "hold", "followed": False, "let_go": True, "stop": None}
    shows(rig.said)
    assert rig.said.count("the performer is followed") == 1
    assert result.stop is not None and result.stop.reason == SOCKET and not rig.bus.torque_on


def test_a_pause_says_only_what_lets_it_go_on(tmp_path: Path) -> None:
    """`p` where there is a terminal; and no motion is promised where a pedal is not held."""
    for terminal, says in ((True, "; p goes on"), (False, "so stop it: `retarget stop`")):
        rig, stop = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0)), StopRequest()
        with rig.prepared() as prepared, ControlSocket(tmp_path / "control") as socket:
            performer = prepared.samples
            assert isinstance(performer, LivePerformer)
            clutch = Clutch(performer, clock=rig.clock, notify=rig.said.append, dead_man=HeldKey("b"))
            keys = Typed({2: "p"}, terminal=terminal)
            controls = LiveControls(keys, stop, performer, clutch, notify=rig.said.append, socket=socket)
            with connect_to(socket.path) as client:
                client.sendall(b"hold\n")
                controls.look()
                assert rig.said[-1].startswith("paused by the control socket") and rig.said[-1].endswith(says)
                controls.look()
        assert rig.said[-1] == "no pause any more: it goes on when it is held" and not clutch.engaged


def test_a_socket_switches_torque_off_at_once(tmp_path: Path) -> None:
    with ControlSocket(tmp_path / "control") as socket, connect_to(socket.path) as client:

        def each(look: int) -> None:
            if look == 500:
                client.sendall(b"torque_off\n")

        rig, result = live_controls_played({}, socket=socket, each=each)
    assert not rig.bus.torque_on and result.stop is not None
    shows(result.stop.reason)


def test_words() -> None:
    assert words_for(LiveStatus("follow", True, False, None)) == "following"
    assert words_for(LiveStatus("hold", False, False, None)) == "holding"
    assert words_for(LiveStatus("approach", True, False, None)) == "approaching the performer"
    assert words_for(LiveStatus("hold", False, True, None)) == "paused: holding"
    assert words_for(LiveStatus("stopping", True, True, "SIGTERM")) == "stopping"
    assert words_for(LiveStatus("go to rest", True, False, None)) == "stopping"
    assert words_for(LiveStatus(None, True, False, None)) == "following"


class Terminal(io.StringIO):
    """One that a person looks at."""

    def isatty(self) -> bool:
        """Yes."""
        return True


@pytest.mark.parametrize("screen", [Terminal(), io.StringIO()])
def test_a_terminal_shows_it_and_a_pipe_gets_nothing(screen: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with live_state("op3", lambda: "holding"):
        pass
    shown = screen.getvalue()
    assert ("op3" in shown and "holding" in shown and "0:00:00" in shown) if screen.isatty() else not shown
    assert "%" not in shown


def test_what_can_be_had_is_not_refused(tmp_path: Path) -> None:
    refuse_oversight(Oversight(stop_file=tmp_path / "stop"), virtual=True)
    refuse_oversight(Oversight(dead_man="b"), virtual=False)


def test_what_cannot_be_had_is_refused(tmp_path: Path) -> None:
    with refuses(UsageError, "--stop-file"):
        refuse_oversight(Oversight(stop_file=tmp_path), virtual=False)
    for file in (tmp_path / "gone" / "stop", Path("a\0b")):
        with refuses(UsageError, "--stop-file"):
            refuse_oversight(Oversight(stop_file=file), virtual=False)
    with refuses(UsageError):
        refuse_oversight(Oversight(dead_man="b"), virtual=True)
    with refuses(HardwareError, "--core"):
        refuse_oversight(Oversight(core=4096), virtual=False)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--realtime 0", "--realtime: no such real-time priority; found 0; allowed: 1 to 99"),
        ("--core 4096", "--core: this core cannot be had; found 4096"),
        ("--dead-man b", "--dead-man: there is no terminal on which a key could be held"),
        ("--dead-man pedal:/nowhere/event9", "/nowhere/event9: the device cannot be opened"),
        ("--control-socket /nowhere/x", "--control-socket /nowhere/x: cannot listen: No such file"),
        ("--source walk.bvh --realtime", "--realtime: only a live stream has this"),
        (
            "--source walk.bvh --dead-man b --control-socket",
            "--dead-man, --control-socket: only a live stream has this",
        ),
    ],
)
def test_on_the_command_line_too(words: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", "--robot", "human", "--source", "json://:14150", *words.split()])
    assert ended.value.code == 2 and said in capsys.readouterr().err


def test_a_port_that_is_taken_is_refused_with_its_holder(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        with pytest.raises(SystemExit) as ended:
            main(["run", "--robot", "human", "--source", f"json://:{port}"])
    said = capsys.readouterr().err
    assert ended.value.code == 2
    shows(said, "UDP", port)
