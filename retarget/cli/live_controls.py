"""What a person at the machine may ask of a live run: by keys, by what is held, by a file that appears, by a socket."""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from hardware.clock import Clock, MonotonicClock
from hardware.guard import Guard
from retarget.cli.clutch import LONGEST_S, Clutch
from retarget.cli.control_socket import ControlSocket
from retarget.cli.interrupt import StopRequest
from retarget.cli.keys import Keys
from retarget.cli.oversight import stop_file_state
from retarget.cli.second_press import SecondPress
from retarget.live.engagement import Engaged
from retarget.live.performer import LivePerformer

__all__ = ["HELP", "LiveControls", "LiveStatus"]

HELP = (
    "keys: space stops (once more, after a second: torque off at once), p pauses and goes on, h takes the way you face "
    "as straight ahead"
)
FILE_PERIOD = 5
"""Ticks between two looks for the file; the first look of all is one, so nothing gets torque where it is there."""
WORDS = "stop, cut, hold, status"
SPACE, SOCKET = "interrupted by the user (space bar)", "stopped through the control socket (`retarget stop`)"
"""Who stopped it."""
GOES_ON, NEVER_GOES_ON = "p goes on", "there is no terminal whose p would go on, so stop it: `retarget stop`"
"""After a pause."""


@dataclass(frozen=True)
class LiveStatus:
    """state: of the guard, null without a robot. followed: whether the performer is, now. let_go: on purpose. stop: why
    the robot stops or stopped, else null."""

    state: str | None
    followed: bool
    let_go: bool
    stop: str | None


class LiveControls:
    """`look` in every tick. guard: of the robot, None without one. stop_file: its appearance stops the robot; it is
    left where it is, and counts as there where nobody can look for it. socket: where other programs stop or hold it;
    what would let it move is refused there. Whatever is asked is done before it is told."""

    def __init__(
        self,
        keys: Keys,
        stop: StopRequest,
        performer: LivePerformer,
        clutch: Clutch,
        *,
        tell: Callable[[str], object],
        clock: Clock | None = None,
        guard: Guard | None = None,
        stop_file: Path | None = None,
        socket: ControlSocket | None = None,
    ) -> None:
        self._keys, self._stop, self._performer, self._clutch = keys, stop, performer, clutch
        self._guard, self._stop_file, self._socket, self._tell = guard, stop_file, socket, tell
        self._clock, self._space = clock or MonotonicClock(), SecondPress()
        self._ticks, self._told = 0, False  # told: that the robot stops

    def look(self) -> bool:
        """Do what was asked; whether that is to stop."""
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
            self._stop_by_itself()
        return self._stop()

    def insisted(self) -> bool:
        """While the robot brakes: whether torque is to go off at once."""
        self.look()
        self._say_why()
        return self._stop.insisted()

    def why(self) -> str:
        """Who asked for the stop."""
        return self._stop.why()

    def status(self) -> LiveStatus:
        """How it is now."""
        guard, following = self._guard, self._performer.engagement.state is Engaged.FOLLOWING
        reason = None if guard is None or guard.stop_reason is None else guard.stop_reason.reason
        state = None if guard is None else guard.state.value
        return LiveStatus(state, following, not self._clutch.engaged, reason)

    def _say_why(self) -> None:
        """Why the robot stops, at once: nobody at the machine should wait for the summary to know. Once."""
        reason = None if self._guard is None else self._guard.stop_reason
        if reason is not None and not self._told:
            with suppress(OSError):  # who hears nothing any more does not keep a second press from being heard
                self._say_stopping(f"stopping: {reason.reason}")

    def _say_stopping(self, text: str) -> None:
        self._told = True
        self._tell(text)

    def _stop_by_itself(self) -> None:
        if self._ticks % FILE_PERIOD == 1 and self._stop_file is not None:
            self._look_for(self._stop_file)
        if self._clutch.expired and not self._stop():
            self._ask(f"let go for {LONGEST_S:g} s")

    def _look_for(self, file: Path) -> None:
        state = stop_file_state(file)
        if state:
            self._ask(f"{file} {state}")

    def _ask(self, why: str) -> None:
        self._stop.ask(why)
        self._say_stopping(f"{why}: stopping")

    def _press_space(self, count: int) -> None:
        """count: how often it came since the last look."""
        again = self._space.pressed(count, self._clock.now())
        if not self._stop():
            self._stop.ask(SPACE)
            self._say_stopping("stopping")
        elif again:
            self._stop.insist(SPACE)

    def _press(self, key: str) -> None:
        if key == "p":
            if self._clutch.paused:
                self._clutch.unpause()
                self._tell("going on" if self._clutch.engaged else "no pause any more: it goes on when it is held")
            else:
                self._clutch.pause()
                self._tell(f"paused: the robot holds; {GOES_ON}")
        elif key == "h":
            self._tell(
                "straight ahead is where you face now" if self._performer.reset_heading() else "left and right are lost"
            )

    def _obey(self, word: str) -> str:
        """The answer to a word of the socket."""
        if word == "status":
            return json.dumps(asdict(self.status()))
        if word == "stop":
            if not self._stop():
                self._stop.ask(SOCKET)
                self._say_stopping("stopping, asked by the control socket")
            return "ok stopping"
        if word == "cut":
            self._stop.insist(SOCKET)
            self._say_stopping("torque off at once, asked by the control socket")
            return "ok torque off"
        if word == "hold":
            if not self._clutch.paused:
                self._clutch.pause()
                then = GOES_ON if self._keys.listens else NEVER_GOES_ON
                self._tell(f"paused by the control socket: the robot holds; {then}")
            return "ok holding"
        return f"error: found {word[:20]!a}, allowed: {WORDS}; only a person at the keyboard lets the robot move"
