"""What there is to see: what stays the same, and one moment of it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from retarget.body import BodyModel, body_from_file
from retarget.body_file import BodyFile
from retarget.record import ModeArray, Phase
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.viewer.solids import LinkMesh, Mesh, link_meshes

__all__ = ["PHASE_WORDS", "Actor", "Cast", "Moment", "Standing", "Viewed", "actor"]

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
class Standing:
    """An obstacle. position (3,) m and quat (4,) wxyz of its mesh, world."""

    name: str
    mesh: Mesh
    position: FloatArray
    quat: FloatArray


@dataclass(frozen=True, eq=False)
class Cast:
    """Who and what is seen. robot: None for a human alone. joints: n that a plot can show, and landmarks (k): names.

    profile: of the robot, where it is known: its soles, observers and servos. around: shapes that stand in its world.
    """

    title: str
    robot: Actor | None
    human: Actor
    joints: tuple[str, ...]
    landmarks: tuple[str, ...]
    profile: RobotBody | None = None
    around: tuple[Standing, ...] = ()


@dataclass(frozen=True, eq=False)
class Moment:
    """One tick. time: s of following. state: what the robot does, a word; why: of a stop, or "".

    robot, goal (nq,): posture of the robot as its servos say, and as it was told; human (nq,). present, sent (n,): rad,
    of the joints that a plot can show; NaN: no servo said. asked, reached (k, 3) m: landmarks. com (3,) m. modes (o,)
    of the observers, and temperature (s,), degrees Celsius, of the servos, where they are known.
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
    modes: ModeArray | None = None
    temperature: FloatArray | None = None

    @property
    def off(self) -> float:
        """Farthest that a servo is from what it was told, rad; NaN where none said."""
        gap = np.abs(self.present - self.sent)
        return float(np.nanmax(gap)) if np.isfinite(gap).any() else float("nan")


def actor(file: BodyFile) -> Actor:
    """Of a compiled body."""
    body = body_from_file(file)
    positions, _ = body.solver_body().forward(body.qpos0)
    return Actor(body, link_meshes(file.model), max(float(np.ptp(positions[1:, 2])), LEAST_M))


class Viewed(Protocol):
    """A run that can be looked at, whole."""

    cast: Cast
    times: FloatArray
    """Of its T moments, s."""
    notes: tuple[str, ...]
    """What is missing of it."""

    def moment(self, row: int) -> Moment:
        """One of them."""

    def track(self, joint: int) -> tuple[FloatArray, FloatArray]:
        """What a joint was told and where it was, rad (T,) each."""
