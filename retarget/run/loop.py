"""The tick loop of every source: read the sensors, reconstruct and follow, send through gate, guard and bus."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from hardware.bus import ServoStates
from hardware.clock import MonotonicClock, thread_cpu
from hardware.guard import FindGoal
from retarget.frames import SensorSample
from retarget.human.samples import Samples
from retarget.run.record import HumanRecord, Phase, Record, RecordRows, Timing
from retarget.run.robot_side import RobotSide
from retarget.run.stages import ReconstructingStage
from retarget.types import FloatArray

# Callbacks that must not fail while a robot moves.


class ObserverCallback:
    """Passes every row of a record to `look`, until that raises. failure: the exception as text, else ""."""

    def __init__(self, look: Callable[[Record, int], object]) -> None:
        self._look = look
        self.failure = ""

    def __call__(self, record: Record, row: int) -> None:
        """Pass a row that was filled."""
        if not self.failure:
            try:
                self._look(record, row)
            except Exception as error:  # noqa: BLE001 - an observer must not stop a robot
                self.failure = f"{type(error).__name__}: {error}"


class ExceptionSafe:
    """Calls `question` until it raises; from then on the answer is no. `raise_failure` raises the exception, once the
    robot stands."""

    def __init__(self, question: Callable[[], bool]) -> None:
        self._question = question
        self._failure: Exception | None = None

    def __call__(self) -> bool:
        """Return the answer."""
        if self._failure is None:
            try:
                return self._question()
            except Exception as error:  # noqa: BLE001 - raised again by `raise_failure`
                self._failure = error
        return False

    def raise_failure(self) -> None:
        """Raise the exception of the question, if there was one."""
        if self._failure is not None:
            raise self._failure


INTERRUPTED = "interrupted by the user"
NOT_FOLLOWABLE = "the performer could not be followed ({})"
EXTRA_APPROACH_S = 10.0
"""An approach may take this much longer than planned and be recorded whole; of a longer one the end is recorded."""


@dataclass(frozen=True)
class Watch:
    """Callbacks of a run.

    on_tick: receives the number of ticks done, once in `every` ticks. stop_asked: whether to stop, asked when a tick is
    due, before anything is sent in it. torque_off_asked: whether torque is to go off at once, asked before every tick
    of braking. why: who asked for the stop. on_row: receives the record and the row that was just filled.
    """

    on_tick: Callable[[int], object] = lambda done: None
    stop_asked: Callable[[], bool] = lambda: False
    torque_off_asked: Callable[[], bool] = lambda: False
    why: Callable[[], str] = lambda: INTERRUPTED
    on_row: Callable[[Record, int], object] = lambda record, row: None
    every: int = 50


@dataclass(frozen=True, eq=False)
class Ending:
    """The end of a run. state: of the guard, None without one; reason: why it stopped early; wall_s: of the clip."""

    record: Record
    state: str | None
    reason: str | None
    wall_s: float


class Pipeline:
    """Runs samples through both stages, or through the first alone where there is no robot."""

    def __init__(self, *, clip: Samples, reconstructor: ReconstructingStage, robot: RobotSide | None = None) -> None:
        self._clip = clip
        self._reconstructor = reconstructor
        self._robot = robot
        self._wall = MonotonicClock()
        self._tick = 0  # of the clip
        self._sample: SensorSample | None = None  # of which the human was made; None: no valid one
        self._record: Record
        self._rows: RecordRows
        self._on_row: Callable[[Record, int], object]

    def run(self, watch: Watch | None = None) -> Ending:
        """Play the clip to its end, to a stop of the guard, or until a stop is asked for.

        Every tick that is sent is kept: the approach before the clip and the braking after it too. Raises GuardError or
        BusError if the robot cannot be armed, TorqueError if a run fails and torque could not be switched off.
        """
        watch = Watch() if watch is None else watch
        torque_off_asked = ExceptionSafe(watch.torque_off_asked)  # when it fails, the robot brakes with torque
        watch, self._on_row = replace(watch, torque_off_asked=torque_off_asked), watch.on_row
        first = self._clip.sample(0)
        assert first is not None, "the first sample is valid"
        self._human, self._sample = self._reconstructor.start(first), first
        try:
            self._allocate(0 if self._robot is None else self._robot.begin(self._human))
            with _without_garbage_collection():
                wall_s, interrupted = self._play(watch)
                self._stand(watch, interrupted=interrupted)
            state, reason = self._finish(interrupted=interrupted)
        except BaseException as error:
            # An error outside of a tick of the guard stops the robot too, before it is raised.
            if self._robot is not None:
                self._robot.give_up(error, watch.torque_off_asked)
            raise
        torque_off_asked.raise_failure()
        record = self._rows.of(self._record)
        followed = record.following
        begins = followed.start if followed.stop else np.count_nonzero(record.phase == Phase.APPROACH)
        record.time[:] = (np.arange(len(record)) - begins) * self._clip.dt
        return Ending(record, state, reason, wall_s)

    def _allocate(self, approach: int) -> None:
        """Make room for the rows of `approach` ticks at least, of the clip, and of the longest braking."""
        clip, robot, human, sample = self._clip, self._robot, self._human, self._sample
        assert sample is not None, "the first sample is valid"
        self._rows = RecordRows(
            approach=0 if robot is None else approach + round(EXTRA_APPROACH_S / clip.dt),
            follow=clip.kept,
            brake=0 if robot is None else robot.stopping_ticks,
        )
        rows = self._rows.room
        self._record = Record(
            np.zeros(rows),  # filled in at the end, when the start of following is known
            np.full(rows, Phase.FOLLOW, dtype=np.int8),
            HumanRecord.empty(
                rows,
                nq=human.q.size,
                joint_names=tuple(human.joint_names),
                observers=human.observer_modes.size,
                sensors=len(sample.names),
            ),
            None if robot is None else robot.new_record(rows),
            Timing.empty(rows),
        )

    def _play(self, watch: Watch) -> tuple[float, str | None]:
        """Tick until the clip or the guard ends it. Returns wall time of the clip, s, and who asked for a stop."""
        robot, clip, begun, tick = self._robot, self._clip, self._wall.now(), 0
        while tick < clip.ticks:
            if robot is not None:
                robot.wait()
            if watch.stop_asked():
                return self._wall.now() - begun, watch.why()
            if clip.over or (robot is not None and not robot.following):
                return self._wall.now() - begun, None
            if robot is not None and robot.approaching:
                self._one_tick(self._approach)
                begun = self._wall.now()
                continue
            self._tick = tick
            if tick == clip.kept:
                self._rows.close()
            self._one_tick(self._follow)
            if tick % watch.every == 0:
                watch.on_tick(tick + 1)
            tick += 1
        watch.on_tick(clip.ticks)
        return self._wall.now() - begun, None

    def _stand(self, watch: Watch, *, interrupted: str | None) -> None:
        """Come to rest; `interrupted` is the reason of a stop that was asked for."""
        robot = self._robot
        if robot is None:
            return
        if interrupted is not None:
            robot.stop(interrupted)
        robot.guard.rest()
        while robot.braking and not robot.force_stop(watch.torque_off_asked):
            self._one_tick(_nothing)

    def _one_tick(self, find_goal: FindGoal) -> None:
        """Run one tick; then record it, if anything was sent and there is room."""
        begun, record, robot = self._wall.now(), self._record, self._robot
        self._row = row = self._rows.row
        if robot is not None:
            robot.wait()
        self._clip.poll()
        if robot is None or record.robot is None:
            self._reconstruct()
        elif robot.act(find_goal):
            record.phase[row] = robot.phase
            robot.keep(record.robot, row)
        else:
            return
        self._keep_human(row, error=robot is None or robot.phase is Phase.FOLLOW)
        record.timing.cycle[row] = self._wall.now() - begun
        self._on_row(record, row)
        record.timing.cycle[row] = self._wall.now() - begun  # callbacks are part of the tick
        self._rows.filled(approaches=robot is not None and robot.approaching and robot.following)

    def _approach(self, states: ServoStates) -> FloatArray | None:
        """The next goal of the approach, rad (n,); None: hold there."""
        assert self._robot is not None
        if self._clip.may_approach():
            return self._robot.approach()
        self._robot.guard.hold_reason = NOT_FOLLOWABLE.format(self._clip.hold_reason)
        return None

    def _follow(self, states: ServoStates) -> FloatArray | None:
        """From the servo states to a goal, rad (n,), in the guard's tick; None: the performer cannot be followed."""
        assert self._robot is not None
        begun = self._reconstruct()
        if begun is None:
            self._robot.guard.hold_reason = NOT_FOLLOWABLE.format(self._clip.hold_reason)
            return None
        goal = self._robot.follow(self._human, settled=self._clip.settled)
        if goal is None:
            self._robot.guard.hold_reason = "no posture found"
        self._record.timing.retarget[self._row] = thread_cpu() - begun
        return goal

    def _reconstruct(self) -> float | None:
        """Reconstruct the human at this tick. Returns thread CPU at its end, s; None without a valid sample: then the
        posture stays."""
        begun = thread_cpu()
        sample = self._sample = self._clip.sample(self._tick)
        if sample is None:
            return None
        if self._tick > 0:  # the reconstructor was started with the first posture
            self._human = self._reconstructor.step(sample, self._clip.motion_dt)
        ended = thread_cpu()
        self._record.timing.reconstruct[self._row] = ended - begun
        return ended

    def _keep_human(self, row: int, *, error: bool) -> None:
        kept = self._record.human
        kept.q[row] = self._human.q
        kept.joints[row] = self._human.joints
        kept.observer_modes[row] = self._human.observer_modes
        kept.sensors[row] = np.nan if self._sample is None else self._sample.position
        kept.balance_error[row] = self._human.balance_error if error else np.nan

    def _finish(self, *, interrupted: str | None) -> tuple[str | None, str | None]:
        """Switch torque off; return the guard's last state and the reason of a stop."""
        if self._robot is None:
            return None, interrupted
        guard = self._robot.guard
        self._robot.finish()
        return guard.state.value, guard.stop_reason.reason if guard.stop_reason else None


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Keep the garbage collector out of the ticks: nothing in them makes cycles."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _nothing(states: ServoStates) -> None:
    """No goal."""
