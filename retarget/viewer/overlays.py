"""Over the links of a robot: observers by what they do, the support polygon, warm servos; and what stands around it."""

from typing import TYPE_CHECKING

import numpy as np

from retarget.observers import robot_observers
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray, multiply, rotate
from retarget.stance import plant
from retarget.support import convex_hull
from retarget.viewer.moment import Moment, Standing
from retarget.viewer.solids import shape_mesh

if TYPE_CHECKING:
    from collections.abc import Sequence

    import viser

__all__ = ["Around", "Observing", "Soles", "Warmth"]

Colour = tuple[int, int, int]

MODES: tuple[Colour, ...] = ((120, 170, 130), (242, 158, 46), (214, 64, 69))
"""Free, preventive, reactive."""
SHAPE_OPACITY, ZONE_OPACITY = 0.35, 0.08
SUPPORT: Colour = (126, 87, 194)
OBSTACLE: Colour = (150, 140, 128)
SUPPORT_M = 0.003
"""Width of the line round the support polygon, and its height over the floor."""
HOT: Colour = (214, 40, 40)
COLD_C = 30.0
"""Servos warmer than this begin to turn red; at the limit of the profile they are."""
SHADES = 12
"""Steps of colour: a shade that stays is not sent again."""


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
            for kept, more, opacity in ((self._shapes, 0.0, SHAPE_OPACITY), (self._zones, influence, ZONE_OPACITY)):
                vertices, faces = shape_mesh(int(kind), size, more=float(more))
                place = f"/observers/{name}/{'zone' if more else 'shape'}"
                kept.append(
                    scene.add_mesh_simple(
                        place, vertices.astype(np.float32), faces, color=MODES[0], opacity=opacity, cast_shadow=False
                    )
                )

    def show(self, moment: Moment) -> None:
        """Move them with the robot; colour them where it is known what they do."""
        if not self._shapes or not self._shapes[0].visible:
            return
        positions, turns = self._body.forward(np.ascontiguousarray(moment.goal))
        at = positions[self._links] + rotate(turns[self._links], self._at)
        turn = multiply(turns[self._links], self._turn)
        for index, pair in enumerate(zip(self._shapes, self._zones, strict=True)):
            for handle in pair:
                handle.position, handle.wxyz = tuple(at[index].tolist()), tuple(turn[index].tolist())
        modes = moment.modes
        if modes is None or len(modes) != len(self._modes):
            return
        for index in np.flatnonzero(modes != self._modes).tolist():
            self._shapes[index].color = self._zones[index].color = MODES[min(int(modes[index]), 2)]
        self._modes = modes.copy()

    def see(self, *, visible: bool) -> None:
        """Show or hide them."""
        for handle in (*self._shapes, *self._zones):
            handle.visible = visible


class Soles:
    """The hull of the soles on the floor."""

    def __init__(self, scene: "viser.SceneApi", robot: RobotBody) -> None:
        soles = plant(robot, robot.profile.postures.stand).soles
        self._body = robot.body.solver_body()
        self._links = [sole.frame.body for sole in soles for _ in sole.corners]
        self._corners = np.concatenate([sole.corners for sole in soles])
        self._lines = scene.add_line_segments(
            "/soles", np.zeros((1, 2, 3), dtype=np.float32), np.array(SUPPORT, dtype=np.uint8), thickness=SUPPORT_M
        )

    def show(self, moment: Moment) -> None:
        """Draw it anew."""
        if self._lines.visible:
            points = self._body.points(np.ascontiguousarray(moment.goal)[None], self._links, self._corners)[0]
            self._lines.points = _ring(points)

    def see(self, *, visible: bool) -> None:
        """Show or hide it."""
        self._lines.visible = visible


def _ring(points: FloatArray) -> "np.ndarray[tuple[int, int, int], np.dtype[np.float32]]":
    """Segments (h, 2, 3) m round the hull of points (n, 3), on the floor."""
    corners = convex_hull(points[:, :2])
    corners = np.column_stack([corners, np.full(len(corners), SUPPORT_M)])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)


class Warmth:
    """Colours links by the servo that turns them."""

    def __init__(self, robot: RobotBody, meshes: "Sequence[tuple[int, viser.MeshHandle]]", *, colour: Colour) -> None:
        limit = robot.profile.safety.temperature_c
        self._cold, self._span = np.array(colour, dtype=float), max(limit - COLD_C, 1.0)
        by_link = dict(meshes)
        body = robot.body
        self._handles = [by_link.get(int(body.joint_body[body.joint_index(j)])) for j in robot.joint_map.joints]
        self._shades = np.zeros(len(self._handles), dtype=int)
        self._visible = True

    def show(self, moment: Moment) -> None:
        """Where temperatures are known."""
        if moment.temperature is None or len(moment.temperature) != len(self._handles):
            return
        share = np.nan_to_num(np.clip((moment.temperature - COLD_C) / self._span, 0.0, 1.0))
        shades = np.round(share * SHADES).astype(int) if self._visible else np.zeros_like(self._shades)
        for index in np.flatnonzero(shades != self._shades):
            handle = self._handles[index]
            if handle is not None:
                mixed = self._cold + (np.array(HOT) - self._cold) * shades[index] / SHADES
                red, green, blue = mixed.astype(int).tolist()
                handle.color = (red, green, blue)
        self._shades = shades

    def see(self, *, visible: bool) -> None:
        """Colour them or not, from the next moment on."""
        self._visible = visible


class Around:
    """What stands around the robot."""

    def __init__(self, scene: "viser.SceneApi", standing: "Sequence[Standing]") -> None:
        self._handles = [
            scene.add_mesh_simple(
                f"/around/{one.name}",
                one.mesh[0].astype(np.float32),
                one.mesh[1],
                color=OBSTACLE,
                opacity=0.6,
                position=tuple(one.position.tolist()),
                wxyz=tuple(one.quat.tolist()),
            )
            for one in standing
        ]

    def show(self, moment: Moment) -> None:
        """They stay where they are."""

    def see(self, *, visible: bool) -> None:
        """Show or hide them."""
        for handle in self._handles:
            handle.visible = visible
