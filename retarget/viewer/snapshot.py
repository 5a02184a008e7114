"""What a page shows: the cast of a run, which stays the same, and snapshots of it, one per tick."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from retarget.model.body import BodyModel, body_from_file
from retarget.model.body_file import BodyFile
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import SceneShapes
from retarget.model.scene_state import ObstaclePoses
from retarget.run.record import Phase
from retarget.schema.scene import FLOOR
from retarget.types import FloatArray, ModeArray
from retarget.viewer.meshes import LinkMesh, Mesh, link_meshes, shape_mesh

PHASE_WORDS = {Phase.APPROACH: "approaching", Phase.FOLLOW: "following", Phase.BRAKE: "stopping"}
"""What a robot does in a tick of that phase."""
LEAST_M = 0.05
"""Height of a body that has none: something to scale by."""


@dataclass(frozen=True, eq=False)
class Actor:
    """A body that moves. meshes: of its links. height: from its lowest to its highest link as the file has it, m."""

    body: BodyModel
    meshes: tuple[LinkMesh, ...]
    height: float


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Of a scene: its mesh, in its own frame."""

    name: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Cast:
    """Who and what is seen. robot: None for a human alone. joints: n that a plot can show, landmarks (k) of the robot
    and sensors (s) of the performer: names.

    profile: of the robot, where it is known: its soles, observers and servos. obstacles: of the scene. simulated: the
    robot has mass, and snapshots hold where it really is. servos_commanded: snapshots hold temperatures and currents of
    the servos.
    """

    title: str
    robot: Actor | None
    human: Actor
    joints: tuple[str, ...]
    landmarks: tuple[str, ...]
    profile: RobotBody | None = None
    obstacles: tuple[Obstacle, ...] = ()
    simulated: bool = False
    sensors: tuple[str, ...] = ()
    servos_commanded: bool = True


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One tick. time: s of following. state: what the robot does, a word; why: of a stop, or "".

    robot, goal (nq,): posture of the robot as its servos report it, or as its physics has it, and as it was sent; human
    (nq,). present, sent (n,): rad, of the joints that a plot can show; NaN: not reported. asked, reached (k, 3) m:
    landmarks. com (3,) m; zmp, pressure (2,) m: zero-moment point of the goals, and centre of pressure of the soles of
    a simulated robot, NaN where not known. sensors (s, 3) m: of the performer, NaN: not valid. obstacle_poses
    (o, 7): position, m, and quaternion. modes (o,) of the observers, temperature (s,), degrees Celsius, and
    current (s,), A, of the servos. None: not known.
    """

    time: float
    state: str
    robot: FloatArray
    goal: FloatArray
    human: FloatArray
    present: FloatArray
    sent: FloatArray
    asked: FloatArray
    reached: FloatArray
    com: FloatArray
    why: str = ""
    zmp: FloatArray | None = None
    pressure: FloatArray | None = None
    sensors: FloatArray | None = None
    obstacle_poses: FloatArray | None = None
    modes: ModeArray | None = None
    temperature: FloatArray | None = None
    current: FloatArray | None = None

    @property
    def off(self) -> float:
        """Largest distance of a servo from its goal, rad; NaN where no servo reported."""
        gap = np.abs(self.present - self.sent)
        return float(np.nanmax(gap)) if np.isfinite(gap).any() else float("nan")


@dataclass(frozen=True, eq=False)
class Tracks:
    """One joint over T snapshots, for a plot: time (T,) s; sent, present (T,) rad; temperature (T,) degrees Celsius and
    current (T,) A of its servo, NaN where not known."""

    time: FloatArray
    sent: FloatArray
    present: FloatArray
    temperature: FloatArray
    current: FloatArray


def actor(file: BodyFile) -> Actor:
    """Of a compiled body."""
    body = body_from_file(file)
    positions, _ = body.solver_body().forward(body.qpos0)
    return Actor(body, link_meshes(file.model), max(float(np.ptp(positions[1:, 2])), LEAST_M))


def drawn(shapes: SceneShapes) -> list[int]:
    """Numbers of the obstacles that are drawn: all but the floor, which the page has anyway."""
    return [row for row, name in enumerate(shapes.names) if name != FLOOR]


def obstacles(shapes: SceneShapes) -> tuple[Obstacle, ...]:
    """Of a scene, those that are `drawn`."""
    return tuple(
        Obstacle(shapes.names[row], shape_mesh(int(shapes.kinds[row]), shapes.sizes[row])) for row in drawn(shapes)
    )


def placed(poses: ObstaclePoses) -> FloatArray:
    """Where obstacles are, (o, 7)."""
    return np.column_stack([poses.position, poses.quat])


class Viewed(Protocol):
    """A run that can be looked at, whole."""

    cast: Cast
    times: FloatArray
    """Of its T snapshots, s."""
    notes: tuple[str, ...]
    """What is missing of it."""

    def snapshot(self, row: int) -> Snapshot:
        """The snapshot of a row."""

    def track(self, joint: int) -> Tracks:
        """A joint over all snapshots."""
