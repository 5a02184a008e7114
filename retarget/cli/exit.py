"""How a command ends: errors become a message and an exit code, signals act as Ctrl-C, no terminal holds it up."""

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

# stdout and stderr through a queue and a thread: a stream that is gone, full or slow costs no run its files, and a
# robot never waits for a terminal.

MOST = 1000
"""Texts kept for a stream that takes none (Ctrl-S, a hung link, an unread pipe)."""
PATIENCE_S = 0.4
"""Time, s, that the end of a run waits for such streams, in all."""


class Screen(io.TextIOBase):
    """A text stream in front of another one, which a thread writes. Writing never raises: `failure` is the first error
    of the stream. waits: whether writing waits for a stream that takes nothing; else its oldest texts are dropped."""

    def __init__(self, stream: TextIO) -> None:
        """Start the thread."""
        self.failure: OSError | None = None
        self.waits = True
        self._stream, self._fd = stream, _descriptor(stream)
        self._texts: Queue[str | None] = Queue(MOST)  # None ends the thread
        self._thread = threading.Thread(target=self._write_all, name="screen", daemon=True)
        self._thread.start()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the stream."""
        return self._stream.encoding or "utf-8"

    def write(self, text: str) -> int:
        """Leave it to the thread. Raises TypeError for what is no text, as any text stream."""
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
        """Whether a terminal is behind it. More of the stream is not shown: `buffer` would lead past the thread."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """Number of the file behind the stream. Raises OSError where there is none."""
        return self._stream.fileno()

    def drain(self, patience: float | None) -> bool:
        """Wait until everything is written, so many s at most (None: as long as it takes). Whether it is."""
        done = self._texts.all_tasks_done
        with done:
            return done.wait_for(lambda: not self._texts.unfinished_tasks, patience)

    def end(self, patience: float | None) -> None:
        """Drain the stream, and end the thread where it does not hang in the stream; call it once."""
        if self.drain(patience):
            self._texts.put(None)
            self._thread.join()

    def _write_all(self) -> None:
        while (text := self._texts.get()) is not None:
            self._put(text)
            self._texts.task_done()

    def _put(self, text: str) -> None:
        try:
            if self._fd is None:
                self._stream.write(text)
                self._stream.flush()
                return
            data = text.encode(self.encoding, "backslashreplace")
            while data:
                # Not through the stream: a thread that hangs in it would keep its lock, and the process its end.
                select.select((), (self._fd,), ())
                with suppress(BlockingIOError):
                    data = data[os.write(self._fd, data) :]
        except OSError as error:  # gone, or full
            self.failure = self.failure or error
        except ValueError:  # closed
            pass

    @property
    def reason(self) -> str:
        """Why not everything was shown; empty if it was, or if the reader had seen enough (`| head`)."""
        if self.failure is None or isinstance(self.failure, BrokenPipeError):
            return ""
        return self.failure.strerror or str(self.failure)


def _descriptor(stream: TextIO) -> int | None:
    """Where the stream writes, with nothing left in it; None where it has no file."""
    with suppress(OSError, ValueError):
        stream.flush()
        return stream.fileno()
    return None


@contextmanager
def careful_stdout() -> Iterator[Screen]:
    """Put a `Screen` in front of stdout, and wait for it in the end. A process that has no stdout or stderr gets one
    that leads nowhere."""
    nowhere = Path(os.devnull).open("w")  # noqa: SIM115 - open as long as the process
    sys.stdout, sys.stderr = sys.stdout or nowhere, sys.stderr or nowhere
    stream, screen = sys.stdout, Screen(sys.stdout)
    sys.stdout = cast(TextIO, screen)
    try:
        yield screen
    finally:
        sys.stdout = stream
        with suppress(KeyboardInterrupt):  # the reader is gone, and the user does not wait for it
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
    """Print a text of the command on stdout, on stderr, or into another stream. Names of files, robots and senders in
    it cannot act on a terminal, whatever they are made of: see `printable`."""
    print(printable(text) + end, end="", file=file or (sys.stderr if err else sys.stdout), flush=True)


# Whether a key was pressed twice. A held key repeats, which does not count.

AFTER_S = 1.2
"""Time, s, from the first press to the earliest second one; keyboards let the first repeat come up to 1 s after it."""
PAUSE_S = 0.2
"""Time, s, without the key before its second press. Slow keyboards repeat every 0.09 s."""


class Press(Enum):
    """What a press of a stop key is. TOO_SOON: as a repeat of the key while it is held; it changes nothing."""

    FIRST = auto()
    TOO_SOON = auto()
    SECOND = auto()


class ForcedStopKey:
    """Detects the second press of one key, which forces a stop."""

    def __init__(self) -> None:
        self._first: float | None = None
        self._last = 0.0

    def pressed(self, count: int, now: float) -> Press:
        """What the key is that came `count` times, once at least, by `now`, s, since the last poll. Several times in
        one poll are repeats of a held key, read late."""
        first, pause, self._last = self._first, now - self._last, now
        if first is None:
            self._first = now
            return Press.FIRST
        return Press.SECOND if count == 1 and now - first >= AFTER_S and pause > PAUSE_S else Press.TOO_SOON


# Signals that end a command, all as Ctrl-C does. While a robot moves they request a stop, and raise nothing.

REASONS = {
    signal.SIGINT: "interrupted by the user (Ctrl-C)",
    signal.SIGTERM: "ended by another program (SIGTERM)",
    signal.SIGHUP: "the terminal is gone (SIGHUP)",
    signal.SIGQUIT: "asked to quit (Ctrl-\\, SIGQUIT)",
}
SUSPENDED = {signal.SIGTSTP: "asked to suspend (Ctrl-Z, SIGTSTP)"}
"""Handled while a robot moves: a suspended process would leave it standing with torque."""
FOREGROUND = {signal.SIGINT, signal.SIGQUIT}
"""Ignored in what a script starts with `&` (POSIX shell, 2.11). Nobody asked for that, so they count as unhandled."""


@contextmanager
def _handled(numbers: Iterable[int], handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """These signals have this handler."""
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


def _kept_ignored(number: signal.Signals) -> bool:
    """Whether the process was started to ignore this signal on purpose (`nohup`)."""
    return signal.getsignal(number) is signal.SIG_IGN and number not in FOREGROUND


@dataclass
class StopRequest:
    """A request to stop. It only keeps the request, so a tick is never interrupted.

    why: its first reason, "" before there is one. torque_off: whether torque is to go off before the robot stands.
    too_soon: presses of a stop key that came too soon after its first one to count.
    """

    why: str = ""
    torque_off: bool = False
    too_soon: int = 0

    def __call__(self) -> bool:
        """Whether a stop was asked for."""
        return bool(self.why)

    def ask(self, why: str) -> None:
        """Ask to stop before the next tick. why: not empty."""
        self.why = self.why or why

    def force(self, why: str) -> None:
        """Ask to stop with torque off at once, without braking."""
        self.why, self.torque_off = self.why or why, True


@contextmanager
def all_as_ctrl_c() -> Iterator[None]:
    """SIGTERM, SIGHUP (a terminal that is gone) and SIGQUIT raise KeyboardInterrupt as SIGINT does: what is open is
    closed.

    Only signals that are not handled or ignored yet (but see `FOREGROUND`), and only in the main thread, which alone
    may set handlers.
    """
    mine, free = threading.current_thread() is threading.main_thread(), (signal.SIG_DFL, signal.SIG_IGN)
    unhandled = [n for n in REASONS if mine and signal.getsignal(n) in free and not _kept_ignored(n)]
    with _handled(unhandled, signal.default_int_handler):
        yield


@contextmanager
def interruptible() -> Iterator[None]:
    """Where nothing moves any more, inside `stop_on_signals`: its signals raise KeyboardInterrupt."""
    mine = threading.current_thread() is threading.main_thread()
    with _handled([n for n in REASONS if mine and not _kept_ignored(n)], signal.default_int_handler):
        yield


@contextmanager
def stop_on_signals(clock: Clock | None = None, *, moves: bool = False) -> Iterator[StopRequest]:
    """SIGINT, SIGTERM, SIGHUP and SIGQUIT ask to stop, and Ctrl-Z where a robot `moves`; SIGINT after another of them
    forces torque off, and so does Ctrl-C that is pressed again (see `ForcedStopKey`; a held one does not).

    None of them raises. One that the process was started to ignore (`nohup`) stays ignored; see `FOREGROUND`.
    """
    request, key, time = StopRequest(), ForcedStopKey(), clock or MonotonicClock()
    others: set[int] = set()  # signals before, but SIGINT
    reasons = {**REASONS, **SUSPENDED} if moves else REASONS

    def handle(number: int, frame: FrameType | None) -> None:
        why = reasons[signal.Signals(number)]
        press = key.pressed(1, time.now()) if number == signal.SIGINT else None
        if press is Press.SECOND or (press is not None and others):
            request.force(why)
        elif press is Press.TOO_SOON:
            request.too_soon += 1
        else:
            request.ask(why)
        others.update({number} - {signal.SIGINT})

    with _handled([number for number in reasons if not _kept_ignored(number)], handle):
        yield request


DONE = 0
STOPPED = 1
"""Stopped by the guard or by the user while something moved, or a file could not be written afterwards."""
REFUSED = 2
"""Refused before anything moved: a bad file, a bad option. Also: what was to be said could not be printed."""
DEFECT = 3
"""An unforeseen error."""
INTERRUPTED = 130
"""Ctrl-C, SIGTERM, SIGHUP, SIGQUIT before anything moved: 128 + SIGINT, as shells count; typer leaves with it too."""


def exit_code_of(command: Callable[[], object]) -> int:
    """Run `command` and return its exit code; what went wrong is on stderr, a traceback only for our own defects.

    A signal that asks the process to end acts as Ctrl-C. A reader of stdout that leaves early changes nothing; a stdout
    that cannot be written is reported.
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
"""The exit code of each kind of error, the first that fits; any other error is a defect."""


def _code_of_error(error: BaseException) -> int:
    """The exit code; what went wrong is printed."""
    # An import that Ctrl-C cuts may come back as 'initialization failed'.
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
"""Messages of loaders of libraries and threads to which the system gave no memory."""


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """An error and all that it comes from."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def out_of_memory(error: BaseException) -> bool:
    """True if an error comes from memory that the system did not give, also while a library was imported."""
    loaders = (ImportError, OSError, RuntimeError)
    return any(
        isinstance(one, MemoryError) or (isinstance(one, loaders) and NO_MEMORY.search(str(one)))
        for one in _causes(error)
    )


LEAST_MEMORY = 700_000_000
"""Address space, bytes, without which no run begins: a short one takes 500 MB, 200 of them for numbers and texts. One
that ends in the middle of a run would leave the robot to the watchdogs of its servos."""


def memory_message() -> str:
    """Why a command ends that the system gives too little memory."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    found = "the system gave no more" if limit == resource.RLIM_INFINITY else f"a limit of {limit / 1e6:.0f} MB"
    step = "Close other programs, or give the process more (ulimit -v unlimited)"
    allowed = f"{LEAST_MEMORY / 1e6:.0f} MB or more"
    return describe(what="too little memory", found=found, allowed=allowed, then=step)


def refuse_little_memory() -> None:
    """Raise MemoryError where a limit of the process (`ulimit -v`) leaves less than a run needs."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY:
        raise MemoryError
