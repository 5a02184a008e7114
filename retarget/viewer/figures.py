"""Bodies, points, observers and obstacles in the scene of a page; only what moves is sent again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from retarget.model.observers import robot_observers
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import ShapeKind
from retarget.rotations import conjugate, multiply, rotate
from retarget.types import FloatArray
from retarget.viewer.colours import MODES, Colour
from retarget.viewer.meshes import Mesh, shape_mesh
from retarget.viewer.snapshot import Actor, Snapshot

if TYPE_CHECKING:
    import viser


STEP_M, STEP_RAD = 2e-5, 1e-4
"""What moves less is not sent."""


@dataclass(frozen=True, eq=False)
class Place:
    """Where the world of a body is in the scene: `scale` times as large, its point `origin` at `to` (3,) m, turned."""

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


class Figure:
    """A body, `scale` times as large. top: its frame, of which all else hangs; meshes: handles by link."""

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
        self._body = actor.body.solver_body()
        self._parent = np.asarray(actor.body.parent)
        self.top = scene.add_frame(f"/{name}", show_axes=False)
        self.meshes: list[tuple[int, viser.MeshHandle]] = []
        meshes, paths = {mesh.link: mesh for mesh in actor.meshes}, [f"/{name}"]
        self._links: list[Movable] = []
        for link in range(1, len(self._parent)):
            # The number keeps links apart whose names a path cannot hold.
            own = actor.body.body_names[link].replace("/", "_")
            paths.append(f"{paths[self._parent[link]]}/{link}_{own}")
            mesh = meshes.get(link)
            if mesh is None:
                self._links.append(Movable(scene.add_frame(paths[-1], show_axes=False)))
                continue
            middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
            vertices = (scale * (middle + shrunk * (mesh.vertices - middle))).astype(np.float32)
            shown = scene.add_mesh_simple(
                paths[-1], vertices, mesh.faces, color=colour, opacity=opacity, cast_shadow=shrunk == 1.0
            )
            self.meshes.append((link, shown))
            self._links.append(Movable(shown))

    def place(self, q: FloatArray, at: Place = HERE) -> None:
        """Pose it in posture q (nq,), in the scene."""
        positions, turns = self._body.forward(np.ascontiguousarray(q))
        positions, turns = at.of(positions), multiply(at.turn, turns)
        positions[0], turns[0] = 0.0, (1.0, 0.0, 0.0, 0.0)  # the scene, in which the first link is
        before = conjugate(turns[self._parent])
        offsets, own = rotate(before, positions - positions[self._parent]), multiply(before, turns)
        for link, node in enumerate(self._links, start=1):
            node.move(offsets[link], own[link])


UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


class Shapes:
    """Shapes in the scene, each hidden until it is known where it is. top: of which all hang; nodes: one for each."""

    def __init__(
        self,
        scene: "viser.SceneApi",
        name: str,
        meshes: Mapping[str, Mesh],
        *,
        colour: Colour,
        opacity: float | None = None,
    ) -> None:
        self.top = scene.add_frame(f"/{name}", show_axes=False)
        self.handles = [
            scene.add_mesh_simple(
                f"/{name}/{number}_{own.replace('/', '_')}",
                vertices.astype(np.float32),
                faces,
                color=colour,
                opacity=opacity,
                cast_shadow=False,
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


def balls(names: Sequence[str], radius: float) -> dict[str, Mesh]:
    """A ball of some radius, m, for each point."""
    return dict.fromkeys(names, shape_mesh(ShapeKind.CAPSULE, (radius, 0.0, 0.0)))


OBSERVER_OPACITY, OBSTACLE_OPACITY = 0.35, 0.75


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
