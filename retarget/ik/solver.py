"""Strict-priority inverse kinematics on any MJCF or URDF: tasks in levels, and a solver that moves a body to meet them.

    body = ik.load_body("arm.xml")
    hand = ik.Position("hand")
    solver = ik.Solver(body, [[ik.KeepClear()], [hand], [ik.Posture()]])
    q = solver.solve({hand: (0.4, 0.1, 0.3)}, dt=0.01)

No level disturbs a level above it; tasks of one level share the error by least squares. Joint limits come before all
levels. docs/ik.md is the guide, docs/solver.md the mathematics.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from math import inf, nan
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retarget import _solver, rotations
from retarget.arithmetic import norm
from retarget.errors import ConfigError, Problem, UsageError
from retarget.ik import arguments
from retarget.model.body import BodyModel, joint_weights
from retarget.model.observers import Observers, PairRules, Part, assemble, geom_shape, placed, steps_between
from retarget.model.scene_shapes import SceneShapes, ShapeKind
from retarget.rotations import as_quat, as_vector
from retarget.types import FloatArray

DAMPING = 0.25
"""Damping for each iteration of a frame, with which two iterations follow as calmly as five (docs/solver.md)."""

Vector = tuple[float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)  # [m] of a frame
ALIKE: Vector = (1.0, 1.0, 1.0)  # weights of three rows
MOST_ITERATIONS = 100  # in a frame; a far posture takes several frames
MOST_HALF_SPACES = 64  # of a task, by the room in the compiled solver


# Each task is its own name: `solve` takes targets by task.


@dataclass(frozen=True, eq=False)
class Position:
    """A point of a frame goes to a world position (3,) m, by at most 0.05 m in an iteration.

    frame: a site or a link of the body. point: m, in that frame. weight: of the rows x, y, z of the world; 0 frees one.
    """

    frame: str
    point: Vector = ORIGIN
    weight: Vector = ALIKE


@dataclass(frozen=True, eq=False)
class Orientation:
    """A frame takes a world orientation (4,) wxyz, by at most 0.2 rad in an iteration.

    weight: of turns about x, y, z of the world.
    """

    frame: str
    weight: Vector = ALIKE


@dataclass(frozen=True, eq=False)
class CentreOfMass:
    """The centre of mass goes to a world position (3,) m, by at most 0.05 m in an iteration. weight: as for
    `Position`."""

    weight: Vector = ALIKE


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """A point p stays inside half-spaces (k, 4), rows nx, ny, nz, d with n . p <= d, m: an inequality.

    n has length 1 and points out. A point outside comes back by at most 0.05 m in an iteration. frame, point: as for
    `Position`; without a frame, the centre of mass. most: the largest k, 64 at most.
    """

    frame: str | None
    point: Vector = ORIGIN
    most: int = 8


@dataclass(frozen=True, eq=False)
class Posture:
    """Joints go to a posture (nq,), by default the start.

    weights: of joints by name, 1 for the others. gain: share of the error per iteration, of 0.3 rad (m) at most.
    """

    weights: Mapping[str, float] = field(default_factory=dict)
    gain: float = 0.05


@dataclass(frozen=True, eq=False)
class KeepClear:
    """Links keep clear of each other, and of what the file fixes to the world: an inequality without a target.

    It takes colliding spheres, capsules, cylinders and boxes, and planes of the world. Within `influence` (m) shapes
    approach at `speed` (m/s) at most, less the nearer they are, and at `margin` (m) not at all. Shapes that touch
    separate at 0.1 m/s. Neighbouring links, and shapes that touch the world at the start, are left out, as are
    `ignored` pairs.
    """

    margin: float = 0.01
    influence: float = 0.05
    speed: float = 0.5
    ignored: tuple[tuple[str, str], ...] = ()


Task = Position | Orientation | CentreOfMass | HalfSpaces | Posture | KeepClear


class Solver:
    """Moves a body in frames of dt seconds so that its tasks are met, level by level, within its joint limits.

    An iteration moves no joint by more than 0.3 rad (m). The same calls give the same postures, to the bit, on every
    machine.
    """

    def __init__(
        self,
        body: BodyModel,
        levels: Sequence[Sequence[Task]],
        *,
        start: ArrayLike | None = None,
        max_velocity: ArrayLike = inf,
        max_acceleration: ArrayLike = inf,
        locked: Iterable[str] = (),
        iterations: int = 2,
    ) -> None:
        """levels: the highest first. start: posture (nq,), the file's if absent. max_velocity (rad/s, m/s),
        max_acceleration (per s^2): of all joints, or (nv,). locked: joints that do not move. iterations: in a frame, up
        to 100.

        Raises ConfigError: a name that the body lacks, distant links that touch at the start, shapes that cannot be
        kept clear. Raises UsageError for any other unusable argument.
        """
        if not isinstance(body, BodyModel):
            raise UsageError("not a body", where="ik.Solver", found=f"{body!r:.60}", allowed="a body of ik.load_body")
        _check_levels(levels)
        where = "ik.Solver, start" if start is not None else f"ik.Solver, start, absent: that of {body.source}"
        start = arguments.posture(body.qpos0 if start is None else start, body, where)
        compiled = [[(task, _compiled(task, body)) for task in level] for level in levels]
        clear = [task for level in levels for task in level if isinstance(task, KeepClear)]
        observers, fixed = _parts(body, clear[0], start) if clear else (None, None)
        still = [(joint, 1.0) for joint in arguments.names(locked, "ik.Solver, locked", "joints")]
        iterations = arguments.whole(iterations, "ik.Solver, iterations", MOST_ITERATIONS)
        self.body = body
        self._body = body.solver_body()
        self._solver = _solver.Solver(
            self._body,
            [[part for _, parts in level for part in parts] for level in compiled],
            lower=body.lower,
            upper=body.upper,
            max_velocity=arguments.limit(max_velocity, body, "ik.Solver, max_velocity"),
            max_acceleration=arguments.limit(max_acceleration, body, "ik.Solver, max_acceleration"),
            locked=joint_weights(body, still, default=0.0) > 0.0,
            n_ik=iterations,
            damping=DAMPING * iterations,
            observers=observers,
            activation="all",
        )
        self._places: dict[Task, list[tuple[int, int, int]]] = {}
        number = count()
        for k, level in enumerate(compiled):
            place = count()
            for task, parts in level:
                self._places[task] = [(next(number), *self._solver.target_slice(k, next(place))) for _ in parts]
        self._start = start
        if fixed is not None:
            self._solver.set_obstacles(*fixed)
        self.reset(start)

    @property
    def q(self) -> FloatArray:
        """The posture (nq,)."""
        return self._solver.q

    @property
    def velocity(self) -> FloatArray:
        """Velocity (nv,) of the last frame, per s."""
        return self._solver.velocity

    @property
    def clearance(self) -> float:
        """Smallest distance of shapes that keep clear, m; infinite beyond influence, NaN before the first `solve`."""
        return min(self._solver.clearance) if self._solved else nan

    @property
    def capped(self) -> int:
        """Number of linear solves that were ended early. Limits held, but tasks may be met less well."""
        return self._solver.capped

    def error(self, task: Task) -> float:
        """Error of a task (m, rad; KeepClear: m too near) after the last frame; NaN without a target or `solve`."""
        self._check_known(task, "ik.Solver.error")
        errors = self._solver.task_errors
        return float(np.max([errors[number] for number, _, _ in self._places[task]])) if self._solved else nan

    def position(self, frame: str, point: Vector = ORIGIN) -> FloatArray:
        """World position (3,) of a point (m) of a frame. Raises ConfigError, UsageError."""
        link, local = _point(self.body, frame, point, "ik.Solver.position")
        return np.asarray(self._body.points(self.q[None], [link], np.array([local]))[0, 0])

    def orientation(self, frame: str) -> FloatArray:
        """World orientation (4,) wxyz of a frame. Raises ConfigError, UsageError."""
        found = arguments.frame(self.body, frame, "ik.Solver.orientation")
        return rotations.multiply(self._body.orientations(self.q[None], [found.body])[0, 0], found.quat)

    @property
    def centre_of_mass(self) -> FloatArray:
        """World position (3,) m of the centre of mass."""
        return np.asarray(self._body.centre_of_mass(self.q[None])[0])

    def reset(self, q: ArrayLike) -> None:
        """Stand still in a posture (nq,) within joint limits. Raises UsageError and then changes nothing."""
        self._solver.reset(arguments.posture(q, self.body, "ik.Solver.reset"))
        self._solved = False

    def solve(self, targets: Mapping[Any, ArrayLike], dt: float) -> FloatArray:
        """Move for dt seconds and return the posture (nq,). targets: by task; a task without one is left out.

        A far target takes several frames. Raises UsageError for an unknown task or an unusable target, and then moves
        nothing.
        """
        dt = arguments.positive(dt, "ik.Solver.solve, dt", "s")
        arguments.check_mapping(targets, "ik.Solver.solve, targets", "{task: target}")
        vector = np.zeros(self._solver.target_size)
        for task in targets:
            self._check_known(task, "ik.Solver.solve")
        for task, places in self._places.items():
            value = self._value(task, targets.get(task))
            if value is not None:
                for _, begin, end in places:
                    vector[begin] = 1.0
                    vector[begin + 1 : begin + 1 + value.size] = value
                    vector[begin + 1 + value.size : end] = 0.0
        q = self._solver.frame(vector, dt)
        self._solved = True
        return q

    def _value(self, task: Task, given: ArrayLike | None) -> FloatArray | None:
        where = f"ik.Solver.solve, target of {_name(task)}"
        if isinstance(task, KeepClear):
            if given is not None:
                raise UsageError("a target of a task that takes none", where=where, next_step="Leave it out")
            return np.zeros(0)
        if isinstance(task, Posture):
            return self._start if given is None else arguments.vector(given, self.body.nq, where)
        if given is None:
            return None
        if isinstance(task, HalfSpaces):
            rows = arguments.half_spaces(given, task.most, where)
            # The compiled task of the centre of mass has rows (n, d), that of a point (0, n, d).
            return rows.ravel() if task.frame is None else np.hstack([np.zeros((len(rows), 3)), rows]).ravel()
        if not isinstance(task, Orientation):
            return arguments.vector(given, 3, where)
        value = arguments.vector(given, 4, where)
        if not norm(value) > 0.0:
            raise UsageError("a quaternion of length 0", where=where, found=f"{given!r:.80}", allowed="wxyz, not all 0")
        return value / norm(value)

    def _check_known(self, task: object, where: str) -> None:
        if not isinstance(task, Task) or task not in self._places:
            raise UsageError(
                "a task that is in none of the levels",
                where=where,
                found=_name(task),
                allowed=", ".join(map(_name, self._places)),
                next_step="Keep the task that you put into a level, and name its target by it",
            )


def _check_levels(levels: Sequence[Sequence[object]]) -> None:
    where, allowed = "ik.Solver, levels", "lists of tasks, [[a], [b]]"
    if not isinstance(levels, Sequence):
        raise UsageError("not a list of levels", where=where, found=f"{levels!r:.60}", allowed=allowed)
    tasks = list[Task]()
    for number, level in enumerate(levels, start=1):
        if not isinstance(level, Sequence):
            raise UsageError("not a list of tasks", where=where, found=f"{level!r:.60}", allowed=allowed)
        if any(isinstance(task, Posture) for task in level) and (len(level) > 1 or number < len(levels)):
            raise UsageError(
                "a posture is not alone in the last level",
                where=f"{where}, level {number}",
                found=", ".join(map(_name, level)),
                next_step="Put [Posture()] at the end: it takes all freedom that is left",
            )
        for task in level:
            if not isinstance(task, Task):
                kinds = ", ".join(kind.__name__ for kind in Task.__args__)
                raise UsageError("not a task", where=f"{where}, level {number}", found=f"{task!r:.60}", allowed=kinds)
            if task in tasks:
                raise UsageError("a task stands in two places", where=f"{where}, level {number}", found=_name(task))
            tasks.append(task)
    if not tasks:
        raise UsageError("there is no task", where=where, found=f"{levels!r:.60}", allowed=allowed)
    if len([task for task in tasks if isinstance(task, KeepClear)]) > 1:
        raise UsageError("KeepClear stands in two places", where=where, allowed="one: it is of the whole body")


def _name(task: object) -> str:
    if not isinstance(task, Task):
        return f"{task!r:.60}"
    frame, name = getattr(task, "frame", None), type(task).__name__
    return name if frame is None else f"{name}({frame!r})"


def _compiled(task: Task, body: BodyModel) -> list[_solver.Task]:
    where = f"ik.{_name(task)}"
    match task:
        case Position():
            weight = arguments.weight(task.weight, f"{where}, weight")
            return [_solver.Task.position(*_point(body, task.frame, task.point, where), weight=weight)]
        case Orientation():
            frame, weight = arguments.frame(body, task.frame, where), arguments.weight(task.weight, f"{where}, weight")
            return [_solver.Task.orientation(frame.body, as_quat(frame.quat), weight=weight)]
        case CentreOfMass():
            return [_solver.Task.centre_of_mass(weight=arguments.weight(task.weight, f"{where}, weight"))]
        case HalfSpaces():
            most = arguments.whole(task.most, f"{where}, most", MOST_HALF_SPACES)
            if task.frame is None:
                return [_solver.Task.support(most)]
            return [_solver.Task.lever(*_point(body, task.frame, task.point, where), max_edges=most)]
        case Posture():
            return [_posture(task, body)]
        case KeepClear():
            return [_solver.Task.reactive(), _solver.Task.preventive(speed=_checked_zone(task)[2])]


def _posture(task: Posture, body: BodyModel) -> _solver.Task:
    arguments.check_mapping(task.weights, "ik.Posture, weights", "{joint: weight}")
    joints = arguments.names(task.weights, "ik.Posture, weights", "joints")
    values = arguments.vector(list(task.weights.values()), len(joints), "ik.Posture, weights")
    if (values < 0.0).any():
        raise UsageError(
            "a negative weight", where="ik.Posture, weights", found=f"{task.weights!r:.80}", allowed="0 and above"
        )
    weights = joint_weights(body, zip(joints, values.tolist(), strict=True), default=1.0)
    return _solver.Task.posture(weights, gain=arguments.positive(task.gain, "ik.Posture, gain", most=1.0))


def _point(body: BodyModel, frame: str, point: Vector, where: str) -> tuple[int, Vector]:
    found = arguments.frame(body, frame, where)
    local = arguments.vector(point, 3, f"{where}, point")
    return found.body, as_vector(found.position + rotations.rotate(found.quat, local))


def _checked_zone(task: KeepClear) -> tuple[float, float, float]:
    margin, influence, speed = arguments.vector(
        [task.margin, task.influence, task.speed], 3, "ik.KeepClear, margin, influence and speed"
    ).tolist()
    if not 0.0 <= margin < influence or not speed > 0.0:
        found = f"margin {margin}, influence {influence}, speed {speed}"
        allowed = "0 <= margin < influence, m, and a speed above 0, m/s"
        raise UsageError("margin, influence or speed out of range", where="ik.KeepClear", found=found, allowed=allowed)
    return margin, influence, speed


def _ignored(task: KeepClear, body: BodyModel) -> tuple[tuple[int, int, str], ...]:
    where, pairs = "ik.KeepClear, ignored", []
    for pair in task.ignored if isinstance(task.ignored, Iterable) else (task.ignored,):
        named = arguments.names(pair, where, "two links")
        if len(named) != 2:
            raise UsageError("not a pair of links", where=where, found=f"{pair!r:.60}", allowed="names of two links")
        pairs.append((body.body_index(named[0]), body.body_index(named[1]), "by the caller"))
    return tuple(pairs)


Fixed = tuple[FloatArray, FloatArray]  # positions (k, 3) m and orientations (k, 4) wxyz of shapes fixed to the world


def _parts(body: BodyModel, task: KeepClear, start: FloatArray) -> tuple[_solver.Observers, Fixed]:
    """The observers of the colliding shapes, and the poses of the fixed ones."""
    margin, influence, _ = _checked_zone(task)
    moving, fixed, problems = dict[str, Part](), dict[str, Part](), list[Problem]()
    for number, geom in enumerate(geom for geom in body.geoms if geom.collides):
        name = geom.name or f"{body.body_names[geom.body]}, shape {number + 1}"
        is_plane = geom.kind == "plane" and geom.body == 0
        row = (ShapeKind.HALF_SPACE, ORIGIN, geom.position, geom.quat) if is_plane else geom_shape(geom)
        if row is None:
            found, allowed = f"{geom.kind} {name!r}", "sphere, capsule, cylinder, box; a plane on the world"
            step = "Give the link one of these for collisions, and set contype and conaffinity of this one to 0"
            problems.append(Problem("a shape that cannot be kept clear", body.source, found, allowed, step))
        else:
            (moving if geom.body else fixed)[name] = Part(geom.body, *row, influence, margin)
    if problems:
        raise ConfigError.from_problems(problems)
    observers = assemble(body, moving, PairRules(neutral=start, ignored=_ignored(task, body), where=body.source))
    zone = np.ones(len(fixed))
    scene = SceneShapes(
        names=tuple(fixed),
        kinds=np.array([part.kind for part in fixed.values()], dtype=np.int64),
        sizes=np.array([part.sizes for part in fixed.values()]).reshape(-1, 3),
        influence=influence * zone,
        margin=margin * zone,
        ground=np.zeros(len(fixed), dtype=bool),
    )
    places = np.array([part.position for part in fixed.values()]).reshape(-1, 3)
    turns = np.array([part.quat for part in fixed.values()]).reshape(-1, 4)
    looks = _looks(body, observers, scene, (places, turns), start)
    return observers.for_solver(body, scene, looks=looks), (places, turns)


def _looks(
    body: BodyModel, observers: Observers, scene: SceneShapes, fixed: Fixed, start: FloatArray
) -> NDArray[np.bool_]:
    n, k = len(observers.names), len(scene.names)
    if not n * k:
        return np.zeros((n, k), dtype=bool)
    part, other = (index.ravel() for index in np.indices((n, k)))
    position, quat = placed(body, observers, start)
    distance = _solver.shape_distances(
        *(observers.kinds[part], observers.sizes[part], position[part], quat[part]),
        *(scene.kinds[other], scene.sizes[other], fixed[0][other], fixed[1][other]),
    )[0].reshape(n, k)
    moves = [steps_between(body, link, 0) > 1 for link in observers.links.tolist()]
    return np.asarray((distance > 0.0) & np.array(moves)[:, None])
