"""Half an hour of a live performer on virtual time: nothing grows, nothing drifts, and no late tick goes unseen."""

import resource
import sys
from pathlib import Path

import numpy as np
import pytest

from hardware.arrays import TickArray
from hardware.bus import ServoGoals
from live_rig import LiveRig
from retarget.live.admission import Datagram
from retarget.live.begin import LiveOptions
from retarget.report.measure import pace
from retarget.run.loop import Progress
from retarget.types import FloatArray
from sim.faults.sender import STILL_S, FakeSender, Poses

pytestmark = pytest.mark.long

LASTS_S = 1800.0
ROUND_S = 60.0
"""The performer goes through the motion and back, and stands for a moment at either end of it."""
DWELL_S = 2.0
SWAY_M = 0.001
WARM_S = 660.0
"""By then everything that is remembered for the report has been."""
STALL_S, EVERY_S = 0.05, 300.0
LATE_TICKS = 5
GROWTH_MB = 2.0
GROWTH_BLOCKS = 2500
TICKS = 3
MOST_TICKS = 250_000


def progress(time: float) -> float:
    """How far through the motion, 0 to 1: there in half a round, and back."""
    lasts = 0.5 * ROUND_S - DWELL_S
    phase = (time - STILL_S) % ROUND_S
    moving = min(phase, ROUND_S - phase) - 0.5 * DWELL_S
    return 0.5 - 0.5 * float(np.cos(np.pi * np.clip(moving / lasts, 0.0, 1.0)))


class NoisySender(FakeSender):
    """Goes through the synthetic performer's motion and back, the same to the bit in every round. At times a poll
    takes long, which makes a tick late."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.faults.append(self._moving)
        self.stalls: list[float] = []
        self.rig: LiveRig

    finished = False

    def poll(self, now: float) -> list[Datagram]:
        found = super().poll(now)
        if now - self.begun > EVERY_S * (len(self.stalls) + 1):
            self.stalls.append(now)
            self.rig.clock.advance(STALL_S)
        return found

    def _moving(self, time: float, poses: Poses) -> Poses:
        row = progress(time) * (len(self.track) - 1)
        low = min(int(row), len(self.track) - 2)
        at: FloatArray = self.track[low] + (row - low) * (self.track[low + 1] - self.track[low])
        sway = SWAY_M * np.sin(2.0 * np.pi * time / np.array([3.0, 4.0, 5.0]))
        return dict(zip(self.frames.names, at + sway, strict=True))


def resident_mb() -> float:
    """Memory of this process that is in use, now."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * resource.getpagesize() / 2**20


class Diary:
    """Memory once a minute, goals at the turn of every round, and late ticks."""

    def __init__(self, rig: LiveRig, sender: NoisySender) -> None:
        self.memory: list[tuple[float, float, int]] = []  # [s] of the run, MiB in use, blocks of Python
        self.turns: list[tuple[int, TickArray]] = []  # rounds, and the goals while the performer stood at their far end
        self.ticks = 0
        self.times = np.full(MOST_TICKS, np.nan)  # [s] end of each tick; filled, so that the diary itself grows no more
        self._rig, self._sender = rig, sender
        self._goals: TickArray = np.zeros(0, dtype=np.int64)
        self._write, rig.bus.write = rig.bus.write, self._keep  # type: ignore[method-assign]

    def look(self, ticks: int) -> None:
        """After every tick."""
        self.times[self.ticks] = self._rig.clock.now()
        self.ticks += 1
        run = self._rig.clock.now() - self._sender.begun - STILL_S
        if not self.memory or run - self.memory[-1][0] >= ROUND_S:
            self.memory.append((run, resident_mb(), sys.getallocatedblocks()))
        number, phase = divmod(run, ROUND_S)
        done = self.turns[-1][0] if self.turns else -1
        if number > done and 0.5 * ROUND_S <= phase < 0.5 * ROUND_S + 0.25 * DWELL_S:
            self.turns.append((int(number), self._goals))

    def _keep(self, goals: ServoGoals) -> None:
        self._goals = goals.ticks.copy()
        self._write(goals)


def test_half_an_hour_is_as_its_first_minutes() -> None:
    sender = NoisySender()
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=LASTS_S))
    sender.rig = rig
    with rig.prepared() as prepared:
        diary = Diary(rig, sender)
        result = prepared.run(observers=[Progress(diary.look, every=1)])
    assert result.stop is None and result.robot is not None

    warm = next(row for row, (time, *_) in enumerate(diary.memory) if time >= WARM_S)
    time, resident, blocks = (np.array(column) for column in zip(*diary.memory[warm:], strict=True))
    assert time[-1] > LASTS_S - 2.0 * ROUND_S
    assert resident.max() - resident[0] < GROWTH_MB, resident.round(1).tolist()
    assert np.median(blocks[-10:]) - np.median(blocks[:10]) < GROWTH_BLOCKS, blocks.tolist()

    goals = np.array([goals for _, goals in diary.turns])
    assert len(goals) >= LASTS_S / ROUND_S - 2.0
    assert np.ptp(goals, axis=0).max() <= TICKS, np.ptp(goals, axis=0).tolist()
    _, _, missed = pace(diary.times[: diary.ticks], result.clip.dt) or (0.0, 0.0, 0)
    late = len(sender.stalls)
    assert late >= LASTS_S / EVERY_S - 1.0
    assert late * LATE_TICKS <= missed <= late * (LATE_TICKS + 2)
    assert sum("late" in text for text in rig.said) == late
