"""Controls of the operator, one by one, and their options: no input raises, nothing waits, memory is bounded."""

import errno
import json
import os
import pty
import random
import select
import socket
import stat
import struct
import tempfile
import termios
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.errors import HardwareError
from messages import refuses, shows
from retarget.cli.controls import (
    LET_GO_S,
    MOST_CLIENTS,
    NEEDED,
    Control,
    ControlRequest,
    ControlSocket,
    HeldKey,
    Keyboard,
    LiveStatus,
    Oversight,
    Pedal,
    StopFile,
    open_dead_man,
    open_stick,
    refuse_oversight,
)
from retarget.cli.stick import (
    ABS_INFO,
    ABS_RX,
    ABS_X,
    ABS_Y,
    EV_ABS,
    EV_KEY,
    EV_SYN,
    EVENT,
    EVIOCGABS,
    LAPSE_S,
    STAND,
    SYN_DROPPED,
    Gamepad,
    KeyStick,
    velocity_of,
)
from retarget.cli.stop import MAX_LINE, connect_to, socket_path
from retarget.errors import UsageError
from retarget.robot.walking.pattern import Request

HELD_KEY_DT = 0.01
EVENT_RANGE = struct.pack("@2i", 0, 255)
KEY_B, BTN_TRIGGER, BTN_TL, BTN_SOUTH = 48, 0x120, 0x136, 0x130


def asked(control: Control, now: float = 0.0) -> list[ControlRequest]:
    return [kind for kind, _ in control.poll(now)]


def typed(times: list[float], until: float) -> list[bool]:
    """Whether it is held at every tick, of a key that comes at these times, s."""
    key, looks = HeldKey("b"), HELD_KEY_DT * np.arange(round(until / HELD_KEY_DT))
    came = np.diff(np.searchsorted(np.sort(times), looks, side="right"), prepend=0)
    return [key.held("b" * count, now) for count, now in zip(came.tolist(), looks.tolist(), strict=True)]


def test_held_from_its_repeats_on_and_soon_let_go() -> None:
    times = [0.0, *(0.5 + 0.033 * n for n in range(31))]
    held = typed(times, 3.0)
    first, last = held.index(True), len(held) - 1 - held[::-1].index(True)
    assert 0.5 < HELD_KEY_DT * first < 0.65 and all(held[first : last + 1])
    assert times[-1] < HELD_KEY_DT * last <= times[-1] + LET_GO_S + HELD_KEY_DT
    assert any(typed([0.09 * n for n in range(10)], 1.0)), "slow keyboards repeat too"


@settings(max_examples=60)
@given(st.lists(st.floats(0.0, 3.0), max_size=40))
def test_never_held_without_repeats_just_before(times: list[float]) -> None:
    for now in HELD_KEY_DT * np.flatnonzero(typed(times, 3.5)):
        assert any(now - LET_GO_S - HELD_KEY_DT <= time <= now for time in times)
        assert sum(time <= now for time in times) >= NEEDED


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """Its two ends."""
    ends = pty.openpty()
    yield ends
    for fd in ends:
        with suppress(OSError):
            os.close(fd)


def test_keys_come_without_enter_and_the_terminal_is_as_it_was(terminal: tuple[int, int]) -> None:
    master, end = terminal
    before = termios.tcgetattr(end)
    keys = Keyboard(end, dead_man=HeldKey("b"))
    assert asked(keys) == []
    os.write(master, b" ph")
    assert asked(keys) == [ControlRequest.STOP, ControlRequest.PAUSE, ControlRequest.HEADING]
    os.write(master, b" ")
    assert asked(keys, 2.0) == [ControlRequest.TORQUE_OFF]
    found = []
    for press in range(NEEDED):
        os.write(master, b"b")
        found += asked(keys, 3.0 + 0.05 * press)
    assert found == [ControlRequest.GRIP] and asked(keys, 4.0) == [ControlRequest.RELEASE]
    os.write(master, b"\x13")  # Ctrl-S is a key, and holds nothing up
    assert asked(keys, 5.0) == []
    os.write(end, b"text")
    assert select.select((master,), (), (), 1.0)[0] and os.read(master, 9) == b"text"
    assert termios.tcgetattr(end) != before
    keys.close()
    assert termios.tcgetattr(end) == before and before[0] & termios.IXON


def test_a_terminal_that_goes_away_and_none_are_no_error(terminal: tuple[int, int]) -> None:
    keys, without = Keyboard(terminal[1]), Keyboard()  # pytest's input is no terminal
    os.close(terminal[0])
    assert asked(keys) == asked(keys) == asked(without) == []
    keys.close()
    without.close()


class Device:
    """A pipe at which a pedal is pressed."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)
        os.mkfifo(path)
        self.fd = os.open(path, os.O_RDWR | os.O_NONBLOCK)

    def event(self, kind: int, code: int, value: int) -> None:
        os.write(self.fd, EVENT.pack(1, 2, kind, code, value) + EVENT.pack(1, 2, 0, 0, 0))

    def unplug(self) -> None:
        if self.fd >= 0:
            os.close(self.fd)
        self.fd = -1


@pytest.fixture
def device(tmp_path: Path) -> Iterator[Device]:
    made = Device(tmp_path / "event7")
    yield made
    made.unplug()


def test_a_pedal_is_pressed_until_it_is_let_go_its_events_are_dropped_or_it_is_gone(device: Device) -> None:
    pedal, event = Pedal(device.path), EVENT.pack(1, 2, 1, KEY_B, 1)
    device.event(1, KEY_B, 2)  # a repeat of what was down before is no press
    assert asked(pedal) == []
    os.write(device.fd, event[:7])
    assert asked(pedal) == []
    os.write(device.fd, event[7:])
    assert asked(pedal) == [ControlRequest.GRIP] and asked(pedal) == []
    device.event(1, KEY_B, 2)
    assert asked(pedal) == []
    for dropped in ((1, KEY_B, 0), (0, 3, 0)):
        device.event(*dropped)
        assert asked(pedal) == [ControlRequest.RELEASE] and not pedal.lost
        device.event(1, KEY_B, 1)
        assert asked(pedal) == [ControlRequest.GRIP]
    device.unplug()
    ((kind, reason),) = pedal.poll(0.0)
    assert kind is ControlRequest.RELEASE and pedal.lost and device.path in reason
    assert asked(pedal) == []
    pedal.close()
    pedal.close()


def test_whatever_bytes_come_nothing_raises_and_a_release_releases(device: Device) -> None:
    pedal, chance, sent = Pedal(device.path), random.Random(3), 0
    for _ in range(500):
        sent += os.write(device.fd, chance.randbytes(chance.randrange(1, 200)))
        pedal.pressed()
    os.write(device.fd, bytes(-sent % EVENT.size))
    for code in range(0x300):
        device.event(1, code, 0)
        pedal.pressed()
    assert not pedal.pressed()


@pytest.mark.parametrize(
    ("text", "code", "counts"), [("", KEY_B, True), (f"#{BTN_TRIGGER}", BTN_TRIGGER, True), ("#57", KEY_B, False)]
)
def test_a_pedal_with_and_without_a_key(device: Device, text: str, code: int, counts: bool) -> None:
    dead_man = open_dead_man(f"pedal:{device.path}{text}", terminal=False)
    assert isinstance(dead_man, Pedal) and device.path in dead_man.label
    device.event(1, code, 1)
    assert asked(dead_man) == [ControlRequest.GRIP] * counts
    dead_man.close()


def test_keys_of_a_stick_walk_from_the_first_press_to_the_lapse(terminal: tuple[int, int]) -> None:
    master, end = terminal
    stick = KeyStick()
    keys = Keyboard(end, stick=stick)
    assert stick.shares(0.0) == STAND
    for now, pressed, found in (
        (1.0, b"w", (1.0, 0.0, 0.0)),
        (1.0 + LAPSE_S, b"", (1.0, 0.0, 0.0)),  # a keyboard waits before it repeats
        (1.01 + LAPSE_S, b"", STAND),
        (2.0, b"ws", (-1.0, 0.0, 0.0)),
        (2.1, b"a", (0.0, 1.0, 0.0)),
        (2.2, b"e", (0.0, 0.0, -1.0)),
        (2.3, b"kP", (0.0, 0.0, -1.0)),  # other keys change nothing
        (2.4, b"qx", STAND),
    ):
        os.write(master, pressed)
        assert asked(keys, now) == [] and stick.shares(now) == found, pressed
    os.write(master, b"w ")
    assert asked(keys, 3.0) == [ControlRequest.STOP], "space stops, whatever walks"
    keys.close()


@pytest.fixture
def gamepad(device: Device, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Gamepad, Device, list[str]]]:
    """With its device, and what it says. Its left stick goes from 0 to 255, its right one as most do."""
    ranges = {ABS_X: (0, 255), ABS_Y: (0, 255), ABS_RX: (-32768, 32767)}

    def answer(fd: int, request: int, info: bytearray) -> None:
        info[:] = ABS_INFO.pack(7, *ranges[request - EVIOCGABS], 0, 15, 0)

    monkeypatch.setattr("fcntl.ioctl", answer)
    said = list[str]()
    made = open_stick(f"gamepad:{device.path}", terminal=False, notify=said.append)
    assert isinstance(made, Gamepad)
    yield made, device, said
    made.close()


def test_a_gamepad_walks_while_a_shoulder_button_is_held_and_its_events_come(
    gamepad: tuple[Gamepad, Device, list[str]],
) -> None:
    stick, device, said = gamepad
    device.event(EV_ABS, ABS_Y, 0)
    assert stick.shares(0.0) == STAND, "no button"
    device.event(EV_KEY, BTN_SOUTH, 1)
    assert stick.shares(0.0) == STAND, "another button"
    device.event(EV_KEY, BTN_TL, 1)
    assert stick.shares(0.0) == (1.0, 0.0, 0.0)
    for axis, value in ((ABS_Y, 255), (ABS_X, 0), (ABS_RX, 32767)):
        device.event(EV_ABS, axis, value)
    assert stick.shares(1e6) == (-1.0, 1.0, -1.0), "a stick that is not moved sends nothing"
    for axis, value in ((ABS_X, 300), (ABS_RX, -16384), (ABS_Y, 128)):
        device.event(EV_ABS, axis, value)
    assert stick.shares(1e6) == pytest.approx((0.0, -1.0, 0.5), abs=0.004)
    device.event(EV_KEY, BTN_TL, 0)
    assert stick.shares(1e6) == STAND
    device.event(EV_KEY, BTN_TL, 1)
    assert stick.shares(0.0) != STAND
    device.event(EV_SYN, SYN_DROPPED, 0)
    assert stick.shares(0.0) == STAND
    device.event(EV_KEY, BTN_TL, 1)
    assert stick.shares(0.0) == STAND, "where the stick is now is not known"
    device.event(EV_ABS, ABS_Y, 0)
    assert stick.shares(0.0) == (1.0, 0.0, 0.0) and said == []
    device.unplug()
    assert stick.shares(0.0) == stick.shares(0.1) == STAND, "gone for good"
    (text,) = said
    shows(text.replace(device.path, "/dev/input/event7"))


@settings(max_examples=200)
@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 5) | st.integers(0, 0x3FF), st.integers(-(2**31), 2**31 - 1))),
    st.binary(),
)
def test_whatever_a_gamepad_sends_the_shares_are_within_their_range(
    events: list[tuple[int, int, int]], junk: bytes
) -> None:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        device, patch = Device(folder / "event7"), stack.enter_context(pytest.MonkeyPatch.context())
        stack.callback(device.unplug)
        patch.setattr("fcntl.ioctl", lambda fd, request, info: info.__setitem__(slice(4, 12), EVENT_RANGE))
        stick = Gamepad(device.path, notify=lambda text: None)
        device.event(EV_KEY, BTN_TL, 1)
        for kind, code, value in events:
            device.event(kind, code, value)
            assert all(-1.0 <= share <= 1.0 for share in stick.shares(0.0))
        os.write(device.fd, junk)
        assert all(-1.0 <= share <= 1.0 for share in stick.shares(0.0))
        stick.close()


def test_a_stick_has_a_dead_zone_and_is_no_faster_on_a_slant_than_straight_on() -> None:
    most = Request(0.1, 0.04, 0.3)
    assert velocity_of((0.14, -0.14, 0.14), most) == Request()
    assert velocity_of((1.0, 0.0, -1.0), most) == Request(0.1, 0.0, -0.3)
    assert vars(velocity_of((0.32, -0.49, 0.1), most)) == pytest.approx({"forward": 0.02, "left": -0.016, "turn": 0.0})
    both = velocity_of((1.0, -1.0, 1.0), most)
    assert (both.forward / 0.1) ** 2 + (both.left / 0.04) ** 2 == pytest.approx(1.0) and both.turn == 0.3


def test_what_is_no_stick_is_refused(device: Device) -> None:
    for text, terminal in (("joy", True), ("gamepad", True), ("keys", False)):
        with refuses(UsageError, "--stick", text):
            open_stick(text, terminal=terminal, notify=print)
    with refuses(HardwareError):  # a pipe has no axes
        open_stick(f"gamepad:{device.path}", terminal=False, notify=print)
    for oversight, virtual in ((Oversight(stick="page"), True), (Oversight(stick="keys", dead_man="b"), False)):
        with refuses(UsageError, "--stick"):
            refuse_oversight(oversight, virtual=virtual)
    refuse_oversight(Oversight(stick="keys", dead_man="pedal:/dev/input/event5"), virtual=False)


def test_a_stop_file_counts_as_there_wherever_it_cannot_be_looked_for(tmp_path: Path) -> None:
    """What `Path.exists` calls absent: its folder is gone, has become a file, or is a link that leads in a circle."""
    link, folder, there = tmp_path / "circle", tmp_path / "folder", tmp_path / "there"
    link.symlink_to(link)
    folder.touch()
    there.touch()
    for file, reason in (
        (there, "is there"),
        (link / "stop", f"cannot be looked for ({os.strerror(errno.ELOOP)})"),
        (folder / "stop", f"cannot be looked for ({os.strerror(errno.ENOTDIR)})"),
        (tmp_path / "gone" / "stop", "cannot be looked for (its folder is not there)"),
    ):
        assert [*StopFile(file).poll(0.0)] == [(ControlRequest.STOP, f"{file} {reason}")]
    assert asked(StopFile(tmp_path / "stop")) == []


STATUS = LiveStatus("follow", True, False, None)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[ControlSocket]:
    made = ControlSocket(tmp_path / "control", status=lambda: STATUS)
    yield made
    made.close()


def test_a_word_is_carried_out_and_then_answered(server: ControlSocket) -> None:
    assert asked(server) == []
    with connect_to(server.path) as client:
        client.sendall(b"hold\nsta")
        polled = server.poll(0.0)
        assert next(polled)[0] is ControlRequest.HOLD
        assert not select.select((client,), (), (), 0.0)[0], "no answer before it is carried out"
        assert [*polled] == [] and client.recv(100) == b"ok holding\n"
        client.sendall(b"tus\r\ntorque_off\n")
        assert asked(server) == [ControlRequest.TORQUE_OFF]
        status, answer, _ = client.recv(500).split(b"\n")
        assert json.loads(status) == asdict(STATUS) and answer == b"ok torque off"
    assert asked(server) == [] and not server._clients
    with connect_to(server.path) as client:
        client.sendall(b"stop\n")
    assert asked(server) == [ControlRequest.STOP], "of a client that left at once"


def test_a_robot_that_stands_at_the_end_is_only_asked_for_its_torque(tmp_path: Path) -> None:
    server = ControlSocket(tmp_path / "control", status=lambda: LiveStatus("standing", False, False, None))
    with connect_to(server.path) as client:
        client.sendall(b"stop\nhold\ntorque_off\n")
        assert asked(server) == [ControlRequest.TORQUE_OFF]
        stop, hold, off, _ = client.recv(1000).decode().split("\n")
        assert stop == hold and off == "ok torque off"
        shows(stop, "torque_off")
    server.close()


def test_a_socket_is_its_owner_s_replaces_a_stale_one_and_is_gone_afterwards(tmp_path: Path) -> None:
    place, stale = tmp_path / "control", socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    stale.bind(str(place))
    stale.close()
    before = os.umask(0)
    try:
        server = ControlSocket(place, status=lambda: STATUS)
        assert stat.S_IMODE(place.stat().st_mode) == 0o600 and os.umask(0) == 0
    finally:
        os.umask(before)
    with refuses(UsageError):
        ControlSocket(place, status=lambda: STATUS)
    with connect_to(place) as client:
        client.sendall(b"stop\n")
        assert asked(server) + asked(server) == [ControlRequest.STOP]
    server.close()
    assert not place.exists()


def test_what_cannot_be_a_socket_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    for place in (tmp_path / "file", tmp_path / "gone/control"):
        with refuses(UsageError):
            ControlSocket(place, status=lambda: STATUS)
    assert (tmp_path / "file").exists()
    with refuses(UsageError, 200, allowed=107):
        socket_path("x" * 200)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    with refuses(UsageError, "XDG_RUNTIME_DIR"):
        socket_path("usual")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert socket_path(None) == socket_path("usual") == tmp_path / "retarget.sock"


@pytest.mark.parametrize(("data", "times"), [(b"x" * MAX_LINE, 10), (b"s\n" * 8, 20_000)])
def test_a_client_without_an_end_of_line_or_that_does_not_read_is_disconnected(
    data: bytes, times: int, server: ControlSocket
) -> None:
    with connect_to(server.path) as client, suppress(OSError):
        client.settimeout(0.0 if len(data) < MAX_LINE else None)
        for _ in range(times):
            client.sendall(data)
            asked(server)
    assert not server._clients


def test_silent_clients_keep_no_other_out_and_no_input_raises(server: ControlSocket) -> None:
    chance, clients = random.Random(5), list[socket.socket]()
    for _ in range(600):
        if chance.random() < 0.2:
            clients.append(connect_to(server.path))
        if clients:
            one = chance.choice(clients)
            try:
                one.settimeout(0.0)
                one.send(chance.randbytes(chance.randrange(1, 300)) + chance.choice([b"", b"\n", b"\0\n"]))
            except OSError:
                clients.remove(one)
                one.close()
        if chance.random() < 0.1 and clients:
            clients.pop(chance.randrange(len(clients))).close()
        assert asked(server) == []
        assert len(server._clients) <= MOST_CLIENTS
        assert all(len(rest) <= MAX_LINE for rest in server._clients.values())
    with ExitStack() as stack:
        for one in clients:
            stack.enter_context(one)
        for _ in range(3 * MOST_CLIENTS):
            stack.enter_context(connect_to(server.path))
            asked(server)
        assert len(server._clients) == MOST_CLIENTS
        client = stack.enter_context(connect_to(server.path))
        client.sendall(b"stop\n")
        assert asked(server) == [ControlRequest.STOP] and client.recv(100) == b"ok stopping\n"


def test_what_can_be_had_is_not_refused_and_the_rest_is(tmp_path: Path) -> None:
    refuse_oversight(Oversight(stop_file=tmp_path / "stop"), virtual=True)
    refuse_oversight(Oversight(dead_man="b"), virtual=False)
    for file in (tmp_path, tmp_path / "gone" / "stop", Path("a\0b")):
        with refuses(UsageError, "--stop-file"):
            refuse_oversight(Oversight(stop_file=file), virtual=False)
    with refuses(UsageError):
        refuse_oversight(Oversight(dead_man="b"), virtual=True)
    with refuses(HardwareError, "--core"):
        refuse_oversight(Oversight(core=4096), virtual=False)
