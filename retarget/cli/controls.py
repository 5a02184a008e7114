"""How the operator stops or holds a live run: keys, a dead-man key or pedal, a stop file, the control socket."""

import json
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from hardware.clock import Clock, MonotonicClock
from hardware.key_device import KeyDevice
from hardware.realtime import Scheduling, refuse_scheduling
from retarget.cli.exit import ForcedStopKey, StopRequest
from retarget.errors import UsageError, renamed_to
from retarget.live.performer import LivePerformer
from retarget.live.sensor_validity import Engaged
from retarget.run.control_socket import ControlSocket
from retarget.run.loop import Machine
from retarget.types import Notify, RunState

# A held key of the terminal, detected by its repeats: a terminal reports no release.

LET_GO_S = 0.15
"""A key counts as released this long after its last repeat. Slow keyboards repeat every 0.09 s."""
NEEDED = 4
"""Repeats without a longer pause after which a key counts as held: neither a tap nor a pasted text does."""


class HeldKey:
    """A key that is held from its fourth repeat (half a second after it went down, as keyboards are set) to 0.15 s
    after its last. Another key ends the repeats, hence the hold. label: what the operator has to hold."""

    def __init__(self, key: str) -> None:
        self.key, self.lost = key, ""
        self.label = f"{key!r} (it must repeat)"
        self._last = float("-inf")
        self._run = 0

    def held(self, pressed: str, now: float) -> bool:
        """Whether it is held at `now`, s. pressed: keys since the last poll."""
        if pressed.strip(self.key):  # another key: this one is released, or a text is pasted
            self._run, self._last = 0, now
        elif pressed:
            self._run = self._run + 1 if now - self._last <= LET_GO_S else 1
            self._last = now
        return self._run >= NEEDED and now - self._last <= LET_GO_S

    def close(self) -> None:
        """Nothing is open."""


# The dead-man control: a robot moves only while a pedal, a key of its own device, or a key of the terminal is held.

PEDAL = "pedal:"
TAKEN = " ph"
"""Keys of the terminal that mean something else already."""
ALLOWED = "a letter or digit key of the terminal but p and h, or pedal:/dev/input/... of a pedal, button or keyboard"


class Pedal:
    """A device that reports presses and releases. label: what the operator has to hold."""

    def __init__(self, device: KeyDevice) -> None:
        self._device = device
        self.label = f"the pedal {device.path}"
        self.close = device.close

    @property
    def lost(self) -> str:
        """Why it has failed, else ""."""
        return f"{self._device.path}: {self._device.lost}" if self._device.lost else ""

    def held(self, pressed: str, now: float) -> bool:
        """Whether it is pressed."""
        return self._device.pressed()


DeadMan = HeldKey | Pedal
"""A control that is held or released. `lost`: why it has failed, which counts as released for good."""


def open_dead_man(text: str, *, terminal: bool) -> DeadMan:
    """The key or device of `--dead-man`. terminal: whether there is one to press keys on.

    Raises UsageError: neither a key nor a device, or a key without a terminal; HardwareError: no such device, or not
    for this user.
    """
    if text.startswith(PEDAL):
        path, _, code = text.removeprefix(PEDAL).partition("#")
        if code and not (code.isascii() and code.isdigit()):
            raise _refused(text, "the code of a key is a number, as `sudo evtest` shows it")
        return Pedal(KeyDevice(path, code=int(code) if code else None))
    if len(text) != 1 or not text.isascii() or not text.isalnum() or text in TAKEN:
        raise _refused(text, "this cannot be held")
    if not terminal:
        raise UsageError(
            "there is no terminal on which a key could be held",
            where="--dead-man",
            found=text,
            next_step="Run it in a terminal, or use a pedal (pedal:DEVICE)",
        )
    return HeldKey(text)


def _refused(text: str, what: str) -> UsageError:
    return UsageError(what, where="--dead-man", found=repr(text[:80]), allowed=ALLOWED)


# The clutch: the robot follows while there is no pause and the dead-man control is held; else it holds.

LONGEST_S = 300.0
"""Longest hold on purpose, s: servos that hold get warm, and the operator may have left."""


class Clutch:
    """Disengages from the performer and engages again. dead_man: None where nothing has to be held."""

    def __init__(
        self,
        performer: LivePerformer,
        *,
        clock: Clock,
        notify: Notify,
        dead_man: DeadMan | None = None,
    ) -> None:
        self._performer, self._dead_man = performer, dead_man
        self._clock, self._notify = clock, notify
        self._paused, self._held = False, dead_man is None
        self._since: float | None = None  # [s] when it was disengaged
        self._lost = False
        self._apply()

    @property
    def engaged(self) -> bool:
        """Whether the performer is to be followed."""
        return self._held and not self._paused

    @property
    def paused(self) -> bool:
        """Whether there is a pause."""
        return self._paused

    @property
    def expired(self) -> bool:
        """Whether it has been disengaged for longer than LONGEST_S."""
        return self._since is not None and self._clock.now() - self._since > LONGEST_S

    def look(self, pressed: str) -> None:
        """Poll the dead-man control, once in every tick. pressed: keys of the terminal since the last poll."""
        dead_man = self._dead_man
        if dead_man is None:
            return
        held = dead_man.held(pressed, self._clock.now())
        if dead_man.lost and not self._lost:
            self._lost = True
            self._notify(f"{dead_man.lost}: it counts as released for good: stop the run")
        if held != self._held:
            self._held = held
            self._notify("dead-man control held" if held else "dead-man control released: the robot holds")
            self._apply()

    def pause(self) -> None:
        """Hold until `unpause`, also while the dead-man control is held."""
        self._paused = True
        self._apply()

    def unpause(self) -> None:
        """End the pause."""
        self._paused = False
        self._apply()

    def _apply(self) -> None:
        engaged = self.engaged
        self._performer.clutch(engaged=engaged)
        self._since = None if engaged else self._clock.now() if self._since is None else self._since


# Keys that are pressed while a robot moves, one at a time, without Enter; none where there is no terminal.

MOST = 64
"""Keys that one poll takes."""
INPUT_MODES = 0
"""Index into what `termios.tcgetattr` returns."""


class Keys(AbstractContextManager["Keys"]):
    """The keyboard of a terminal as a context. Ctrl-C stays a signal; Ctrl-S does not stop the output."""

    def __init__(self, fd: int | None = None) -> None:
        """fd: of a terminal; None: standard input, if it is one."""
        self._fd = sys.stdin.fileno() if fd is None and sys.stdin.isatty() else fd
        self._before: list[object] | None = None

    def __enter__(self) -> Self:
        if self._fd is not None:
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd, termios.TCSANOW)
            as_keys = termios.tcgetattr(self._fd)
            as_keys[INPUT_MODES] &= ~termios.IXON
            termios.tcsetattr(self._fd, termios.TCSANOW, as_keys)
        return self

    def __exit__(self, *failure: object) -> None:
        if self._fd is not None and self._before is not None:
            with suppress(termios.error, OSError):  # the terminal may be gone
                termios.tcsetattr(self._fd, termios.TCSANOW, self._before)  # type: ignore[arg-type]
            self._before = None

    @property
    def listens(self) -> bool:
        """Whether there is a terminal."""
        return self._fd is not None

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


# Options of the command line: what may stop or hold a live run, and how its ticks are scheduled.


@dataclass(frozen=True, kw_only=True)
class Oversight:
    """What may stop or hold a live run, and how its ticks are scheduled.

    Operator of a live stream:
        dead_man KEY|pedal:FILE: The robot moves only while this key of the terminal, or pedal, is held.
        stop_file FILE: Stop when this file appears.
        control_socket [PATH]: Be stopped or held by `retarget stop` and others.
        realtime [PRIORITY]: Real-time priority of the ticks, 1 to 99; usually 40.
        core N: The only core on which the ticks run.
    """

    dead_man: str | None = None
    stop_file: Path | None = None
    control_socket: str | None = None
    realtime: int | None = None
    core: int | None = None

    @property
    def scheduling(self) -> Scheduling:
        """Of the ticks."""
        return Scheduling(priority=self.realtime, core=self.core)


def refuse_oversight(oversight: Oversight, *, virtual: bool) -> None:
    """Raise UsageError or HardwareError for what is not possible, also for a file that would stop the robot at once.
    virtual: time runs as fast as the machine can."""
    file = oversight.stop_file
    if file is not None and (state := stop_file_state(file)):
        already, step = "", "Name one in a folder that exists and is yours"
        if state == IS_THERE:
            already, step = " already", "Remove it"
        what = f"the file that stops the robot {state}{already}"
        raise UsageError(what, where="--stop-file", found=str(file), next_step=step)
    if virtual and oversight.dead_man is not None:
        raise UsageError(
            "a key cannot be held on virtual time",
            where="--dead-man",
            found="a recording on simulated servos",
            next_step="Leave it out, or use a live sender",
        )
    refuse_scheduling(oversight.scheduling)


IS_THERE = "is there"


def stop_file_state(file: Path) -> str:
    """Why the stop file stops the robot: it exists, or cannot be looked for; "" while it is absent."""
    try:
        file.lstat()  # `exists` is also False where it cannot be looked for
    except FileNotFoundError:
        return "" if file.parent.is_dir() else "cannot be looked for (its folder is not there)"
    except (OSError, ValueError) as error:
        return f"cannot be looked for ({getattr(error, 'strerror', None) or error})"
    return IS_THERE


def has_terminal() -> bool:
    """Whether keys can be pressed."""
    return sys.stdin is not None and sys.stdin.isatty()


HELP = (
    "keys: space stops (once more, after a second: torque off at once), p pauses and goes on, h takes the way you face "
    "as straight ahead"
)
FILE_PERIOD = 5
"""Ticks between two checks for the file. The first poll checks, so no servo gets torque while the file is there."""
WORDS = ("stop", "torque_off", "hold", "status")
"""Of the control socket."""
SPACE, SOCKET = "interrupted by the user (space bar)", "requested through the control socket (`retarget stop`)"
"""Reasons of a stop."""
GOES_ON, NEVER_GOES_ON = "p goes on", "there is no terminal whose p would go on, so stop it: `retarget stop`"
"""After a pause."""


@dataclass(frozen=True)
class LiveStatus:
    """state: of the run, null without a robot. followed: whether the performer is followed now. let_go: whether it
    holds on purpose. stop: why the robot stops or stopped, else null."""

    state: str | None
    followed: bool
    let_go: bool
    stop: str | None


class LiveControls:
    """Controls of a live run; call `look` in every tick.

    machine: the robot, None without one. stop_file: its appearance stops the robot; it is not removed, and counts as
    there where it cannot be looked for. socket: other programs stop or hold the robot through it, and cannot make it
    move. Every request is carried out before it is reported.
    """

    def __init__(
        self,
        keys: Keys,
        stop: StopRequest,
        performer: LivePerformer,
        clutch: Clutch,
        *,
        notify: Notify,
        clock: Clock | None = None,
        machine: Machine | None = None,
        stop_file: Path | None = None,
        socket: ControlSocket | None = None,
    ) -> None:
        self._keys, self._stop, self._performer, self._clutch = keys, stop, performer, clutch
        self._machine, self._stop_file, self._socket, self._notify = machine, stop_file, socket, notify
        self._clock, self._space = clock or MonotonicClock(), ForcedStopKey()
        self._ticks, self._announced = 0, False  # announced: that the robot stops

    def look(self) -> bool:
        """Carry out what was asked for; whether the robot is to stop."""
        pressed = self._keys.pressed()
        if " " in pressed:
            self._press_space(pressed.count(" "))
        for key in pressed:
            self._press(key)
        self._clutch.look(pressed)
        if self._socket is not None:
            self._socket.poll(self._obey)
        self._ticks += 1
        if not self._stop():
            self._check_automatic_stops()
        return self._stop()

    def forced_stop(self) -> bool:
        """While the robot brakes: whether torque is to go off at once."""
        self.look()
        self._say_why()
        return self._stop.forced_stop()

    def why(self) -> str:
        """The reason of the stop that was asked for."""
        return self._stop.why()

    def status(self) -> LiveStatus:
        """The present state."""
        machine, following = self._machine, self._performer.engagement.state is Engaged.FOLLOWING
        reason = None if machine is None or machine.guard.stop is None else machine.guard.stop.reason
        state = None if machine is None else machine.supervisor.state.value
        return LiveStatus(state, following, not self._clutch.engaged, reason)

    def words(self) -> str:
        """The present state of the run, in a few words."""
        return words_for(self.status())

    def _say_why(self) -> None:
        """Report why the robot stops, once, without waiting for the summary."""
        reason = None if self._machine is None else self._machine.guard.stop
        if reason is not None and not self._announced:
            with suppress(OSError):  # a lost terminal must not keep a second press from being received
                self._say_stopping(f"stopping: {reason.reason}")

    def _say_stopping(self, text: str) -> None:
        self._announced = True
        self._notify(text)

    def _ask(self, why: str, text: str) -> None:
        """Ask to stop, unless it was asked before."""
        if not self._stop():
            self._stop.ask(why)
            self._say_stopping(text)

    def _check_automatic_stops(self) -> None:
        file = self._stop_file
        if self._ticks % FILE_PERIOD == 1 and file is not None and (state := stop_file_state(file)):
            self._ask(f"{file} {state}", f"{file} {state}: stopping")
        if self._clutch.expired:
            why = f"paused by the operator for {LONGEST_S:g} s"
            self._ask(why, f"{why}: stopping")

    def _press_space(self, count: int) -> None:
        """count: how often it came since the last look."""
        again, stopping = self._space.pressed(count, self._clock.now()), self._stop()
        self._ask(SPACE, "stopping")
        if again and stopping:
            self._stop.force(SPACE)

    def _press(self, key: str) -> None:
        if key == "p":
            if self._clutch.paused:
                self._clutch.unpause()
                self._notify("going on" if self._clutch.engaged else "no pause any more: it goes on when it is held")
            else:
                self._clutch.pause()
                self._notify(f"paused: the robot holds; {GOES_ON}")
        elif key == "h":
            self._notify(
                "straight ahead is where you face now" if self._performer.reset_heading() else "left and right are lost"
            )

    def _obey(self, word: str) -> str:
        """The answer to a word of the socket."""
        if word == "status":
            return json.dumps(asdict(self.status()))
        if word == "stop":
            self._ask(SOCKET, "stopping, asked by the control socket")
            return "ok stopping"
        if word == "torque_off":
            self._stop.force(SOCKET)
            self._say_stopping("torque off at once, asked by the control socket")
            return "ok torque off"
        if word == "hold":
            if not self._clutch.paused:
                self._clutch.pause()
                then = GOES_ON if self._keys.listens else NEVER_GOES_ON
                self._notify(f"paused by the control socket: the robot holds; {then}")
            return "ok holding"
        return refused_word(word)


def refused_word(word: str) -> str:
    """The answer of the control socket to a word that it does not have, or no longer has."""
    step = renamed_to(word, WORDS) or "only a person at the keyboard lets the robot move"
    return f"error: found {word[:20]!a}, allowed: {', '.join(WORDS)}; {step}"


# The state and duration of a live run on a terminal; nothing in a pipe.


STOPS = (RunState.STOPPING.value, RunState.RETURN_TO_STANCE.value, RunState.GO_TO_REST.value)
"""States of a run that ends."""


def words_for(status: LiveStatus) -> str:
    """The present state in a few words."""
    if status.stop is not None or status.state in STOPS:
        return "stopping"
    if status.let_go:
        return "paused: holding"
    if status.state == RunState.APPROACH.value:
        return "approaching the performer"
    return "following" if status.followed else "holding"


@contextmanager
def live_state(what: str, words: Callable[[], str]) -> Iterator[None]:
    """Show a line on stderr. words: the present state, read by a thread of its own some times a second."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
    from rich.text import Text

    class Words(ProgressColumn):
        """The present state, whenever the line is drawn."""

        def render(self, task: Task) -> Text:
            return Text(words())

    columns = (SpinnerColumn(), TextColumn("{task.description}"), Words(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as line:
        line.add_task(what, total=None)
        yield
