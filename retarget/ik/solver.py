"""Strict-priority inverse kinematics on any MJCF or URDF: tasks in levels, and a solver that moves a body to meet them.

    body = ik.load_body("arm.xml")
    hand = ik.Position("hand")
    solver = ik.Solver(body, [[ik.KeepClear()], [hand], [ik.Posture()]])
    q = solver.solve({hand: (0.4, 0.1, 0.3)}, dt=0.01)

The first level is met before the second has a say, and so on; tasks of one level share what cannot be met by least
squares. Joint limits come before all levels. docs/ik.md is the guide, docs/solver.md the mathematics.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retarget import _solver, rotations
from retarget.arithmetic import norm
from retarget.errors import ConfigError, Problem, UsageError
from retarget.model.body import BodyModel, joint_weights
from retarget.model.observers import Observers, PairRules, Part, assemble, geom_shape, placed, steps_between
from retarget.model.scene_shapes import SceneShapes, ShapeKind
from retarget.rotations import as_quat, as_vector
from retarget.types import FloatArray

DAMPING = 0.25
"""Damping of the solver for each iteration of a frame: measured to follow as calmly with two iterations as with five
(docs/solver.md)."""

Vector = tuple[float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)
"""[m] A frame's own origin."""
ALIKE: Vector = (1.0, 1.0, 1.0)
"""Weights of three rows of which none counts more than another."""


# Tasks. Each is its own name: `solve` takes targets by task.


@dataclass(frozen=True, eq=False)
class Position:
    """A point of a frame goes to a place in the world. Target: (3,) m.

    frame: a site or a link of the body. point: m, in that frame. weight: of the rows x, y, z of the world; 0 leaves one
    free.
    """

    frame: str
    point: Vector = ORIGIN
    weight: Vector = ALIKE


@dataclass(frozen=True, eq=False)
class Orientation:
    """A frame takes an orientation in the world. Target: (4,) wxyz. weight: of turns about x, y, z of the world."""

    frame: str
    weight: Vector = ALIKE


@dataclass(frozen=True, eq=False)
class CentreOfMass:
    """The centre of mass goes to a place in the world. Target: (3,) m. weight: as for `Position`."""

    weight: Vector = ALIKE


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """A point p stays inside half-spaces, an inequality. Target: (k, 4), rows nx, ny, nz, d: n . p <= d, m.

    n has length 1 and points out.
    frame, point: as for `Position`; None: the centre of mass. most: the largest k.
    """

    frame: str | None
    point: Vector = ORIGIN
    most: int = 8


@dataclass(frozen=True, eq=False)
class Posture:
    """Joints go to a posture. Target: (nq,); without one it is where the solver began.

    weights: of joints by name, 1 for the others. gain: share of the way for each iteration.
    """

    weights: Mapping[str, float] = field(default_factory=dict)
    gain: float = 0.05


@dataclass(frozen=True, eq=False)
class KeepClear:
    """Parts of the body keep away from each other, and from what the file fixes to the world: an inequality. No target.

    Parts are the file's colliding spheres, capsules, cylinders and boxes, on the world planes too. Within `influence`
    (m) a part may approach at `speed` (m/s) at most, and the less, the nearer; at `margin` (m) not at all. Links that
    one joint parts are neighbours, and are left out; so is what touches the world at the start. ignored: pairs of links
    that may touch.
    """

    margin: float = 0.01
    influence: float = 0.05
    speed: float = 0.5
    ignored: tuple[tuple[str, str], ...] = ()


Task = Position | Orientation | CentreOfMass | HalfSpaces | Posture | KeepClear
"""What may stand in a level."""

Target = ArrayLike | None


class Solver:
    """Moves a body in frames of dt seconds so that its tasks are met, level by level, within its joint limits.

    Deterministic: the same calls give the same postures, to the bit, on every machine. It starts at rest.
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
        """levels: the highest first. start: posture (nq,); absent: the file's. max_velocity (rad/s, m/s),
        max_acceleration (per s^2): of all joints, or (nv,). locked: joints that do not move. iterations: in a frame.

        Raises ConfigError: a name that the body does not have, parts far apart that touch at the start, shapes that
        cannot be kept clear. Raises UsageError: what is no level, no limit, no posture.
        """
        self.body = body
        self._tasks = _tasks_of(levels)
        compiled = [[(task, _compiled(task, body)) for task in level] for level in levels]
        start = body.qpos0 if start is None else self._checked_posture(start, "ik.Solver, start")
        clear = [task for task in self._tasks if isinstance(task, KeepClear)]
        observers, fixed = _parts(body, clear[0], start) if clear else (None, None)
        self._solver = _solver.Solver(
            body.solver_body(),
            [[part for _, parts in level for part in parts] for level in compiled],
            lower=body.lower,
            upper=body.upper,
            max_velocity=_limit(body, max_velocity, "max_velocity"),
            max_acceleration=_limit(body, max_acceleration, "max_acceleration"),
            locked=joint_weights(body, [(joint, 1.0) for joint in locked], default=0.0) > 0.0,
            n_ik=_checked_count(iterations),
            damping=DAMPING * iterations,
            observers=observers,
            activation="all",
        )
        self._slices: dict[Task, list[tuple[int, int]]] = {}
        for number, level in enumerate(compiled):
            places = iter(range(self._solver.target_size))
            for task, parts in level:
                self._slices[task] = [self._solver.target_slice(number, next(places)) for _ in parts]
        self._start = start
        if fixed is not None:
            self._solver.set_obstacles(*fixed)
        self.reset(start)

    @property
    def q(self) -> FloatArray:
        """The posture (nq,) reached."""
        return self._solver.q

    @property
    def velocity(self) -> FloatArray:
        """Velocity (nv,) of the last frame, per s."""
        return self._solver.velocity

    @property
    def clearance(self) -> float:
        """Smallest distance of two parts that keep clear, m; infinite where none is within influence."""
        return min(self._solver.clearance)

    def error(self, task: Task) -> float:
        """How far a task is from its target (m, rad; KeepClear: m too near) after the last frame; NaN without one."""
        self._known(task, "ik.Solver.error")
        errors, place = self._solver.task_errors, 0
        for each, slices in self._slices.items():
            if each is task:
                return float(np.max(errors[place : place + len(slices)]))
            place += len(slices)
        return float("nan")

    def position(self, frame: str, point: Vector = ORIGIN) -> FloatArray:
        """Where a point (m) of a frame is in the posture reached: (3,) m, world. Raises ConfigError."""
        link, local = _point(self.body, frame, point)
        return np.asarray(self.body.solver_body().points(self.q[None], [link], np.array([local]))[0, 0])

    @property
    def centre_of_mass(self) -> FloatArray:
        """Where the centre of mass is in the posture reached: (3,) m, world."""
        return np.asarray(self.body.solver_body().centre_of_mass(self.q[None])[0])

    def reset(self, q: ArrayLike) -> None:
        """Stand still in a posture (nq,). Raises UsageError, and then nothing has changed."""
        self._solver.reset(self._checked_posture(q, "ik.Solver.reset"))

    def solve(self, targets: Mapping[Any, ArrayLike], dt: float) -> FloatArray:
        """Move for dt seconds. targets: of tasks; one without is left out in this frame. Returns the posture (nq,).

        Raises UsageError for another task, a target of another shape or one that is not finite; then nothing has moved.
        """
        if not 0.0 < dt < inf:
            raise UsageError("no time", where="ik.Solver.solve, dt", found=repr(dt), allowed="a number above 0, s")
        vector = np.zeros(self._solver.target_size)
        for task in targets:
            self._known(task, "ik.Solver.solve")
        for task, slices in self._slices.items():
            value = self._value(task, targets.get(task))
            if value is not None:
                for begin, end in slices:
                    vector[begin] = 1.0
                    vector[begin + 1 : begin + 1 + value.size] = value
                    vector[begin + 1 + value.size : end] = 0.0
        return self._solver.frame(vector, float(dt))

    def _value(self, task: Task, given: Target) -> FloatArray | None:
        """The numbers of a target, flat; None: the task is left out."""
        where = f"ik.Solver.solve, target of {_said(task)}"
        if isinstance(task, KeepClear):
            if given is not None:
                raise UsageError("a target of a task that takes none", where=where, next_step="Leave it out")
            return np.zeros(0)
        if isinstance(task, Posture):
            return self._start if given is None else self._checked_posture(given, where)
        if given is None:
            return None
        if isinstance(task, HalfSpaces):
            return _half_spaces(task, given, where)
        size = 4 if isinstance(task, Orientation) else 3
        value = _numbers(given, (size,), where)
        if size == 4:
            if not norm(value) > 0.0:
                raise UsageError("no orientation", where=where, found="all zero", allowed="a quaternion wxyz")
            value = value / norm(value)
        return value

    def _checked_posture(self, q: ArrayLike, where: str) -> FloatArray:
        return _numbers(q, (self.body.nq,), where)

    def _known(self, task: object, where: str) -> None:
        if not any(task is known for known in self._tasks):
            raise UsageError(
                "a task that is in none of the levels",
                where=where,
                found=_said(task),
                allowed=", ".join(map(_said, self._tasks)),
                next_step="Keep the task that you put into a level, and name its target by it",
            )


def _tasks_of(levels: Sequence[Sequence[object]]) -> tuple[Task, ...]:
    """All tasks, checked. Raises UsageError."""
    where = "ik.Solver, levels"
    tasks = list[Task]()
    for number, level in enumerate(levels, start=1):
        if not isinstance(level, Sequence):
            raise UsageError("no level", where=where, found=f"{level!r:.60}", allowed="lists of tasks, [[a], [b]]")
        if any(isinstance(task, Posture) for task in level) and (len(level) > 1 or number < len(levels)):
            raise UsageError(
                "a posture is not alone in the last level",
                where=f"{where}, level {number}",
                found=", ".join(map(_said, level)),
                next_step="Put [Posture()] at the end: it takes all freedom that is left",
            )
        for task in level:
            if not isinstance(task, Task):
                allowed = ", ".join(kind.__name__ for kind in Task.__args__)
                raise UsageError("no task", where=f"{where}, level {number}", found=f"{task!r:.60}", allowed=allowed)
            if any(task is other for other in tasks):
                raise UsageError("a task stands in two places", where=f"{where}, level {number}", found=_said(task))
            tasks.append(task)
    if len([task for task in tasks if isinstance(task, KeepClear)]) > 1:
        raise UsageError("KeepClear stands in two places", where=where, allowed="one: it is of the whole body")
    return tuple(tasks)


def _said(task: object) -> str:
    """A task as messages name it."""
    frame = getattr(task, "frame", None)
    name = type(task).__name__
    return name if frame is None else f"{name}({frame!r})"


def _compiled(task: Task, body: BodyModel) -> list[_solver.Task]:
    """A task as the compiled solver has it. Raises ConfigError for an unknown name, UsageError for what cannot be."""
    try:
        return _made(task, body)
    except (TypeError, ValueError, OverflowError) as error:
        raise UsageError("an impossible task", where=f"ik.{_said(task)}", found=str(error)) from error


def _made(task: Task, body: BodyModel) -> list[_solver.Task]:
    match task:
        case Position():
            return [_solver.Task.position(*_point(body, task.frame, task.point), weight=task.weight)]
        case Orientation():
            frame = body.frame(task.frame)
            return [_solver.Task.orientation(frame.body, as_quat(frame.quat), weight=task.weight)]
        case CentreOfMass():
            return [_solver.Task.centre_of_mass(weight=task.weight)]
        case HalfSpaces():
            if task.frame is None:
                return [_solver.Task.support(task.most)]
            return [_solver.Task.lever(*_point(body, task.frame, task.point), max_edges=task.most)]
        case Posture():
            weights = joint_weights(body, task.weights.items(), default=1.0)
            return [_solver.Task.posture(weights, gain=task.gain)]
        case KeepClear():
            return [_solver.Task.reactive(), _solver.Task.preventive(speed=task.speed)]


def _point(body: BodyModel, frame: str, point: Vector) -> tuple[int, Vector]:
    """The link of a frame, and a point of the frame as one of the link, m."""
    found = body.frame(frame)
    return found.body, as_vector(found.position + rotations.rotate(found.quat, np.array(point, dtype=np.float64)))


def _half_spaces(task: HalfSpaces, given: ArrayLike, where: str) -> FloatArray:
    """Half-spaces as the compiled task has them: of the centre of mass (n, d), of a point (0, n, d)."""
    try:
        rows = np.array(given, dtype=np.float64).reshape(-1, 4)
    except (TypeError, ValueError):
        rows = np.full((1, 4), np.nan)
    long = np.sqrt(np.square(rows[:, :3]).sum(axis=1))
    if len(rows) > task.most or not np.isfinite(rows).all() or not (np.abs(long - 1.0) < 1e-6).all():
        allowed = f"up to {task.most} rows (nx, ny, nz, d), n of length 1"
        raise UsageError("no half-spaces", where=where, found=f"{given!r:.80}", allowed=allowed)
    return rows.ravel() if task.frame is None else np.hstack([np.zeros((len(rows), 3)), rows]).ravel()


def _numbers(given: ArrayLike, shape: tuple[int, ...], where: str) -> FloatArray:
    """Finite numbers of a shape. Raises UsageError."""
    try:
        value = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        value = np.zeros(0)
    if value.shape != shape or not np.isfinite(value).all():
        raise UsageError(
            "numbers of a wrong kind", where=where, found=f"{given!r:.80}", allowed=f"{shape[0]} finite numbers"
        )
    return value


def _limit(body: BodyModel, given: ArrayLike, name: str) -> FloatArray:
    """A limit of each DoF (nv,). Raises UsageError."""
    try:
        value = np.array(np.broadcast_to(np.array(given, dtype=np.float64), (body.nv,)))
    except (TypeError, ValueError):
        value = np.zeros(body.nv)
    if not (value > 0.0).all():
        allowed = f"one number above 0, or {body.nv} of them in the order of `body.dof_names`"
        raise UsageError("no limit", where=f"ik.Solver, {name}", found=f"{given!r:.80}", allowed=allowed)
    return value


def _checked_count(given: int) -> int:
    if not (isinstance(given, int) and 1 <= given <= 100):
        raise UsageError("no count", where="ik.Solver, iterations", found=repr(given), allowed="1 to 100")
    return given


# The parts that keep clear: the colliding shapes of the file.


Fixed = tuple[FloatArray, FloatArray]
"""Positions (k, 3) m and orientations (k, 4) wxyz of what the file fixes to the world."""


def _parts(body: BodyModel, task: KeepClear, start: FloatArray) -> tuple[_solver.Observers, Fixed]:
    """What keeps clear, and where the fixed parts are.

    Raises ConfigError: a shape that cannot be kept clear, parts far apart along the body that touch at the start.
    """
    if not 0.0 <= task.margin < task.influence < inf or not 0.0 < task.speed < inf:
        found = f"margin {task.margin}, influence {task.influence}, speed {task.speed}"
        allowed = "0 <= margin < influence, m, and a speed above 0, m/s"
        raise UsageError("no zone", where="ik.KeepClear", found=found, allowed=allowed)
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
            (moving if geom.body else fixed)[name] = Part(geom.body, *row, task.influence, task.margin)
    if problems:
        raise ConfigError.from_problems(problems)
    ignored = tuple((body.body_index(one), body.body_index(other), "as asked") for one, other in task.ignored)
    observers = assemble(body, moving, PairRules(neutral=start, ignored=ignored, where=body.source))
    zone = np.ones(len(fixed))
    scene = SceneShapes(
        names=tuple(fixed),
        kinds=np.array([part.kind for part in fixed.values()], dtype=np.int64),
        sizes=np.array([part.sizes for part in fixed.values()]).reshape(-1, 3),
        influence=task.influence * zone,
        margin=task.margin * zone,
        ground=np.zeros(len(fixed), dtype=bool),
    )
    places = np.array([part.position for part in fixed.values()]).reshape(-1, 3)
    turns = np.array([part.quat for part in fixed.values()]).reshape(-1, 4)
    looks = _looks(body, observers, scene, (places, turns), start)
    return observers.for_solver(body, scene, looks=looks), (places, turns)


def _looks(
    body: BodyModel, observers: Observers, scene: SceneShapes, fixed: Fixed, start: FloatArray
) -> NDArray[np.bool_]:
    """Which parts (n, k) keep clear of which fixed ones: not neighbours of the world, nor what touches at the start."""
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
