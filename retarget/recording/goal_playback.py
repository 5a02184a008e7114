"""Goal playback: the goals of a recording are sent again, to any bus, without a performer."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from hardware.clock import Clock
from retarget.errors import InputError
from retarget.human.samples import Clip, Performance
from retarget.model.robot import RobotBody
from retarget.recording.reading import Recording
from retarget.recording.replay import refuse_other_robot
from retarget.run.controllers import GoalPlayback, GoalsInstead
from retarget.run.options import RunOptions
from retarget.run.prepare import MakeBus, Prepared, prepare_for
from retarget.run.record import Phase
from retarget.schema.performer import Performer
from retarget.types import FloatArray, Notify

FOR_EVER = 10**9
HOLDS_S = 10.0
"""Time, s, that is recorded of holds and of the return to the goals."""


def recorded_goals(recording: Recording, *, speed: float, dt: float) -> FloatArray:
    """The goals (T, n), rad, of following, resampled to ticks of `dt` s. Raises InputError without any, or for
    non-finite ones."""
    cycles, where = recording.cycles, str(recording.path)
    followed = np.flatnonzero(cycles.kept & (cycles.phase == Phase.FOLLOW))
    if not followed.size:
        raise InputError("no performer was followed in the recording: it has no goals", where=where)
    rows = followed[0] + np.flatnonzero(cycles.kept[followed[0] : followed[-1] + 1])
    if not np.isfinite(cycles.q_servos[rows]).all():
        raise InputError(
            "the goals of this recording were never a robot's", where=where, found="one that is not finite"
        )
    index = (cycles.index[rows] - cycles.index[rows[0]]).astype(np.float64)
    step = speed * dt / recording.session.dt  # recorded ticks in one tick
    at = np.append(np.arange(0.0, index[-1], step), index[-1])
    before = np.clip(np.searchsorted(index, at, side="right") - 1, 0, max(len(index) - 2, 0))
    after, q = np.minimum(before + 1, len(index) - 1), cycles.q_servos[rows].astype(np.float64)
    share = ((at - index[before]) / np.maximum(index[after] - index[before], 1.0))[:, None]
    return np.asarray(q[before] + share * (q[after] - q[before]))


@dataclass(frozen=True, eq=False)
class HeldClip(Clip):
    """The first sample of a recording, repeated. planned: ticks without holds."""

    planned: int

    @property
    def kept(self) -> int:
        """Twice the planned ticks, and those of holds."""
        return 2 * self.planned + round(HOLDS_S * self.rate_hz)

    def recorded(self) -> Clip:
        """The first sample, for as many ticks as planned."""
        return Clip(self.frames, self.planned, self.rate_hz, self.speed, self.source_frames)


def held_performance(performance: Performance, planned: int) -> Performance:
    """The first sample of a recorded performance, while `planned` goals are sent."""
    clip = performance.samples.recorded()
    return replace(performance, samples=HeldClip(**vars(replace(clip, ticks=FOR_EVER)), planned=planned))


def playing_back(prepared: Prepared, goals: FloatArray) -> Prepared:
    """The run of a robot that sends goals (T, n), rad, servo order, one row per tick."""
    assert prepared.machine is not None, "goals are a robot's"
    controller = GoalPlayback(prepared.machine.robot, goals, dt=prepared.machine.dt)
    instead = GoalsInstead(controller, goals[0], "the recorded goals")
    return replace(prepared, machine=replace(prepared.machine, goals=instead))


@contextmanager
def goal_playback(
    recording: Recording,
    options: RunOptions,
    *,
    speed: float,
    clock: Clock,
    make_bus: MakeBus,
    notify: Notify,
    robot: RobotBody | None = None,
) -> Iterator[Prepared]:
    """A prepared run that sends the goals and ends at rest. options: with another bus. Raises RetargetError for goals
    that this robot cannot have."""
    session = recording.session
    goals: list[FloatArray] = []

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        if robot is None:
            raise InputError("a human has no servos: there are no goals", where=str(recording.path))
        refuse_other_robot(session, robot)
        dt = 1.0 / robot.profile.safety.rate_hz
        goals.append(recorded_goals(recording, speed=speed, dt=dt))
        first = recording.clip(np.zeros(1, dtype=np.intp), 1, dt=dt, speed=1.0)
        return held_performance(Performance(first, session.size, (), session.intake_times), len(goals[0]))

    with prepare_for(
        perform, options, clock=clock, make_bus=make_bus, goes_to_rest=True, notify=notify, robot=robot
    ) as prepared:
        yield playing_back(prepared, goals[0])
