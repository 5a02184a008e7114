"""What clips of a batch are run with in tests: found by name in their processes."""

import os
import signal
from typing import Any

from hardware.bus import ServoBus
from hardware.clock import Clock
from hardware.guard_state import StopCause
from retarget.batch.clip import BatchClip, BatchSettings, ClipRow, ClipStatus, failed_row
from retarget.model.robot import RobotBody
from retarget.run.run_result import RunResult
from sim.mock_bus import mock_bus

AFTER = 100


class Falling:
    """A mock bus, and a robot that has fallen after AFTER ticks."""

    def __init__(self, *_: object) -> None:
        self._ticks = 0

    def make_bus(self, robot: RobotBody, clock: Clock) -> ServoBus:
        return mock_bus(robot, clock)

    def look(self, *_: Any) -> tuple[StopCause, str] | None:
        self._ticks += 1
        return (StopCause.FALLEN, "the robot has fallen") if self._ticks > AFTER else None

    def seen(self, run: RunResult) -> RunResult:
        return run


def surroundings(clip: BatchClip, settings: BatchSettings) -> ClipRow:
    """Says how many threads libraries may have, and whether Ctrl-C is seen."""
    blocked = signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    threads = f"{os.environ.get('OMP_NUM_THREADS')} {os.environ.get('OPENBLAS_NUM_THREADS')}"
    return failed_row(clip, settings, ClipStatus.DONE, "", f"{threads} {'blocked' if blocked else 'seen'}")
