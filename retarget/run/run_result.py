"""A finished run, for metrics, pictures and files, and the extras of a snapshot."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hardware.guard_state import Stop
from retarget import rotations
from retarget.arithmetic import arctan2
from retarget.human.samples import Clip, Parts
from retarget.live.stream_report import LiveReport
from retarget.model.body import BodyModel, JointType
from retarget.model.human import Human
from retarget.model.observers import Observers
from retarget.model.robot import RobotBody, plant_roots
from retarget.model.scene_state import SceneState
from retarget.robot.walking.travel import WalkTally
from retarget.run.record import Record
from retarget.safety.contact import Presses
from retarget.schema.performer import Performer
from retarget.schema.priorities import Priorities
from retarget.types import FloatArray


@dataclass(frozen=True)
class Fallen:
    """A fall. time: s, on the run's time. how: in words, with or without torque."""

    time: float
    how: str


@dataclass(frozen=True, eq=False)
class PhysicsRun:
    """A simulated run of n servos and k soles, in T samples from the first torque on.

    toppled: fall at rest without torque. time (T,): s, on the run's time. body (T, 7 + j): root, m and wxyz, and
    joints, rad or m. com (T, 3): m. pressure (T, 2): centre of pressure, m, NaN in the air; margin (T,): m, inside the
    hull of the carrying soles. slip (k,): m. tilt: the worst of a carrying sole, rad. torque (T, n): N m. hottest (n,):
    degrees Celsius, not calibrated. contacts: samples in contact with itself, and with a fixture.
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
        """Least margin of the centre of pressure until a fall, m; None if no sole carried."""
        standing = np.isfinite(self.margin) & (self.time <= (np.inf if self.fall is None else self.fall.time))
        known = self.margin[standing]
        return float(known.min()) if known.size else None


@dataclass(frozen=True)
class RefusedPair:
    """The links, or link and obstacle, for which the gate refused goals in most ticks."""

    first: str
    second: str
    ticks: int
    obstacle: bool


CAPPED = "linear solves took too many steps and were ended: they keep all limits, and follow less"
"""Text of a note, after their number."""


@dataclass(frozen=True)
class RunTally:
    """The findings of a run. standing: why it stood at the end, or "". strategies: s of each, by name."""

    walk: WalkTally | None = None
    refused_pair: RefusedPair | None = None
    presses: Presses | None = None
    standing: str = ""
    strategies: dict[str, float] | None = None


@dataclass(frozen=True, eq=False)
class RunSetup:
    """The setup of a run. priorities: of the stages. has_bus: servos answered. real_time: ticks could be late."""

    performer: Performer
    priorities: tuple[Priorities, ...]
    has_bus: bool
    real_time: bool = True
    parts: Parts = "whole"


@dataclass(frozen=True, eq=False)
class RunResult:
    """A run. Arrays per tick have the rows of `record`. robot: None for a human alone. wall_s: of the loop."""

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
        """Observers of the last stage."""
        return () if self.observers is None else self.observers.names

    @property
    def ticks_followed(self) -> int:
        """Number of ticks that followed the clip."""
        following = self.record.following
        return int(following.stop - following.start)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Sensors of the performer."""
        return self.clip.frames.names

    @property
    def sensors_desired(self) -> FloatArray:
        """Sensor positions (T, k, 3) m, world; NaN if invalid and outside of following."""
        position = self.clip.frames.position[self.clip.rows(self.ticks_followed)]
        padded = np.full((len(self.record), *position.shape[1:]), np.nan)
        padded[self.record.following] = position
        return padded

    @property
    def sensors_reached(self) -> FloatArray:
        """Positions (T, k, 3) m of the human's joints at the sensors."""
        names = self.record.human_joint_names
        columns = [names.index(self.setup.performer.sensors[sensor].joint) for sensor in self.sensors]
        return np.asarray(self.record.human_joints[:, columns])

    @property
    def human_truth(self) -> FloatArray | None:
        """Recorded joint centres (T, m, 3) m, in the record's order; NaN or None if not known."""
        return self.truth_of(self.record.human_joint_names)

    def truth_of(self, names: tuple[str, ...], rows: slice | None = None) -> FloatArray | None:
        """As `human_truth`, of some joints (T, m, 3) m and some consecutive rows."""
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
        """Landmarks (T, k, 3) m of the postures sent."""
        sent = self.record.robot
        if self.robot is None or sent is None:
            return None
        return self.robot.points(sent.q, self.robot.landmark_frames(sent.landmark_names))

    @property
    def followed(self) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        """Names, desired and actual positions (T, k, 3) m: landmarks of a robot, sensors of a human."""
        reached, sent = self.landmarks_reached, self.record.robot
        if reached is None or sent is None:
            return self.sensors, self.sensors_desired, self.sensors_reached
        return sent.landmark_names, sent.landmarks_asked, reached

    def present_q(self, rows: slice) -> FloatArray | None:
        """Measured postures (T, nq), m, wxyz and rad, on the planted sole; None without servos."""
        sent = self.record.robot
        if self.robot is None or sent is None or not self.setup.has_bus:
            return None
        q = sent.q[rows].copy()
        q[:, self.robot.servo_columns] = sent.present[rows]
        plant_roots(self.robot, sent.q[rows], q)
        return q

    @property
    def moved_q(self) -> FloatArray | None:
        """Postures (T, nq), m, wxyz and rad, of the simulated body, or as sent."""
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
        """Points (T, k, 3) m along the axes of the stance of a robot that walks, and turns."""
        back = self._back
        return points if back is None else rotations.rotate(back[:, None], points)

    @property
    def seen_q(self) -> FloatArray | None:
        """`moved_q` (T, nq) along the axes of the stance."""
        q, back = self.moved_q, self._back
        if q is None or back is None:
            return q
        q = q.copy()
        q[:, :3], q[:, 3:7] = rotations.rotate(back, q[:, :3]), rotations.multiply(back, q[:, 3:7])
        return q

    @property
    def _back(self) -> FloatArray | None:
        """Rotations (T, 4) wxyz from the world to the axes of the stance; None if equal."""
        robot, sent, walk = self.robot, self.record.robot, self.tally.walk
        if robot is None or sent is None or walk is None or not walk.steps:
            return None
        soles = robot.orientations(sent.q, tuple(foot.frame for foot in robot.profile.feet.values()))
        x, y, _ = rotations.rotate(soles, np.array([1.0, 0.0, 0.0])).sum(axis=1).T
        return rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), -arctan2(y, x))


ROOT, PRESSURE = 7, 2  # numbers of a free root, and of a centre of pressure


def truth_names(body: BodyModel) -> tuple[str, ...]:
    """Names of the numbers of a simulated body: root, joints, and centre of pressure, m."""
    joints = [name for name, kind in zip(body.joint_names, body.joint_type, strict=True) if kind > JointType.BALL]
    return ("x", "y", "z", "qw", "qx", "qy", "qz", *joints, "pressure_x", "pressure_y")


def in_truth(body: BodyModel, goal: FloatArray, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Posture (nq,), m, wxyz and rad, of the numbers of `truth_names`, and centre of pressure (2,). goal: of a fixed
    root."""
    q = goal.copy()
    if body.root == "free":
        q[:ROOT] = numbers[:ROOT]
    q[body.joint_qpos[body.joint_type > JointType.BALL]] = numbers[ROOT:-PRESSURE]
    return q, numbers[-PRESSURE:]


@dataclass(frozen=True)
class Extras:
    """Extras of a snapshot. words: state and reason. current (s,): A. obstacles (o, 7): poses. latency: s, from a live
    frame to goals."""

    words: Callable[[], tuple[str, str]] = lambda: ("", "")
    current: Callable[[], FloatArray | None] = lambda: None
    obstacles: Callable[[], FloatArray | None] = lambda: None
    truth: Callable[[], FloatArray | None] = lambda: None
    latency: Callable[[], float | None] = lambda: None
