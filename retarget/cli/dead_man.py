"""What must be held so that a robot moves: a pedal or key of its own device, or a key of the terminal."""

from typing import Protocol

from hardware.key_device import KeyDevice
from retarget.cli.held_key import HeldKey
from retarget.errors import UsageError

__all__ = ["DeadMan", "Pedal", "open_dead_man"]

PEDAL = "pedal:"
TAKEN = " ph"
"""Keys of the terminal that mean something else already."""
ALLOWED = "a letter or digit key of the terminal but p and h, or pedal:/dev/input/... of a pedal, button or keyboard"


class DeadMan(Protocol):
    """What is held or let go."""

    @property
    def lost(self) -> str:
        """Why it can tell nothing any more; then it is let go for good. "" while it can."""
        ...

    @property
    def told(self) -> str:
        """What a person is to hold."""
        ...

    def held(self, pressed: str, now: float) -> bool:
        """Whether it is held at `now`, s. pressed: keys of the terminal since the last look."""
        ...

    def close(self) -> None:
        """Let go of the device."""
        ...


class Pedal:
    """A device that tells of presses and releases."""

    def __init__(self, device: KeyDevice) -> None:
        self._device = device

    @property
    def lost(self) -> str:
        """Why it tells nothing any more."""
        return f"{self._device.path}: {self._device.lost}" if self._device.lost else ""

    @property
    def told(self) -> str:
        """What a person is to hold."""
        return f"the pedal {self._device.path}"

    def held(self, pressed: str, now: float) -> bool:
        """Whether it is pressed."""
        return self._device.pressed()

    def close(self) -> None:
        """Close the device."""
        self._device.close()


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
        raise _refused(text, "nothing that can be held")
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
