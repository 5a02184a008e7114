"""A bus of the user's own, named on the command line as `module:Class`: for servos of another make.

The class is called with the robot and the clock, and returns a `hardware.bus.ServoBus` below gate and guard. The module
is searched in the current folder first; its code runs, as `python my_bus.py` would.
"""

import importlib
import re
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from hardware.bus import ServoBus, ServoGoals, ServoStates
from hardware.clock import Clock
from hardware.errors import BusError, RetargetError
from hardware.imu import ImuSample
from retarget.errors import UsageError, suggest
from retarget.model.robot import RobotBody

_NAMED = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")
METHODS = ("open", "read", "write", "torque", "close")
"""Required methods. Without `limit_drive` servos keep their full drive in a fall."""
KINDS = {
    "position": "iu",
    "velocity": "f",
    "current": "f",
    "voltage": "f",
    "temperature": "f",
    "error": "iu",
    "alert": "iu",
    "age": "f",
    "valid": "b",
    "driven": "b",
}
"""Arrays (n,) of the servo states, and their NumPy kinds."""


def is_own(name: str) -> bool:
    """True if a bus is named as a class; the path of a port has a slash."""
    return ":" in name and "/" not in name


def own_bus_class(name: str) -> Callable[[RobotBody, Clock], ServoBus]:
    """The class `module:Class`. Raises UsageError."""

    def refused(what: str, allowed: str, step: str = "") -> UsageError:
        return UsageError(what, where="--bus", found=repr(name[:80]), allowed=allowed, next_step=step)

    if not _NAMED.fullmatch(name):
        raise refused("this names no class of a bus", "module:Class, such as my_bus:MyBus")
    module_name, _, word = name.partition(":")
    with _current_folder_first():
        try:
            module = importlib.import_module(module_name)
        except (Exception, SystemExit) as error:
            if isinstance(error, ModuleNotFoundError) and error.name and f"{module_name}.".startswith(f"{error.name}."):
                file = f"{module_name.replace('.', '/')}.py"
                allowed = f"{file} in this folder ({Path.cwd()}), or an installed module"
                raise refused("no such module", allowed, "Go to its folder, or correct the name") from None
            raise refused(f"its module cannot be imported: {_text(error)}", "a module that Python imports") from error
    found = getattr(module, word, None)
    if found is None:
        buses = [key for key, value in vars(module).items() if isinstance(value, type) and not _missing(value)]
        raise refused(
            f"{module_name} has no such class", ", ".join(buses) or "a class of its own", suggest(word, buses)
        )
    missing = _missing(found) if isinstance(found, type) else "it is no class"
    if missing:
        step = "See docs/dynamixel.md, Other servos"
        raise refused(f"this is no ServoBus: {missing}", f"a class with {', '.join(METHODS)}", step)
    make: Callable[[RobotBody, Clock], ServoBus] = found
    return make


def _missing(found: type) -> str:
    lacking = [name for name in METHODS if not callable(getattr(found, name, None))]
    return f"it has no {', '.join(lacking)}" if lacking else ""


@contextmanager
def _current_folder_first() -> Iterator[None]:
    """Search the current folder first here, and last afterwards, so that no file in it hides a module from others."""
    folder = str(Path.cwd())
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
        if folder not in sys.path:
            sys.path.append(folder)


def _text(error: BaseException) -> str:
    """An exception of the user's code: kind, text and line."""
    at = traceback.extract_tb(error.__traceback__)[-1]
    place = (
        "" if at.filename == __file__ or isinstance(error, SyntaxError) else f" ({Path(at.filename).name}:{at.lineno})"
    )
    return f"{type(error).__name__}: {error}{place}"


class OwnBus:
    """Checks a user's `ServoBus`: exceptions and wrong states become a BusError that names the method."""

    def __init__(self, name: str, robot: RobotBody, clock: Clock) -> None:
        """Raises UsageError for a class that cannot be used, or cannot be made."""
        self._name, self._servos = name, len(robot.joint_map)
        make = own_bus_class(name)
        try:
            self._bus = make(robot, clock)
        except RetargetError:
            raise
        except Exception as error:
            raise UsageError(
                f"the bus cannot be made: {_text(error)}",
                where="--bus",
                found=repr(name),
                allowed="Class(robot, clock)",
                next_step="It is called with the robot and the clock of a run",
            ) from error

    def open(self) -> None:
        """Open the bus. Raises BusError."""
        self._call("open")

    def read(self) -> ServoStates:
        """Read one cycle. Raises BusError."""
        states = self._call("read")
        if not isinstance(states, ServoStates):
            raise self._error("read", f"it returned {type(states).__name__}", "hardware.bus.ServoStates")
        for name, kinds in KINDS.items():
            values = getattr(states, name)
            if not isinstance(values, np.ndarray) or values.shape != (self._servos,) or values.dtype.kind not in kinds:
                found = f"{values.dtype} {values.shape}" if isinstance(values, np.ndarray) else type(values).__name__
                kind = {"iu": "integers", "f": "floats", "b": "booleans"}[kinds]
                raise self._error("read", f"{name} is {found}", f"an array of {kind}, ({self._servos},)")
        if not isinstance(states.imu, ImuSample | None):
            raise self._error("read", f"imu is {type(states.imu).__name__}", "hardware.imu.ImuSample or None")
        return states

    def write(self, goals: ServoGoals) -> None:
        """Send goals. Raises BusError."""
        self._call("write", goals)

    def limit_drive(self, share: float) -> None:
        """Limit the drive, where the bus can. Raises BusError."""
        if hasattr(self._bus, "limit_drive"):
            self._call("limit_drive", share)

    def torque(self, on: bool) -> None:
        """Switch torque. Raises BusError."""
        self._call("torque", on)

    def close(self) -> None:
        """Close the bus. Raises BusError."""
        self._call("close")

    def _call(self, method: str, *arguments: object) -> Any:
        try:
            return getattr(self._bus, method)(*arguments)
        except BusError:
            raise
        except Exception as error:
            raise self._error(method, _text(error), None) from error

    def _error(self, method: str, found: str, allowed: str | None) -> BusError:
        return BusError(
            "the bus of your own failed",
            where=f"{self._name}.{method}",
            found=found,
            allowed=allowed,
            then="Check its servos, or correct its code",
        )
