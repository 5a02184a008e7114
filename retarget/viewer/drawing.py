"""A snapshot of a run as shapes in the scene of the page: bodies, points, observers, obstacles and balance.

Viser sends to browsers only what has changed.
"""

import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from retarget.ik.support_polygon import convex_hull, plant, support_distance, support_edges
from retarget.model.meshes import Mesh, SolidBody, shape_mesh
from retarget.model.observers import robot_observers
from retarget.model.robot import RobotBody
from retarget.model.scene_shapes import ShapeKind
from retarget.rotations import multiply, rotate
from retarget.types import FloatArray
from retarget.viewer.colours import (
    ASKED,
    BALANCE,
    GOAL,
    HUMAN,
    LEGEND,
    MODES,
    OBSTACLE,
    OUTSIDE,
    PRESSURE,
    REACHED,
    ROBOT,
    SENSOR,
    SOLES,
    ZMP,
    Keys,
    heat,
    heat_keys,
)
from retarget.viewer.snapshot import Cast, Snapshot

if TYPE_CHECKING:
    import viser

Part = tuple["viser.SceneNodeHandle", Callable[[Snapshot], object]]
"""What can be hidden: the node on which all of it hangs, and what moves it to where it is in a snapshot."""


def move(node: "viser.SceneNodeHandle", position: FloatArray, turn: FloatArray | None = None) -> None:
    """Put a node at position (3,) m, turned by a quaternion (4,), else not turned; hide it while its place is NaN."""
    node.visible = bool(np.isfinite(position).all())
    if node.visible:
        node.position = position
        if turn is not None:
            node.wxyz = turn


class Shapes:
    """Shapes in the scene, each hidden until it is known where it is, in a world that is shown `scale` times as large.
    top: of which all hang; handles: one for each, named by its number. look: of `add_mesh_simple`."""

    def __init__(
        self, scene: "viser.SceneApi", name: str, meshes: Sequence[Mesh], *, scale: float = 1.0, **look: Any
    ) -> None:
        self.top, self._scale = scene.add_frame(name, show_axes=False), scale
        self.handles = [
            scene.add_mesh_simple(f"{name}/{number}", mesh.vertices, mesh.faces, scale=scale, visible=False, **look)
            for number, mesh in enumerate(meshes)
        ]

    def show(self, points: FloatArray | None, turns: FloatArray | None = None) -> None:
        """Move them to points (k, 3) m, turned by quaternions (k, 4), else not turned; None: not known. Those that are
        NaN are hidden."""
        if points is not None and len(points) == len(self.handles):
            for index, handle in enumerate(self.handles):
                move(handle, self._scale * points[index], None if turns is None else turns[index])

    def show_poses(self, poses: FloatArray) -> None:
        """Move them to poses (k, 7): position, m, and quaternion."""
        self.show(poses[:, :3], poses[:, 3:])


# The robot and its goal.

GOAL_OPACITY, GOAL_SIZE = 0.55, 0.94
"""A goal is seen where the robot is not: each link is smaller about its middle, and so inside of the robot's."""


def _add_robot(scene: "viser.SceneApi", cast: Cast, solid: SolidBody) -> dict[str, Part]:
    """The robot, its limbs in the colour of their servos' heat, and its goal."""
    robot = Shapes(scene, "/robot", solid.meshes, color=ROBOT)
    smaller = []
    for mesh in solid.meshes:
        middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
        smaller.append(Mesh(middle + GOAL_SIZE * (mesh.vertices - middle), mesh.faces))
    goal = Shapes(scene, "/goal", smaller, color=GOAL, opacity=GOAL_OPACITY, cast_shadow=False)
    limbs: list[viser.MeshHandle | None] = []
    if cast.profile is not None:
        body, handles = cast.profile.body, dict(zip(solid.links.tolist(), robot.handles, strict=True))
        limbs = [handles.get(int(body.joint_body[body.joint_index(joint)])) for joint in cast.joints]

    def show_robot(seen: Snapshot) -> None:
        robot.show_poses(solid.poses(seen.robot[None])[0])
        if cast.profile is None or "temperature" not in seen:
            return
        for limb, temperature in zip(limbs, seen.temperature.tolist(), strict=True):
            if limb is not None:
                limb.color = heat(temperature, cast.profile.profile.safety.temperature_c)

    def show_goal(seen: Snapshot) -> None:
        goal.show_poses(solid.poses(seen.q[None])[0])

    return {"robot": (robot.top, show_robot), "goal": (goal.top, show_goal)}


# The performer with its sensors, and what was asked and reached of the landmarks.

HUMAN_OPACITY = 0.65
"""Sensors are inside of the performer."""
BALL, SENSOR_BALL = 0.0145, 0.0205
"""Radius of a landmark and of a sensor, as a share of the height of the robot: a sensor is thicker than a wrist."""


def _add_performer(scene: "viser.SceneApi", cast: Cast, height: float) -> dict[str, Part]:
    scale = height / cast.human.height
    human = Shapes(scene, "/performer/body", cast.human.meshes, scale=scale, color=HUMAN, opacity=HUMAN_OPACITY)

    def show_human(seen: Snapshot) -> None:
        human.show_poses(cast.human.poses(seen.human_q[None])[0])

    parts: dict[str, Part] = {"performer": (human.top, show_human)}
    if cast.sensors:
        balls = [_ball(SENSOR_BALL * cast.human.height)] * len(cast.sensors)
        worn = Shapes(scene, "/performer/sensors", balls, scale=scale, color=SENSOR, cast_shadow=False)
        parts["sensors"] = worn.top, lambda seen: worn.show(seen.sensors)
    if cast.landmarks:
        balls = [_ball(BALL * height)] * len(cast.landmarks)
        asked = Shapes(scene, "/asked", balls, color=ASKED, cast_shadow=False)
        reached = Shapes(scene, "/reached", balls, color=REACHED, cast_shadow=False)
        parts["asked"] = asked.top, lambda seen: asked.show(seen.landmarks_asked)
        parts["reached"] = reached.top, lambda seen: reached.show(seen.landmarks_reached)
    return parts


def _ball(radius: float) -> Mesh:
    return shape_mesh(ShapeKind.CAPSULE, (radius, 0.0, 0.0))


# Balance on the floor, observers and obstacles.

LINE_M = 0.003
"""Width of the line round the support polygon, and its height over the floor."""
EDGE_M = 0.0005
"""A point on the edge is not outside."""
CENTRE, DISC, POINT, PRESSED = 0.018, 0.023, 0.0175, 0.0105
"""Radii, as shares of the robot's height."""
OBSERVER_OPACITY, OBSTACLE_OPACITY = 0.35, 0.75
"""What is inside an observer is seen through it; an obstacle is more solid."""


def _add_ground(scene: "viser.SceneApi", cast: Cast, height: float) -> dict[str, Part]:
    robot = cast.profile
    name = "/performer/balance" if cast.robot is None else "/balance"
    parts = {"balance": _balance(scene, name, robot if robot is not None and robot.stands else None, height)}
    if robot is not None:
        parts["observers"] = _observers(scene, robot)
    if cast.obstacles:
        look: dict[str, Any] = {"color": OBSTACLE, "opacity": OBSTACLE_OPACITY, "cast_shadow": False}
        shapes = Shapes(scene, "/obstacles", cast.obstacles, **look)

        def show_obstacles(seen: Snapshot) -> None:
            if "obstacles" in seen:
                shapes.show_poses(seen.obstacles)

        parts["obstacles"] = shapes.top, show_obstacles
    return parts


def _balance(scene: "viser.SceneApi", name: str, robot: RobotBody | None, height: float) -> Part:
    """Centre of mass with the point below it, a line round the soles of a robot that stands, the zero-moment point, red
    outside of it, and the centre of pressure of a simulated robot, hidden where no sole carries."""
    top = scene.add_frame(name, show_axes=False)
    centre = scene.add_icosphere(f"{name}/centre", CENTRE * height, color=BALANCE)
    below = scene.add_cylinder(f"{name}/below", DISC * height, 0.002, color=BALANCE)
    disc = scene.add_cylinder(f"{name}/zmp", POINT * height, 0.004, color=ZMP, visible=False)
    pressed = scene.add_cylinder(f"{name}/pressure", PRESSED * height, 0.006, color=PRESSURE, visible=False)
    nowhere, colour = np.zeros((1, 2, 3), np.float32), np.array(SOLES, dtype=np.uint8)
    line = scene.add_line_segments(f"{name}/soles", nowhere, colour, thickness=LINE_M)
    soles = () if robot is None else plant(robot, robot.profile.postures.stand).soles
    links = [sole.frame.body for sole in soles for _ in sole.corners]
    local = [corner for sole in soles for corner in sole.corners]

    def show(seen: Snapshot) -> None:
        move(centre, seen.com)
        for node, point, up in ((below, seen.com[:2], 0.001), (disc, seen.zmp, 0.002), (pressed, seen.pressure, 0.003)):
            move(node, np.append(point, up))
        if robot is not None:
            points = robot.kinematics.points(np.ascontiguousarray(seen.q)[None], links, np.array(local))[0]
            flat = convex_hull(points[:, :2])
            disc.color = OUTSIDE if float(support_distance(seen.zmp[None], support_edges([flat]))[0]) < -EDGE_M else ZMP
            corners = np.column_stack([flat, np.full(len(flat), LINE_M)]).round(4)
            line.points = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)

    return top, show


def _observers(scene: "viser.SceneApi", robot: RobotBody) -> Part:
    """The observers of a robot that act, on its links, in the colour of what they do; nothing where it is not known."""
    known, body = robot_observers(robot), robot.body.solver_body()
    meshes = [shape_mesh(kind, size) for kind, size in zip(known.kinds.tolist(), known.sizes, strict=True)]
    shapes = Shapes(scene, "/observers", meshes, color=MODES[0], opacity=OBSERVER_OPACITY, cast_shadow=False)

    def show(seen: Snapshot) -> None:
        modes = np.zeros(len(known.names), dtype=np.uint8)
        if "observer_modes" in seen and len(seen.observer_modes) == len(known.names):
            modes = seen.observer_modes
        positions, turns = body.forward(np.ascontiguousarray(seen.q))
        at = positions[known.links] + rotate(turns[known.links], known.positions)
        at[modes == 0] = np.nan
        shapes.show(at, multiply(turns[known.links], known.quats))
        for index in np.flatnonzero(modes):
            shapes.handles[index].color = MODES[min(int(modes[index]), len(MODES)) - 1]

    return shapes.top, show


LEFT_OF_ROBOT = 0.92
"""The performer stands so many heights of the robot to its left, as tall as it."""


class Drawing:
    """Puts all that is seen into the scene of a server; `show` moves it. Its methods may be called by any thread."""

    def __init__(self, server: "viser.ViserServer", cast: Cast) -> None:
        self._server, self._cast = server, cast
        self._lock = threading.Lock()
        self._last: Snapshot | None = None
        scene, self._height = server.scene, (cast.robot or cast.human).height
        self._left = 0.0 if cast.robot is None else LEFT_OF_ROBOT * self._height
        self._performer = scene.add_frame("/performer", show_axes=False)
        """The performer's world, placed by the first snapshot."""
        self._parts = {} if cast.robot is None else _add_robot(scene, cast, cast.robot)
        self._parts |= _add_performer(scene, cast, self._height) | _add_ground(scene, cast, self._height)
        scene.set_up_direction("+z")
        scene.add_grid(
            "/floor", 20.0, 20.0, cell_size=0.1, section_size=0.5, cell_color=(225, 228, 232), fade_distance=8.0
        )
        camera, middle = server.initial_camera, 0.5 * self._left  # in front of robot and performer
        camera.position = (1.5 * self._height, middle, 0.7 * self._height)
        camera.look_at = (0.0, middle, 0.36 * self._height)

    @property
    def parts(self) -> tuple[str, ...]:
        """What can be hidden, by its names in `LEGEND`, in the order of the page."""
        return tuple(self._parts)

    @property
    def keys(self) -> Keys:
        """What their colours mean."""
        profile = self._cast.profile if self._cast.servos_measure else None
        heated = () if profile is None else heat_keys(profile.profile.safety.temperature_c)
        return (*(key for part in self._parts for key in LEGEND[part]), *heated)

    def see(self, part: str, *, visible: bool) -> None:
        """Show or hide one of `parts`."""
        with self._lock:
            self._parts[part][0].visible = visible
        if self._last is not None:
            self.show(self._last)

    def show(self, snapshot: Snapshot) -> None:
        """Move everything that is not hidden to where it is."""
        with self._lock, self._server.atomic():
            if self._last is None:
                self._begin(snapshot)
            self._last = snapshot
            for node, show in self._parts.values():
                if node.visible:
                    show(snapshot)

    def _begin(self, first: Snapshot) -> None:
        """The performer begins left of the robot (alone, where one looks) and looks along x, as the robot does."""
        human = self._cast.human
        _, turns = human.kinematics.forward(np.ascontiguousarray(first.human_q))
        x, y, _ = rotate(turns[1], np.array([1.0, 0.0, 0.0])).tolist()
        half = -0.5 * np.arctan2(y, x)
        turn = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
        origin = self._height / human.height * first.human_q[:3] * (1.0, 1.0, 0.0)
        move(self._performer, np.array([0.0, self._left, 0.0]) - rotate(turn, origin), turn)
