"""A synthetic performer as JSON over UDP, in a process of its own: still at first, then the arms wave for ever.

`python -m benchmarks.pose_sender PORT`: until the end of its input.
"""

from __future__ import annotations

import json
import math
import socket
import subprocess
import sys
from types import TracebackType

from hardware.clock import MonotonicClock

RATE_HZ = 100.0
STILL_S = 8.0
STANDING = {
    "head": (0.0, 0.0, 1.6),
    "l_wrist": (0.0, 0.25, 0.8),
    "r_wrist": (0.0, -0.25, 0.8),
    "l_ankle": (0.0, 0.1, 0.08),
    "r_ankle": (0.0, -0.1, 0.08),
}
TREMBLE_M = 1e-4
"""Nobody is still to the bit, which would be a frozen sensor."""


def message(number: int) -> bytes:
    """The datagram of one frame."""
    time = number / RATE_HZ
    lift = 0.0 if time < STILL_S else 0.3 * (1.0 - math.cos(1.5 * (time - STILL_S)))
    poses = {}
    for name, (x, y, z) in STANDING.items():
        raised = lift if name.endswith("wrist") else 0.0
        tremble = TREMBLE_M * math.sin(2.3 * number + len(name) * y)
        poses[name] = {"p": [x + 0.5 * raised + tremble, y, z + raised + tremble]}
    return json.dumps({"axes": "rep103", "time": time, "frame": number, "poses": poses}).encode()


def send(port: int) -> None:
    """Send in real time until killed."""
    clock, number = MonotonicClock(), 0
    begun = clock.now()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        while True:
            out.sendto(message(number), ("127.0.0.1", port))
            number += 1
            clock.sleep_until(begun + number / RATE_HZ)


class PoseSender:
    """The process, while the context lasts; it begins still."""

    def __init__(self, port: int) -> None:
        self._command = [sys.executable, "-m", "benchmarks.pose_sender", str(port)]

    def __enter__(self) -> PoseSender:
        self._process = subprocess.Popen(self._command)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()


if __name__ == "__main__":
    send(int(sys.argv[1]))
