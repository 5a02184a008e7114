"""The end of a command: messages, exit codes, signals, and streams that never hold up a robot."""

import io
import os
import re
import resource
import select
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path
from queue import Empty, Full, Queue
from types import FrameType
from typing import TextIO, cast

from hardware.clock import Clock, MonotonicClock
from hardware.errors import RetargetError, TorqueError, describe, printable

# stdout and stderr pass through a queue and a thread, so that a robot never waits for a terminal.

MOST = 1000
"""Texts kept for a stream that takes none (Ctrl-S, a hung link)."""
PATIENCE_S = 0.4
"""Time, s, that the end of a run waits for such streams."""


class Screen(io.TextIOBase):
    """A text stream whose thread writes to another one. Writing never raises OSError: `failure` is the first error.

    waits: writing waits for a stream that takes nothing; else the oldest texts are dropped.
    """

    def __init__(self, stream: TextIO) -> None:
        """Start the thread."""
        self.failure: OSError | None = None
        self.waits = True
        self._stream, self._fd = stream, _descriptor(stream)
        self._texts: Queue[str | None] = Queue(MOST)  # None ends the thread
        self._thread = threading.Thread(target=self._write, name="screen", daemon=True)
        self._thread.start()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the stream."""
        return self._stream.encoding or "utf-8"

    def write(self, text: str) -> int:
        """Queue a text for the thread. Raises TypeError for another type, as any text stream."""
        if not isinstance(text, str):
            raise TypeError(f"a text stream takes str, found {type(text).__name__}")
        while True:
            try:
                self._texts.put(text, block=self.waits)
                return len(text)
            except Full:
                with suppress(Empty):
                    self._texts.get_nowait()
                    self._texts.task_done()

    def isatty(self) -> bool:
        """True if the stream is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """Number of the file behind the stream. Raises OSError where there is none."""
        return self._stream.fileno()

    def drain(self, patience: float | None) -> bool:
        """Wait until all is written, so many s at most (None: no limit). True if it is."""
        done = self._texts.all_tasks_done
        with done:
            return done.wait_for(lambda: not self._texts.unfinished_tasks, patience)

    def end(self, patience: float | None) -> None:
        """Drain the stream, and end the thread unless it hangs in the stream. Call it once."""
        if self.drain(patience):
            self._texts.put(None)
            self._thread.join()

    def _write(self) -> None:
        while (text := self._texts.get()) is not None:
            try:
                if self._fd is None:
                    self._stream.write(text)
                    self._stream.flush()
                else:
                    # A thread that hangs in the stream itself would keep its lock, and with it the end of the process.
                    data = text.encode(self.encoding, "backslashreplace")
                    while data:
                        select.select((), (self._fd,), ())
                        with suppress(BlockingIOError):
                            data = data[os.write(self._fd, data) :]
            except OSError as error:  # gone, or full
                self.failure = self.failure or error
            except ValueError:  # closed
                pass
            self._texts.task_done()

    @property
    def reason(self) -> str:
        """The reason why a text is missing; "" for none, and for a reader that left (`| head`)."""
        if self.failure is None or isinstance(self.failure, BrokenPipeError):
            return ""
        return self.failure.strerror or str(self.failure)


def _descriptor(stream: TextIO) -> int | None:
    with suppress(OSError, ValueError):
        stream.flush()
        return stream.fileno()
    return None


@contextmanager
def careful_stdout() -> Iterator[Screen]:
    """Put a `Screen` in front of stdout, and wait for it at the end. A missing stream becomes a null device."""
    nowhere = Path(os.devnull).open("w")  # noqa: SIM115 - open as long as the process
    sys.stdout, sys.stderr = sys.stdout or nowhere, sys.stderr or nowhere
    stream, screen = sys.stdout, Screen(sys.stdout)
    sys.stdout = cast(TextIO, screen)
    try:
        yield screen
    finally:
        sys.stdout = stream
        with suppress(KeyboardInterrupt):  # the user does not wait for a reader that is gone
            screen.end(None if screen.waits else PATIENCE_S)


@contextmanager
def detached_screens() -> Iterator[None]:
    """Put a `Screen` that waits for nothing in front of stdout and stderr."""
    before = sys.stdout, sys.stderr
    screens = [stream if isinstance(stream, Screen) else Screen(stream) for stream in before]
    for screen in screens:
        screen.waits = False
    sys.stdout, sys.stderr = (cast(TextIO, screen) for screen in screens)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
        clock = MonotonicClock()
        last = clock.now() + PATIENCE_S
        for screen, stream in zip(screens, before, strict=True):
            patience = max(last - clock.now(), 0.0)
            if screen is stream:
                screen.drain(patience)
            else:
                screen.end(patience)


def echo(text: str = "", *, err: bool = False, end: str = "\n", file: TextIO | None = None) -> None:
    """Print a text on stdout, on stderr, or into another stream. Control codes in names cannot act on a terminal."""
    print(printable(text) + end, end="", file=file or (sys.stderr if err else sys.stdout), flush=True)


# The second press of a key. The repeats of a held key do not count.

AFTER_S = 1.2
"""Least time, s, between two presses: keyboards repeat a held key after up to 1 s."""
PAUSE_S = 0.2
"""Least pause, s, before the second press. Slow keyboards repeat every 0.09 s."""


class KeyPress(Enum):
    """The effect of a press of a stop key. TOO_SOON: it may be the repeat of a held key, and changes nothing."""

    FIRST = auto()
    TOO_SOON = auto()
    SECOND = auto()


class ForcedStopKey:
    """Detects the second press of one key, which forces a stop."""

    def __init__(self) -> None:
        self._first: float | None = None
        self._last = 0.0

    def pressed(self, count: int, now: float) -> KeyPress:
        """The effect of a key that came `count` times, at least once, since the last poll. now: s."""
        first, pause, self._last = self._first, now - self._last, now
        if first is None:
            self._first = now
            return KeyPress.FIRST
        # Several times in one poll are repeats that were read late.
        return KeyPress.SECOND if count == 1 and now - first >= AFTER_S and pause > PAUSE_S else KeyPress.TOO_SOON


# Signals end a command as Ctrl-C does. While a robot moves they request a stop and raise nothing.

REASONS = {
    signal.SIGINT: "interrupted by the user (Ctrl-C)",
    signal.SIGTERM: "ended by another program (SIGTERM)",
    signal.SIGHUP: "the terminal is gone (SIGHUP)",
    signal.SIGQUIT: "asked to quit (Ctrl-\\, SIGQUIT)",
}
SUSPENDED = {signal.SIGTSTP: "asked to suspend (Ctrl-Z, SIGTSTP)"}
"""Handled while a robot moves: a suspended process would leave it with torque."""
FOREGROUND = {signal.SIGINT, signal.SIGQUIT}
"""Shells ignore these in processes started with `&` (POSIX shell, 2.11). They count as unhandled."""


@contextmanager
def _handled(numbers: Iterable[int], handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


def _kept_ignored(number: signal.Signals) -> bool:
    """True if the process was started to ignore this signal on purpose (`nohup`)."""
    return signal.getsignal(number) is signal.SIG_IGN and number not in FOREGROUND


@dataclass
class StopRequest:
    """A request to stop, which is kept until the next tick reads it.

    why: its first reason; "" for no request. torque_off: torque goes off at once, without braking. too_soon: presses of
    a stop key that came too soon to count.
    """

    why: str = ""
    torque_off: bool = False
    too_soon: int = 0

    def __call__(self) -> bool:
        """True if a stop was requested."""
        return bool(self.why)

    def request(self, why: str) -> None:
        """Request a stop before the next tick. why: not empty."""
        self.why = self.why or why

    def force(self, why: str) -> None:
        """Request torque off at once."""
        self.why, self.torque_off = self.why or why, True


@contextmanager
def all_as_ctrl_c() -> Iterator[None]:
    """SIGTERM, SIGHUP and SIGQUIT raise KeyboardInterrupt as SIGINT does, unless they are handled or ignored already.

    Only the main thread may set handlers.
    """
    mine, free = threading.current_thread() is threading.main_thread(), (signal.SIG_DFL, signal.SIG_IGN)
    unhandled = [n for n in REASONS if mine and signal.getsignal(n) in free and not _kept_ignored(n)]
    with _handled(unhandled, signal.default_int_handler):
        yield


@contextmanager
def interruptible() -> Iterator[None]:
    """Within `stop_on_signals`, once nothing moves any more: its signals raise KeyboardInterrupt."""
    mine = threading.current_thread() is threading.main_thread()
    with _handled([n for n in REASONS if mine and not _kept_ignored(n)], signal.default_int_handler):
        yield


@contextmanager
def stop_on_signals(clock: Clock | None = None, *, moves: bool = False) -> Iterator[StopRequest]:
    """Signals of REASONS request a stop, and so does Ctrl-Z if a robot `moves`. SIGINT after another signal, or a
    second Ctrl-C (see `ForcedStopKey`), forces torque off. No signal raises.
    """
    request, key, time = StopRequest(), ForcedStopKey(), clock or MonotonicClock()
    others: set[int] = set()  # signals before, but SIGINT
    reasons = {**REASONS, **SUSPENDED} if moves else REASONS

    def handle(number: int, frame: FrameType | None) -> None:
        why = reasons[signal.Signals(number)]
        press = key.pressed(1, time.now()) if number == signal.SIGINT else None
        if press is KeyPress.SECOND or (press is not None and others):
            request.force(why)
        elif press is KeyPress.TOO_SOON:
            request.too_soon += 1
        else:
            request.request(why)
        others.update({number} - {signal.SIGINT})

    with _handled([number for number in reasons if not _kept_ignored(number)], handle):
        yield request


DONE = 0
STOPPED = 1
"""Stopped by guard or user while something moved, or a file could not be written afterwards."""
REFUSED = 2
"""Refused before anything moved: a bad file or option. Also: stdout could not be written."""
DEFECT = 3
"""An unforeseen error."""
INTERRUPTED = 130
"""A signal before anything moved: 128 + SIGINT, as in shells and typer."""


def exit_code_of(command: Callable[[], object]) -> int:
    """Run `command` and return its exit code. Errors go to stderr, with a traceback only for a defect of ours.

    A reader of stdout that leaves early changes nothing. Any other error of stdout is reported.
    """
    with careful_stdout() as screen:
        code = _code_of(command)
    if not screen.reason:
        return code
    echo(f"error: stdout: cannot print: {screen.reason}. Files that were asked for are written all the same.", err=True)
    return code or REFUSED


def _code_of(command: Callable[[], object]) -> int:
    try:
        with all_as_ctrl_c():
            command()
    except SystemExit as leaving:
        code = STOPPED if isinstance(leaving.code, str) else leaving.code or DONE
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 - the outermost boundary
        code = _code_of_error(error)
    else:
        return DONE
    if code == INTERRUPTED:  # also typer's exit code for Ctrl-C inside a command
        echo("interrupted", err=True)
    return code


CODES = {TorqueError: STOPPED, RetargetError: REFUSED}
"""The exit code of each kind of error; the first match counts. Any other error is a defect."""


def _code_of_error(error: BaseException) -> int:
    # An import that Ctrl-C interrupts may raise 'initialization failed'.
    if not isinstance(error, TorqueError) and any(isinstance(one, KeyboardInterrupt) for one in _causes(error)):
        return INTERRUPTED
    if out_of_memory(error):
        echo(f"error: {memory_message()}", err=True)
        return REFUSED
    code = next((code for kind, code in CODES.items() if isinstance(error, kind)), DEFECT)
    if code == DEFECT:
        echo("".join(traceback.format_exception(error)), err=True, end="")
        echo("error: this is a defect of ours; please report it with the lines above", err=True)
    else:
        echo(f"error: {error}", err=True)
    return code


NO_MEMORY = re.compile("cannot allocate memory|failed to map segment|can't start new thread", re.IGNORECASE)
"""Messages of loaders and threads that got no memory."""


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def out_of_memory(error: BaseException) -> bool:
    """True if an error comes from a lack of memory, also during an import."""
    loaders = (ImportError, OSError, RuntimeError)
    return any(
        isinstance(one, MemoryError) or (isinstance(one, loaders) and NO_MEMORY.search(str(one)))
        for one in _causes(error)
    )


LEAST_MEMORY = 700_000_000
"""Least address space, bytes, of a run: a short one takes 500 MB. Too little would end a run in motion."""


def memory_message() -> str:
    """The message about too little memory."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    found = "the system gave no more" if limit == resource.RLIM_INFINITY else f"a limit of {limit / 1e6:.0f} MB"
    step = "Close other programs, or give the process more (ulimit -v unlimited)"
    allowed = f"{LEAST_MEMORY / 1e6:.0f} MB or more"
    return describe(what="too little memory", found=found, allowed=allowed, then=step)


def refuse_little_memory() -> None:
    """Raise MemoryError if `ulimit -v` leaves less than LEAST_MEMORY."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY:
        raise MemoryError
