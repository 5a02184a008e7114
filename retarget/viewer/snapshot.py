"""What a page shows: the cast of a run, which stays the same, and snapshots of it, one per tick."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from retarget.ik.gravity_torque import GRAVITY
from retarget.model.meshes import Mesh, SolidBody, shape_mesh
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import SceneShapes
from retarget.model.scene_state import ObstaclePoses
from retarget.run.run_result import in_truth
from retarget.schema.scene import FLOOR
from retarget.types import FloatArray, IntArray, ModeArray, RunState

STATE_WORDS = {
    RunState.APPROACH: "approaching",
    RunState.FOLLOW: "following",
    RunState.HOLD: "holding",
    RunState.STOPPING: "stopping",
    RunState.RETURN_TO_STANCE: "returning to its stance",
    RunState.GO_TO_REST: "going to rest",
    RunState.STANDING: "standing, with torque",
    RunState.OFF: "ended",
    RunState.FAULT: "stopped",
}
"""What a robot does in a state of the run."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Cast:
    """Who and what is seen. robot: None for a human alone. joints: n that a plot can show, landmarks (k) of the robot
    and sensors (s) of the performer: names.

    profile: of the robot, where it is known: its soles, observers and servos. obstacles: of the scene.
    servos_measure: snapshots hold temperatures and currents of the servos.
    """

    human: SolidBody
    robot: SolidBody | None = None
    profile: RobotBody | None = None
    joints: tuple[str, ...] = ()
    landmarks: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    obstacles: Sequence[Mesh] = ()
    servos_measure: bool = True

    @cached_property
    def columns(self) -> IntArray:
        """Where a posture of the robot holds `joints`, (n,)."""
        if self.robot is None:
            return np.zeros(0, dtype=np.int64)
        body = self.robot.body
        return body.joint_qpos[[body.joint_index(joint) for joint in self.joints]]


UNKNOWN = np.full(2, np.nan)
"""A point on the floor that is not known."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Row:
    """What a run says of one tick. time: s of following (live: of the run). state: what the robot does, a word; why: of
    a stop, or "".

    goal (nq,): posture of the robot that was sent, empty for a human alone; human (nq,). present (n,): rad, of the
    joints of the cast, NaN: not reported. asked, reached (k, 3) m: its landmarks, NaN: not asked. sensors (s, 3) m: of
    the performer, NaN: not valid. obstacle_poses (o, 7): position, m, and quaternion. modes (o,) of the observers,
    temperature (n,), degrees Celsius, and current (n,), A, of the servos. truth: the numbers of `truth_names` of a
    simulated body. latency: s, from a live frame to goals, of late. None: not known.
    """

    time: float
    human: FloatArray
    state: str = ""
    why: str = ""
    goal: FloatArray = field(default_factory=lambda: np.zeros(0))
    present: FloatArray = field(default_factory=lambda: np.zeros(0))
    asked: FloatArray | None = None
    reached: FloatArray | None = None
    sensors: FloatArray | None = None
    obstacle_poses: FloatArray | None = None
    modes: ModeArray | None = None
    temperature: FloatArray | None = None
    current: FloatArray | None = None
    truth: FloatArray | None = None
    latency: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot(Row):
    """A row, and what is computed of it. robot (nq,): posture of the robot as its servos report it, or as its physics
    has it. sent (n,): rad, as `present`. com (3,) m; zmp, pressure (2,) m: zero-moment point of the goals, and centre
    of pressure of the soles of a simulated robot, NaN where not known.
    """

    robot: FloatArray
    sent: FloatArray
    com: FloatArray
    zmp: FloatArray = field(default_factory=UNKNOWN.copy)
    pressure: FloatArray = field(default_factory=UNKNOWN.copy)

    @property
    def off(self) -> float:
        """Largest distance of a servo from its goal, rad; NaN where no servo reported."""
        gap = np.abs(self.present - self.sent)
        return float(np.nanmax(gap)) if np.isfinite(gap).any() else float("nan")


# The zero-moment point of a motion that is looked at: where the floor would have to push.

WINDOW_S = 0.05
"""The acceleration of the centre of mass is that of a parabola through what it did so long before and after, s: two
rows of a page at 25 Hz."""
MOST_NEAR = 15
"""Rows of a recording that are looked at before and after."""


def zero_moment_point(times: FloatArray, com: FloatArray) -> FloatArray:
    """Where it was, (2,) m on the floor, at time 0, of a centre of mass at com (k, 3) m at times (k,) s, rising.

    As in `standing_balance`, with all mass in one point: p = c - z / (g + z'') c''. NaN where nothing is known before
    or after, and where it falls freely.
    """
    if not times[0] < 0.0 < times[-1]:
        return UNKNOWN
    bend, _, place = np.polyfit(times, com, 2)  # c(t) = bend t^2 + speed t + place
    weight = GRAVITY + 2.0 * bend[2]
    if weight <= 0.0:
        return UNKNOWN
    point: FloatArray = place[:2] - place[2] / weight * 2.0 * bend[:2]
    return point


class Rows(Protocol):
    """Rows of a motion in their order."""

    def __len__(self) -> int: ...

    def __getitem__(self, row: int, /) -> Row: ...


def snapshot_at(rows: Rows, cast: Cast, at: int, *, balanced_at: int | None = None) -> Snapshot:
    """What a row shows. balanced_at: the row whose zero-moment point is shown, where it is another one."""
    row, middle, body = rows[at], at if balanced_at is None else balanced_at, cast.robot or cast.human
    near = [rows[one] for one in range(max(middle - MOST_NEAR, 0), min(middle + MOST_NEAR + 1, len(rows)))]
    near = [one for one in near if abs(one.time - rows[middle].time) <= WINDOW_S]
    com = body.com(np.array([one.human if cast.robot is None else one.goal for one in (*near, row)]))
    zmp = zero_moment_point(np.array([one.time for one in near]) - rows[middle].time, com[:-1])
    there, pressure, reached = row.goal.copy(), UNKNOWN, row.reached
    there[cast.columns] = np.where(np.isfinite(row.present), row.present, there[cast.columns])
    if cast.robot is not None and row.truth is not None and np.isfinite(row.truth[:-2]).all():
        there, pressure = in_truth(cast.robot.body, row.goal, row.truth)
    if reached is None and cast.profile is not None:
        reached = cast.profile.points(row.goal[None], cast.profile.landmark_frames(cast.landmarks))[0]
    computed = {"robot": there, "sent": row.goal[cast.columns], "com": com[-1], "zmp": zmp, "pressure": pressure}
    return Snapshot(**vars(row) | computed | {"reached": reached})


# The obstacles of a scene: all but the floor, which the page has anyway.


def obstacle_meshes(shapes: SceneShapes) -> list[Mesh]:
    """Their meshes, each in its own frame."""
    solid = zip(shapes.names, shapes.kinds, shapes.sizes, strict=True)
    return [shape_mesh(int(kind), size) for name, kind, size in solid if name != FLOOR]


def obstacle_poses(shapes: SceneShapes, poses: ObstaclePoses) -> FloatArray:
    """Where they are, (o, 7): position, m, and quaternion."""
    return np.column_stack([poses.position, poses.quat])[[name != FLOOR for name in shapes.names]]
