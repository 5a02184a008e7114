"""A finished run: what was asked, what happened, and to which bodies. Metrics, pictures and files read it."""

from dataclasses import dataclass, field

import numpy as np

from hardware.guard_state import Stop
from retarget.clip import Clip
from retarget.human import Human
from retarget.joint_limits import JointLimits
from retarget.live.account import LiveReport
from retarget.observers import Observers
from retarget.performer import Performer
from retarget.physics_run import PhysicsRun
from retarget.planted_root import plant_roots
from retarget.priorities import Priorities
from retarget.record import Record
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.scene_motion import SceneState
from retarget.step_plan import StepTally

__all__ = ["RunResult"]


@dataclass(frozen=True, eq=False)
class RunResult:
    """A run. Everything per tick has the rows of `record`.

    human_limits (nv,). robot: None where only the human was reconstructed. priorities: of the stages. state, reason:
    how the run ended (see `StopReport`). wall_s: of the loop. has_bus: servos answered. stop: the guard's, None
    without one. scene: what was around the last stage's body; observers: of that body. physics: what a simulation
    saw, None without one; steps: None of a robot that makes none. live: what there is to tell of a stream, None of a
    file.
    """

    record: Record
    clip: Clip
    human: Human
    human_limits: JointLimits
    performer: Performer
    robot: RobotBody | None
    priorities: tuple[Priorities, ...]
    state: str | None
    reason: str | None
    wall_s: float
    has_bus: bool
    notes: tuple[str, ...] = field(default=())
    stop: Stop | None = None
    scene: SceneState | None = None
    observers: Observers | None = None
    physics: PhysicsRun | None = None
    steps: StepTally | None = None
    live: LiveReport | None = None

    @property
    def observer_names(self) -> tuple[str, ...]:
        """Of the last stage's body, in the order of the recorded modes."""
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
        names = self.record.human.joint_names
        columns = [names.index(self.performer.sensors[sensor].joint) for sensor in self.sensors]
        return np.asarray(self.record.human.joints[:, columns])

    @property
    def human_truth(self) -> FloatArray | None:
        """Recorded joint centres (T, m, 3) m, in the order of the record's; NaN or None where not known."""
        truth = self.clip.truth(self.record.human.joint_names, self.ticks_followed)
        return None if truth is None else self._while_following(truth)

    @property
    def landmarks_reached(self) -> FloatArray | None:
        """Where the posture that was sent puts each landmark (T, k, 3) m; None without a robot."""
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

    @property
    def present_q(self) -> FloatArray | None:
        """Postures (T, nq) in which the servos stood, on the sole that is planted; None without servos that answer."""
        sent = self.record.robot
        if self.robot is None or sent is None or not self.has_bus:
            return None
        q = sent.q.copy()
        q[:, self.robot.servo_columns] = sent.present
        plant_roots(self.robot, sent.q, q)
        return q

    def _while_following(self, rows: FloatArray) -> FloatArray:
        """Rows of the ticks that followed, with NaN in all others."""
        padded = np.full((len(self.record), *rows.shape[1:]), np.nan)
        padded[self.record.following] = rows
        return padded
