"""What a person at the machine may ask of a live run: by keys, or by a file that appears."""

from collections.abc import Callable
from pathlib import Path

from retarget.cli.interrupt import StopRequest
from retarget.cli.keys import Keys
from retarget.live.performer import LivePerformer

__all__ = ["HELP", "LiveControls"]

HELP = "keys: space stops (twice: torque off at once), p pauses and goes on, h takes the way you face as straight ahead"
FILE_PERIOD = 5
"""Ticks between two looks for the file."""


class LiveControls:
    """`look` in every tick. stop_file: its appearance stops the robot; it is left where it is."""

    def __init__(
        self,
        keys: Keys,
        stop: StopRequest,
        performer: LivePerformer,
        *,
        stop_file: Path | None,
        tell: Callable[[str], object],
    ) -> None:
        self._keys, self._stop, self._performer = keys, stop, performer
        self._stop_file, self._tell = stop_file, tell
        self._ticks = 0

    def look(self) -> bool:
        """Do what was asked; whether that is to stop."""
        for key in self._keys.pressed():
            self._press(key)
        self._ticks += 1
        if self._ticks % FILE_PERIOD == 0 and not self._stop() and self._is_stopped_by_file():
            self._tell(f"{self._stop_file} is there: stopping")
            self._stop.ask()
        return self._stop()

    def insisted(self) -> bool:
        """While the robot brakes: whether torque is to go off at once."""
        self.look()
        return self._stop.insisted()

    def _is_stopped_by_file(self) -> bool:
        return self._stop_file is not None and self._stop_file.exists()

    def _press(self, key: str) -> None:
        if key == " ":
            if self._stop():
                self._stop.insist()
            else:
                self._tell("stopping")
                self._stop.ask()
        elif key == "p":
            paused = self._performer.pause()
            self._tell("paused: the robot holds; p goes on" if paused else "going on")
        elif key == "h":
            self._tell(
                "straight ahead is where you face now" if self._performer.reset_heading() else "left and right are lost"
            )
