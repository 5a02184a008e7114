"""Signals that end a command: all are as Ctrl-C is. While a robot moves they ask, and raise nothing inside a tick."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from hardware.clock import Clock, MonotonicClock
from retarget.cli.second_press import SecondPress

__all__ = ["REASONS", "SUSPENDED", "StopRequest", "all_as_ctrl_c", "stop_on_signals"]

REASONS = {
    "SIGINT": "interrupted by the user (Ctrl-C)",
    "SIGTERM": "told to end by another program (SIGTERM)",
    "SIGHUP": "the terminal is gone (SIGHUP)",
    "SIGQUIT": "told to quit (Ctrl-\\, SIGQUIT)",
}
SUSPENDED = {"SIGTSTP": "told to wait (Ctrl-Z, SIGTSTP)"}
"""While a robot moves: one that nobody looks after would stand there with torque."""
SIGNALS = [getattr(signal, name) for name in REASONS if hasattr(signal, name)]
"""Those of them that the platform has."""


class StopRequest:
    """Whether somebody asked to stop, who was the first, and whether they insisted. Nothing is done here: a tick is
    never torn."""

    def __init__(self) -> None:
        self._why = ""
        self._insisted = False

    def __call__(self) -> bool:
        """Whether somebody asked."""
        return bool(self._why)

    def why(self) -> str:
        """Who asked first, as the reason of a stop; "" before somebody has."""
        return self._why

    def insisted(self) -> bool:
        """Whether somebody asked not to wait for the robot to stand."""
        return self._insisted

    def ask(self, why: str) -> None:
        """Ask to stop before the next tick. why: not empty."""
        self._why = self._why or why

    def insist(self, why: str) -> None:
        """Ask to stop, without braking."""
        self._why, self._insisted = self._why or why, True


@contextmanager
def all_as_ctrl_c() -> Iterator[None]:
    """SIGTERM, SIGHUP (a terminal that is gone) and SIGQUIT raise KeyboardInterrupt as SIGINT does: what is open is
    closed.

    Only those that nobody handles or ignores yet, and only in the main thread: no other may set them.
    """
    mine = [
        number
        for number in SIGNALS
        if threading.current_thread() is threading.main_thread() and signal.getsignal(number) is signal.SIG_DFL
    ]
    for number in mine:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in mine:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def stop_on_signals(clock: Clock | None = None, *, moves: bool = False) -> Iterator[StopRequest]:
    """SIGINT, SIGTERM, SIGHUP and SIGQUIT ask to stop, and Ctrl-Z where a robot `moves`; SIGINT after another of them
    insists, and so does Ctrl-C that is pressed again (see `SecondPress`): held, it repeats.

    None of them raises. One that the process was started to ignore (`nohup`) stays ignored.
    """
    request, key, time = StopRequest(), SecondPress(), clock or MonotonicClock()

    def handle(number: int, frame: FrameType | None) -> None:
        why = {**REASONS, **SUSPENDED}[signal.Signals(number).name]
        again = number == signal.SIGINT and key.pressed(1, time.now())
        if again or (number == signal.SIGINT and request() and request.why() != REASONS["SIGINT"]):
            request.insist(why)
        else:
            request.ask(why)

    known = [*SIGNALS, *(getattr(signal, name) for name in SUSPENDED if moves and hasattr(signal, name))]
    heard = [number for number in known if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handle) for number in heard}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
