"""Crouch envelope: how low a robot on both soles can crouch, and how far it can lean at each height.

A human folds at the hips to the knees; most servo humanoids do not. What is asked of the robot stays inside this
envelope, so that the landmarks above the hips are asked from a trunk that the robot can hold. It depends on the robot
alone: body, joint limits, observers, soles and stance. It is measured once for each robot, by the solver itself.

The heights are those that the robot reaches upright without touching itself. How far it leans at each is measured
without its observers: which lean they leave depends on whether the pelvis is ahead of the feet or behind them, and a
lean that is asked too far costs no more than that lean.
"""

from collections.abc import Iterable
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

HEIGHTS = 9
"""Pelvis heights at which the lean is measured."""
FORWARD = (1.0, 0.0)
DIRECTIONS = (FORWARD, (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Forward, left, back, right."""
STEP_M, LAST_STEP_M, STEP_RAD = 0.005, 0.001, 0.05
"""Height and lean are searched in small steps, so that every posture is found from one close by; the last heights in
smaller ones, as a millimetre of a leg that is nearly straight is 8 degrees of its knee."""
MISSED_M, MISSED_RAD = 0.001, 0.02
"""Errors from which on the robot counts as unable to get where it is asked."""
FARTHEST_M, FARTHEST_RAD = 1.0, 1.4
"""Heights over or under the standing posture, and leans, beyond which nothing is tried."""
SPARE = 0.05
"""Share of the crouch and of the lean that is not asked for: at its very end a leg has no room to brake."""
LEAST_CROUCH_M, LEAST_SHARE = 0.01, 2.0 / 3.0
"""A crouch of less is none; one of a smaller share of what the joints allow is worth a note."""
ITERATIONS = 8
"""Most iterations of the solver, per step."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """heights (h,) m of the pelvis frame over the soles, rising; lean (h, 4) rad: most forward, left, back, right.
    note: a sentence for the operator where the robot crouches little, else ""."""

    heights: FloatArray
    lean: FloatArray
    note: str = ""

    @property
    def lowest(self) -> float:
        """Lowest height (m) of the pelvis."""
        return float(self.heights[0])

    @property
    def highest(self) -> float:
        """Greatest height (m) of the pelvis."""
        return float(self.heights[-1])

    def most_lean(self, height: float, x: float, y: float) -> float:
        """Most lean (rad) towards the ground direction (x, y) with the pelvis at `height` m; quarters of ellipses."""
        return _towards(self._leans(height), x, y)

    def highest_for(self, lean: float, x: float, y: float) -> float:
        """The greatest height (m) of the pelvis at which the robot leans by `lean` rad towards the ground direction
        (x, y): straight legs cannot tilt hips sideways. Where none suffices, the greatest of those with most lean."""
        if _towards(self._nodes[-1], x, y) >= lean:
            return self.highest
        heights: list[float] = self.heights.tolist()
        leans = [_towards(node, x, y) for node in self._nodes]
        asked, above = min(lean, max(leans)), len(heights) - 1
        while leans[above] < asked:
            above -= 1
        if above == len(heights) - 1:
            return heights[above]
        # Between a height that suffices and the next one, which does not.
        share = (leans[above] - asked) / (leans[above] - leans[above + 1])
        return heights[above] + share * (heights[above + 1] - heights[above])

    @cached_property
    def _nodes(self) -> list[list[float]]:
        """Most lean (rad) forward, left, back and right at each of the heights."""
        return [self._leans(height) for height in self.heights.tolist()]

    def below(self, top: float) -> "Envelope":
        """The part of it with the pelvis no higher than `top` m, where any is left."""
        heights = np.linspace(self.lowest, min(max(top, float(self.heights[1])), self.highest), HEIGHTS)
        return Envelope(heights, np.array([self._leans(height) for height in heights.tolist()]), self.note)

    def _leans(self, height: float) -> list[float]:
        """Most lean (rad) forward, left, back and right at a height (m), between those of the two heights around it."""
        span = self.highest - self.lowest
        share = (height - self.lowest) / span if span > 0.0 else 0.0  # some robots cannot crouch at all
        place = min(max(share, 0.0), 1.0) * (len(self.heights) - 1)
        below = min(int(place), len(self.heights) - 2)
        share = place - below
        rows = self.lean[below].tolist(), self.lean[below + 1].tolist()
        return [(1.0 - share) * low + share * high for low, high in zip(*rows, strict=True)]


def _towards(leans: list[float], x: float, y: float) -> float:
    """Most lean (rad) towards the ground direction (x, y), of the most forward, left, back and right."""
    a, b = leans[0 if x >= 0.0 else 2], leans[1 if y >= 0.0 else 3]
    # Radius of the ellipse with half axes a (along) and b (across) in direction (x, y): a b / |(b x, a y)|, with
    # |(x, y)| = 1.
    length = hypot(x, y)
    return a * b * length / max(hypot(b * x, a * y), 1e-12)


def robot_envelope(robot: RobotBody, limits: JointLimits, *, edges: FloatArray, margin: float | None) -> Envelope:
    """The envelope of a robot in posture `stand`, its limbs apart by `margin` m; measured once for
    all robots of the same content.

    limits, edges: of `measure_envelope`.
    """
    joints = [(float(low), float(high)) for low, high in zip(limits.lower, limits.upper, strict=True)]
    return _measured(_Same(robot.content, robot), tuple(joints), tuple(map(tuple, edges.tolist())), margin)


@dataclass(frozen=True)
class _Same:
    """A robot, equal to any other of its content."""

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
    apart = robot_observers(robot).with_margin(margin).for_solver(robot.body)
    stance = plant(robot, robot.profile.postures.stand)
    return measure_envelope(
        robot, JointLimits(lower, upper, free, free), stance, edges=np.array(edges), observers=apart
    )


def measure_envelope(
    robot: RobotBody, limits: JointLimits, stance: Stance, *, edges: FloatArray, observers: Observers | None = None
) -> Envelope:
    """Let a robot crouch and lean with its trunk as far as it goes, from its stance, with planted soles; m and rad.

    limits (nv,): of its body. The centre of mass stays inside `edges` (e, 3). The height is its landmark `pelvis`'.
    """
    apart, probe = _Probe(robot, limits, stance, edges, observers), _Probe(robot, limits, stance, edges)
    postures = apart.upright(-1.0) | apart.upright(1.0)
    bottom, top = min(postures), max(postures)
    heights = np.linspace(bottom + SPARE * (top - bottom), top, HEIGHTS)
    lean = np.array([probe.leans(float(height), postures) for height in heights])
    possible = postures if observers is None else probe.upright(-1.0)
    return Envelope(heights, np.maximum((1.0 - SPARE) * lean, 1e-3), _note(probe.standing - bottom, probe, possible))


def _note(depth: float, probe: "_Probe", possible: Iterable[float]) -> str:
    """What to say of a crouch `depth` m deep. possible: heights (m) that the robot reaches without observers."""
    most = probe.standing - min(possible)
    if depth >= max(LEAST_SHARE * most, LEAST_CROUCH_M):
        return ""
    if most < LEAST_CROUCH_M:
        return "the robot cannot crouch: its joints, soles or balance do not let the pelvis down from posture stand"
    crouches = "cannot crouch" if depth < LEAST_CROUCH_M else f"crouches only {MM * depth:.0f} mm"
    return (
        f"the robot {crouches}, though its joints allow {MM * most:.0f} mm: its links would come nearer to each other "
        "than the margins of its observers"
    )


class _Probe:
    """A solver without rates: limbs apart, soles, balance, the height of the pelvis, the trunk, in this order.
    standing: height of the pelvis in the stance, m."""

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
        apart = [] if observers is None else [Task.reactive(against="self"), Task.preventive(against="self")]
        levels = [
            apart,
            planted,
            [Task.support(len(edges))],
            [Task.position(pelvis.body, as_vector(pelvis.position), weight=(0.0, 0.0, 1.0))],
            [Task.orientation(trunk.body, as_quat(trunk.quat))],
            [Task.posture(np.r_[np.zeros(6), np.ones(body.nv - 6)], gain=0.02)],
        ]
        # Without rates: how far it can go counts, not how fast.
        free = np.full(body.nv, np.inf)
        self._solver = Solver(
            self._kinematics,
            levels,
            lower=limits.lower,
            upper=limits.upper,
            max_velocity=free,
            max_acceleration=free,
            locked=np.zeros(body.nv, dtype=bool),
            n_ik=ITERATIONS,
            observers=observers,
            activation="all",
        )
        self._kept = len(apart) + len(planted) + 1  # and balance
        self._targets = np.zeros(self._solver.target_size)
        for index, sole in enumerate(soles):
            self._set(1, 2 * index, self._point(start, sole))
            self._set(1, 2 * index + 1, self._orientation(start, sole))
        for index in range(len(apart)):
            self._set(0, index, ())
        self._set(2, 0, half_spaces(edges).ravel())
        self._set(5, 0, start)
        self.standing = float(self._point(start, pelvis)[2])

    def upright(self, sign: float) -> dict[float, FloatArray]:
        """Postures (nq,) by height (m), from the standing one up (sign 1) or down (-1), each a step from the one
        before: as far as the robot gets without leaning back."""
        height, reached = self.standing, {self.standing: self._start}
        # Continuation: small steps, each from the posture before, since one large step may end in another branch.
        for step in (STEP_M, LAST_STEP_M):
            self._solver.reset(reached[height])
            while abs(height - self.standing) < FARTHEST_M:
                asked = height + sign * step
                missed = abs(self._go(asked, NO_TURN) - asked)
                if not (missed <= MISSED_M and self._leaned(FORWARD) >= -MISSED_RAD):
                    break
                height, reached[asked] = asked, self._solver.q
        return reached

    def leans(self, height: float, postures: dict[float, FloatArray]) -> list[float]:
        """Lean (rad) reached towards each of DIRECTIONS with the pelvis at `height` m, from the upright posture (nq,)
        nearest to it by height."""
        self._solver.reset(postures[min(postures, key=lambda near: abs(near - height))])
        self._go(height, NO_TURN)
        upright = self._solver.q
        return [self._lean(upright, height, direction) for direction in DIRECTIONS]

    def _lean(self, upright: FloatArray, height: float, direction: tuple[float, float]) -> float:
        """Lean (rad) reached towards a direction from the posture `upright` (nq,), with the pelvis at `height` m."""
        self._solver.reset(upright)
        x, y = direction
        reached = 0.0
        for asked in np.arange(STEP_RAD, FARTHEST_RAD, STEP_RAD).tolist():
            now = self._go(height, turn((-y * asked, x * asked, 0.0)))
            lean = self._leaned(direction)
            if not (abs(lean - asked) <= MISSED_RAD and abs(now - height) <= MISSED_M):
                break
            reached = lean
        return reached

    def _go(self, height: float, trunk: Quat) -> float:
        """Go on to a height (m) and a trunk. Returns the height reached; NaN where soles or balance are lost."""
        self._set(3, 0, (0.0, 0.0, height))
        self._set(4, 0, trunk)
        q = self._solver.frame(self._targets, 1.0)
        lost = float(self._solver.task_errors[: self._kept].max()) > MISSED_M
        return float("nan") if lost else float(self._point(q, self._pelvis)[2])

    def _leaned(self, direction: tuple[float, float]) -> float:
        """Lean (rad) of the trunk towards a direction: of its upward axis, in the plane of that and the vertical."""
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
