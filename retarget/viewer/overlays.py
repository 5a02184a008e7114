"""Over the links of a robot and around it: observers by what they do, and obstacles."""

from typing import TYPE_CHECKING

import numpy as np

from retarget.observers import robot_observers
from retarget.robot_body import RobotBody
from retarget.rotations import multiply, rotate
from retarget.viewer.figure import Movable
from retarget.viewer.moment import Moment, Obstacle
from retarget.viewer.palette import MODES, OBSTACLE
from retarget.viewer.solids import shape_mesh

if TYPE_CHECKING:
    from collections.abc import Sequence

    import viser

__all__ = ["Around", "Observing"]

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

    def show(self, moment: Moment) -> None:
        """Move them with the robot; colour them where it is known what they do."""
        if not self._shapes or not self._shapes[0].visible:
            return
        positions, turns = self._body.forward(np.ascontiguousarray(moment.goal))
        at = positions[self._links] + rotate(turns[self._links], self._at)
        turn = multiply(turns[self._links], self._turn)
        for index, pair in enumerate(self._nodes):
            for node in pair:
                node.move(at[index], turn[index])
        modes = moment.modes
        if modes is None or len(modes) != len(self._modes):
            return
        for index in np.flatnonzero(modes != self._modes).tolist():
            self._shapes[index].color = self._zones[index].color = MODES[min(int(modes[index]), len(MODES) - 1)]
        self._modes = modes.copy()

    def see(self, *, visible: bool) -> None:
        """Show or hide them."""
        for handle in (*self._shapes, *self._zones):
            handle.visible = visible


class Around:
    """What stands and moves around the robot."""

    def __init__(self, scene: "viser.SceneApi", obstacles: "Sequence[Obstacle]") -> None:
        self._handles = [
            scene.add_mesh_simple(
                f"/around/{one.name.replace('/', '_')}",
                one.mesh[0].astype(np.float32),
                one.mesh[1],
                color=OBSTACLE,
                opacity=OBSTACLE_OPACITY,
            )
            for one in obstacles
        ]
        self._nodes = [Movable(handle) for handle in self._handles]

    def show(self, moment: Moment) -> None:
        """Move them to where they are, where that is known."""
        if moment.around is not None and len(moment.around) == len(self._nodes):
            for node, pose in zip(self._nodes, moment.around, strict=True):
                node.move(pose[:3], pose[3:])

    def see(self, *, visible: bool) -> None:
        """Show or hide them."""
        for handle in self._handles:
            handle.visible = visible
