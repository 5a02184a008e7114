"""Sticks, by which the operator asks a robot that walks for a velocity: keys of the terminal, and a gamepad. That of a
web page is `retarget.cli.web.control.PageControl`."""

from collections.abc import Callable
from math import copysign, hypot, inf
from typing import Protocol

from hardware.errors import HardwareError
from retarget.cli.event_device import EV_ABS, EV_SYN, SYN_DROPPED, EventDevice
from retarget.robot.walking.pattern import Request

Shares = tuple[float, float, float]
"""Velocity forward, to the left, and turning to the left, each from -1 to 1: shares of the robot's fastest walk."""
STAND: Shares = (0.0, 0.0, 0.0)
"""Nothing is asked for."""


class Stick(Protocol):
    """Something by which the operator asks for a velocity."""

    def shares(self, now: float) -> Shares:
        """The shares that are asked for at `now`, s; STAND where nothing is held any more. Never waits, and raises
        nothing that a person or a device causes."""


DEAD_ZONE = 0.15
"""A smaller share is none: worn sticks do not come back to the centre, and no finger goes straight."""


def velocity_of(shares: Shares, fastest: Request) -> Request:
    """The velocity of these shares of a robot's fastest walk. On a slant it is no faster than straight on."""
    forward, left, turn = (copysign(max(abs(share) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE), share) for share in shares)
    length = max(hypot(forward, left), 1.0)
    return Request(fastest.forward * forward / length, fastest.left * left / length, fastest.turn * turn)


# Keys of a terminal, which reports no release.

LAPSE_S = 0.6
"""Time, s, for which a key counts after it came: keyboards wait half a second before they repeat."""
WALK_KEYS: dict[str, Shares] = {
    "w": (1.0, 0.0, 0.0),
    "s": (-1.0, 0.0, 0.0),
    "a": (0.0, 1.0, 0.0),
    "d": (0.0, -1.0, 0.0),
    "q": (0.0, 0.0, 1.0),
    "e": (0.0, 0.0, -1.0),
    "x": STAND,
}
"""Shares that the keys ask for."""
KEYS_HELP = "w and s (held) walk forward and back, a and d sideways, q and e turn, x stands"


class KeyStick:
    """Keys that walk while they are held; the last one that came counts."""

    def __init__(self) -> None:
        self._shares, self._until = STAND, -inf

    def press(self, keys: str, now: float) -> None:
        """Take the keys that came until `now`, s."""
        for key in keys.lower():
            if key in WALK_KEYS:
                self._shares, self._until = WALK_KEYS[key], now + LAPSE_S

    def shares(self, now: float) -> Shares:
        """The shares, as `Stick.shares` says."""
        return self._shares if now <= self._until else STAND


# A gamepad.

GAMEPAD_HELP = "the left stick of the gamepad walks and the right one turns while a shoulder button is held"

ABS_X, ABS_Y, ABS_Z, ABS_RX = 0, 1, 2, 3
"""Axes of the left stick, and to the right of the right one; gamepads without ABS_RX have it as ABS_Z."""
SHOULDERS = {0x136, 0x137, 0x138, 0x139}
"""BTN_TL, BTN_TR, BTN_TL2, BTN_TR2."""


class Gamepad(EventDevice):
    """A gamepad as a stick, of which only what was moved and pressed since it was opened counts."""

    def __init__(self, path: str, *, notify: Callable[[str], object]) -> None:
        """notify: receives that the gamepad is lost. Raises HardwareError as an EventDevice does, and for a device
        without a stick."""
        super().__init__(path)
        self._notify: Callable[[str], object] | None = notify
        codes = (ABS_Y, ABS_X, ABS_RX if any(self.axis(ABS_RX)) else ABS_Z)  # forward, left, turn
        self._ranges = {code: self.axis(code) for code in codes}
        self._shares = dict.fromkeys(codes, 0.0)
        if any(least >= greatest for least, greatest in self._ranges.values()):
            self.close()
            step = "Name the event device of a gamepad: ls /dev/input/by-id/*-event-joystick"
            raise HardwareError("this device has no two sticks", where=path, then=step)

    def shares(self, now: float) -> Shares:
        """The shares, as `Stick.shares` says. A stick that is held still sends no events, so they count while a
        shoulder button is down; once the device is lost, the robot is to stand for good."""
        for kind, code, value in self._events():
            if kind == EV_ABS and code in self._ranges:
                self._shares[code] = _share(value, *self._ranges[code])
            elif kind == EV_SYN and code == SYN_DROPPED:
                self._shares = dict.fromkeys(self._shares, 0.0)
        if self.lost and self._notify is not None:
            self._notify(f"{self.path}: {self.lost}: the robot walks no more: stop the run")
            self._notify = None
        if not self._down & SHOULDERS:
            return STAND
        forward, left, turn = self._shares.values()
        return forward, left, turn


def _share(value: int, least: int, greatest: int) -> float:
    """Share, -1 to 1, of a stick's way forward or to the left: its axes point backward and to the right."""
    return 1.0 - 2.0 * (min(max(value, least), greatest) - least) / (greatest - least)
