"""Bodies, observers and obstacles in the scene of a page; only what moves is sent again."""

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
    from collections.abc import Sequence

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
    """A node of the scene that may have moved, and is hidden while nobody wants to see it or its place is not known."""

    def __init__(self, handle: "viser.SceneNodeHandle") -> None:
        self.handle = handle
        self._position, self._turn = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self._seen = self._known = True

    def move(self, position: FloatArray, turn: FloatArray | None = None) -> None:
        """Put it at position (3,) m, turned by a quaternion (4,), if that is anywhere else."""
        if np.abs(position - self._position).max() > STEP_M:
            self._position = position.copy()
            self.handle.position = tuple(position.tolist())
        if turn is not None and np.abs(turn - self._turn).max() > 0.5 * STEP_RAD:
            self._turn = turn.copy()
            self.handle.wxyz = tuple(turn.tolist())

    def put(self, point: FloatArray) -> None:
        """Put it at a point (3,) m; NaN: not known."""
        self._known = bool(np.isfinite(point).all())
        self._update()
        if self.handle.visible:
            self.move(point)

    def see(self, *, visible: bool) -> None:
        """Show or hide it."""
        self._seen = visible
        self._update()

    def _update(self) -> None:
        if self.handle.visible != (self._seen and self._known):
            self.handle.visible = self._seen and self._known


class Figure:
    """A body, `scale` times as large. meshes: handles by link."""

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
        self._body, self._opacity = actor.body.solver_body(), opacity
        self._parent = np.asarray(actor.body.parent)
        self._top = scene.add_frame(f"/{name}", show_axes=False)
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

    def see(self, *, visible: bool) -> None:
        """Show or hide it."""
        self._top.visible = visible

    def see_through(self, opacity: float | None) -> None:
        """Let what is inside be seen; None: no more."""
        for _, handle in self.meshes:
            handle.opacity = self._opacity if opacity is None else opacity

    def place(self, q: FloatArray, at: Place = HERE) -> None:
        """Pose it in posture q (nq,), in the scene; nothing, while it is hidden."""
        if not self._top.visible:
            return
        positions, turns = self._body.forward(np.ascontiguousarray(q))
        positions, turns = at.of(positions), multiply(at.turn, turns)
        positions[0], turns[0] = 0.0, (1.0, 0.0, 0.0, 0.0)  # the scene, in which the first link is
        before = conjugate(turns[self._parent])
        offsets, own = rotate(before, positions - positions[self._parent]), multiply(before, turns)
        for link, node in enumerate(self._links, start=1):
            node.move(offsets[link], own[link])


# Observers on the links of a robot, by what they do, and obstacles.

SHAPE_OPACITY, ZONE_OPACITY, OBSTACLE_OPACITY = 0.35, 0.08, 0.75


class Observing:
    """Observers of a robot, in the colour of what they do, each in its zone of influence."""

    def __init__(self, scene: "viser.SceneApi", robot: RobotBody) -> None:
        known = robot_observers(robot)
        self._body, self._links = robot.body.solver_body(), known.links
        self._at, self._turn = known.positions, known.quats
        self._modes = np.zeros(len(known.names), dtype=np.uint8)
        self._shapes: list[viser.MeshHandle] = []
        self._zones: list[viser.MeshHandle] = []
        for name, kind, size, influence in zip(known.names, known.kinds, known.sizes, known.influence, strict=True):
            for kept, part, more, opacity in (
                (self._shapes, "shape", 0.0, SHAPE_OPACITY),
                (self._zones, "zone", float(influence), ZONE_OPACITY),
            ):
                vertices, faces = shape_mesh(int(kind), size, more=more)
                place = f"/observers/{name.replace('/', '_')}/{part}"
                kept.append(
                    scene.add_mesh_simple(
                        place, vertices.astype(np.float32), faces, color=MODES[0], opacity=opacity, cast_shadow=False
                    )
                )
        self._nodes = [(Movable(shape), Movable(zone)) for shape, zone in zip(self._shapes, self._zones, strict=True)]

    def show(self, snapshot: Snapshot) -> None:
        """Move them with the robot; colour them where it is known what they do."""
        if not self._shapes or not self._shapes[0].visible:
            return
        positions, turns = self._body.forward(np.ascontiguousarray(snapshot.goal))
        at = positions[self._links] + rotate(turns[self._links], self._at)
        turn = multiply(turns[self._links], self._turn)
        for index, pair in enumerate(self._nodes):
            for node in pair:
                node.move(at[index], turn[index])
        modes = snapshot.modes
        if modes is None or len(modes) != len(self._modes):
            return
        for index in np.flatnonzero(modes != self._modes).tolist():
            self._shapes[index].color = self._zones[index].color = MODES[min(int(modes[index]), len(MODES) - 1)]
        self._modes = modes.copy()

    def see(self, *, visible: bool) -> None:
        """Show or hide them."""
        for handle in (*self._shapes, *self._zones):
            handle.visible = visible


class SceneFigures:
    """The obstacles of the scene."""

    def __init__(self, scene: "viser.SceneApi", obstacles: "Sequence[Obstacle]") -> None:
        self._handles = [
            scene.add_mesh_simple(
                f"/obstacles/{one.name.replace('/', '_')}",
                one.mesh[0].astype(np.float32),
                one.mesh[1],
                color=OBSTACLE,
                opacity=OBSTACLE_OPACITY,
            )
            for one in obstacles
        ]
        self._nodes = [Movable(handle) for handle in self._handles]

    def show(self, snapshot: Snapshot) -> None:
        """Move them to where they are, where that is known."""
        if snapshot.obstacle_poses is not None and len(snapshot.obstacle_poses) == len(self._nodes):
            for node, pose in zip(self._nodes, snapshot.obstacle_poses, strict=True):
                node.move(pose[:3], pose[3:])

    def see(self, *, visible: bool) -> None:
        """Show or hide them."""
        for handle in self._handles:
            handle.visible = visible
