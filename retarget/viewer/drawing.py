"""A snapshot of a run as shapes in the scene of the page."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from retarget.rotations import rotate
from retarget.types import FloatArray
from retarget.viewer.colours import ASKED, GOAL, HUMAN, OBSTACLE, REACHED, ROBOT, SENSOR, Colour, LimbColours
from retarget.viewer.figures import HERE, OBSTACLE_OPACITY, Figure, Observing, Place, Shapes, balls
from retarget.viewer.ground import Balance
from retarget.viewer.snapshot import Actor, Cast, Snapshot

if TYPE_CHECKING:
    import viser


GOAL_OPACITY, GOAL_SIZE = 0.55, 0.94
"""A goal is seen where the robot is not."""
HUMAN_OPACITY = 0.65
"""Sensors are inside of the performer."""
LEFT_OF_ROBOT = 1.15
"""The performer stands so many heights of the robot to its left, as tall as it."""
BALL, SENSOR_BALL = 0.018, 0.026
"""Radius of a landmark and of a sensor, as a share of the height of the robot: a sensor is thicker than a wrist."""
Show = Callable[[Snapshot], object]
"""Moves a part of the scene to where it is in a snapshot."""


class Drawing:
    """Puts all that is seen into the scene of a server; `show` moves it. Its methods may be called by any thread."""

    def __init__(self, server: "viser.ViserServer", cast: Cast) -> None:
        self._scene, self._server, self._cast = server.scene, server, cast
        self._lock = threading.Lock()
        self._last: Snapshot | None = None
        self.height = (cast.robot or cast.human).height
        self.place = HERE  # of the performer, known from the first snapshot on
        self._limbs: LimbColours | None = None
        self._furnish()
        self._parts: dict[str, tuple[viser.SceneNodeHandle, Show]] = {}
        if cast.robot is not None:
            self._add_robot(cast.robot)
        self._add_performer()
        self._add_ground()

    @property
    def parts(self) -> tuple[str, ...]:
        """What can be hidden, by its names in `LEGEND`, in the order of the page."""
        return tuple(self._parts)

    @property
    def limb_keys(self) -> tuple[tuple[Colour, str], ...]:
        """What the colours of the limbs mean; empty: they have none."""
        return () if self._limbs is None else self._limbs.keys

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

    def _add_robot(self, actor: Actor) -> None:
        cast, scene = self._cast, self._scene
        robot = Figure(scene, "robot", actor, colour=ROBOT)
        goal = Figure(scene, "goal", actor, colour=GOAL, opacity=GOAL_OPACITY, shrunk=GOAL_SIZE)
        if cast.profile is not None and cast.servos_commanded:
            self._limbs = LimbColours(cast.profile, robot.handles)

        def show_robot(snapshot: Snapshot) -> None:
            robot.place(snapshot.robot)
            if self._limbs is not None:
                self._limbs.show(snapshot.temperature)

        self._parts["body" if cast.simulated else "robot"] = robot.top, show_robot
        self._parts["goal"] = goal.top, lambda snapshot: goal.place(snapshot.goal)

    def _add_performer(self) -> None:
        """The performer with its sensors, and what was asked and reached of the landmarks."""
        cast, scene, height = self._cast, self._scene, self.height
        scale = height / cast.human.height
        human = Figure(scene, "performer", cast.human, colour=HUMAN, opacity=HUMAN_OPACITY, scale=scale)
        name = "human" if cast.robot is None else "performer"
        self._parts[name] = human.top, lambda snapshot: human.place(snapshot.human, self.place)
        if cast.sensors:
            worn = Shapes(scene, "sensors", balls(cast.sensors, SENSOR_BALL * height), colour=SENSOR)
            self._parts["sensors"] = worn.top, lambda snapshot: worn.show(_at(self.place, snapshot.sensors))
        if cast.landmarks:
            marks = balls(cast.landmarks, BALL * height)
            asked = Shapes(scene, "asked", marks, colour=ASKED)
            reached = Shapes(scene, "reached", marks, colour=REACHED)
            self._parts["asked"] = asked.top, lambda snapshot: asked.show(snapshot.asked)
            self._parts["reached"] = reached.top, lambda snapshot: reached.show(snapshot.reached)

    def _add_ground(self) -> None:
        """Balance, observers and obstacles."""
        cast, scene, robot = self._cast, self._scene, self._cast.profile
        balance = self.balance = Balance(scene, robot, height=self.height)
        if balance.soles is not None:
            self._parts["soles"] = balance.soles, balance.show_soles
        self._parts["balance"] = balance.top, lambda snapshot: balance.show(snapshot, self._world.of)
        if cast.simulated:
            self._parts["pressure"] = balance.pressure, balance.show_pressure
        if robot is not None:
            observing = Observing(scene, robot)
            self._parts["observers"] = observing.top, observing.show
        if cast.obstacles:
            obstacles = Shapes(scene, "obstacles", cast.obstacles, colour=OBSTACLE, opacity=OBSTACLE_OPACITY)

            def show_obstacles(snapshot: Snapshot) -> None:
                poses = snapshot.obstacle_poses
                if poses is not None:
                    obstacles.show(poses[:, :3], poses[:, 3:])

            self._parts["obstacles"] = obstacles.top, show_obstacles

    @property
    def _world(self) -> Place:
        """Where balance is: in the robot's world, or in that of a human alone."""
        return self.place if self._cast.robot is None else HERE

    def _furnish(self) -> None:
        """The floor, and where one looks from: in front of robot and performer."""
        self._scene.set_up_direction("+z")
        self._scene.add_grid(
            "/floor", 20.0, 20.0, cell_size=0.1, section_size=0.5, cell_color=(225, 228, 232), fade_distance=8.0
        )
        left, camera = 0.5 * self._left, self._server.initial_camera
        camera.position = (1.9 * self.height, left, 0.9 * self.height)
        camera.look_at = (0.0, left, 0.45 * self.height)

    @property
    def _left(self) -> float:
        """How far to the left of the robot the performer stands, m; alone, where one looks."""
        return 0.0 if self._cast.robot is None else LEFT_OF_ROBOT * self.height

    def _begin(self, first: Snapshot) -> None:
        """The performer looks along x in the beginning, as the robot does."""
        human = self._cast.human
        _, turns = human.body.solver_body().forward(np.ascontiguousarray(first.human))
        x, y, _ = rotate(turns[1], np.array([1.0, 0.0, 0.0])).tolist()
        half = -0.5 * np.arctan2(y, x)
        turn = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
        origin = first.human[:3] * (1.0, 1.0, 0.0)
        self.place = Place(self.height / human.height, origin, turn, np.array([0.0, self._left, 0.0]))


def _at(place: Place, points: FloatArray | None) -> FloatArray | None:
    """Points (k, 3) m of a world, in the scene."""
    return None if points is None else place.of(points)
