"""A finished run, which metrics, pictures and files read; and what is shown of a run while it goes on."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hardware.guard_state import Stop
from retarget import rotations
from retarget.arithmetic import arctan2
from retarget.human.samples import Clip, Parts
from retarget.ik.base_pose import plant_roots
from retarget.live.stream_report import LiveReport
from retarget.model.body import BodyModel, JointType
from retarget.model.human import Human
from retarget.model.observers import Observers
from retarget.model.robot import RobotBody
from retarget.model.scene_state import SceneState
from retarget.robot.walking.travel import WalkTally
from retarget.run.record import Record
from retarget.safety.contact import Presses
from retarget.schema.performer import Performer
from retarget.schema.priorities import Priorities
from retarget.types import FloatArray

# What only a simulation knows of a run: falls, pressure, slip, torque, heat.


@dataclass(frozen=True)
class Fallen:
    """A fall. time: s, on the run's time. how: in words, and whether that was without torque."""

    time: float
    how: str


@dataclass(frozen=True, eq=False)
class PhysicsRun:
    """A run of n servos and k soles, sampled T times from the first torque on.

    mount: what the robot was on. seed, perturbations: of what was perturbed on purpose. fall: the first, None while it
    stands; toppled: the fall of a robot at rest after its torque went off, None if it stayed. time (T,) s, on the run's
    time. body (T, 7 + j): its root, m and wxyz, and its joints, rad or m, as `truth_names` lists them. com (T, 3),
    pressure (T, 2): centre of mass and centre of pressure of the soles, m, world, the latter NaN where no sole carried;
    margin (T,): of it inside the hull of the soles that carried, m. slip (k,) m: horizontal path of each sole while it
    carried. tilt: worst of a sole that carried, rad. torque (T, n) N m; hottest (n,) degrees Celsius, by a stated model
    that is not calibrated. contacts: samples in which the body touched itself, and in which it touched a fixture.
    """

    mount: str
    seed: int
    perturbations: tuple[str, ...]
    fall: Fallen | None
    toppled: Fallen | None
    time: FloatArray
    body: FloatArray
    com: FloatArray
    pressure: FloatArray
    margin: FloatArray
    slip: FloatArray
    tilt: float
    torque: FloatArray
    hottest: FloatArray
    contacts: tuple[int, int]

    @property
    def least_margin(self) -> float | None:
        """Least margin of the centre of pressure until a fall, m; None where no sole carried."""
        standing = np.isfinite(self.margin) & (self.time <= (np.inf if self.fall is None else self.fall.time))
        known = self.margin[standing]
        return float(known.min()) if known.size else None


@dataclass(frozen=True)
class RefusedPair:
    """The two links, or the link and the obstacle, for which the gate refused goals in most ticks. ticks: how many;
    obstacle: the second is one."""

    first: str
    second: str
    ticks: int
    obstacle: bool


CAPPED = "linear solves took too many steps and were ended: they keep all limits, and follow less"
"""Ends a note of a run that counts them: nobody who runs a robot can act on it."""


@dataclass(frozen=True)
class RunTally:
    """What its machine saw in a run. walk: None for a robot that makes no steps; refused_pair: None where the gate
    refused no goal for one; presses: None where the robot pressed against nothing. standing: why it stood at the end,
    "" where it did not. strategies: s, by name, that hands were reached for by each; None of a robot that chooses
    none."""

    walk: WalkTally | None = None
    refused_pair: RefusedPair | None = None
    presses: Presses | None = None
    standing: str = ""
    strategies: dict[str, float] | None = None


@dataclass(frozen=True, eq=False)
class RunSetup:
    """What a run was made of. priorities: of the stages. has_bus: servos answered. real_time: ticks could be late; on
    virtual time none is. parts: of the robot that follow."""

    performer: Performer
    priorities: tuple[Priorities, ...]
    has_bus: bool
    real_time: bool = True
    parts: Parts = "whole"


@dataclass(frozen=True, eq=False)
class RunResult:
    """A run. Everything per tick has the rows of `record`.

    robot: None where only the human was reconstructed. state, reason: how the run ended (see `StopReport`). wall_s: of
    the loop. stop: the guard's, None without one. scene: of the
    last stage's body; observers: of that body. physics: what a simulation measured, None without one. live: the report
    of a stream, None for a file.
    """

    record: Record
    clip: Clip
    human: Human
    robot: RobotBody | None
    setup: RunSetup
    state: str | None
    reason: str | None
    wall_s: float
    notes: tuple[str, ...] = field(default=())
    stop: Stop | None = None
    scene: SceneState | None = None
    observers: Observers | None = None
    physics: PhysicsRun | None = None
    tally: RunTally = RunTally()
    live: LiveReport | None = None

    @property
    def observer_names(self) -> tuple[str, ...]:
        """Names of the observers of the last stage's body, in the order of the recorded modes."""
        return () if self.observers is None else self.observers.names

    @property
    def ticks_followed(self) -> int:
        """Ticks that followed the clip, from its first on."""
        following = self.record.following
        return int(following.stop - following.start)

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that the performer wears."""
        return self.clip.frames.names

    @property
    def sensors_asked(self) -> FloatArray:
        """Sensor positions (T, k, 3) m, world; NaN where invalid and outside of following."""
        return self._while_following(self.clip.frames.position[self.clip.rows(self.ticks_followed)])

    @property
    def sensors_reached(self) -> FloatArray:
        """Positions (T, k, 3) m of the human's joints that wear the sensors."""
        names = self.record.human_joint_names
        columns = [names.index(self.setup.performer.sensors[sensor].joint) for sensor in self.sensors]
        return np.asarray(self.record.human_joints[:, columns])

    @property
    def human_truth(self) -> FloatArray | None:
        """Recorded joint centres (T, m, 3) m, in the order of the record's; NaN or None where not known."""
        return self.truth_of(self.record.human_joint_names)

    def truth_of(self, names: tuple[str, ...], rows: slice | None = None) -> FloatArray | None:
        """As `human_truth`, of some joints (T, m, 3) m and some rows, which go up one by one."""
        of, following = range(len(self.record))[slice(None) if rows is None else rows], self.record.following
        first, end = max(of.start, following.start), min(of.stop, following.stop)
        known = self.clip.truth(names, range(first - following.start, max(end, first) - following.start))
        if known is None:
            return None
        padded = np.full((len(of), *known.shape[1:]), np.nan)
        padded[first - of.start : max(end, first) - of.start] = known
        return padded

    @property
    def landmarks_reached(self) -> FloatArray | None:
        """Places (T, k, 3) m of the landmarks in the postures that were sent; None without a robot."""
        sent = self.record.robot
        if self.robot is None or sent is None:
            return None
        return self.robot.points(sent.q, self.robot.landmark_frames(sent.landmark_names))

    @property
    def followed(self) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        """What was followed: names, tracks asked and reached (T, k, 3) m. Landmarks of a robot, sensors of a human."""
        reached, sent = self.landmarks_reached, self.record.robot
        if reached is None or sent is None:
            return self.sensors, self.sensors_asked, self.sensors_reached
        return sent.landmark_names, sent.landmarks_asked, reached

    def present_q(self, rows: slice) -> FloatArray | None:
        """Postures (T, nq), m, wxyz and rad, of the present positions in some rows, on the planted sole; None without
        servos that answer."""
        sent = self.record.robot
        if self.robot is None or sent is None or not self.setup.has_bus:
            return None
        q = sent.q[rows].copy()
        q[:, self.robot.servo_columns] = sent.present[rows]
        plant_roots(self.robot, sent.q[rows], q)
        return q

    @property
    def moved_q(self) -> FloatArray | None:
        """Postures (T, nq), m, wxyz and rad, of the simulated body at every tick, or as they were sent where nothing
        has mass; None without a robot."""
        sent, physics = self.record.robot, self.physics
        if self.robot is None or sent is None or physics is None or not len(physics.time):
            return None if sent is None else sent.q
        body, q = self.robot.body, sent.q.copy()
        rows = np.searchsorted(physics.time, self.record.time).clip(max=len(physics.time) - 1)
        if body.root == "free":
            q[:, :ROOT] = physics.body[rows, :ROOT]
        q[:, body.joint_qpos[body.joint_type > JointType.BALL]] = physics.body[rows, ROOT:]
        return q

    def seen(self, points: FloatArray) -> FloatArray:
        """Points (T, k, 3) m of the world as a robot sees them that walks, and turns: along the axes of its stance;
        those of another are the same."""
        back = self._back
        return points if back is None else rotations.rotate(back[:, None], points)

    @property
    def seen_q(self) -> FloatArray | None:
        """`moved_q` (T, nq) along the axes of the robot's stance."""
        q, back = self.moved_q, self._back
        if q is None or back is None:
            return q
        q = q.copy()
        q[:, :3], q[:, 3:7] = rotations.rotate(back, q[:, :3]), rotations.multiply(back, q[:, 3:7])
        return q

    @property
    def _back(self) -> FloatArray | None:
        """Turns (T, 4) wxyz from the world to the axes of the stance, mid-way between the soles; None where they are
        the same."""
        robot, sent, walk = self.robot, self.record.robot, self.tally.walk
        if robot is None or sent is None or walk is None or not walk.steps:
            return None
        soles = robot.orientations(sent.q, tuple(foot.frame for foot in robot.profile.feet.values()))
        x, y, _ = rotations.rotate(soles, np.array([1.0, 0.0, 0.0])).sum(axis=1).T
        return rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), -arctan2(y, x))

    def _while_following(self, rows: FloatArray) -> FloatArray:
        """Rows of the ticks that followed, with NaN in all others."""
        padded = np.full((len(self.record), *rows.shape[1:]), np.nan)
        padded[self.record.following] = rows
        return padded


# What is shown of a run in addition to the rows of its record, read only when a snapshot is shown.

ROOT, PRESSURE = 7, 2
"""Numbers of a free root in a row (position, quaternion) and of the centre of pressure (x, y)."""


def truth_names(body: BodyModel) -> tuple[str, ...]:
    """Names of the numbers that describe the state of a simulated body: the pose of its root link, the angles of its
    hinges and slides, and the centre of pressure of its soles (m, NaN where none carries)."""
    joints = [name for name, kind in zip(body.joint_names, body.joint_type, strict=True) if kind > JointType.BALL]
    return ("x", "y", "z", "qw", "qx", "qy", "qz", *joints, "pressure_x", "pressure_y")


def in_truth(body: BodyModel, goal: FloatArray, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Posture (nq,), m, wxyz and rad, of a body by the numbers of `truth_names`, and the centre of pressure (2,).

    The root of a body with a fixed root is that of `goal`.
    """
    q = goal.copy()
    if body.root == "free":
        q[:ROOT] = numbers[:ROOT]
    q[body.joint_qpos[body.joint_type > JointType.BALL]] = numbers[ROOT:-PRESSURE]
    return q, numbers[-PRESSURE:]


@dataclass(frozen=True)
class Extras:
    """words: what the robot does now, and why. current: that of its servos, (s,) A. obstacles: their poses
    (o, 7). truth: the state of a simulated body. latency: s, from a live frame to goals, of late. Each is None where it
    is not known or does not exist."""

    words: Callable[[], tuple[str, str]] = lambda: ("", "")
    current: Callable[[], FloatArray | None] = lambda: None
    obstacles: Callable[[], FloatArray | None] = lambda: None
    truth: Callable[[], FloatArray | None] = lambda: None
    latency: Callable[[], float | None] = lambda: None
