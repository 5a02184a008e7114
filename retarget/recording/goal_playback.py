"""Goal playback: a recording's goals are sent once more, to any bus. No performer is followed, all else is as ever."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from hardware.clock import Clock
from retarget._solver import Braking, TrajectoryGenerator
from retarget.errors import InputError
from retarget.frames import SensorSample
from retarget.human.samples import Clip, Performance
from retarget.model.robot import RobotBody
from retarget.recording.reading import Played
from retarget.recording.replay import refuse_other_robot
from retarget.run.options import RunOptions
from retarget.run.prepare import MakeBus, Prepared, prepare_for
from retarget.run.record import Phase
from retarget.run.stages import ReconstructingStage
from retarget.schema.performer import Performer
from retarget.types import BoolArray, FloatArray, Notify, RobotPosture

if TYPE_CHECKING:
    from retarget.types import HumanPosture


MOST_REFUSED, GONE_S = 5, 1.0
"""The most refusals in a row, each within so many s of the trajectory after the last; one more ends the playback."""
FOR_EVER = 10**9
STILL = 1e-9
"""rad/s; what is slower stands."""
REGAIN_S = 0.4
"""Time in which the playback is back at its full speed after a hold."""
RISE_S, JERK_S = 0.5, 0.2
"""Times in which the way back reaches its full speed, and its full acceleration."""


class PlaybackPart(Enum):
    """What the playback does."""

    PLAYING = "goes along the recorded goals"
    BRAKING = "stands first, after something else was sent"
    RETURNING = "returns to them"


class RecordedGoals:
    """A `FollowingStage` whose postures are those that were sent. speed: 1 is as fast as then.

    The postures end at standstill. After a hold or a refused goal the robot stands first, and rejoins the trajectory
    slowly; where goals are refused again and again, the next posture is NaN. Raises InputError if the recording has no
    followed tick or no goals.
    """

    def __init__(self, played: Played, robot: RobotBody, *, speed: float, dt: float) -> None:
        cycles = played.cycles
        followed = np.flatnonzero(cycles.kept & (cycles.phase == Phase.FOLLOW))
        if not followed.size:
            raise InputError(
                "no performer was followed in the recording: it has no goals", where=str(played.recording.path)
            )
        rows = followed[0] + np.flatnonzero(cycles.kept[followed[0] : followed[-1] + 1])
        index = (cycles.index[rows] - cycles.index[rows[0]]).astype(np.float64)
        step = speed * dt / played.recording.session.dt  # recorded ticks in one tick
        at = np.append(np.arange(0.0, index[-1], step), index[-1])
        self._robot, self._dt = robot, dt
        joints = np.stack([np.interp(at, index, column) for column in cycles.q[rows].T], axis=1)
        self._rest = cycles.rest[rows][np.searchsorted(index, at, side="right") - 1]
        self._columns = np.setdiff1d(np.arange(robot.body.nq), robot.servo_columns)
        limits, caps = robot.limits, robot.profile.safety.speed_caps
        fastest = 2.0 * robot.joint_map.max_velocity * dt
        if not np.isfinite(joints).all() or (np.abs(np.diff(joints[-2:], axis=0)) > fastest).any():
            raise InputError(
                "the goals of this recording were never a robot's",
                where=str(played.recording.path),
                found="a goal that is not finite, or last goals faster than twice the servos' speed",
            )
        fast = max(caps.follow, caps.approach) * limits.max_velocity
        self._braking = Braking(limits.lower, limits.upper, fast, limits.max_acceleration, dt=dt)
        self._joints = np.vstack([joints, *self._to_rest(joints)])
        self._refused, self._refused_at = 0, 0.0
        body = robot.body
        self._dofs = body.joint_dof[[body.joint_index(joint) for joint in robot.joint_map.joints]]
        self._speed_override, self._gone = 1.0, 0.0
        self._part = PlaybackPart.PLAYING
        self._here: FloatArray = self._joints[0]
        self._moved: FloatArray = np.zeros_like(self._here)
        velocity = robot.profile.safety.speed_caps.approach * limits.max_velocity
        acceleration = np.minimum(velocity / RISE_S, limits.max_acceleration)
        self._back = TrajectoryGenerator(velocity, acceleration, acceleration / JERK_S, dt=dt)
        self._begin()

    @property
    def ticks(self) -> int:
        """Ticks that all of it takes at full speed, if it is never held."""
        return len(self._joints)

    @property
    def done(self) -> bool:
        """Whether the last posture was asked for."""
        return self._part is PlaybackPart.PLAYING and self._gone > len(self._joints) - 1

    def start(self, human: "HumanPosture") -> RobotPosture:
        """Return the first recorded posture (nq,)."""
        self._begin()
        return self._posture(self._here)

    def settle(self, human: "HumanPosture", dt: float) -> None:
        """Return None: following begins at the first posture, where the robot is."""

    def step(self, human: "HumanPosture", dt: float) -> RobotPosture:
        """Return the next posture (nq,); NaN after too many refusals."""
        if self._refused > MOST_REFUSED:
            return self._posture(np.full_like(self._here, np.nan))
        if self._part is PlaybackPart.BRAKING and not self._moved.any():
            self._part = PlaybackPart.RETURNING
            self._back.reset(self._here)
        there = self._at(self._gone)
        if self._part is PlaybackPart.RETURNING and np.array_equal(self._here, there):
            self._part, self._pace = PlaybackPart.PLAYING, 0.0
        if self._part is PlaybackPart.BRAKING:
            moved = self._braking.in_line(self._moved)
        elif self._part is PlaybackPart.RETURNING:
            moved = self._back.step(there, self._speed_override) - self._here
            if np.array_equal(self._back.position, there):
                moved = there - self._here
        else:
            moved = there - self._here
            last = len(self._joints) - 1.0
            on = self._gone + self._pace * self._speed_override
            self._gone = min(on, last) if self._gone < last else on
            self._pace = min(self._pace + self._dt / REGAIN_S, 1.0)
        self._here, self._moved = self._here + moved, moved
        return self._posture(self._here)

    def set_speed_override(self, override: float) -> None:
        """Play the postures at a share (0, 1] of the speed."""
        self._speed_override = override

    def halt(self, dt: float) -> FloatArray | None:
        """Return None: there is no trajectory to a stop, so each joint brakes on its own."""
        return None

    def return_to_stance(self, dt: float) -> FloatArray | None:
        """Return None: the feet are taken to be on the floor."""
        return None

    def begin_return_to_stance(self, q: FloatArray, dt: float) -> None:
        """Do nothing: recorded goals do not depend on it."""

    def pass_time(self, dt: float) -> None:
        """Do nothing: no obstacle is known that could move."""

    def set_contact_state(self, soles: BoolArray | None) -> None:
        """Recorded goals do not depend on it."""

    def reseed(self, q: FloatArray, velocity: FloatArray) -> None:
        """Go on from posture q (nq,) and velocity (nv,), rad and rad/s, that were sent instead of the last posture."""
        moved = velocity[self._dofs]
        self._here = q[self._robot.servo_columns].copy()
        self._moved = np.where(np.abs(moved) > STILL, moved, 0.0) * self._dt
        if self._part is not PlaybackPart.BRAKING:
            gone = (self._gone - self._refused_at) * self._dt > GONE_S
            self._refused, self._refused_at = 1 if gone else self._refused + 1, self._gone
        self._part = PlaybackPart.BRAKING

    def _begin(self) -> None:
        self._part, self._gone = PlaybackPart.PLAYING, 0.0
        self._pace = 1.0  # share of the speed of then: all of it, but after a return
        self._here, self._moved = self._joints[0], np.zeros_like(self._joints[0])

    def _at(self, gone: float) -> FloatArray:
        """The recorded posture (n,) after so many goals, rad."""
        row = min(int(gone), len(self._joints) - 1)
        then = min(row + 1, len(self._joints) - 1)
        between: FloatArray = self._joints[row] + (gone - row) * (self._joints[then] - self._joints[row])
        return between if then > row else self._joints[row]

    def _to_rest(self, joints: FloatArray) -> list[FloatArray]:
        """What follows postures (T, n) rad until all joints rest: in line, the joints brake together."""
        rows: list[FloatArray] = []
        here, moved = joints[-1], joints[-1] - joints[-2] if len(joints) > 1 else np.zeros(joints.shape[1])
        while np.abs(moved).max() > STILL * self._dt:
            moved = self._braking.in_line(moved)
            here = here + moved
            rows.append(here)
        return rows

    def _posture(self, joints: FloatArray) -> RobotPosture:
        robot, q = self._robot, self._robot.body.qpos0.copy()
        q[robot.servo_columns] = joints
        if self._columns.size == self._rest.shape[1]:
            q[self._columns] = self._rest[min(int(self._gone), len(self._rest) - 1)]
        landmarks, modes = np.zeros((0, 3)), np.zeros(0, dtype=np.uint8)
        return RobotPosture(q, joints, q[:3], q[3:7], (), landmarks, landmarks, np.zeros(3), float("inf"), modes)


@dataclass(frozen=True, eq=False)
class UntilDone(Clip):
    """`Samples` of the first sample of a recording, until all goals were sent. planned: ticks that this takes."""

    stage: RecordedGoals
    planned: int

    @property
    def kept(self) -> int:
        """Twice as many ticks as planned."""
        return 2 * self.planned

    @property
    def over(self) -> bool:
        """Whether all goals were sent."""
        return self.stage.done

    def recorded(self) -> Clip:
        """The first sample, for as many ticks as planned."""
        return Clip(self.frames, self.planned, self.rate_hz, self.speed, self.source_frames)


class StillHuman:
    """A `ReconstructingStage` whose human does not move."""

    def __init__(self, inner: ReconstructingStage) -> None:
        self._inner = inner
        self._posture: HumanPosture | None = None

    def start(self, sample: SensorSample) -> "HumanPosture":
        """The human of the first sample."""
        self._posture = self._inner.start(sample)
        return self._posture

    def step(self, sample: SensorSample, dt: float) -> "HumanPosture":
        """Return the same posture, whatever the sample."""
        return self.start(sample) if self._posture is None else self._posture


@contextmanager
def goal_playback(
    played: Played,
    options: RunOptions,
    *,
    speed: float,
    clock: Clock,
    make_bus: MakeBus,
    notify: Notify,
    robot: RobotBody | None = None,
) -> Iterator[Prepared]:
    """A run that sends the goals, ready to start; it ends at rest. options: those of the recording, on another bus.
    robot: as of `prepare_for`.

    Raises RetargetError for what cannot be sent to this robot.
    """
    session = played.recording.session
    stages: list[RecordedGoals] = []

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        if robot is None:
            raise InputError("a human has no servos: there are no goals", where=str(played.recording.path))
        refuse_other_robot(session, robot)
        dt = 1.0 / robot.profile.safety.rate_hz
        stages.append(RecordedGoals(played, robot, speed=speed, dt=dt))
        held = played.clip(np.zeros(1, dtype=np.intp), FOR_EVER, dt=dt, speed=1.0)
        samples = UntilDone(**vars(held), stage=stages[0], planned=stages[0].ticks)
        return Performance(samples, session.size, session.notes, session.intake_times)

    with prepare_for(
        perform,
        options,
        clock=clock,
        make_bus=make_bus,
        goes_to_rest=True,
        notify=notify,
        lead=lambda follower: stages[0],
        robot=robot,
    ) as prepared:
        yield replace(prepared, reconstructor=StillHuman(prepared.reconstructor))
