"""The record of a run, one row per tick: arrays made before the first tick and filled in place."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardware.clock import MonotonicClock
from hardware.guard import CheckedGoal, Guard
from hardware.imu import ImuSample
from retarget.frames import SensorSample
from retarget.human.samples import Samples
from retarget.model.robot import RobotBody
from retarget.run.table import OF_IMU, STAGES, RunTable
from retarget.types import FloatArray, HumanPosture, RobotPosture


class Phase(IntEnum):
    """The purpose of a tick. A run goes through them in this order."""

    APPROACH = 0
    FOLLOW = 1
    BRAKE = 2
    """Also return to stance, and rest."""


PHASE_NAMES = tuple(phase.name.lower() for phase in Phase)
KEPT = (
    *("time", "phase", "gated", "no_command", "cost", *STAGES, "sensors", "human_q", "human_joints"),
    *("human_observer_modes", "balance_error", "q", "goals", "goal_ticks", "landmarks_asked", "observer_modes"),
    *("bus_time", "present", "faults", "voltage", "current", "temperature", "unexplained", "retries", *OF_IMU),
)
"""The fields that the record of a run has."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Record(RunTable):
    """A run, a row per sent tick. start (n,): rad, before the first; empty for a human alone. from_start, to_end: no
    tick is missing there."""

    human_joint_names: tuple[str, ...]
    landmark_names: tuple[str, ...] = ()
    start: FloatArray = field(default_factory=lambda: np.zeros(0))
    from_start: bool = True
    to_end: bool = True

    @property
    def robot(self) -> "Record | None":
        """The record of a robot; None for a human alone."""
        return self if self.start.size else None

    @property
    def following(self) -> slice:
        """The rows from the first to the last tick that followed."""
        rows = np.flatnonzero(self.phase == Phase.FOLLOW)
        return slice(int(rows[0]), int(rows[-1]) + 1) if rows.size else slice(0, 0)

    def missing(self) -> tuple[str, ...]:
        """Notes about missing parts of the run."""
        approach = () if self.from_start else ("the approach took long: its beginning is not recorded",)
        end = () if self.to_end else (f"what came after the first {self.time[-1]:.0f} s is not recorded",)
        return approach + end


class RecordRows:
    """Rows for ticks of approach, of following and of braking.

    Kept rows have no gap, since rates and missed ticks are measured between them. A too long approach keeps its end,
    and nothing is kept after `close`.
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
        """Go on to the next row. approaches: the next tick is still one of the approach."""
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
    def reused(self) -> bool:
        """True if the next row may have been filled before."""
        return self._laps > 0 or self._end is not None

    @property
    def closed(self) -> bool:
        """True if no more ticks are kept."""
        return self._end is not None

    def close(self) -> None:
        """Keep none of the ticks that follow."""
        if self._end is None:
            self._end, self.row = self.row, self.room - 1

    def of(self, record: Record) -> Record:
        """The kept rows of the record, in order; it is changed in place."""
        end, first = self.row if self._end is None else self._end, 0
        if self._laps:
            oldest, first = self.row if self._oldest is None else self._oldest, 1
            end = end if self._oldest is not None else self._approach

            def in_order(array: NDArray[Any]) -> NDArray[Any]:
                array[: self._approach] = np.roll(array[: self._approach], -oldest, axis=0)
                return array

            record = record.each(in_order)
            if record.robot is not None:  # the goals of the oldest row are where the kept rows begin
                record.start[:] = record.goals[0]
        return replace(record[first:end], from_start=self._laps == 0, to_end=self._end is None)


CYCLE = 2  # column of `cost` with the wall time of the tick
LONGEST_APPROACH_S = 30.0  # of a longer one the end is recorded


class TickRecorder:
    """Fills the rows of one run: `begin` of a tick, its parts, then `keep`."""

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
        """human, posture: the first ones. sensors: their number. stopping: s that a stop may take."""
        approach = 0 if robot is None else round(LONGEST_APPROACH_S / samples.dt)
        self._rows = RecordRows(approach=approach, follow=samples.kept, brake=round(stopping / samples.dt))
        self._samples, self._robot = samples, robot
        self._wall, self._begun, self._followed_at = MonotonicClock(), 0.0, (0.0, 0.0)
        widths = {
            "sensors": sensors,
            "human": human.q.size,
            "joints": len(human.joint_names),
            "human_observers": human.observer_modes.size,
        }
        known: dict[str, Any] = {"human_joint_names": tuple(human.joint_names)}
        if robot is not None and posture is not None:
            widths |= {"robot": robot.body.nq, "servos": len(robot.joint_map)}
            widths |= {"landmarks": len(posture.landmark_names), "observers": posture.observer_modes.size}
            known |= {"landmark_names": posture.landmark_names, "start": np.zeros(len(robot.joint_map))}
        self.record = Record.empty(self._rows.room, widths, KEPT, **known)
        self.record.phase[:] = Phase.FOLLOW
        self._stages = {name: self.record.known[name] for name in STAGES}
        self._followed = 0  # ticks

    def started(self, present: FloatArray) -> None:
        """Keep the joint positions (n,) rad before the first tick."""
        if self.record.robot is not None:
            self.record.start[:] = present

    def begin(self) -> None:
        """Begin the row of a tick."""
        self._begun = self._wall.now()
        if self._rows.reused:
            for times in self._stages.values():
                times[self._rows.row] = np.nan

    def keep_times(self, times: Mapping[str, float]) -> None:
        """Keep times of STAGES, s on the run's clock."""
        for stage, time in times.items():
            self._stages[stage][self._rows.row] = time

    def keep_human(self, human: HumanPosture, sample: SensorSample | None, *, error: bool) -> None:
        """Keep the human and the sample. error: the balance error is one of following."""
        kept, row = self.record, self._rows.row
        kept.human_q[row], kept.human_joints[row] = human.q, human.joints
        kept.human_observer_modes[row] = human.observer_modes
        kept.sensors[row] = np.nan if sample is None else sample.position
        kept.balance_error[row] = human.balance_error if error else np.nan

    def keep_costs(self, reconstruct: float, retarget: float) -> None:
        """Keep the thread CPU of both stages, s."""
        cost, row = self.record.cost, self._rows.row
        cost[row, 0], cost[row, 1] = reconstruct, retarget

    def keep_robot(
        self,
        guard: Guard,
        q: FloatArray,
        goal: CheckedGoal,
        *,
        commanded: bool,
        gated: bool,
        followed: RobotPosture | None,
        unexplained: FloatArray | None = None,
    ) -> None:
        """Keep posture q (nq,), m, wxyz and rad, and goal. commanded: there was a target, or the robot was to stop."""
        record, robot, row, states = self.record, self._robot, self._rows.row, guard.states
        assert robot is not None and states is not None and guard.sent is not None, "a goal was written"
        record.q[row], record.goals[row], record.goal_ticks[row] = q, goal.joints, guard.sent
        record.gated[row], record.no_command[row] = gated, not commanded
        record.landmarks_asked[row] = np.nan if followed is None else followed.landmarks_asked
        if followed is not None:
            record.observer_modes[row] = followed.observer_modes
        record.bus_time[row], record.retries[row] = states.time, states.retries
        record.present[row] = robot.joint_map.to_radians(states.position)
        record.temperature[row], record.voltage[row] = states.temperature, states.voltage
        record.current[row] = states.current
        if unexplained is not None:
            record.unexplained[row] = unexplained
        record.faults[row] = np.count_nonzero(~states.valid | (states.alert != 0))
        keep_imu(record, row, states.imu)

    def keep(self, phase: Phase, look: Callable[[Record, int], object], *, approaches: bool = False) -> None:
        """End the tick. look: receives the record and the row. approaches: the next tick is still one of the
        approach."""
        record, row = self.record, self._rows.row
        record.phase[row] = phase
        now = self._wall.now()
        record.cost[row, CYCLE] = now - self._begun
        look(record, row)
        record.cost[row, CYCLE] = self._wall.now() - self._begun  # callbacks are part of the tick
        if phase is Phase.FOLLOW and not self._rows.closed:
            self._followed_at = (self._followed_at[0] if self._followed else self._begun, now)
            self._followed += 1
        self._rows.filled(approaches=approaches)

    def close(self) -> None:
        """Keep none of the ticks that follow."""
        self._rows.close()

    def finish(self) -> tuple[Record, float]:
        """The record, and the wall time of its following, s."""
        record = self._rows.of(self.record)
        followed = record.following
        begins = followed.start if followed.stop else np.count_nonzero(record.phase == Phase.APPROACH)
        record.time[:] = (np.arange(len(record)) - begins) * self._samples.dt
        return record, self._followed_at[1] - self._followed_at[0]


def keep_imu(rows: RunTable, at: int, imu: ImuSample | None) -> None:
    """Keep a measurement in a row."""
    if imu is None:
        rows.imu_time[at] = np.nan
        return
    rows.imu_time[at], rows.imu_valid[at], rows.imu_age[at] = imu.time, imu.valid, imu.age
    rows.imu_orientation[at] = np.nan if imu.orientation is None else imu.orientation
    rows.imu_angular_velocity[at], rows.imu_acceleration[at] = imu.angular_velocity, imu.acceleration
