"""Controls of a live run: keys, a dead-man control, a stop file, the control socket.

A `Control` only yields requests. `RunOperator` carries them out in every tick.
"""

import errno
import json
import os
import select
import socket
import stat
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from enum import Enum, auto
from pathlib import Path
from typing import Protocol

from hardware.realtime import Scheduling, refuse_scheduling
from retarget.cli.exit import ForcedStopKey, KeyPress
from retarget.cli.stick import EventDevice, Gamepad, KeyStick
from retarget.cli.stop import MAX_LINE, WHERE, connect_to
from retarget.errors import UsageError, renamed_to
from retarget.types import RunState


class ControlRequest(Enum):
    """A request of a control. STOP_TOO_SOON: see `KeyPress`. HOLD lasts until PAUSE, the key that pauses and goes on,
    PAGE_HOLD until PAGE_GO_ON, and RELEASE, of the dead-man control, until GRIP."""

    STOP = auto()
    STOP_TOO_SOON = auto()
    TORQUE_OFF = auto()
    HOLD = auto()
    PAUSE = auto()
    PAGE_HOLD = auto()
    PAGE_GO_ON = auto()
    GRIP = auto()
    RELEASE = auto()
    HEADING = auto()


class Control(Protocol):
    """A control of a live run."""

    def poll(self, now: float) -> Iterator[tuple[ControlRequest, str]]:
        """Yield the requests since the last poll, each with its reason for the operator. now: s. Never waits, and
        raises nothing that a person, device or client causes. The caller carries out each before it takes the next."""


# A held key of the terminal is detected by its repeats, because a terminal reports no release.

LET_GO_S = 0.15
"""Time, s, after the last repeat until a key counts as released. Slow keyboards repeat every 0.09 s."""
NEEDED = 4
"""Repeats after which a key counts as held, so that neither a tap nor a pasted text does."""


class HeldKey:
    """A key of the terminal. Another key ends its hold. label: name of the key, for the operator."""

    def __init__(self, key: str) -> None:
        self.key = key
        self.label = f"{key!r} (it must repeat)"
        self._last = float("-inf")
        self._run = 0

    def held(self, pressed: str, now: float) -> bool:
        """True if it is held at `now`, s. pressed: keys since the last poll."""
        if pressed.strip(self.key):  # another key, or a pasted text
            self._run, self._last = 0, now
        elif pressed:
            self._run = self._run + 1 if now - self._last <= LET_GO_S else 1
            self._last = now
        return self._run >= NEEDED and now - self._last <= LET_GO_S


# Keys of the terminal, without Enter.

MOST = 64
"""Most keys of one poll."""
KEYS = {"p": ControlRequest.PAUSE, "h": ControlRequest.HEADING}
PRESSES = {
    KeyPress.FIRST: ControlRequest.STOP,
    KeyPress.TOO_SOON: ControlRequest.STOP_TOO_SOON,
    KeyPress.SECOND: ControlRequest.TORQUE_OFF,
}
"""Requests of the space bar."""
HELP = (
    "keys: space stops (once more, after a second: torque off at once), p pauses and goes on, h takes the way you face "
    "as straight ahead"
)
SPACE, GOES_ON = "interrupted by the user (space bar)", "p goes on"
NEVER_GOES_ON = "there is no terminal whose p would go on, so stop it: `retarget stop`"
GRIPS = {
    True: (ControlRequest.GRIP, "dead-man control held"),
    False: (ControlRequest.RELEASE, "dead-man control released: the robot holds"),
}
"""Requests of a dead-man control that is held, and let go."""
INPUT_MODES = 0
"""Index into the list of `termios.tcgetattr`."""


class Keyboard:
    """The keyboard of a terminal: the keys of HELP, of the dead-man control and of a stick. Ctrl-C stays a signal."""

    def __init__(
        self, fd: int | None = None, *, dead_man: HeldKey | None = None, stick: KeyStick | None = None
    ) -> None:
        """fd: of a terminal; None: standard input, if it is one."""
        self._fd = sys.stdin.fileno() if fd is None and has_terminal() else fd
        self._before: list[object] | None = None
        self._space, self._dead_man, self._held, self._stick = ForcedStopKey(), dead_man, False, stick
        if self._fd is not None:
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd, termios.TCSANOW)
            as_keys = termios.tcgetattr(self._fd)
            as_keys[INPUT_MODES] &= ~termios.IXON
            termios.tcsetattr(self._fd, termios.TCSANOW, as_keys)

    def close(self) -> None:
        """Restore the settings of the terminal."""
        if self._fd is not None and self._before is not None:
            with suppress(termios.error, OSError):  # the terminal may be gone
                termios.tcsetattr(self._fd, termios.TCSANOW, self._before)  # type: ignore[arg-type]
            self._before = None

    def poll(self, now: float) -> Iterator[tuple[ControlRequest, str]]:
        """Yield the requests of the keys; see `Control.poll`."""
        pressed = self.pressed()
        if self._stick is not None:
            self._stick.press(pressed, now)
        if count := pressed.count(" "):
            yield PRESSES[self._space.pressed(count, now)], SPACE
        for key in pressed:
            if key in KEYS:
                yield KEYS[key], f"paused: the robot holds; {GOES_ON}"
        if self._dead_man is not None and self._dead_man.held(pressed, now) is not self._held:
            self._held = not self._held
            yield GRIPS[self._held]

    def pressed(self) -> str:
        """The keys since the last poll. Never waits, never raises."""
        if self._fd is None:
            return ""
        try:
            if not select.select((self._fd,), (), (), 0.0)[0]:
                return ""
            data = os.read(self._fd, MOST)
        except OSError:
            data = b""
        if not data:  # the terminal is gone
            self._fd = None
        return data.decode("utf-8", errors="ignore")


# A pedal, a button, or a key of its own device.


class Pedal(EventDevice):
    """An event device as a dead-man control. A key that was down before it was opened counts from its next press.

    code: the only key that counts, as `evtest` shows it; None: any. label: name of the device, for the operator.
    """

    def __init__(self, path: str, *, code: int | None = None) -> None:
        """Raises HardwareError as an EventDevice does."""
        super().__init__(path)
        self._code = code
        self.label = f"the pedal {path}"
        self._held = False

    def poll(self, now: float) -> Iterator[tuple[ControlRequest, str]]:
        """Yield the requests of the pedal; see `Control.poll`. A lost device counts as released for good."""
        lost_before = self.lost
        held = self.pressed()
        if self.lost and not lost_before:
            self._held = False
            yield ControlRequest.RELEASE, f"{self.path}: {self.lost}: it counts as released for good: stop the run"
        elif held is not self._held:
            self._held = held
            yield GRIPS[held]

    def pressed(self) -> bool:
        """True if a key that counts is down now; never, once the device is lost."""
        for _ in self._events():
            pass
        return bool(self._down) if self._code is None else self._code in self._down


# The dead-man control: a robot moves only while it is held.

PEDAL = "pedal:"
TAKEN = " ph"
"""Keys of the terminal that have another meaning."""
ALLOWED = "a letter or digit key of the terminal but p and h, or pedal:/dev/input/... of a pedal, button or keyboard"


def open_dead_man(text: str, *, terminal: bool) -> HeldKey | Pedal:
    """Open the key or device of `--dead-man`. terminal: there is one for keys. Raises UsageError or HardwareError."""
    if text.startswith(PEDAL):
        path, _, code = text.removeprefix(PEDAL).partition("#")
        if code and not (code.isascii() and code.isdigit()):
            raise _refused(text, "the code of a key is a number, as `sudo evtest` shows it")
        return Pedal(path, code=int(code) if code else None)
    if len(text) != 1 or not text.isascii() or not text.isalnum() or text in TAKEN:
        raise _refused(text, "this cannot be held")
    _refuse_no_terminal("--dead-man", text, terminal=terminal, instead="a pedal (pedal:DEVICE)")
    return HeldKey(text)


def _refused(text: str, what: str) -> UsageError:
    return UsageError(what, where="--dead-man", found=repr(text[:80]), allowed=ALLOWED)


def _refuse_no_terminal(option: str, text: str, *, terminal: bool, instead: str) -> None:
    if not terminal:
        step = f"Run it in a terminal, or use {instead}"
        raise UsageError("there is no terminal on which a key could be held", where=option, found=text, next_step=step)


# The stick, by which the operator requests a velocity.

STICK_KEYS, GAMEPAD = "keys", "gamepad:"


def open_stick(text: str, *, terminal: bool, notify: Callable[[str], object]) -> KeyStick | Gamepad:
    """Open the stick of `--stick`. terminal: there is one for keys. notify: receives that the device is lost. Raises
    UsageError or HardwareError."""
    if text.startswith(GAMEPAD):
        return Gamepad(text.removeprefix(GAMEPAD), notify=notify)
    if text != STICK_KEYS:
        allowed = f"{STICK_KEYS}, page, or {GAMEPAD}/dev/input/..."
        raise UsageError("this is no stick", where="--stick", found=repr(text[:80]), allowed=allowed)
    _refuse_no_terminal("--stick", text, terminal=terminal, instead=f"a gamepad ({GAMEPAD}DEVICE)")
    return KeyStick()


# The stop file stops the robot when it appears.

FILE_PERIOD = 5
"""Ticks between two checks for the file. The first poll checks: no servo gets torque while the file is there."""
IS_THERE = "is there"


def stop_file_state(file: Path) -> str:
    """The reason why the stop file stops the robot: it exists, or cannot be looked for. "" while it is absent."""
    try:
        file.lstat()  # `exists` is also False where it cannot be looked for
    except FileNotFoundError:
        return "" if file.parent.is_dir() else "cannot be looked for (its folder is not there)"
    except (OSError, ValueError) as error:
        return f"cannot be looked for ({getattr(error, 'strerror', None) or error})"
    return IS_THERE


class StopFile:
    """A file that stops the run when it appears or cannot be looked for. It is not removed."""

    def __init__(self, path: Path) -> None:
        self._path, self._polls = path, 0

    def poll(self, now: float) -> Iterator[tuple[ControlRequest, str]]:
        """Yield a stop if the file is there; see `Control.poll`."""
        self._polls += 1
        if self._polls % FILE_PERIOD == 1 and (state := stop_file_state(self._path)):
            yield ControlRequest.STOP, f"{self._path} {state}"


# The control socket of this user: a word a line, and a line in answer.


@dataclass(frozen=True)
class LiveStatus:
    """The state of a run, null without a robot. followed: the performer is followed now. let_go: the operator holds the
    robot. stop: reason of the stop, else null."""

    state: str | None
    followed: bool
    let_go: bool
    stop: str | None


STOPPED_BY = "requested through the control socket (`retarget stop`)"
WORDS = {
    "stop": (ControlRequest.STOP, STOPPED_BY, "ok stopping"),
    "torque_off": (ControlRequest.TORQUE_OFF, STOPPED_BY, "ok torque off"),
    "hold": (ControlRequest.HOLD, "paused by the control socket: the robot holds", "ok holding"),
}
"""Words of the socket: request, reason for the operator, and answer. `status` requests nothing."""
MOST_CLIENTS = 4
"""Clients that are served at once. A new one replaces the oldest."""
MOST_LINES = 8
"""Longest lines that one poll reads from a client."""


STANDS = "error: the robot stands already, with torque: hold it, then send torque_off (retarget stop --torque-off)"


class ControlSocket:
    """The listener, by which other programs of its owner stop or hold the run, but cannot make it move."""

    def __init__(self, path: Path, *, status: Callable[[], LiveStatus], goes_on: str = GOES_ON) -> None:
        """goes_on: how a hold ends, in words. Raises UsageError for a path that is in use, is no socket, or has no
        folder."""
        self.path, self._status, self._goes_on = path, status, goes_on
        self._clients: dict[socket.socket, bytes] = {}  # the begun line of each, oldest first
        _clear(path)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        before = os.umask(0o177)  # only its owner may connect, from the start
        try:
            self._listener.setblocking(False)
            self._listener.bind(str(path))
            self._listener.listen(MOST_CLIENTS)
        except OSError as error:
            self._listener.close()
            taken = error.errno == errno.EADDRINUSE
            step = "Choose another path" if taken else "Choose a path in a folder that exists and is yours"
            what = f"cannot listen: {error.strerror or error}"
            raise UsageError(what, where=f"{WHERE} {path}", next_step=step) from error
        finally:
            os.umask(before)

    def close(self) -> None:
        """Disconnect all clients, and remove the file."""
        for client in [*self._clients]:
            self._drop(client)
        with suppress(OSError):
            self.path.unlink()
        self._listener.close()

    def poll(self, now: float) -> Iterator[tuple[ControlRequest, str]]:
        """Yield the requests of clients; see `Control.poll`. Each is answered when it has been carried out."""
        self._accept()
        for client in [*self._clients]:
            for word in self._received(client):
                if word in ("stop", "hold") and self._status().state == RunState.STANDING.value:
                    answer = STANDS
                elif word in WORDS:
                    request, reason, answer = WORDS[word]
                    yield request, f"{reason}; {self._goes_on}" if request is ControlRequest.HOLD else reason
                elif word == "status":
                    answer = json.dumps(asdict(self._status()))
                else:
                    answer = refused_word(word)
                if client in self._clients:
                    self._answer(client, answer)

    def _accept(self) -> None:
        for _ in range(MOST_CLIENTS):
            try:
                client, _ = self._listener.accept()
            except OSError:  # no client, or one that has left already
                return
            client.setblocking(False)
            if len(self._clients) >= MOST_CLIENTS:
                self._drop(next(iter(self._clients)))
            self._clients[client] = b""

    def _received(self, client: socket.socket) -> list[str]:
        try:
            data = client.recv(MAX_LINE * MOST_LINES)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        *lines, rest = (self._clients[client] + data).split(b"\n")
        if not data or len(rest) > MAX_LINE:
            self._drop(client)
        else:
            self._clients[client] = rest
        return [line.decode("ascii", errors="replace").strip() for line in lines]

    def _answer(self, client: socket.socket, text: str) -> None:
        line, sent = text.encode() + b"\n", 0
        with suppress(OSError):
            sent = client.send(line)
        if sent < len(line):  # it does not read
            self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        self._clients.pop(client, None)
        client.close()


def _clear(path: Path) -> None:
    """Remove the file of a socket without a listener. Raises UsageError for any other."""
    try:
        mode = path.lstat().st_mode
    except OSError:
        return
    if not stat.S_ISSOCK(mode):
        raise UsageError("this is not a socket", where=f"{WHERE} {path}", next_step="Choose another path")
    try:
        connect_to(path).close()
    except ConnectionRefusedError:
        with suppress(OSError):
            path.unlink()
        return
    except OSError:  # a busy listener, or the socket of another user
        pass
    raise UsageError(
        "another run listens there",
        where=f"{WHERE} {path}",
        next_step="Stop it (retarget stop), or choose another path",
    )


def refused_word(word: str) -> str:
    """The answer of the control socket to an unknown or renamed word."""
    allowed = (*WORDS, "status")
    step = renamed_to(word, allowed) or "only a person at the keyboard lets the robot move"
    return f"error: found {word[:20]!a}, allowed: {', '.join(allowed)}; {step}"


@dataclass(frozen=True, kw_only=True)
class Oversight:
    """Options of the operator of a live run, and of the scheduling of its ticks.

    Operator of a live stream:
        dead_man KEY|pedal:FILE|page: The robot moves only while this is held.
        stick keys|gamepad:FILE|page: It walks as this asks, with --steps walk.
        stop_file FILE: Stop when this file appears.
        control_socket [PATH]: Be stopped or held by `retarget stop` and others.

    Robot:
        realtime [PRIORITY]: Real-time priority of ticks, 1 to 99; usually 40.
        core N: The only core on which the ticks run.
    """

    dead_man: str | None = None
    stick: str | None = None
    stop_file: Path | None = None
    control_socket: str | None = None
    realtime: int | None = None
    core: int | None = None

    @property
    def scheduling(self) -> Scheduling:
        """Real-time priority and core of the ticks."""
        return Scheduling(priority=self.realtime, core=self.core)


def refuse_oversight(oversight: Oversight, *, virtual: bool) -> None:
    """Raise UsageError or HardwareError for impossible options, and for a stop file that is there already. virtual: the
    run is on virtual time."""
    file = oversight.stop_file
    if file is not None and (state := stop_file_state(file)):
        already, step = "", "Name one in a folder that exists and is yours"
        if state == IS_THERE:
            already, step = " already", "Remove it"
        what = f"the file that stops the robot {state}{already}"
        raise UsageError(what, where="--stop-file", found=str(file), next_step=step)
    held = {"--dead-man": oversight.dead_man, "--stick": oversight.stick}
    for option in filter(held.__getitem__, held) if virtual else ():
        raise UsageError(
            "nothing can be held on virtual time",
            where=option,
            found="a recording on simulated servos",
            next_step="Leave it out, or use a live sender",
        )
    if oversight.stick == STICK_KEYS and oversight.dead_man is not None and len(oversight.dead_man) == 1:
        raise UsageError(
            "a keyboard repeats one key at a time",
            where="--stick keys",
            found=f"--dead-man {oversight.dead_man}",
            next_step="Use a pedal (pedal:DEVICE), or a gamepad as the stick",
        )
    refuse_scheduling(oversight.scheduling)


def has_terminal() -> bool:
    """True if keys can be pressed."""
    return sys.stdin is not None and sys.stdin.isatty()
