"""A snapshot of a run as shapes in the scene of the page."""

import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from retarget.rotations import rotate
from retarget.types import FloatArray
from retarget.viewer.colours import ASKED, GOAL, HUMAN, REACHED, ROBOT, SENSOR, Colour, LimbColours, Scale
from retarget.viewer.figures import HERE, Figure, Movable, Observing, Place, SceneFigures
from retarget.viewer.ground import Balance, Pressure, Soles
from retarget.viewer.snapshot import Actor, Cast, Snapshot

if TYPE_CHECKING:
    import viser


GOAL_OPACITY, GOAL_SIZE = 0.55, 0.94
"""A goal is seen where the robot is not."""
HUMAN_OPACITY = 0.65
"""Sensors are inside of the performer."""
SEEN_THROUGH = 0.4
LEFT_OF_ROBOT, FARTHEST = 1.15, 2.5
"""The performer stands so many heights of the robot to its left, or beyond what is there, as tall as it."""
BALL, SENSOR_BALL = 0.018, 0.026
"""Radius of a landmark and of a sensor, as a share of the height of the robot: a sensor is thicker than a wrist."""


class _Hidden(Protocol):
    """What can be shown and hidden."""

    def see(self, *, visible: bool) -> None: ...


class _Part(_Hidden, Protocol):
    """What also moves."""

    def show(self, snapshot: Snapshot) -> None: ...


class Drawing:
    """Puts all that is seen into the scene of a server; `show` moves it. Its methods may be called by any thread."""

    def __init__(self, server: "viser.ViserServer", cast: Cast) -> None:
        self._scene, self._server, self._cast = server.scene, server, cast
        self._lock = threading.Lock()
        self._last: Snapshot | None = None
        height = cast.human.height if cast.robot is None else cast.robot.height
        self._height = height
        self._furnish(height)
        self._robot = self._goal = None
        self._limbs: LimbColours | None = None
        if cast.robot is not None:
            self._robot = Figure(self._scene, "robot", cast.robot, colour=ROBOT)
            self._goal = Figure(self._scene, "goal", cast.robot, colour=GOAL, opacity=GOAL_OPACITY, shrunk=GOAL_SIZE)
            if cast.profile is not None and cast.servos_commanded:
                self._limbs = LimbColours(cast.profile, self._robot.meshes)
        scale = height / cast.human.height
        self._human = Figure(self._scene, "performer", cast.human, colour=HUMAN, opacity=HUMAN_OPACITY, scale=scale)
        self._place: Place | None = None  # of the performer, known from the first snapshot on
        self._balls = {
            "sensors": _Balls(self._scene, "sensors", SENSOR_BALL * height, lambda snapshot: snapshot.sensors),
            "asked": _Balls(self._scene, "asked", BALL * height, lambda snapshot: snapshot.asked),
            "reached": _Balls(self._scene, "reached", BALL * height, lambda snapshot: snapshot.reached),
        }
        self._balls["sensors"].make(cast.sensors, SENSOR)
        self._overlays = self._overlaid(cast)
        self.name_landmarks(cast.landmarks)
        self._parts = self._named_parts(cast)

    @property
    def parts(self) -> tuple[str, ...]:
        """What can be hidden, by its names in `LEGEND`."""
        return tuple(self._parts)

    @property
    def colourings(self) -> tuple[str, ...]:
        """What limbs can be coloured by."""
        return () if self._limbs is None else self._limbs.choices

    @property
    def scale(self) -> Scale | None:
        """What the colours of the limbs mean; None: they have none."""
        return None if self._limbs is None else self._limbs.scale

    def name_landmarks(self, names: Sequence[str]) -> None:
        """Which landmarks the snapshots hold."""
        with self._lock:
            self._balls["asked"].make(names, ASKED)
            self._balls["reached"].make(names, REACHED)

    def colour_by(self, choice: str) -> None:
        """Colour the limbs by one of `colourings`."""
        if self._limbs is not None:
            self._limbs.by = choice
            self._again()

    def see_through(self, *, bodies: bool) -> None:
        """Let what is inside of robot and performer be seen: centre of mass, sensors; or no more."""
        with self._lock:
            for figure in (self._robot, self._human):
                if figure is not None:
                    figure.see_through(SEEN_THROUGH if bodies else None)

    def see(self, part: str, *, visible: bool) -> None:
        """Show or hide one of `parts`."""
        with self._lock:
            self._parts[part].see(visible=visible)
        self._again()

    def show(self, snapshot: Snapshot) -> None:
        """Move everything to where it is."""
        with self._lock, self._server.atomic():
            self._last = snapshot
            if self._place is None:
                self._begin(snapshot)
            assert self._place is not None
            if self._robot is not None and self._goal is not None:
                self._robot.place(snapshot.robot)
                self._goal.place(snapshot.goal)
            self._human.place(snapshot.human, self._place)
            if self._limbs is not None:
                self._limbs.show(snapshot)
            for part in (*self._balls.values(), *self._overlays.values()):
                part.show(snapshot)

    def _again(self) -> None:
        """Show the last snapshot again, after another choice of what is seen."""
        if self._last is not None:
            self.show(self._last)

    def _furnish(self, height: float) -> None:
        """The floor, and where one looks from."""
        self._scene.set_up_direction("+z")
        self._scene.add_grid(
            "/floor", 20.0, 20.0, cell_size=0.1, section_size=0.5, cell_color=(225, 228, 232), fade_distance=8.0
        )
        self._look_from(0.0 if self._cast.robot is None else LEFT_OF_ROBOT)

    def _look_from(self, left: float) -> None:
        """Let every browser begin in front of robot and performer, who is so many heights to its left."""
        height, camera = self._height, self._server.initial_camera
        camera.position = (max(1.9, 1.2 * left) * height, 0.5 * left * height, 0.9 * height)
        camera.look_at = (0.0, 0.5 * left * height, 0.45 * height)

    def _overlaid(self, cast: Cast) -> dict[str, _Part]:
        scene, robot = self._scene, cast.profile
        overlays: dict[str, _Part] = {}
        soles = Soles(scene, robot) if robot is not None and robot.stands else None
        if soles is not None:  # first: the zero-moment point is judged by it
            overlays["soles"] = soles
        self._balance = overlays["balance"] = Balance(scene, height=self._height, soles=soles)
        if cast.simulated:
            overlays["pressure"] = Pressure(scene, height=self._height)
        if robot is not None:
            overlays["observers"] = Observing(scene, robot)
        if cast.obstacles:
            overlays["obstacles"] = SceneFigures(scene, cast.obstacles)
        return overlays

    def _named_parts(self, cast: Cast) -> "dict[str, _Hidden]":
        """What can be hidden, in the order of the page."""
        named: dict[str, _Hidden] = {"human": self._human}
        if self._robot is not None and self._goal is not None:
            robot = "body" if cast.simulated else "robot"
            named = {robot: self._robot, "goal": self._goal, "performer": self._human}
        shown = ["sensors"] if cast.sensors else []
        if cast.robot is not None or cast.landmarks:  # live, they are named later
            shown += ["asked", "reached"]
        return named | {name: self._balls[name] for name in shown} | self._overlays

    def _begin(self, first: Snapshot) -> None:
        """The performer stands to the left of the robot, or, alone, where one looks; facing as the robot does."""
        human, alone = self._cast.human, self._robot is None
        left = 0.0 if alone else _left(self._cast, first)
        self._look_from(left)
        to = np.array([0.0, left * self._height, 0.0])
        origin = first.human[:3] * (1.0, 1.0, 0.0)
        self._place = Place(self._height / human.height, origin, _facing(human, first), to)
        self._balls["sensors"].at = self._place
        if alone:
            self._balance.at = self._balls["asked"].at = self._balls["reached"].at = self._place


class _Balls:
    """Points of a snapshot, each a ball of some radius, m."""

    def __init__(
        self, scene: "viser.SceneApi", name: str, radius: float, points: Callable[[Snapshot], FloatArray | None]
    ) -> None:
        self._scene, self._name, self._radius, self._points = scene, name, radius, points
        self._balls: list[Movable] = []
        self._seen = True
        self.names: tuple[str, ...] = ()
        self.at = HERE

    def make(self, names: Sequence[str], colour: Colour) -> None:
        """One for each name."""
        if tuple(names) == self.names:
            return
        for ball in self._balls:
            ball.handle.remove()
        self.names = tuple(names)
        paths = [f"/{self._name}/{i}_{name.replace('/', '_')}" for i, name in enumerate(names)]
        self._balls = [Movable(self._scene.add_icosphere(path, self._radius, color=colour)) for path in paths]
        self.see(visible=self._seen)

    def show(self, snapshot: Snapshot) -> None:
        """Move them to points (k, 3) m; those that are NaN are hidden."""
        points = self._points(snapshot)
        for ball, point in zip(self._balls, () if points is None else self.at.of(points), strict=False):
            ball.put(point)

    def see(self, *, visible: bool) -> None:
        """Show or hide them."""
        self._seen = visible
        for ball in self._balls:
            ball.see(visible=visible)


def _left(cast: Cast, first: Snapshot) -> float:
    """How far to the left of the robot there is room for the performer, in heights of the robot."""
    if cast.robot is None or first.obstacle_poses is None:
        return LEFT_OF_ROBOT
    height, left = cast.robot.height, LEFT_OF_ROBOT
    for one, pose in zip(cast.obstacles, first.obstacle_poses, strict=False):
        end = float((pose[1] + rotate(pose[3:], one.mesh[0])[:, 1]).max()) / height
        if end < FARTHEST:  # a wall goes on and on
            left = max(left, end + 0.5 * LEFT_OF_ROBOT)
    return left


def _facing(human: Actor, first: Snapshot) -> FloatArray:
    """The turn about the vertical, wxyz (4,), after which the performer looks along x in the beginning."""
    _, turns = human.body.solver_body().forward(np.ascontiguousarray(first.human))
    x, y, _ = rotate(turns[1], np.array([1.0, 0.0, 0.0])).tolist()
    half = -0.5 * np.arctan2(y, x)
    return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
