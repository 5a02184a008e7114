"""`python -P wire_tap.py FILE.npz WORDS...`: `retarget WORDS...` with every byte of its emulated ports kept.

It is started as a script, in a process of its own, with the version to be run first on PYTHONPATH. No version needs an
option for it, and none can forget one: the emulated port is found by its shape, wherever that version keeps it.
"""

import importlib
import pkgutil
import runpy
import sys
from types import ModuleType
from typing import Any

import numpy as np

PLACES = ("sim.emulator", "sim")
"""Packages that may hold the emulated port, the likeliest first: what is imported costs time."""
SHAPE = ("open", "set_baud", "write", "read", "wait", "drop", "now", "close")
"""Methods of a byte port. The class that itself defines all of them is the port; one that adds to it does not."""
TO_SERVOS, TO_HOST = 0, 1


class Log:
    """Messages of all ports in the order in which they were written, and what was read in the order of reading."""

    def __init__(self) -> None:
        self._ports: list[object] = []
        self._rows: list[tuple[float, int, int, int]] = []
        self._data = bytearray()

    def add(self, port: Any, direction: int, data: bytes) -> None:
        """Keep one message. What is read while nothing has arrived is none."""
        if not data:
            return
        if not any(port is one for one in self._ports):
            self._ports.append(port)
        index = next(place for place, one in enumerate(self._ports) if one is port)
        self._rows.append((float(port.now()), index, direction, len(data)))
        self._data += data

    def arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """time (m,) s on the run's clock, port, direction and size (m,) of each message; data (sum of sizes,) bytes."""
        time, port, direction, size = zip(*self._rows, strict=True) if self._rows else ((), (), (), ())
        return {
            "time": np.array(time, dtype=np.float64),
            "port": np.array(port, dtype=np.int64),
            "direction": np.array(direction, dtype=np.int64),
            "size": np.array(size, dtype=np.int64),
            "data": np.frombuffer(bytes(self._data), dtype=np.uint8),
        }


def emulated_port() -> type[Any]:
    """The class. Raises LookupError unless there is exactly one in the first package that has any."""
    for place in PLACES:
        try:
            package = importlib.import_module(place)
        except ModuleNotFoundError:
            continue
        found: set[type[Any]] = {
            kind for module in _modules(package) for kind in vars(module).values() if _has_the_shape(kind)
        }
        if len(found) > 1:
            raise LookupError(f"several emulated ports in {place}: {sorted(kind.__qualname__ for kind in found)}")
        if found:
            return found.pop()
    raise LookupError(f"no class of {' or '.join(PLACES)} has the methods of a port: {', '.join(SHAPE)}")


def _modules(package: ModuleType) -> list[ModuleType]:
    names = [one.name for one in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")]
    return [package, *(importlib.import_module(name) for name in names if not name.endswith("__main__"))]


def _has_the_shape(kind: object) -> bool:
    return isinstance(kind, type) and all(callable(vars(kind).get(name)) for name in SHAPE)


def tap(kind: Any, log: Log) -> None:
    """Keep what every port of this class writes and reads."""
    write, read = kind.write, kind.read

    def written(self: object, data: bytes) -> None:
        log.add(self, TO_SERVOS, bytes(data))
        write(self, data)

    def was_read(self: object) -> bytes:
        data = bytes(read(self))
        log.add(self, TO_HOST, data)
        return data

    kind.write, kind.read = written, was_read


def main(file: str, *words: str) -> None:
    """Run it; the bytes are written however it ends."""
    log = Log()
    tap(emulated_port(), log)
    sys.argv = ["retarget", *words]
    try:
        runpy.run_module("retarget", run_name="__main__", alter_sys=True)
    finally:
        kept: dict[str, Any] = log.arrays()
        np.savez(file, **kept)


if __name__ == "__main__":
    main(*sys.argv[1:])
