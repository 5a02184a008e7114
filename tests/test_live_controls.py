"""What a person may ask of a live run while it runs."""

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hardware.guard_state import StopCause
from live_rig import LiveRig
from retarget.cli.clutch import Clutch
from retarget.cli.control_socket import ControlSocket, connect_to
from retarget.cli.held_key import HeldKey
from retarget.cli.interrupt import StopRequest
from retarget.cli.keys import Keys
from retarget.cli.live_controls import SOCKET, SPACE, LiveControls
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.pipeline import Watch
from retarget.prepare import Prepared
from retarget.record import Phase
from retarget.run_result import RunResult
from sim.faults.sender import FakeSender
from support.messages import shows


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


def played(
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
    assert isinstance(performer, LivePerformer) and prepared.side is not None
    guard, tell = prepared.side.guard, rig.said.append
    clutch = Clutch(performer, clock=rig.clock, tell=tell, guard=guard)
    controls = LiveControls(
        Typed(keys),
        stop,
        performer,
        clutch,
        tell=tell,
        clock=rig.clock,
        guard=guard,
        stop_file=stop_file,
        socket=socket,
    )
    looks = 0

    def look() -> bool:
        nonlocal looks
        looks += 1
        each(looks)
        return controls.look()

    return prepared.run(Watch(stop_asked=look, cut_asked=controls.insisted, why=controls.why))


def test_the_space_bar_stops_and_the_robot_is_parked() -> None:
    rig, result = played({400: " "})
    assert result.stop is not None and result.stop.reason == SPACE
    shows(rig.said)
    assert not rig.bus.torque_on
    robot, sent = result.robot, result.record.robot
    assert robot is not None and sent is not None
    rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    away = np.abs(sent.q[:, robot.servo_columns] - rest).max(axis=1)
    braking = np.flatnonzero(result.record.phase == Phase.BRAKE)
    braking = braking[braking > 400 - 10]
    assert away[-1] < 1e-6 < away[braking[0]] and len(braking) * result.clip.dt <= 3.0


def test_the_space_bar_again_takes_the_torque_at_once() -> None:
    _, once = played({400: " "})
    rig, twice = played({400: " ", 560: " "})
    assert len(twice.record) < 560 < len(once.record) - 100
    assert not rig.bus.torque_on and twice.stop is not None
    shows(twice.stop.reason)


def test_a_space_bar_that_is_held_stops_once_and_torque_stays() -> None:
    """Repeats 30 times a second after half a second, and two that are read at once."""
    _, once = played({400: " "})
    rig, held = played({400: " ", 402: "  "} | dict.fromkeys(range(462, 900, 4), " "))
    assert len(held.record) == len(once.record) and rig.said.count("stopping") == 1
    assert held.stop is not None and held.stop.reason == SPACE


def test_a_pause_holds_and_goes_on() -> None:
    rig, result = played({300: "p", 400: "p"})
    assert rig.said.count("paused: the robot holds; p goes on") == rig.said.count("going on") == 1
    assert rig.said.count("the performer is followed") == 2
    assert result.stop is None


def test_a_new_heading_is_taken_without_a_leap() -> None:
    rig, result = played({350: "h"})
    shows(rig.said)
    assert rig.said.count("the performer is followed") == 2
    steps = np.linalg.norm(np.diff(result.clip.frames.position, axis=0), axis=2)
    assert np.nanmax(steps) < 0.05 and result.stop is None


def test_a_file_that_appears_stops_the_robot(tmp_path: Path) -> None:
    file = tmp_path / "stop"

    def appear(look: int) -> None:
        if look == 301:
            file.touch()

    rig, result = played({}, stop_file=file, each=appear)
    shows(rig.said, file)
    assert result.stop is not None and result.reason == result.stop.reason == f"{file} is there"


def test_where_the_file_is_there_at_the_first_look_nothing_gets_torque(tmp_path: Path) -> None:
    """It appeared while the performer was measured."""
    file = tmp_path / "stop"
    file.touch()
    rig, stop = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0)), StopRequest()
    with rig.prepared() as prepared:
        assert isinstance(prepared.samples, LivePerformer)
        clutch = Clutch(prepared.samples, clock=rig.clock, tell=rig.said.append)
        controls = LiveControls(Typed({}), stop, prepared.samples, clutch, tell=rig.said.append, stop_file=file)
        assert controls.look() and stop.why() == f"{file} is there"


def test_why_the_robot_stops_is_told_while_it_does() -> None:
    """A servo that reports an error, and what nobody pressed a key for; once."""
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=5.0))
    told: list[bool] = []
    with rig.prepared() as prepared:
        stop, performer, side = StopRequest(), prepared.samples, prepared.side
        assert isinstance(performer, LivePerformer) and side is not None

        def tell(text: str) -> None:
            rig.said.append(text)
            told.append(rig.bus.torque_on)

        clutch = Clutch(performer, clock=rig.clock, tell=tell, guard=side.guard)
        controls = LiveControls(Typed({}), stop, performer, clutch, tell=tell, clock=rig.clock, guard=side.guard)
        looks = 0

        def look() -> bool:
            nonlocal looks
            looks += 1
            if looks == 300:
                side.guard.stop("servo reports overload: l_knee (id 11)", StopCause.SERVO_ALERT)
            return controls.look()

        rig.said.clear()
        prepared.run(Watch(stop_asked=look, cut_asked=controls.insisted, why=controls.why))
    line = "stopping: servo reports overload: l_knee (id 11)"
    assert rig.said.count(line) == 1 and told[-1] and not rig.bus.torque_on
    assert not any("stopping: " in text for text in played({400: " "})[0].said)


class Unreadable(type(Path())):  # type: ignore[misc]
    """A file of a drive that has failed, from some look on."""

    failed = False

    def lstat(self) -> os.stat_result:
        """Nobody knows."""
        raise OSError(errno.EIO, os.strerror(errno.EIO)) if self.failed else FileNotFoundError


def test_a_file_that_nobody_can_look_for_stops_the_robot_as_well() -> None:
    """It brakes and is parked as ever, and looks that fail while it does take no torque."""
    file = Unreadable("stop")

    def fail(look: int) -> None:
        file.failed = look > 330

    rig, result = played({}, stop_file=file, each=fail)
    _, asked = played({332: " "})
    told = f"stop cannot be looked for ({os.strerror(errno.EIO)}): stopping"
    assert rig.said.count(told) == 1 and result.stop is not None
    assert result.stop.reason == told.removesuffix(": stopping") and abs(len(result.record) - len(asked.record)) < 10


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
            clutch = Clutch(prepared.samples, clock=rig.clock, tell=rig.said.append)
            controls = LiveControls(Typed({}), stop, prepared.samples, clutch, tell=rig.said.append, stop_file=file)
            for _ in range(5):
                controls.look()
        assert stop() and stop.why() == f"{file} cannot be looked for ({reason})"


def test_a_stop_is_asked_before_it_is_told() -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))

    def gone(text: str) -> None:
        raise BrokenPipeError

    with rig.prepared() as prepared:
        assert isinstance(prepared.samples, LivePerformer)
        stop, clutch = StopRequest(), Clutch(prepared.samples, clock=rig.clock, tell=gone)
        controls = LiveControls(Typed({1: " "}), stop, prepared.samples, clutch, tell=gone, clock=rig.clock)
        with pytest.raises(BrokenPipeError):
            controls.look()
        assert stop() and not stop.insisted()


def test_a_socket_holds_stops_and_tells_and_gives_no_motion(tmp_path: Path) -> None:
    heard: dict[int, str] = {}
    asked = {300: "status", 310: "hold", 330: "resume", 340: "status", 450: "stop"}
    with ControlSocket(tmp_path / "control") as socket, connect_to(socket.path) as client:

        def each(look: int) -> None:
            if look in asked:
                client.sendall(asked[look].encode() + b"\n")
            if look - 1 in asked:
                heard[look - 1] = client.recv(500).decode()

        rig, result = played({}, socket=socket, each=each)
        heard[450] = client.recv(500).decode()
    assert json.loads(heard[300]) == {"state": "moving", "followed": True, "let_go": False, "stop": None}
    assert heard[310] == "ok holding\n" and heard[450] == "ok stopping\n"
    assert heard[330].startswith("error: found 'resume', allowed: stop, cut, hold, status")
    assert json.loads(heard[340]) == {"state": "holding", "followed": False, "let_go": True, "stop": None}
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
            clutch = Clutch(performer, clock=rig.clock, tell=rig.said.append, dead_man=HeldKey("b"))
            keys = Typed({2: "p"}, terminal=terminal)
            controls = LiveControls(keys, stop, performer, clutch, tell=rig.said.append, socket=socket)
            with connect_to(socket.path) as client:
                client.sendall(b"hold\n")
                controls.look()
                assert rig.said[-1].startswith("paused by the control socket") and rig.said[-1].endswith(says)
                controls.look()
        assert rig.said[-1] == "no pause any more: it goes on when it is held" and not clutch.engaged


def test_a_socket_cuts_the_torque_at_once(tmp_path: Path) -> None:
    with ControlSocket(tmp_path / "control") as socket, connect_to(socket.path) as client:

        def each(look: int) -> None:
            if look == 400:
                client.sendall(b"cut\n")

        rig, result = played({}, socket=socket, each=each)
    assert not rig.bus.torque_on and result.stop is not None
    shows(result.stop.reason)
