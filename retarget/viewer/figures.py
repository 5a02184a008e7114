"""Bodies, points, observers and obstacles in the scene of a page; only what moves is sent again."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from retarget.model.observers import robot_observers
from retarget.model.robot import RobotBody
from retarget.rotations import conjugate, multiply, rotate
from retarget.types import FloatArray
from retarget.viewer.colours import MODES, OBSTACLE, Colour
from retarget.viewer.meshes import shape_mesh
from retarget.viewer.snapshot import Actor, Obstacle, Snapshot

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


class Balls:
    """Points of a snapshot in the scene, each a ball of some radius, m."""

    def __init__(
        self, scene: "viser.SceneApi", name: str, points: Sequence[str], *, radius: float, colour: Colour
    ) -> None:
        self.top = scene.add_frame(f"/{name}", show_axes=False)
        paths = [f"/{name}/{i}_{point.replace('/', '_')}" for i, point in enumerate(points)]
        self.balls = [Movable(scene.add_icosphere(path, radius, color=colour, visible=False)) for path in paths]

    def show(self, place: Place, points: FloatArray | None) -> None:
        """Move them to points (k, 3) m of a world; those that are NaN are hidden. None: not known."""
        for ball, point in zip(self.balls, () if points is None else place.of(points), strict=False):
            ball.move(point)


# Observers on the links of a robot, by what they do, and obstacles.

OBSERVER_OPACITY, OBSTACLE_OPACITY = 0.35, 0.75


class Observing:
    """The observers of a robot that act, in the colour of what they do."""

    def __init__(self, scene: "viser.SceneApi", robot: RobotBody) -> None:
        self.top = scene.add_frame("/observers", show_axes=False)
        self._known, self._body = robot_observers(robot), robot.body.solver_body()
        self.shapes: list[viser.MeshHandle] = []
        for name, kind, size in zip(self._known.names, self._known.kinds, self._known.sizes, strict=True):
            vertices, faces = shape_mesh(int(kind), size)
            self.shapes.append(
                scene.add_mesh_simple(
                    f"/observers/{name.replace('/', '_')}",
                    vertices.astype(np.float32),
                    faces,
                    opacity=OBSERVER_OPACITY,
                    cast_shadow=False,
                    visible=False,
                )
            )
        self._nodes = [Movable(shape) for shape in self.shapes]

    def show(self, snapshot: Snapshot) -> None:
        """Show those that act, where it is known."""
        known, modes = self._known, snapshot.modes
        if modes is None or len(modes) != len(self._nodes):
            modes = np.zeros(len(self._nodes), dtype=np.uint8)
        positions, turns = self._body.forward(np.ascontiguousarray(snapshot.goal))
        at = positions[known.links] + rotate(turns[known.links], known.positions)
        turn = multiply(turns[known.links], known.quats)
        at[modes == 0] = np.nan
        for index, mode in enumerate(modes.tolist()):
            self._nodes[index].move(at[index], turn[index])
            if mode:
                self.shapes[index].color = MODES[min(mode, len(MODES)) - 1]


class SceneFigures:
    """The obstacles of the scene."""

    def __init__(self, scene: "viser.SceneApi", obstacles: Sequence[Obstacle]) -> None:
        self.top = scene.add_frame("/obstacles", show_axes=False)
        self.nodes = [
            Movable(
                scene.add_mesh_simple(
                    f"/obstacles/{one.name.replace('/', '_')}",
                    one.mesh[0].astype(np.float32),
                    one.mesh[1],
                    color=OBSTACLE,
                    opacity=OBSTACLE_OPACITY,
                )
            )
            for one in obstacles
        ]

    def show(self, snapshot: Snapshot) -> None:
        """Move them to where they are, where that is known."""
        if snapshot.obstacle_poses is not None and len(snapshot.obstacle_poses) == len(self.nodes):
            for node, pose in zip(self.nodes, snapshot.obstacle_poses, strict=True):
                node.move(pose[:3], pose[3:])
