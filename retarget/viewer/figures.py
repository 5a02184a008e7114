"""Bodies, points, observers and obstacles in the scene of a page; only what moves is sent again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from retarget.model.observers import robot_observers
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import ShapeKind
from retarget.rotations import multiply, rotate
from retarget.types import FloatArray
from retarget.viewer.colours import MODES, Colour
from retarget.viewer.meshes import Mesh, shape_mesh
from retarget.viewer.snapshot import Actor, Snapshot

if TYPE_CHECKING:
    import viser


STEP_M, STEP_RAD = 2e-5, 1e-4
"""Least motion, m and rad, that is sent: less is not seen."""


@dataclass(frozen=True, eq=False)
class Place:
    """Pose of the world of a body in the scene: `scale` times as large, its point `origin` at `to` (3,) m, turned."""

    scale: float = 1.0
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    turn: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    to: FloatArray = field(default_factory=lambda: np.zeros(3))

    def of(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) m, in the scene."""
        return self.to + self.scale * rotate(self.turn, points - self.origin)


HERE = Place()


class Movable:
    """A node of the scene that may have moved, and is hidden while its place is not known."""

    def __init__(self, handle: "viser.SceneNodeHandle") -> None:
        self.handle = handle
        self._position, self._turn = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])

    def move(self, position: FloatArray, turn: FloatArray | None = None) -> None:
        """Put it at position (3,) m (NaN: not known), turned by a quaternion (4,), if that is anywhere else."""
        self.handle.visible = bool(np.isfinite(position).all())
        if np.abs(position - self._position).max() > STEP_M:
            self._position = position.copy()
            self.handle.position = tuple(position.tolist())
        if turn is not None and np.abs(turn - self._turn).max() > 0.5 * STEP_RAD:
            self._turn = turn.copy()
            self.handle.wxyz = tuple(turn.tolist())


UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion wxyz of no rotation."""


class Shapes:
    """Shapes in the scene, each hidden until it is known where it is. top: of which all hang; handles: one for each."""

    def __init__(
        self,
        scene: "viser.SceneApi",
        name: str,
        meshes: Mapping[str, Mesh],
        *,
        colour: Colour,
        opacity: float | None = None,
        shadow: bool = False,
    ) -> None:
        self.top = scene.add_frame(f"/{name}", show_axes=False)
        self.handles = [
            scene.add_mesh_simple(
                f"/{name}/{number}_{own.replace('/', '_')}",
                vertices.astype(np.float32),
                faces,
                color=colour,
                opacity=opacity,
                cast_shadow=shadow,
                visible=False,
            )
            for number, (own, (vertices, faces)) in enumerate(meshes.items())
        ]
        self._nodes = [Movable(handle) for handle in self.handles]

    def show(self, points: FloatArray | None, turns: FloatArray | None = None) -> None:
        """Move them to points (k, 3) m, turned by quaternions (k, 4), else not turned; None: not known. Those that are
        NaN are hidden."""
        if points is not None and len(points) == len(self._nodes):
            for index, node in enumerate(self._nodes):
                node.move(points[index], UNTURNED if turns is None else turns[index])


class Figure:
    """The links of a body, `scale` times as large. handles: of their meshes, by link."""

    def __init__(
        self,
        scene: "viser.SceneApi",
        name: str,
        actor: Actor,
        *,
        colour: Colour,
        opacity: float | None = None,
        scale: float = 1.0,
        shrunk: float = 1.0,
    ) -> None:
        """shrunk: every link by this about its middle, so that it is inside of one that is where it is; then it casts
        no shadow."""
        self._body, self._links = actor.body.solver_body(), list(actor.meshes)
        meshes: dict[str, Mesh] = {}
        for link, (vertices, faces) in actor.meshes.items():
            middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
            meshes[actor.body.body_names[link]] = (scale * (middle + shrunk * (vertices - middle)), faces)
        self._shapes = Shapes(scene, name, meshes, colour=colour, opacity=opacity, shadow=shrunk == 1.0)
        self.top, self.handles = self._shapes.top, dict(zip(self._links, self._shapes.handles, strict=True))

    def place(self, q: FloatArray, at: Place = HERE) -> None:
        """Show the figure in posture q (nq,), m, wxyz and rad, in the scene."""
        positions, turns = self._body.forward(np.ascontiguousarray(q))
        self._shapes.show(at.of(positions[self._links]), multiply(at.turn, turns[self._links]))


def balls(names: Sequence[str], radius: float) -> dict[str, Mesh]:
    """A ball of some radius, m, for each point."""
    return dict.fromkeys(names, shape_mesh(ShapeKind.CAPSULE, (radius, 0.0, 0.0)))


OBSERVER_OPACITY, OBSTACLE_OPACITY = 0.35, 0.75
"""From 0 to 1: the body is seen through its observers, and the robot through a table."""


class Observing:
    """The observers of a robot that act, on its links, in the colour of what they do."""

    def __init__(self, scene: "viser.SceneApi", robot: RobotBody) -> None:
        known = self._known = robot_observers(robot)
        self._body = robot.body.solver_body()
        kinds = zip(known.names, known.kinds.tolist(), known.sizes, strict=True)
        meshes = {name: shape_mesh(kind, size) for name, kind, size in kinds}
        self._shapes = Shapes(scene, "observers", meshes, colour=MODES[0], opacity=OBSERVER_OPACITY)
        self.top = self._shapes.top

    def show(self, snapshot: Snapshot) -> None:
        """Show those that act, where it is known."""
        known, modes = self._known, snapshot.modes
        if modes is None or len(modes) != len(known.names):
            modes = np.zeros(len(known.names), dtype=np.uint8)
        positions, turns = self._body.forward(np.ascontiguousarray(snapshot.goal))
        at = positions[known.links] + rotate(turns[known.links], known.positions)
        at[modes == 0] = np.nan
        self._shapes.show(at, multiply(turns[known.links], known.quats))
        for index in np.flatnonzero(modes):
            self._shapes.handles[index].color = MODES[min(int(modes[index]), len(MODES)) - 1]
