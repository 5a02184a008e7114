"""Paths of a walking robot: postures of root and legs for a pattern, tick by tick, until it stands on both feet.

Soles come first, then the centre of mass, then a pelvis that is upright; within the limits of the servos. Joints that
carry nothing stay as they were when the path was begun: where they go meanwhile moves the zero-moment point by as much
as the mass, and the next step has them where they are then.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retarget._solver import Solver, Task
from retarget.arithmetic import norm
from retarget.ik.support_polygon import Stance
from retarget.model.body import JointLimits
from retarget.model.robot import RobotBody
from retarget.robot.walking.pattern import Foothold, Gait, PatternState, Request, Step, minimum_jerk
from retarget.rotations import Quat, as_quat, as_vector, inverse, product, rotated, rotation_vector, turn
from retarget.types import BoolArray, FloatArray

ROOT = 1
"""The link that the legs hang from."""


@dataclass(frozen=True, eq=False)
class WalkPath:
    """postures (k, nq), m, wxyz and rad, world, tick by tick: first the one from which it goes on, last the robot
    stands. carries (k, 2): which soles do, left and right. yaws (k,): of the trunk, rad. feet: where both soles are at
    its end. step: the last one that was asked for, which ends with row `branch`, from where another path may go on;
    None: none was. speed: of that step. since: the row of the path before from which it goes on."""

    postures: FloatArray
    carries: BoolArray
    yaws: FloatArray
    feet: tuple[Foothold, Foothold]
    step: Step | None
    speed: Request
    branch: int
    since: int


@dataclass(frozen=True, eq=False)
class Sketch:
    """A path in the making. moments: of its rows but the first. velocity (nv,): in the first row. offset (3,) m, turned
    (3,) rad: of centre of mass and root from the pattern there, which fade within `ease` ticks. asked: step, speed,
    branch and since of the path."""

    postures: list[FloatArray]
    velocity: FloatArray
    moments: Sequence[PatternState]
    offset: FloatArray
    turned: FloatArray
    ease: int
    asked: tuple[Step | None, Request, int, int]

    @property
    def since(self) -> int:
        """The row of the path before from which it goes on."""
        return self.asked[-1]


class PathPlanner:
    """Makes the paths of one robot, a few postures in each tick."""

    def __init__(self, robot: RobotBody, stance: Stance, limits: JointLimits, carrying: BoolArray, gait: Gait) -> None:
        """limits (nv,): which postures keep. carrying (nv,): root and joints of the legs."""
        self._body, self._gait = robot.body.solver_body(), gait
        self._soles = stance.soles
        upright = self._body.orientations(stance.q[None], [ROOT])[0, 0]
        self._upright = as_quat(upright)
        self._middles = [sole.outline.mean(axis=0) - sole.position[:2] for sole in stance.soles]
        frames = [sole.frame for sole in stance.soles]
        soles = [Task.position(frame.body, as_vector(frame.position)) for frame in frames]
        soles += [Task.orientation(frame.body, as_quat(frame.quat)) for frame in frames]
        self._solver = Solver(
            self._body,
            [soles, [Task.centre_of_mass(weight=(1.0, 1.0, 1.0))], [Task.orientation(ROOT)]],
            lower=limits.lower,
            upper=limits.upper,
            max_velocity=limits.max_velocity,
            max_acceleration=limits.max_acceleration,
            locked=~carrying,
            n_ik=2,
            damping=0.0,
        )
        self._targets = np.zeros(self._solver.target_size)
        self._places = [slice(*self._solver.target_slice(0, k)) for k in range(4)]
        self._mass, self._root = slice(*self._solver.target_slice(1, 0)), slice(*self._solver.target_slice(2, 0))

    def sketch(
        self,
        q: FloatArray,
        velocity: FloatArray,
        start: PatternState,
        moments: Sequence[PatternState],
        ease: int,
        asked: tuple[Step | None, Request, int, int],
    ) -> Sketch:
        """Begin a path in posture q (nq,), moving at velocity (nv,), through moments, tick by tick. start: the pattern
        there. ease: ticks in which what q is off the pattern fades. asked: see `Sketch`."""
        return Sketch([q], velocity, moments, *self._offsets(q, start), ease, asked)

    def off(self, q: FloatArray, start: PatternState) -> tuple[float, float]:
        """How far (m, rad) a posture (nq,) is off the pattern."""
        offset, turned = self._offsets(q, start)
        return norm(offset), norm(turned)

    def velocity(self, before: FloatArray, now: FloatArray) -> FloatArray:
        """Velocity (nv,) from one posture (nq,) to the next, a tick later."""
        return self._body.difference(before, now) / self._gait.dt

    def _offsets(self, q: FloatArray, start: PatternState) -> tuple[FloatArray, FloatArray]:
        """Offset (3,) m of the centre of mass, and turn (3,) rad of the root, from the pattern."""
        mass = self._body.centre_of_mass(q[None])[0]
        root = as_quat(self._body.orientations(q[None], [ROOT])[0, 0])
        turned = rotation_vector(product(root, inverse(self._pelvis(start.yaw))))
        return mass - np.array([*start.pendulum.mass, self._gait.height]), np.array(turned)

    def advance(self, sketch: Sketch, rows: int) -> bool:
        """Make so many more rows of a path; whether it is whole."""
        solver, done = self._solver, len(sketch.postures) - 1
        if not done:
            solver.reset(sketch.postures[0], sketch.velocity)
        for row in range(done, min(done + rows, len(sketch.moments))):
            moment = sketch.moments[row]
            left = 1.0 - minimum_jerk((row + 1) / sketch.ease)
            self._aim(moment, left * sketch.offset, left * sketch.turned)
            sketch.postures.append(solver.frame(self._targets, self._gait.dt, 1.0))
        return len(sketch.postures) > len(sketch.moments)

    def whole(self, sketch: Sketch) -> WalkPath:
        """The path of a sketch that is whole."""
        moments = [sketch.moments[0], *sketch.moments]
        carries = np.array([moment.carries for moment in moments])
        yaws = np.array([moment.yaw for moment in moments])
        left, right = (Foothold(sole.place[:2], sole.yaw) for sole in moments[-1].soles)
        postures = np.array(sketch.postures)
        return WalkPath(postures, carries, yaws, (left, right), *sketch.asked)

    def _aim(self, moment: PatternState, offset: FloatArray, turned: FloatArray) -> None:
        """Write the targets of a row."""
        targets = self._targets
        for k, (sole, middle, pose) in enumerate(zip(self._soles, self._middles, moment.soles, strict=True)):
            about = turn((0.0, 0.0, pose.yaw))
            place = pose.place - np.array(rotated(about, (float(middle[0]), float(middle[1]), 0.0)))
            targets[self._places[k]] = (1.0, *place)
            targets[self._places[2 + k]] = (1.0, *product(about, as_quat(sole.orientation)))
        targets[self._mass] = (1.0, *(np.array([*moment.pendulum.mass, self._gait.height]) + offset))
        targets[self._root] = (1.0, *product(turn(as_vector(turned)), self._pelvis(moment.yaw)))

    def _pelvis(self, yaw: float) -> Quat:
        """Orientation wxyz of an upright pelvis at a yaw, rad."""
        return product(turn((0.0, 0.0, yaw)), self._upright)
