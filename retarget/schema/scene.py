"""A scene file: obstacles near the robot. `configs/scenes/*.yaml`. SI units.

`world` has its origin between the robot's soles at the start, x forward, z up; for the virtual human it is the
performer's. `stand` is fixed to the mount of the base, or equals `world` at the start. Time 0 is the beginning of the
clip; before it, obstacles rest.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from retarget.errors import Problem
from retarget.rotations import Quat, Vector, inverse, length, minus, plus, product, rotated, rotation_vector
from retarget.schema.catalogue import Kind, read_as
from retarget.schema.shapes import Distance, Point, Size, SolidShape
from retarget.schema.strict_models import Name, Quaternion, Schema, Switch, Text, validated
from retarget.schema.strict_yaml import Document, KeyPath

MAX_SPEED = 100.0  # [m/s] of an obstacle in a file
MAX_TURN = 100.0  # [rad/s]
MIN_LENGTH = 1e-6  # [m] shortest normal, segment, capsule or cylinder with a direction
SAME_POINT = 1e-6
"""[m] and [rad] Largest gap of a closed loop."""

Speed = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-MAX_SPEED, le=MAX_SPEED)]
Turn = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-MAX_TURN, le=MAX_TURN)]
Instant = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1e6)]


def _direction(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if length(value) < MIN_LENGTH:
        raise PydanticCustomError("zero", "a direction without length", {"allowed": "such as [0, 0, 1]"})
    return value


Direction = Annotated[Point, AfterValidator(_direction)]


class HalfSpace(Schema):
    """All that is behind a plane."""

    point: Point = (0.0, 0.0, 0.0)
    """[m] A point of its plane."""
    normal: Direction
    """Points out of the solid; its length does not matter."""


class ObstacleShape(SolidShape):
    """Exactly one of the shapes: those of a profile's observers, and the half-space."""

    half_space: HalfSpace | None = None
    """All that is behind a plane."""


class Place(Schema):
    """Pose of an obstacle's own frame in the frame that the obstacle names."""

    pos: Point = (0.0, 0.0, 0.0)
    """[m] Position of the obstacle's origin."""
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation of its axes, wxyz."""


class PathPoint(Schema):
    """Pose of an obstacle's own frame at a time."""

    time: Instant
    """[s] From the start, rising from point to point."""
    pos: Point
    """[m] Position of the obstacle's origin."""
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation of its axes, wxyz."""


class Obstacle(Schema):
    """An object that the robot must not touch. Velocities hold between `from` and `until`; a `path` takes the place of
    both."""

    shape: ObstacleShape
    """Exactly one, in the obstacle's own frame."""
    frame: Literal["world", "stand"] = "world"
    """Frame of `at`, `path`, `velocity` and live updates: the world, or the robot's stand."""
    at: Place = Place()
    """Pose of the obstacle's own frame at the start."""
    influence: Size = 0.1
    """[m] Distance at which observers begin to yield."""
    margin: Distance = 0.01
    """[m] Distance that they keep."""
    ground: Switch = False
    """The robot stands on it: its soles do not keep away from it."""
    velocity: tuple[Speed, Speed, Speed] | None = None
    """[m/s] Velocity of the obstacle's origin, along the axes of `frame`."""
    angular_velocity: tuple[Turn, Turn, Turn] | None = None
    """[rad/s] About those axes."""
    start: Instant = Field(default=0.0, alias="from")
    """[s] Beginning of its motion."""
    until: Instant | None = None
    """[s] End of its motion; absent: never."""
    path: Annotated[tuple[PathPoint, ...], Field(max_length=10_000)] | None = None
    """Poses at times, instead of `at` and velocities."""
    loop: Switch = False
    """The path again and again."""


Obstacles = Annotated[dict[Name, Obstacle], Field(max_length=256)]


NO_MOTION: Vector = (0.0, 0.0, 0.0)  # [m/s] or [rad/s]


@dataclass(frozen=True, slots=True)
class Pose:
    """A frame in its parent: position m, unit quaternion wxyz."""

    position: Vector = (0.0, 0.0, 0.0)
    quat: Quat = (1.0, 0.0, 0.0, 0.0)

    def inside(self, child: "Pose") -> "Pose":
        """A pose of this frame, in the parent: T_parent_this T_this_child."""
        return Pose(plus(self.position, rotated(self.quat, child.position)), product(self.quat, child.quat))


HERE = Pose()
"""The parent's own frame."""


@dataclass(frozen=True, slots=True)
class MovingPose:
    """A pose, the velocity of its origin, m/s, and angular velocity, rad/s, along the parent's axes."""

    pose: Pose
    linear: Vector = NO_MOTION
    angular: Vector = NO_MOTION


def carried_by(parent: Pose, moving: MovingPose) -> MovingPose:
    """A moving pose of a frame at rest, in that frame's own parent."""
    return MovingPose(
        parent.inside(moving.pose), rotated(parent.quat, moving.linear), rotated(parent.quat, moving.angular)
    )


def on_body(moving: MovingPose, child: Pose) -> MovingPose:
    """A pose fixed to a moving one: v_child = v + w x r, the same w."""
    arm = rotated(moving.pose.quat, child.position)
    return MovingPose(moving.pose.inside(child), plus(moving.linear, cross(moving.angular, arm)), moving.angular)


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(quat: Quat) -> Quat:
    """The quaternion (not zero) at length 1."""
    w, x, y, z = quat
    norm = sqrt(w * w + x * x + y * y + z * z)
    return (w / norm, x / norm, y / norm, z / norm)


def _check(scene: "Scene", document: Document) -> list[Problem]:
    """All problems of the obstacles that are valid by themselves."""
    problems = []
    if document.data.get("obstacles") == {}:
        problems.append(document.problem(("obstacles",), "a scene without obstacles", allowed="one obstacle at least"))
    for name, obstacle in scene.obstacles.items():
        for check in (_distances, _length, _motion, _path):
            problems += check(obstacle, document, ("obstacles", name))
    return problems


def _distances(obstacle: Obstacle, document: Document, here: KeyPath) -> Iterable[Problem]:
    if obstacle.influence > obstacle.margin:
        return
    key = "influence" if "influence" in obstacle.model_fields_set else "margin"
    yield document.problem(
        (*here, key),
        "the influence must be larger than the margin",
        found=f"influence {obstacle.influence} m, margin {obstacle.margin} m",
        allowed=f"influence above {obstacle.margin} m",
        next_step="Observers yield from the influence on, down to the margin",
    )


def _length(obstacle: Obstacle, document: Document, here: KeyPath) -> Iterable[Problem]:
    shape = obstacle.shape
    for label in ("segment", "capsule", "cylinder"):
        line = getattr(shape, label)
        if line is not None and length(minus(line.end, line.start)) < MIN_LENGTH:
            yield document.problem(
                (*here, "shape", label, "to"),
                f"a {label} without length",
                found=f"{list(line.end)}, where it begins",
                allowed="two different points",
                next_step="" if label == "segment" else "A ball is a sphere",
            )


def _motion(obstacle: Obstacle, document: Document, here: KeyPath) -> Iterable[Problem]:
    given = {type(obstacle).model_fields[key].alias or key for key in obstacle.model_fields_set}
    if obstacle.path is not None:
        for key in ("at", "velocity", "angular_velocity", "from", "until"):
            if key in given:
                step = f"Remove {key!r} or 'path'"
                yield document.problem((*here, key), f"'path' and {key!r} exclude each other", next_step=step)
        return
    if obstacle.loop:
        yield document.problem((*here, "loop"), "a loop without a path", next_step="Add 'path', or remove 'loop'")
    if obstacle.velocity is None and obstacle.angular_velocity is None:
        for key in ("from", "until"):
            if key in given:
                step = f"Add 'velocity', or remove {key!r}"
                yield document.problem((*here, key), "a time without a velocity", next_step=step)
    elif obstacle.until is not None and obstacle.until <= obstacle.start:
        found, allowed = f"{obstacle.until} s", f"later than 'from', {obstacle.start} s"
        yield document.problem((*here, "until"), "the motion ends before it begins", found=found, allowed=allowed)


def _path(obstacle: Obstacle, document: Document, here: KeyPath) -> Iterable[Problem]:
    path = obstacle.path
    if path is None:
        return
    here = (*here, "path")
    if len(path) < 2:
        step = "An obstacle that stays has 'at' instead"
        yield document.problem(here, "a path of fewer than two points", found=str(len(path)), next_step=step)
        return
    for index, (before, after) in enumerate(pairwise(path), 1):
        place = (*here, index, "time")
        if after.time <= before.time:
            yield document.problem(
                place,
                "a moving obstacle whose times do not rise",
                found=f"{after.time} s after {before.time} s",
                allowed=f"more than {before.time} s",
            )
            continue
        duration = after.time - before.time
        distance, turn = _separation(before, after)
        for value, limit, unit_name in ((distance / duration, MAX_SPEED, "m/s"), (turn / duration, MAX_TURN, "rad/s")):
            if value > limit:
                what, found = "the path is too fast", f"{value:.4g} {unit_name} since the point before"
                yield document.problem(place, what, found=found, allowed=f"at most {limit:g} {unit_name}")
    if obstacle.loop and max(_separation(path[0], path[-1])) > SAME_POINT:
        yield document.problem(
            (*here, len(path) - 1),
            "the loop does not close",
            found=f"pos {list(path[-1].pos)}, quat {list(path[-1].quat)}",
            allowed=f"the first pose: pos {list(path[0].pos)}, quat {list(path[0].quat)}",
        )


def _separation(a: PathPoint, b: PathPoint) -> tuple[float, float]:
    """Distance, m, and angle, rad, between two poses."""
    turn = rotation_vector(product(unit(b.quat), inverse(unit(a.quat))))
    return length(minus(b.pos, a.pos)), length(turn)


FLOOR = "floor"  # the obstacle on which a robot with feet stands, in every scene
FLOOR_MARGIN_M = 0.005
"""[m] Distance of all but soles from the floor: deflection under load, and the skin of a hand."""
FLOOR_INFLUENCE_M = 0.05
"""[m] As of observers of the shipped robots to each other."""


class Scene(Schema):
    """The obstacles near a robot, by name."""

    name: Name
    """Name by which it is chosen."""
    description: Text
    """One line for lists."""
    obstacles: Obstacles
    """Obstacles, by name."""


def load_scene(name_or_path: str | Path) -> Scene:
    """A scene by name or path. Raises UsageError, ConfigError with all its problems."""
    return validated(Scene, read_as(Kind.SCENE, name_or_path), check=_check)


def on_floor(scene: Scene | None) -> Scene:
    """A scene with the floor z = 0, unless it has an obstacle of that name. scene: None for the floor alone."""
    floor = {
        "shape": {"half_space": {"normal": (0.0, 0.0, 1.0)}},
        "influence": FLOOR_INFLUENCE_M,
        "margin": FLOOR_MARGIN_M,
        "ground": True,
    }
    if scene is None:
        return Scene.model_validate(
            {"name": FLOOR, "description": "Nothing but the floor", "obstacles": {FLOOR: floor}}
        )
    return scene.model_copy(update={"obstacles": {FLOOR: Obstacle.model_validate(floor)} | dict(scene.obstacles)})
