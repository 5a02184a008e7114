"""The record of a run, one row per tick: arrays made before the first tick and filled in place."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hardware.bus import ServoStates
from hardware.clock import MonotonicClock
from hardware.guard import CheckedGoal, Guard
from hardware.joint_map import JointMap
from retarget.frames import SensorSample
from retarget.human.samples import Samples
from retarget.model.robot import RobotBody
from retarget.types import BoolArray, FloatArray, HumanPosture, IntArray, ModeArray, RobotPosture

ByteArray = NDArray[np.int8]


class Phase(IntEnum):
    """The purpose of a tick. A run goes through them in this order."""

    APPROACH = 0
    """A slow move to the posture in which following begins."""
    FOLLOW = 1
    BRAKE = 2
    """Braking, after the end of the clip or after a stop, and what follows: return to stance, rest."""


T = TypeVar("T")


def room(kind: type[T], rows: int, wide: Mapping[str, tuple[int, ...]], **given: Any) -> T:
    """A dataclass whose arrays have room for so many rows, zero and not touched yet: a long run is not filled before
    its first tick. wide: of the arrays that have more than one number a row. given: fields that are no such array."""
    arrays = {
        one.name: np.zeros((rows, *wide.get(one.name, ())), one.type.__args__[1].__args__[0])  # type: ignore[union-attr]
        for one in fields(kind)  # type: ignore[arg-type]
        if one.name not in given
    }
    return kind(**arrays, **given)


@dataclass(frozen=True, eq=False)
class HumanRecord:
    """The reconstructed human. q (T, nq); joints (T, m, 3) m, world: centres of `joint_names`.

    balance_error (T,) m: of the centre of mass from its goal. Outside of following the human stands still, and only the
    error is NaN. observer_modes (T, o). sensors (T, s, 3) m, world: what the posture was made of; NaN: not valid.
    """

    joint_names: tuple[str, ...]
    q: FloatArray
    joints: FloatArray
    balance_error: FloatArray
    observer_modes: ModeArray
    sensors: FloatArray

    @classmethod
    def empty(
        cls, ticks: int, *, nq: int, joint_names: tuple[str, ...], observers: int = 0, sensors: int = 0
    ) -> "HumanRecord":
        """Room for so many ticks."""
        wide = {"q": (nq,), "joints": (len(joint_names), 3), "observer_modes": (observers,), "sensors": (sensors, 3)}
        return room(cls, ticks, wide, joint_names=joint_names)


@dataclass(frozen=True, eq=False)
class RobotRecord:
    """What was asked of the robot, what was sent, and where its servos were, over T ticks.

    landmarks_asked (T, k, 3) m, world, NaN outside of following. q (T, nq): posture sent, before rounding to ticks,
    with the root that the robot's stage assumes. goals (T, n) rad, servo order: what the filter returned, which differs
    from the posture where it compensates a load; goal_ticks (T, n): the same, rounded; present (T, n) rad: read at the
    start of the tick. gated (T,): the gate sent something else than was asked. no_command (T,): there was no goal, and
    the filter braked by itself. bus_time (T,) s: when the servos were read, on the bus's clock. faults (T,): servos
    that did not answer or reported an alert. temperature (T, n) degrees Celsius, voltage (T, n) V; retries (T,):
    requests repeated on the bus since it was opened. observer_modes (T, o): of the stage that asked. start (n,) rad:
    where the robot stood before the first tick.
    """

    landmark_names: tuple[str, ...]
    landmarks_asked: FloatArray
    q: FloatArray
    goals: FloatArray
    goal_ticks: IntArray
    present: FloatArray
    gated: BoolArray
    no_command: BoolArray
    bus_time: FloatArray
    faults: IntArray
    temperature: FloatArray
    voltage: FloatArray
    retries: IntArray
    observer_modes: ModeArray
    start: FloatArray

    @classmethod
    def empty(
        cls, ticks: int, *, nq: int, start: FloatArray, landmark_names: tuple[str, ...], observers: int = 0
    ) -> "RobotRecord":
        """Room for so many ticks of a robot that stands at `start` (n,) rad, servo order."""
        wide = dict.fromkeys(("goals", "goal_ticks", "present", "temperature", "voltage"), start.shape)
        wide |= {"landmarks_asked": (len(landmark_names), 3), "q": (nq,), "observer_modes": (observers,)}
        return room(cls, ticks, wide, landmark_names=landmark_names, start=np.array(start, dtype=np.float64))

    def keep_servos(self, row: int, states: ServoStates, joint_map: JointMap) -> None:
        """Write the servo states at the start of a tick into its row."""
        self.bus_time[row] = states.time
        self.present[row] = joint_map.to_radians(states.position)
        self.temperature[row], self.voltage[row] = states.temperature, states.voltage
        self.retries[row] = states.retries
        if states.alert.any() or not states.valid.all():
            self.faults[row] = np.count_nonzero(~states.valid | (states.alert != 0))
        else:
            self.faults[row] = 0


@dataclass(frozen=True, eq=False)
class Timing:
    """Cost of each tick (T,), s: thread CPU of both stages, NaN where they did not run; wall time of the whole tick."""

    reconstruct: FloatArray
    retarget: FloatArray
    cycle: FloatArray

    @classmethod
    def empty(cls, ticks: int) -> "Timing":
        """Room for so many ticks."""
        return cls(*(np.full(ticks, np.nan) for _ in fields(cls)))


@dataclass(frozen=True, eq=False)
class Record:
    """A run, a row for every tick that was sent. time (T,) s: 0 at the first tick of following, before it negative.

    phase (T,): a `Phase`. robot is None when only the human was reconstructed; then every tick follows.
    """

    time: FloatArray
    phase: ByteArray
    human: HumanRecord
    robot: RobotRecord | None
    timing: Timing
    from_start: bool = True
    to_end: bool = True

    def __len__(self) -> int:
        return len(self.time)

    @property
    def following(self) -> slice:
        """The rows of the ticks that followed the clip, from its first on."""
        rows = np.flatnonzero(self.phase == Phase.FOLLOW)
        return slice(int(rows[0]), int(rows[-1]) + 1) if rows.size else slice(0, 0)

    def missing(self) -> tuple[str, ...]:
        """Notes about the parts of the run that are not in it."""
        approach = () if self.from_start else ("the approach took long: its beginning is not recorded",)
        end = () if self.to_end else (f"what came after the first {self.time[-1]:.0f} s is not recorded",)
        return approach + end

    def rows(self, first: int, end: int) -> "Record":
        """The rows from `first` to before `end`, as views: for a run that ended early."""
        return self.each(lambda array: array[first:end])

    def each(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> "Record":
        """The record with every array that has one row per tick changed."""
        return replace(
            self,
            time=change(self.time),
            phase=change(self.phase),
            human=_each(self.human, change),
            robot=None if self.robot is None else _each(self.robot, change),
            timing=_each(self.timing, change),
        )


Part = TypeVar("Part", HumanRecord, RobotRecord, Timing)


def _each(part: Part, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Part:
    values = {one.name: getattr(part, one.name) for one in fields(part) if one.name != "start"}
    arrays: dict[str, Any] = {name: change(value) for name, value in values.items() if isinstance(value, np.ndarray)}
    return replace(part, **arrays)


# Which row of the record each tick fills, where a run lasts longer than there is room for.


class RecordRows:
    """Rows for so many ticks of approach, of following and of braking, filled one after the other.

    The kept rows have no gap, because rates, limits and missed ticks are measured between consecutive rows. Of an
    approach that takes longer than its rows, the end is kept; of what comes after `close`, nothing.
    """

    def __init__(self, *, approach: int, follow: int, brake: int) -> None:
        self.room = approach + follow + brake + 1
        """Rows of the record; the last is for ticks that are not kept."""
        self.row = 0
        """The row that the next tick fills."""
        self._approach, self._laps = approach, 0  # times that the approach has filled its rows
        self._oldest: int | None = None  # row of the approach, once it is over
        self._end: int | None = None  # rows that are kept, once no more are

    def filled(self, *, approaches: bool) -> None:
        """Go on after a tick has filled its row. approaches: the next tick is still one of the approach."""
        if self._end is not None or self.row == self.room - 1:
            self.close()
            return
        self.row += 1
        if approaches:
            if self.row == self._approach:
                self._laps, self.row = self._laps + 1, 0
        elif self._laps and self._oldest is None:
            self._oldest, self.row = self.row % self._approach, self._approach

    @property
    def closed(self) -> bool:
        """Whether no more ticks are kept."""
        return self._end is not None

    def close(self) -> None:
        """Keep none of the ticks that follow."""
        if self._end is None:
            self._end, self.row = self.row, self.room - 1

    def of(self, record: Record) -> Record:
        """The rows of the record that are kept, in the order of their ticks; it is changed in place."""
        end, first = self.row if self._end is None else self._end, 0
        if self._laps:
            oldest, first = self.row if self._oldest is None else self._oldest, 1
            end = end if self._oldest is not None else self._approach

            def in_order(array: NDArray[Any]) -> NDArray[Any]:
                array[: self._approach] = np.roll(array[: self._approach], -oldest, axis=0)
                return array

            record = record.each(in_order)
            if record.robot is not None:  # the goals of the oldest row are where the kept rows begin
                record.robot.start[:] = record.robot.goals[0]
        return replace(record.rows(first, end), from_start=self._laps == 0, to_end=self._end is None)


LONGEST_APPROACH_S = 30.0
"""An approach that takes up to this long is recorded whole; of a longer one the end is recorded."""


class TickRecorder:
    """Fills the rows of one run while it goes on: `begin` of a tick, what is kept of it, then `keep`."""

    def __init__(
        self,
        samples: Samples,
        human: HumanPosture,
        sensors: int,
        *,
        robot: RobotBody | None = None,
        posture: RobotPosture | None = None,
        stopping: float = 0.0,
    ) -> None:
        """human, posture: the first ones. sensors: number of them. stopping: s that a stop may take."""
        approach = 0 if robot is None else round(LONGEST_APPROACH_S / samples.dt)
        self._rows = RecordRows(approach=approach, follow=samples.kept, brake=round(stopping / samples.dt))
        self._samples, self._robot = samples, robot
        self._wall, self._begun, self._followed_at = MonotonicClock(), 0.0, (0.0, 0.0)
        self.record = self._empty(self._rows.room, human, sensors, posture)
        self._followed = 0  # ticks

    def _empty(self, rows: int, human: HumanPosture, sensors: int, posture: RobotPosture | None) -> Record:
        own, robot = human.observer_modes.size, None
        if self._robot is not None and posture is not None:
            robot = RobotRecord.empty(
                rows,
                nq=self._robot.body.nq,
                start=np.zeros(len(self._robot.joint_map)),
                landmark_names=posture.landmark_names,
                observers=posture.observer_modes.size,
            )
        return Record(
            np.zeros(rows),  # filled in at the end, when the start of following is known
            np.full(rows, Phase.FOLLOW, dtype=np.int8),
            HumanRecord.empty(
                rows, nq=human.q.size, joint_names=tuple(human.joint_names), observers=own, sensors=sensors
            ),
            robot,
            Timing.empty(rows),
        )

    def started(self, present: FloatArray) -> None:
        """Keep the joint positions (n,) rad before the first tick."""
        if self.record.robot is not None:
            self.record.robot.start[:] = present

    def begin(self) -> None:
        """Begin the row of a tick."""
        self._begun = self._wall.now()

    def keep_human(self, human: HumanPosture, sample: SensorSample | None, *, error: bool) -> None:
        """The human of this tick, and the sample; error: whether the balance error is one of following."""
        kept, row = self.record.human, self._rows.row
        kept.q[row], kept.joints[row] = human.q, human.joints
        kept.observer_modes[row] = human.observer_modes
        kept.sensors[row] = np.nan if sample is None else sample.position
        kept.balance_error[row] = human.balance_error if error else np.nan

    def keep_costs(self, reconstruct: float, retarget: float) -> None:
        """Thread CPU of both stages, s."""
        timing, row = self.record.timing, self._rows.row
        timing.reconstruct[row], timing.retarget[row] = reconstruct, retarget

    def keep_robot(
        self,
        guard: Guard,
        q: FloatArray,
        goal: CheckedGoal,
        *,
        asked: bool,
        gated: bool,
        followed: RobotPosture | None,
    ) -> None:
        """Keep what was sent: posture q (nq,), m, wxyz and rad, and goal. asked: whether there was a target; gated:
        whether the gate refused what was asked; followed: for the performer."""
        record, robot, row = self.record.robot, self._robot, self._rows.row
        assert record is not None and robot is not None, "a goal was written"
        assert guard.states is not None and guard.sent is not None, "a goal was written"
        record.q[row], record.goals[row], record.goal_ticks[row] = q, goal.joints, guard.sent
        record.gated[row], record.no_command[row] = gated, not asked
        record.landmarks_asked[row] = np.nan if followed is None else followed.landmarks_asked
        if followed is not None:
            record.observer_modes[row] = followed.observer_modes
        record.keep_servos(row, guard.states, robot.joint_map)

    def keep(self, phase: Phase, look: Callable[[Record, int], object], *, approaches: bool = False) -> None:
        """The tick is over. look: receives the record and the row. approaches: the next tick is still of the
        approach."""
        record, row = self.record, self._rows.row
        record.phase[row] = phase
        now = self._wall.now()
        record.timing.cycle[row] = now - self._begun
        look(record, row)
        record.timing.cycle[row] = self._wall.now() - self._begun  # callbacks are part of the tick
        if phase is Phase.FOLLOW and not self._rows.closed:
            self._followed_at = (self._followed_at[0] if self._followed else self._begun, now)
            self._followed += 1
        self._rows.filled(approaches=approaches)

    def close(self) -> None:
        """Keep none of the ticks that follow."""
        self._rows.close()

    def finish(self) -> tuple[Record, float]:
        """The record of the run, and the wall time of the following that is in it, s."""
        record = self._rows.of(self.record)
        followed = record.following
        begins = followed.start if followed.stop else np.count_nonzero(record.phase == Phase.APPROACH)
        record.time[:] = (np.arange(len(record)) - begins) * self._samples.dt
        return record, self._followed_at[1] - self._followed_at[0]
