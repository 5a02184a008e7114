"""Crouch envelope: how low a robot on both soles can crouch, and how far it can lean at each height.

Most servo humanoids do not fold at the hips as a human does, so pelvis and trunk are limited to what the robot can
hold. The solver measures heights of an upright trunk with observers, and leans without them, as their clearance depends
on the place of the pelvis.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from retarget._solver import Observers, Solver, Task
from retarget.arithmetic import arctan2, hypot
from retarget.ik.support_polygon import Stance, half_spaces, plant
from retarget.model.body import Frame, JointLimits
from retarget.model.observers import robot_observers
from retarget.model.robot import TRUNK, RobotBody
from retarget.rotations import NO_TURN, Quat, as_quat, as_vector, product, rotated, turn
from retarget.types import MM, FloatArray

ENVELOPE_HEIGHTS = 9
"""Number of pelvis heights at which the lean is measured."""
AHEAD = (1.0, 0.0)
DIRECTIONS = (AHEAD, (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Forward, left, back, right."""
STEP_M, LAST_STEP_M, STEP_RAD = 0.005, 0.001, 0.05
"""Steps of the search, m and rad: smaller ones at last, as a millimetre of a nearly straight leg is 8 degrees of its
knee."""
MISSED_M, MISSED_RAD = 0.001, 0.02
"""Errors of a posture out of reach."""
FARTHEST_M, FARTHEST_RAD = 1.0, 1.4
"""Greatest change of height and lean."""
END_SHARE = 0.05
"""Share of crouch and lean that is left out for braking."""
LEAST_CROUCH_M, NOTED_SHARE = 0.01, 2.0 / 3.0
"""Least crouch, and share of the joints' crouch below which there is a note."""
CROUCH_ITERATIONS = 8
"""Iterations of the solver per step."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """heights (h,): of the pelvis over the soles, m, rising. lean (h, 4): greatest, forward, left, back, right, rad.
    note: for the operator."""

    heights: FloatArray
    lean: FloatArray
    note: str = ""

    @property
    def lowest(self) -> float:
        """Lowest height of the pelvis, m."""
        return float(self.heights[0])

    @property
    def highest(self) -> float:
        """Greatest height of the pelvis, m."""
        return float(self.heights[-1])

    def most_lean(self, height: float, x: float, y: float) -> float:
        """Greatest lean, rad, in the ground direction (x, y) at a height, m."""
        return _towards(self._leans(height), x, y)

    def highest_for(self, lean: float, x: float, y: float) -> float:
        """Greatest height, m, that allows a lean, rad, in a ground direction, as straight legs cannot tilt hips
        sideways; if none does, that of most lean."""
        if _towards(self._nodes[-1], x, y) >= lean:
            return self.highest
        heights: list[float] = self.heights.tolist()
        leans = [_towards(node, x, y) for node in self._nodes]
        allowed, above = min(lean, max(leans)), len(heights) - 1
        while leans[above] < allowed:
            above -= 1
        if above == len(heights) - 1:
            return heights[above]
        share = (leans[above] - allowed) / (leans[above] - leans[above + 1])
        return heights[above] + share * (heights[above + 1] - heights[above])

    @cached_property
    def _nodes(self) -> list[list[float]]:
        return [self._leans(height) for height in self.heights.tolist()]

    def _leans(self, height: float) -> list[float]:
        span = self.highest - self.lowest
        share = (height - self.lowest) / span if span > 0.0 else 0.0  # a robot may not crouch at all
        place = min(max(share, 0.0), 1.0) * (len(self.heights) - 1)
        below = min(int(place), len(self.heights) - 2)
        share = place - below
        rows = self.lean[below].tolist(), self.lean[below + 1].tolist()
        return [(1.0 - share) * low + share * high for low, high in zip(*rows, strict=True)]


def _towards(leans: list[float], x: float, y: float) -> float:
    a, b = leans[0 if x >= 0.0 else 2], leans[1 if y >= 0.0 else 3]
    length = hypot(x, y)
    return a * b * length / max(hypot(b * x, a * y), 1e-12)


def robot_envelope(robot: RobotBody, limits: JointLimits, *, edges: FloatArray, margin: float | None) -> Envelope:
    """Envelope of a robot in `stand` with clearances `margin`, m, measured once for all robots of the same content."""
    joints = [(float(low), float(high)) for low, high in zip(limits.lower, limits.upper, strict=True)]
    return _measured(_Same(robot.content, robot), tuple(joints), tuple(map(tuple, edges.tolist())), margin)


@dataclass(frozen=True)
class _Same:
    content: bytes
    robot: RobotBody = field(compare=False)


@lru_cache(maxsize=32)
def _measured(
    same: _Same,
    joints: tuple[tuple[float, float], ...],
    edges: tuple[tuple[float, ...], ...],
    margin: float | None,
) -> Envelope:
    robot, (lower, upper) = same.robot, np.array(joints).T.copy()
    free = np.full_like(lower, np.inf)
    observers = robot_observers(robot).with_margin(margin).for_solver(robot.body)
    stance = plant(robot, robot.profile.postures.stand)
    limits = JointLimits(lower, upper, free, free)
    return measure_envelope(robot, limits, stance, edges=np.array(edges), observers=observers)


def measure_envelope(
    robot: RobotBody, limits: JointLimits, stance: Stance, *, edges: FloatArray, observers: Observers | None = None
) -> Envelope:
    """Measure the envelope of a robot with planted soles. edges (e, 3): for the centre of mass."""
    clear, probe = _Probe(robot, limits, stance, edges, observers), _Probe(robot, limits, stance, edges)
    postures = clear.upright(-1.0) | clear.upright(1.0)
    bottom, top = min(postures), max(postures)
    heights = np.linspace(bottom + END_SHARE * (top - bottom), top, ENVELOPE_HEIGHTS)
    lean = np.array([probe.leans(float(height), postures) for height in heights])
    possible = postures if observers is None else probe.upright(-1.0)
    note = _note(probe.standing - bottom, probe.standing - min(possible))
    return Envelope(heights, np.maximum((1.0 - END_SHARE) * lean, 1e-3), note)


def _note(depth: float, most: float) -> str:
    if depth >= max(NOTED_SHARE * most, LEAST_CROUCH_M):
        return ""
    if most < LEAST_CROUCH_M:
        return "the robot cannot crouch: its joints, soles or balance do not let the pelvis down from posture stand"
    crouches = "cannot crouch" if depth < LEAST_CROUCH_M else f"crouches only {MM * depth:.0f} mm"
    return (
        f"the robot {crouches}, though its joints allow {MM * most:.0f} mm: its links would come nearer to each other "
        "than the margins of its observers"
    )


class _Probe:
    """A solver without rates. standing: height of the pelvis in the stance, m."""

    def __init__(
        self,
        robot: RobotBody,
        limits: JointLimits,
        stance: Stance,
        edges: FloatArray,
        observers: Observers | None = None,
    ) -> None:
        body, start, soles = robot.body, stance.q, [sole.frame for sole in stance.soles]
        pelvis, trunk = robot.frame(robot.profile.landmarks["pelvis"].frame), robot.frame(TRUNK)
        self._kinematics, self._start, self._pelvis, self._trunk = robot.kinematics, start, pelvis, trunk
        planted = []
        for sole in soles:
            planted += [
                Task.position(sole.body, as_vector(sole.position)),
                Task.orientation(sole.body, as_quat(sole.quat)),
            ]
        clearances = [] if observers is None else [Task.reactive(against="self"), Task.preventive(against="self")]
        levels = [
            clearances,
            planted,
            [Task.support(len(edges))],
            [Task.position(pelvis.body, as_vector(pelvis.position), weight=(0.0, 0.0, 1.0))],
            [Task.orientation(trunk.body, as_quat(trunk.quat))],
            [Task.posture(np.r_[np.zeros(6), np.ones(body.nv - 6)], gain=0.02)],
        ]
        free = np.full(body.nv, np.inf)
        self._solver = Solver(
            self._kinematics,
            levels,
            lower=limits.lower,
            upper=limits.upper,
            max_velocity=free,
            max_acceleration=free,
            locked=np.zeros(body.nv, dtype=bool),
            n_ik=CROUCH_ITERATIONS,
            observers=observers,
            activation="all",
        )
        self._kept = len(clearances) + len(planted) + 1  # and balance
        self._targets = np.zeros(self._solver.target_size)
        for index, sole in enumerate(soles):
            self._set(1, 2 * index, self._point(start, sole))
            self._set(1, 2 * index + 1, self._orientation(start, sole))
        for index in range(len(clearances)):
            self._set(0, index, ())
        self._set(2, 0, half_spaces(edges).ravel())
        self._set(5, 0, start)
        self.standing = float(self._point(start, pelvis)[2])

    def upright(self, sign: float) -> dict[float, FloatArray]:
        """Postures (nq,) by height, m, up (sign 1) or down (-1) from the stance without leaning back. Each starts from
        the one before, as large steps may end in another branch."""
        height, reached = self.standing, {self.standing: self._start}
        for step in (STEP_M, LAST_STEP_M):
            self._solver.reset(reached[height])
            while abs(height - self.standing) < FARTHEST_M:
                tried = height + sign * step
                missed = abs(self._go(tried, NO_TURN) - tried)
                if not (missed <= MISSED_M and self._leaned(AHEAD) >= -MISSED_RAD):
                    break
                height, reached[tried] = tried, self._solver.q
        return reached

    def leans(self, height: float, postures: dict[float, FloatArray]) -> list[float]:
        """Greatest leans, rad, in DIRECTIONS at a height, m."""
        self._solver.reset(postures[min(postures, key=lambda near: abs(near - height))])
        self._go(height, NO_TURN)
        upright = self._solver.q
        found = []
        for direction in DIRECTIONS:
            self._solver.reset(upright)
            x, y = direction
            reached = 0.0
            for tried in np.arange(STEP_RAD, FARTHEST_RAD, STEP_RAD).tolist():
                now = self._go(height, turn((-y * tried, x * tried, 0.0)))
                lean = self._leaned(direction)
                if not (abs(lean - tried) <= MISSED_RAD and abs(now - height) <= MISSED_M):
                    break
                reached = lean
            found.append(reached)
        return found

    def _go(self, height: float, trunk: Quat) -> float:
        """Actual height after a move to a height, m, and a trunk; NaN if soles or balance are lost."""
        self._set(3, 0, (0.0, 0.0, height))
        self._set(4, 0, trunk)
        q = self._solver.frame(self._targets, 1.0)
        lost = float(self._solver.task_errors[: self._kept].max()) > MISSED_M
        return float("nan") if lost else float(self._point(q, self._pelvis)[2])

    def _leaned(self, direction: tuple[float, float]) -> float:
        """Lean, rad, of the trunk in the plane of a direction and the vertical."""
        up = rotated(self._orientation(self._solver.q, self._trunk), (0.0, 0.0, 1.0))
        return arctan2(direction[0] * up[0] + direction[1] * up[1], up[2])

    def _set(self, level: int, task: int, target: FloatArray | tuple[float, ...]) -> None:
        start, stop = self._solver.target_slice(level, task)
        self._targets[start] = 1.0
        self._targets[start + 1 : stop] = target

    def _point(self, q: FloatArray, frame: Frame) -> FloatArray:
        return np.asarray(self._kinematics.points(q[None], [frame.body], frame.position[None])[0, 0])

    def _orientation(self, q: FloatArray, frame: Frame) -> Quat:
        return product(as_quat(self._kinematics.orientations(q[None], [frame.body])[0, 0]), as_quat(frame.quat))
