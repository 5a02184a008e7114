"""What a page shows: the cast of a run, which stays the same, and snapshots of it, one per tick."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from retarget.model.body import BodyModel, body_from_file
from retarget.model.body_file import BodyFile
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import SceneShapes
from retarget.model.scene_state import ObstaclePoses
from retarget.run.record import Phase
from retarget.run.run_result import in_truth
from retarget.schema.scene import FLOOR
from retarget.types import FloatArray, IntArray, ModeArray, RunState
from retarget.viewer.meshes import Mesh, link_meshes, shape_mesh

PHASE_WORDS = {Phase.APPROACH: "approaching", Phase.FOLLOW: "following", Phase.BRAKE: "stopping"}
"""What a robot does in a tick of that phase."""
STATE_WORDS = {
    RunState.APPROACH: "approaching",
    RunState.FOLLOW: "following",
    RunState.HOLD: "holding",
    RunState.STOPPING: "stopping",
    RunState.RETURN_TO_STANCE: "returning to its stance",
    RunState.GO_TO_REST: "going to rest",
    RunState.OFF: "ended",
    RunState.FAULT: "stopped",
}
"""The same by the state of the run."""
LEAST_M = 0.05
"""Height of a body that has none: something to scale by."""


@dataclass(frozen=True, eq=False)
class Actor:
    """A body that moves. meshes: of its links, by their numbers. height: from its lowest to its highest link as the
    file has it, m."""

    body: BodyModel
    meshes: dict[int, Mesh]
    height: float


@dataclass(frozen=True, eq=False)
class Cast:
    """Who and what is seen. robot: None for a human alone. joints: n that a plot can show, landmarks (k) of the robot
    and sensors (s) of the performer: names.

    profile: of the robot, where it is known: its soles, observers and servos. obstacles: of the scene. simulated: the
    robot has mass, and snapshots hold where it really is. servos_commanded: snapshots hold temperatures and currents of
    the servos. columns (n,): where a posture of the robot holds `joints`.
    """

    robot: Actor | None
    human: Actor
    joints: tuple[str, ...]
    landmarks: tuple[str, ...]
    profile: RobotBody | None = None
    obstacles: dict[str, Mesh] = field(default_factory=dict)
    simulated: bool = False
    sensors: tuple[str, ...] = ()
    servos_commanded: bool = True
    columns: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def com(self, q: FloatArray) -> FloatArray:
        """Centre of mass (T, 3) m of the robot, or of a human alone, in postures (T, nq)."""
        body = (self.robot or self.human).body
        return body.solver_body().centre_of_mass(np.ascontiguousarray(q))


def _no_points() -> FloatArray:
    return np.zeros((0, 3))


@dataclass(frozen=True, eq=False, kw_only=True)
class Row:
    """What a run says of one tick. time: s of following (live: of the run). state: what the robot does, a word; why: of
    a stop, or "".

    goal (nq,): posture of the robot that was sent, empty for a human alone; human (nq,). present (n,): rad, of the
    joints of the cast, NaN: not reported. landmarks (k): names; asked, reached (k, 3) m. sensors (s, 3) m: of the
    performer, NaN: not valid. obstacle_poses (o, 7): position, m, and quaternion. modes (o,) of the observers,
    temperature (n,), degrees Celsius, and current (n,), A, of the servos. truth: the numbers of `truth_names` of a
    simulated body. None, and empty `reached`: not known.
    """

    time: float
    human: FloatArray
    state: str = ""
    why: str = ""
    goal: FloatArray = field(default_factory=lambda: np.zeros(0))
    present: FloatArray = field(default_factory=lambda: np.zeros(0))
    landmarks: tuple[str, ...] = ()
    asked: FloatArray = field(default_factory=_no_points)
    reached: FloatArray = field(default_factory=_no_points)
    sensors: FloatArray | None = None
    obstacle_poses: FloatArray | None = None
    modes: ModeArray | None = None
    temperature: FloatArray | None = None
    current: FloatArray | None = None
    truth: FloatArray | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot(Row):
    """A row, and what is computed of it. robot (nq,): posture of the robot as its servos report it, or as its physics
    has it. sent (n,): rad, as `present`. com (3,) m; zmp, pressure (2,) m: zero-moment point of the goals, and centre
    of pressure of the soles of a simulated robot, NaN or None where not known.
    """

    robot: FloatArray
    sent: FloatArray
    com: FloatArray
    zmp: FloatArray | None = None
    pressure: FloatArray | None = None

    @property
    def off(self) -> float:
        """Largest distance of a servo from its goal, rad; NaN where no servo reported."""
        gap = np.abs(self.present - self.sent)
        return float(np.nanmax(gap)) if np.isfinite(gap).any() else float("nan")


def snapshot_of(row: Row, cast: Cast, *, com: FloatArray, zmp: FloatArray) -> Snapshot:
    """What a row shows. com (3,), zmp (2,): of the motion that it is a part of, m."""
    there, pressure = row.goal.copy(), None
    there[cast.columns] = np.where(np.isfinite(row.present), row.present, there[cast.columns])
    if cast.robot is not None and row.truth is not None and np.isfinite(row.truth[:-2]).all():
        there, pressure = in_truth(cast.robot.body, row.goal, row.truth)
    asked = reached = np.full((len(cast.landmarks), 3), np.nan)
    if row.landmarks:
        named = [cast.landmarks.index(name) for name in row.landmarks]
        asked, reached = asked.copy(), reached.copy()
        asked[named], reached[named] = row.asked, _reached(row, cast)
    computed = {"robot": there, "sent": row.goal[cast.columns], "com": com, "zmp": zmp, "pressure": pressure}
    return Snapshot(**vars(row) | computed | {"asked": asked, "reached": reached})


def _reached(row: Row, cast: Cast) -> FloatArray:
    """Where the goal has the landmarks of a row (k, 3) m."""
    if cast.profile is None or len(row.reached):
        return row.reached
    reached: FloatArray = cast.profile.points(row.goal[None], cast.profile.landmark_frames(row.landmarks))[0]
    return reached


def actor(file: BodyFile) -> Actor:
    """Make the figure of a compiled body."""
    body = body_from_file(file)
    positions, _ = body.solver_body().forward(body.qpos0)
    return Actor(body, link_meshes(file.model), max(float(np.ptp(positions[1:, 2])), LEAST_M))


def drawn(shapes: SceneShapes) -> list[int]:
    """Numbers of the obstacles that are drawn: all but the floor, which the page has anyway."""
    return [row for row, name in enumerate(shapes.names) if name != FLOOR]


def obstacles(shapes: SceneShapes) -> dict[str, Mesh]:
    """Meshes of a scene, each in its own frame: of those that are `drawn`, by name."""
    return {shapes.names[row]: shape_mesh(int(shapes.kinds[row]), shapes.sizes[row]) for row in drawn(shapes)}


def placed(poses: ObstaclePoses) -> FloatArray:
    """Poses (o, 7) of obstacles: position m, orientation wxyz."""
    return np.column_stack([poses.position, poses.quat])


# The zero-moment point of a motion that is looked at: where the floor would have to push.

GRAVITY = 9.81  # [m/s^2]
SPACING_S = 0.04
"""Time, s, between the three looks at the centre of mass of which its acceleration is made: a mean over twice that."""
LONGEST_S = 0.2
"""Looks that are farther apart give no acceleration."""


def zero_moment_point(times: FloatArray, com: FloatArray) -> FloatArray:
    """Zero-moment point (2,) m on the floor at the second of three times (3,) s, of a centre of mass at com (3, 3) m.

    As in `standing_balance`, with all mass in one point: p = c - z / (g + z'') c''. NaN where times are not apart, or
    too far, and where it falls freely.
    """
    before, after = np.diff(times)
    if not (0.0 < before <= LONGEST_S and 0.0 < after <= LONGEST_S):
        return np.full(2, np.nan)
    change = (com[2] - com[1]) / after - (com[1] - com[0]) / before
    acceleration = 2.0 * change / (before + after)
    weight = GRAVITY + acceleration[2]
    if weight <= 0.0:
        return np.full(2, np.nan)
    point: FloatArray = com[1, :2] - com[1, 2] / weight * acceleration[:2]
    return point


def rows_around(times: FloatArray, row: int) -> tuple[int, int, int]:
    """The row of times (T,) s, with one about SPACING_S before and one as long after it; NaN comes of those that are
    not there."""
    before, after = np.searchsorted(times, times[row] + np.array([-SPACING_S, SPACING_S]) - 1e-6)
    last = len(times) - 1
    return max(min(int(before), row - 1), 0), row, min(max(int(after), row + 1), last)


class Rows(Protocol):
    """Rows of a motion, in their order."""

    def __len__(self) -> int: ...

    def __getitem__(self, row: int, /) -> Row: ...


def snapshot_at(rows: Rows, times: FloatArray, at: int, looked: int, cast: Cast) -> Snapshot:
    """What a row of a motion shows. times (T,) s: of its rows; looked: the row whose zero-moment point is shown."""
    near = [*rows_around(times, looked), at]
    com = cast.com(np.array([rows[i].human if cast.robot is None else rows[i].goal for i in near]))
    return snapshot_of(rows[at], cast, com=com[3], zmp=zero_moment_point(times[near[:3]], com[:3]))
