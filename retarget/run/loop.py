"""The tick loop: read the sensors, think (reconstruct, follow), act (gate, guard, bus). One loop for every source."""

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

__all__ = ["Ending", "ExceptionSafe", "ObserverCallback", "Pipeline", "Watch"]


# What must not fail while a robot moves: a question, and whoever looks on.


class ObserverCallback:
    """Shows every row of a record to `look`; from its first exception on to nobody. failure: that one, in words."""

    def __init__(self, look: Callable[[Record, int], object]) -> None:
        self._look = look
        self.failure = ""

    def __call__(self, record: Record, row: int) -> None:
        """A row was filled."""
        if not self.failure:
            try:
                self._look(record, row)
            except Exception as error:  # noqa: BLE001 - a robot goes on, whoever looks on
                self.failure = f"{type(error).__name__}: {error}"


class ExceptionSafe:
    """Asks `question`. From its first exception on the answer is no, and nobody is asked any more; `settle` raises it,
    when the robot stands."""

    def __init__(self, question: Callable[[], bool]) -> None:
        self._question = question
        self._failure: Exception | None = None

    def __call__(self) -> bool:
        """The answer."""
        if self._failure is None:
            try:
                return self._question()
            except Exception as error:  # noqa: BLE001 - raised again by `settle`
                self._failure = error
        return False

    def settle(self) -> None:
        """Raise what the question failed with, if it did."""
        if self._failure is not None:
            raise self._failure


INTERRUPTED = "interrupted by the user"
NOT_FOLLOWABLE = "nobody could be followed ({})"
HELD_UP_S = 10.0
"""So much longer than it is laid out an approach may take and be recorded whole; of a longer one the end is."""


@dataclass(frozen=True)
class Watch:
    """Who looks on. on_tick: told the number of ticks done, now and then; stop_asked: looked at when a tick is due,
    before anything is sent in it; torque_off_asked: before every tick of braking, whether torque is to go off at once.
    why: who asked for the stop. on_row: told the record, and its row that was just filled."""

    on_tick: Callable[[int], object] = lambda done: None
    stop_asked: Callable[[], bool] = lambda: False
    torque_off_asked: Callable[[], bool] = lambda: False
    why: Callable[[], str] = lambda: INTERRUPTED
    on_row: Callable[[Record, int], object] = lambda record, row: None
    every: int = 50


@dataclass(frozen=True, eq=False)
class Ending:
    """What a run left. state: of the guard, None without one; reason: why it stopped early; wall_s: of the clip."""

    record: Record
    state: str | None
    reason: str | None
    wall_s: float


class Pipeline:
    """Plays samples through both stages, or through the first alone where there is no robot."""

    def __init__(self, *, clip: Samples, reconstructor: ReconstructingStage, robot: RobotSide | None = None) -> None:
        self._clip = clip
        self._reconstructor = reconstructor
        self._robot = robot
        self._wall = MonotonicClock()
        self._tick = 0  # of the clip
        self._said: SensorSample | None = None  # of which the human was made; None: nothing that was believed
        self._record: Record
        self._rows: RecordRows
        self._on_row: Callable[[Record, int], object]

    def run(self, watch: Watch | None = None) -> Ending:
        """Play the clip to its end, to a stop of the guard, or until somebody asks to stop.

        Every tick that is sent is kept: the approach before the clip and the braking after it too. Raises GuardError or
        BusError if the robot cannot be armed, TorqueError if a run fails and torque could not be switched off.
        """
        watch = Watch() if watch is None else watch
        torque_off_asked = ExceptionSafe(watch.torque_off_asked)  # whatever it fails with, the robot brakes with torque
        watch, self._on_row = replace(watch, torque_off_asked=torque_off_asked), watch.on_row
        first = self._clip.sample(0)
        assert first is not None, "nobody is followed from the start"
        self._human, self._said = self._reconstructor.start(first), first
        try:
            self._allocate(0 if self._robot is None else self._robot.begin(self._human))
            with _collector_at_rest():
                wall_s, interrupted = self._play(watch)
                self._stand(watch, interrupted=interrupted)
            state, reason = self._finish(interrupted=interrupted)
        except BaseException as error:
            # What goes wrong outside of a tick of the guard stops the robot too, before it is raised.
            if self._robot is not None:
                self._robot.give_up(error, watch.torque_off_asked)
            raise
        torque_off_asked.settle()
        record = self._rows.of(self._record)
        followed = record.following
        begins = followed.start if followed.stop else np.count_nonzero(record.phase == Phase.APPROACH)
        record.time[:] = (np.arange(len(record)) - begins) * self._clip.dt
        return Ending(record, state, reason, wall_s)

    def _allocate(self, approach: int) -> None:
        """Make room for every row: of at least so many ticks of approach, of the clip, and of the longest braking."""
        clip, robot, human, said = self._clip, self._robot, self._human, self._said
        assert said is not None, "somebody is there at first"
        self._rows = RecordRows(
            approach=0 if robot is None else approach + round(HELD_UP_S / clip.dt),
            follow=clip.kept,
            brake=0 if robot is None else robot.stopping_ticks,
        )
        rows = self._rows.room
        self._record = Record(
            np.zeros(rows),  # when following begins is known in the end
            np.full(rows, Phase.FOLLOW, dtype=np.int8),
            HumanRecord.empty(
                rows,
                nq=human.q.size,
                joint_names=tuple(human.joint_names),
                observers=human.observer_modes.size,
                sensors=len(said.names),
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
            self._one_tick(self._think)
            if tick % watch.every == 0:
                watch.on_tick(tick + 1)
            tick += 1
        watch.on_tick(clip.ticks)
        return self._wall.now() - begun, None

    def _stand(self, watch: Watch, *, interrupted: str | None) -> None:
        """Come to a stand, by a stop if somebody asked for it."""
        robot = self._robot
        if robot is None:
            return
        if interrupted is not None:
            robot.stop(interrupted)
        robot.guard.rest()
        while robot.braking and not robot.cut_short(watch.torque_off_asked):
            self._one_tick(_nothing)

    def _one_tick(self, think: FindGoal) -> None:
        """Read, think, act; then keep what happened, if anything was sent and there is room."""
        begun, record, robot = self._wall.now(), self._record, self._robot
        self._row = row = self._rows.row
        if robot is not None:
            robot.wait()
        self._clip.listen()
        if robot is None or record.robot is None:
            self._reconstruct()
        elif robot.act(think):
            record.phase[row] = robot.phase
            robot.keep(record.robot, row)
        else:
            return
        self._keep_human(row, error=robot is None or robot.phase is Phase.FOLLOW)
        record.timing.cycle[row] = self._wall.now() - begun
        self._on_row(record, row)
        record.timing.cycle[row] = self._wall.now() - begun  # whoever looks on is part of the tick
        self._rows.filled(approaches=robot is not None and robot.approaching and robot.following)

    def _approach(self, states: ServoStates) -> FloatArray | None:
        """The next goal posture, rad (n,), on the way to where following begins; None: wait on it."""
        assert self._robot is not None
        if self._clip.may_approach():
            return self._robot.approach()
        self._robot.guard.hold_reason = NOT_FOLLOWABLE.format(self._clip.hold_reason)
        return None

    def _think(self, states: ServoStates) -> FloatArray | None:
        """From the servo states to a goal posture, rad (n,), inside the guard's tick; None: nobody is followed."""
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
        """From what the sensors say at this tick to the posture of the human. Returns thread CPU at its end, s; None
        where they say nothing that can be trusted: then the human stays."""
        begun = thread_cpu()
        sample = self._said = self._clip.sample(self._tick)
        if sample is None:
            return None
        if self._tick > 0:  # the first posture is where the reconstructor was started
            self._human = self._reconstructor.step(sample, self._clip.motion_dt)
        ended = thread_cpu()
        self._record.timing.reconstruct[self._row] = ended - begun
        return ended

    def _keep_human(self, row: int, *, error: bool) -> None:
        kept = self._record.human
        kept.q[row] = self._human.q
        kept.joints[row] = self._human.joints
        kept.observer_modes[row] = self._human.observer_modes
        kept.sensors[row] = np.nan if self._said is None else self._said.position
        kept.balance_error[row] = self._human.balance_error if error else np.nan

    def _finish(self, *, interrupted: str | None) -> tuple[str | None, str | None]:
        """The guard's last state and the reason of a stop; torque is off."""
        if self._robot is None:
            return None, interrupted
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


def _nothing(states: ServoStates) -> None:
    """No goal."""
