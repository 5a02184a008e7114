"""What a person may ask of a live run while it runs."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from live_rig import LiveRig
from retarget.cli.clutch import Clutch
from retarget.cli.control_socket import ControlSocket, connect_to
from retarget.cli.interrupt import StopRequest
from retarget.cli.keys import Keys
from retarget.cli.live_controls import LiveControls
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.pipeline import INTERRUPTED, Watch
from retarget.prepare import Prepared
from retarget.record import Phase
from retarget.run_result import RunResult
from sim.faults.sender import FakeSender


class Typed(Keys):
    """A keyboard that types by itself."""

    def __init__(self, keys: dict[int, str]) -> None:
        self._keys, self._looks = keys, 0

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
        Typed(keys), stop, performer, clutch, tell=tell, guard=guard, stop_file=stop_file, socket=socket
    )
    looks = 0

    def look() -> bool:
        nonlocal looks
        looks += 1
        each(looks)
        return controls.look()

    return prepared.run(Watch(stop_asked=look, cut_asked=controls.insisted))


def test_the_space_bar_stops_and_the_robot_is_parked() -> None:
    rig, result = played({400: " "})
    assert result.stop is not None and result.stop.reason.startswith(INTERRUPTED)
    assert "stopping" in rig.said and not rig.bus.torque_on
    robot, sent = result.robot, result.record.robot
    assert robot is not None and sent is not None
    rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    away = np.abs(sent.q[:, robot.servo_columns] - rest).max(axis=1)
    braking = np.flatnonzero(result.record.phase == Phase.BRAKE)
    braking = braking[braking > 400 - 10]
    assert away[-1] < 1e-6 < away[braking[0]] and len(braking) * result.clip.dt <= 3.0


def test_the_space_bar_twice_takes_the_torque_at_once() -> None:
    _, once = played({400: " "})
    rig, twice = played({400: " ", 405: " "})
    assert len(twice.record) < len(once.record) - 50
    assert not rig.bus.torque_on and twice.stop is not None and "insisted" in twice.stop.reason


def test_a_pause_holds_and_goes_on() -> None:
    rig, result = played({300: "p", 400: "p"})
    assert rig.said.count("paused: the robot holds; p goes on") == rig.said.count("going on") == 1
    assert rig.said.count("the performer is followed") == 2
    assert result.stop is None


def test_a_new_heading_is_taken_without_a_leap() -> None:
    rig, result = played({350: "h"})
    assert "straight ahead is where you face now" in rig.said
    assert rig.said.count("the performer is followed") == 2
    steps = np.linalg.norm(np.diff(result.clip.frames.position, axis=0), axis=2)
    assert np.nanmax(steps) < 0.05 and result.stop is None


def test_a_file_that_appears_stops_the_robot(tmp_path: Path) -> None:
    file = tmp_path / "stop"

    def appear(look: int) -> None:
        if look == 301:
            file.touch()

    rig, result = played({}, stop_file=file, each=appear)
    assert f"{file} is there: stopping" in rig.said and result.stop is not None


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
    assert "paused by the control socket: the robot holds; p goes on" in rig.said
    assert rig.said.count("the performer is followed") == 1
    assert result.stop is not None and result.stop.reason.startswith(INTERRUPTED) and not rig.bus.torque_on


def test_a_socket_cuts_the_torque_at_once(tmp_path: Path) -> None:
    with ControlSocket(tmp_path / "control") as socket, connect_to(socket.path) as client:

        def each(look: int) -> None:
            if look == 400:
                client.sendall(b"cut\n")

        rig, result = played({}, socket=socket, each=each)
    assert not rig.bus.torque_on and result.stop is not None and "insisted" in result.stop.reason
