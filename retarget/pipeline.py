"""The tick loop: read the sensors, think (reconstruct, follow), act (gate, guard, bus). One loop for every source."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from hardware.bus import ServoStates
from hardware.clock import MonotonicClock, thread_cpu
from hardware.guard_state import GuardState
from retarget.clip import Clip
from retarget.human_posture import HumanPosture
from retarget.record import HumanRecord, Record, RobotRecord, Timing
from retarget.robot_side import RobotSide
from retarget.rotations import FloatArray
from retarget.stages import ReconstructingStage

__all__ = ["Ending", "Pipeline", "Watch"]

MAX_BRAKE_TICKS = 1000
"""Rows kept for ticks of braking after a stop; a stop takes a few dozen."""

INTERRUPTED = "interrupted by the user"


@dataclass(frozen=True)
class Watch:
    """Who looks on. on_tick: told the number of ticks done, now and then; stop_asked: looked at before every tick."""

    on_tick: Callable[[int], object] = lambda done: None
    stop_asked: Callable[[], bool] = lambda: False
    every: int = 50


@dataclass(frozen=True, eq=False)
class Ending:
    """What a run left. state: of the guard, None without one; reason: why it stopped early; wall_s: of the loop."""

    record: Record
    state: str | None
    reason: str | None
    wall_s: float


class Pipeline:
    """Plays a clip through both stages, or through the first alone where there is no robot."""

    def __init__(self, *, clip: Clip, reconstructor: ReconstructingStage, robot: RobotSide | None = None) -> None:
        self._clip = clip
        self._reconstructor = reconstructor
        self._robot = robot
        self._wall = MonotonicClock()
        self._tick = 0
        self._record: Record

    def run(self, watch: Watch | None = None) -> Ending:
        """Play the clip to its end, to a stop of the guard, or until somebody asks to stop.

        A stopped robot is braked, and those ticks are kept too. Raises GuardError or BusError if it cannot be armed.
        """
        watch = Watch() if watch is None else watch
        self._allocate()
        with _collector_at_rest():
            begun = self._wall.now()
            done, interrupted = self._guarded_play(watch)
            if interrupted and self._robot is not None:
                self._robot.stop(INTERRUPTED)
            done = self._brake(done)
            wall_s = self._wall.now() - begun
        state, reason = self._finish(interrupted=interrupted)
        return Ending(self._record.first(done), state, reason, wall_s)

    def _allocate(self) -> None:
        """Make room for every row, and bring the robot to where following begins."""
        clip, robot = self._clip, self._robot
        human = self._reconstructor.start(clip.sample(0))
        rows = clip.ticks + (MAX_BRAKE_TICKS if robot else 0)
        kept = None
        if robot is not None:
            start, names = robot.begin(human)
            kept = RobotRecord.empty(rows, nq=robot.robot.body.nq, start=start, landmark_names=names)
        self._record = Record(
            np.asarray(np.arange(rows) * clip.dt, dtype=np.float64),
            HumanRecord.empty(rows, nq=human.q.size, joint_names=tuple(human.joint_names)),
            kept,
            Timing.empty(rows),
        )
        self._human = human

    def _guarded_play(self, watch: Watch) -> tuple[int, bool]:
        """`_play`; whatever goes wrong outside a tick of the guard stops the robot too, before it is raised."""
        try:
            return self._play(watch)
        except BaseException as error:
            if self._robot is not None:
                self._robot.stop(str(error) or type(error).__name__)
                self._robot.finish()
            raise

    def _play(self, watch: Watch) -> tuple[int, bool]:
        """Tick until the clip or the guard ends it. Returns the ticks done, and whether somebody asked to stop."""
        for tick in range(self._clip.ticks):
            if watch.stop_asked():
                return tick, True
            if self._robot is not None and not self._robot.following:
                return tick, False
            self._one_tick(tick)
            if tick % watch.every == 0:
                watch.on_tick(tick + 1)
        watch.on_tick(self._clip.ticks)
        return self._clip.ticks, False

    def _one_tick(self, tick: int) -> None:
        """Read, think, act; then keep what happened."""
        begun = self._wall.now()
        self._tick = tick
        if self._robot is None or self._record.robot is None:
            self._reconstruct()
        else:
            self._robot.act(self._think)
            self._robot.keep(self._record.robot, tick)
        self._keep_human(tick)
        self._record.timing.cycle[tick] = self._wall.now() - begun

    def _think(self, states: ServoStates) -> FloatArray:
        """From the servo states to a goal posture, rad (n,), inside the guard's tick."""
        assert self._robot is not None
        human = self._reconstruct()
        begun = thread_cpu()
        goal = self._robot.follow(human)
        self._record.timing.retarget[self._tick] = thread_cpu() - begun
        return goal

    def _reconstruct(self) -> HumanPosture:
        """From what the sensors say at this tick to the posture of the human."""
        begun = thread_cpu()
        sample = self._clip.sample(self._tick)
        if self._tick > 0:  # the first posture is where the reconstructor was started
            self._human = self._reconstructor.step(sample, self._clip.motion_dt)
        self._record.timing.reconstruct[self._tick] = thread_cpu() - begun
        return self._human

    def _keep_human(self, tick: int) -> None:
        kept = self._record.human
        kept.q[tick] = self._human.q
        kept.joints[tick] = self._human.joints
        kept.balance_error[tick] = self._human.balance_error

    def _brake(self, done: int) -> int:
        """After a stop: tick until the robot stands, and keep those ticks. Returns the ticks done."""
        robot, kept = self._robot, self._record.robot
        if robot is None or kept is None:
            return done
        while robot.guard.state is GuardState.STOPPING and done < len(self._record):
            robot.brake()
            robot.keep(kept, done)
            self._keep_human(done)
            done += 1
        return done

    def _finish(self, *, interrupted: bool) -> tuple[str | None, str | None]:
        """The guard's last state and the reason of a stop; torque is off."""
        if self._robot is None:
            return None, INTERRUPTED if interrupted else None
        guard = self._robot.guard
        self._robot.finish()
        return guard.state.value, guard.stop_reason.reason if guard.stop_reason else None


@contextmanager
def _collector_at_rest() -> Iterator[None]:
    """Keep the garbage collector out of the ticks: nothing in them makes cycles."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
